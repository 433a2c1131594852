"""Cells of several `landing fly` runs in one table, each with its pairs against the run's first pad and regressor.

Called as landing_cells.py CSV RUN ...; each RUN is a folder WORKSPACE/eval/landing/NAME.
"""

import json
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from tables import write_table

from toolkit.core.files import sha256_file
from toolkit.rooms.landing.fly import FlightCell


def read_cells(run: Path) -> list[dict[str, Any]]:
    """The rows of a run, as the table has them."""
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    settings, cells = summary["settings"], summary["cells"]
    keys = {_key(one): one for one in cells}
    pairs = {(pair["cell"], pair["against"]): pair for pair in summary["pairs"]}
    rows = []
    for key, one in keys.items():
        first = _key(one | {"pad": cells[0]["pad"], "regressor": cells[0]["regressor"]})
        pair = pairs.get((key, first), {})
        low, high = one["success_ci95"]
        file = run.parents[2] / "rig" / "regressors" / f"{one['regressor']}.safetensors"
        rows.append(
            {"world": one["world"], "world_seed": settings["world_seed"], "time": settings["time"]}
            | {name: one[name] for name in ("weather", "severity", "pad", "regressor")}
            | {"sha256": sha256_file(file)[:16] if file.is_file() else "", "gains": one["gains"]}
            | {"seed": summary["seed"], "places": len(summary["places"]), "n": one["n"]}
            | {"success": one["success"], "low": low, "high": high}
            | {name: one[name] for name in ("missed", "crashed", "lost", "timed_out", "diverged", "median_error_m")}
            | {name: pair.get(name, "") for name in ("gained", "lost_pairs", "mcnemar_p")}
            | ({"lost_pairs": pair["lost"], "mcnemar_p": float(f"{pair['mcnemar_p']:.2g}")} if pair else {})
        )
    return rows


def _key(cell: dict[str, Any]) -> str:
    return FlightCell(**{one.name: cell[one.name] for one in fields(FlightCell)}).key


def main(table: str, *runs: str) -> None:
    """Write the table."""
    write_table(Path(table), [row for run in runs for row in read_cells(Path(run).resolve())])


if __name__ == "__main__":
    main(*sys.argv[1:])
