"""Write the predictions of several networks for sets of boosters, clear and corrupted, into one table.

Called as transfer_cells.py CSV SET=WORKSPACE … MATRIX …: each run in WORKSPACE/eval is of one network, by
`toolkit eval captures --corrupt common` of the plan, bare and boosted; of a detector, the images in which it finds the
object count. Each MATRIX is a `matrix.json` of
`toolkit transfer`, whose sets are called `without NETWORK`, and `without NETWORK, painted freely` where textures were
trained without `--max-change`. A set's patches, textures or wraps of which no source has any stay in the CSV.
"""

import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tables import BOOSTERS, Row, list_changes, read_others, read_summaries, write_table

from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import open_workspace
from toolkit.corruptions.catalogue import COMMON, SEVERITIES
from toolkit.rooms.benchmarks.transfer.leave_one_out import JudgedRow

AIRS, ALL = {"sim": "clear", "sim-fog-3": "fog 3"}, "15 corruptions"
COUNTS = ("n", "bare", "boosted", "gained", "lost")
FREELY = ", painted freely"
KEY = ("set", "network", "booster", "air", "object")


def read_run(run: str, summary: dict[str, Any]) -> Iterator[Row]:
    """Return the rows of a run: each object and all, in clear conditions, in fog 3 and over all 75 corruptions."""
    model, seen = summary["model"], {one["variant"] for one in summary["boosters"] if one["seen"]}
    pooled: dict[tuple[str, str], Row] = defaultdict(lambda: dict.fromkeys(COUNTS, 0))
    cells: set[str] = set()
    head = {"network": model["name"], "sha256": model["sha256"][:16]}
    for row in list_found(summary) if "detections_sha256" in summary else list_changes(run, summary):
        source, name, variant = row["source"], row["object"], row["variant"]
        if variant not in BOOSTERS:
            continue
        counts = {key: row[key] for key in COUNTS}
        if source in AIRS:
            what = {"seen": variant in seen, "booster": BOOSTERS[variant], "air": AIRS[source], "object": name}
            yield head | what | counts | {"p": row["p"]}
        if source.removeprefix("sim-").rpartition("-")[0] in COMMON:
            cells.add(source)
            for key in COUNTS:
                pooled[name, variant][key] += counts[key]
    if len(cells) == len(COMMON) * len(SEVERITIES):
        for (name, variant), counts in pooled.items():
            what = {"seen": variant in seen, "booster": BOOSTERS[variant], "air": ALL, "object": name}
            yield head | what | counts | {"p": None}


def list_found(summary: dict[str, Any]) -> Iterator[Row]:
    """Rows as of `list_changes`, of the images in which a detector finds the object."""
    for pair in summary["pairs"]:
        yield {
            "source": pair["source"], "object": pair["object"], "variant": pair["variant"], "n": pair["n_pairs"],
            "bare": pair["n_first"], "boosted": pair["n_second"], "gained": pair["gained"], "lost": pair["lost"],
            "p": pair["mcnemar_p"],
        }  # fmt: skip


def read_workspace(folder: Path) -> Iterator[Row]:
    """Rows of all of its runs."""
    for run, summary in read_summaries(open_workspace(folder)).items():
        yield from read_run(run, summary)


def read_matrix(file: Path) -> Iterator[Row]:
    """Rows of a leave-one-out experiment."""
    matrix = json.loads(file.read_text(encoding="utf-8"))
    for row in map(JudgedRow.model_validate, matrix["rows"]):
        freely = row.kind == "texture" and matrix["settings"].get("max_change") is None
        if row.source in AIRS:
            yield {
                "set": f"without {row.left_out}{FREELY * freely}", "network": row.judge,
                "sha256": row.judge_sha256[:16], "seen": row.seen, "booster": row.kind,
                "air": AIRS[row.source], "object": row.object,
                **{key: getattr(row, key) for key in COUNTS}, "p": row.mcnemar_p,
            }  # fmt: skip


def main(table: str, *sources: str) -> None:
    """Write the table."""
    found: list[Row] = []
    for source in sources:
        name, is_set, folder = source.partition("=")
        rows = [{"set": name, **row} for row in read_workspace(Path(folder))] if is_set else read_matrix(Path(source))
        found += rows
    others = read_others(Path(table), found, "set", "booster")
    found += [row | {"seen": row["seen"] == "True"} | {key: int(row[key]) for key in COUNTS} for row in others]
    # a pose that two runs asked the same network about has the same answer
    kept = list({tuple(row[key] for key in KEY): row for row in found}.values())
    kept.sort(
        key=lambda row: (row["set"], row["booster"], not row["seen"], row["network"], row["air"] == ALL, row["air"])
    )
    for row in kept:
        row["low"], row["high"] = wilson_interval(row["boosted"], row["n"])
    write_table(Path(table), kept)


if __name__ == "__main__":
    main(*sys.argv[1:])
