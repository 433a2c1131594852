"""What several networks say of one set of boosters, clear and corrupted, in one table: transfer_cells.py CSV WORKSPACE.

Each run in WORKSPACE/eval is of one network: `toolkit eval captures --corrupt common` of the plan, bare and boosted.
"""

import csv
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from toolkit.captures.read import UNPATCHED
from toolkit.core.severities import SEVERITIES
from toolkit.core.statistics import wilson_interval
from toolkit.corruptions.catalogue import COMMON
from toolkit.transfer.matrix import BOOSTED

CLEAR, ALL = "sim", "15 corruptions"
COUNTS = ("n", "bare", "boosted", "gained", "lost")


def read_run(summary: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows of a run: each object and all of them in clear air and in fog 3, and over the 75 corruptions at once."""
    model, seen = summary["model"], {one["object"]: one["seen"] for one in summary["boosters"]}
    bare = {(one["source"], one["object"]): one for one in summary["groups"] if one["variant"] == UNPATCHED}
    shown = {(one["source"], one["object"], one["variant"]): one for one in summary["groups"]}
    pooled: dict[tuple[str, str], dict[str, int]] = defaultdict(lambda: dict.fromkeys(COUNTS, 0))
    cells: set[str] = set()
    head = {"network": model["name"], "sha256": model["sha256"][:16], "seen": any(seen.values())}
    for pair in summary["pairs"]:
        source, name, variant = pair["source"], pair["object"], pair["variant"]
        if variant not in BOOSTED:
            continue
        first, second = bare[source, name], shown[source, name, variant]
        counts = {
            "n": pair["n_pairs"], "bare": round(first["top1"] * first["n"]),
            "boosted": round(second["top1"] * second["n"]), "gained": pair["gained"], "lost": pair["lost"],
        }  # fmt: skip
        kind = BOOSTED[variant]
        if source in (CLEAR, f"{CLEAR}-fog-3"):
            air = "clear" if source == CLEAR else "fog 3"
            yield (
                head | {"booster": kind, "air": air, "object": name} | counts | {"p": float(f"{pair['mcnemar_p']:.2g}")}
            )
        if source.removeprefix(f"{CLEAR}-").rpartition("-")[0] in COMMON:
            cells.add(source)
            for key in COUNTS:
                pooled[name, kind][key] += counts[key]
    for (name, kind), counts in pooled.items() if len(cells) == len(COMMON) * len(SEVERITIES) else ():
        yield head | {"booster": kind, "air": ALL, "object": name} | counts | {"p": ""}


def main(table: str, workspace: str) -> None:
    """Write the table."""
    files = sorted((Path(workspace) / "eval").glob("*/summary.json"))
    found = [row for file in files for row in read_run(json.loads(file.read_text(encoding="utf-8")))]
    # a pose that two runs asked the same network about has the same answer
    rows = list({tuple(row[key] for key in ("network", "booster", "air", "object")): row for row in found}.values())
    rows.sort(key=lambda row: (not row["seen"], row["network"], row["air"] == ALL, row["air"]))
    for row in rows:
        row["low"], row["high"] = (round(float(end), 4) for end in wilson_interval(row["boosted"], row["n"]))
    with Path(table).open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
