"""What several networks say of one set of boosters, clear and corrupted, in one table: transfer_cells.py CSV WORKSPACE.

Each run in WORKSPACE/eval is of one network: `toolkit eval captures --corrupt common` of the plan, bare and boosted.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tables import Row, list_groups, list_pairs, read_summaries, write_table

from toolkit.captures.read import UNPATCHED
from toolkit.core.severities import SEVERITIES
from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import open_workspace
from toolkit.corruptions.catalogue import COMMON
from toolkit.transfer.matrix import BOOSTED

AIRS, ALL = {"sim": "clear", "sim-fog-3": "fog 3"}, "15 corruptions"
COUNTS = ("n", "bare", "boosted", "gained", "lost")


def read_run(run: str, summary: dict[str, Any]) -> Iterator[Row]:
    """Rows of a run: each object and all of them in clear air and in fog 3, and over the 75 corruptions at once."""
    model, seen = summary["model"], any(one["seen"] for one in summary["boosters"])
    right = {(one["source"], one["object"], one["variant"]): one["correct"] for one in list_groups(run, summary)}
    pooled: dict[tuple[str, str], Row] = defaultdict(lambda: dict.fromkeys(COUNTS, 0))
    cells: set[str] = set()
    head = {"network": model["name"], "sha256": model["sha256"][:16], "seen": seen}
    for pair in list_pairs(run, summary):
        source, name, variant = pair["source"], pair["object"], pair["variant"]
        if variant not in BOOSTED:
            continue
        counts = {
            "n": pair["n_pairs"], "bare": right[source, name, UNPATCHED], "boosted": right[source, name, variant],
            "gained": pair["gained"], "lost": pair["lost"],
        }  # fmt: skip
        if source in AIRS:
            what = {"booster": BOOSTED[variant], "air": AIRS[source], "object": name}
            yield head | what | counts | {"p": pair["mcnemar_p"]}
        if source.removeprefix("sim-").rpartition("-")[0] in COMMON:
            cells.add(source)
            for key in COUNTS:
                pooled[name, variant][key] += counts[key]
    if len(cells) == len(COMMON) * len(SEVERITIES):
        for (name, variant), counts in pooled.items():
            yield head | {"booster": BOOSTED[variant], "air": ALL, "object": name} | counts | {"p": None}


def main(table: str, workspace: str) -> None:
    """Write the table."""
    summaries = read_summaries(open_workspace(Path(workspace)))
    found = [row for run, summary in summaries.items() for row in read_run(run, summary)]
    # a pose that two runs asked the same network about has the same answer
    rows = list({tuple(row[key] for key in ("network", "booster", "air", "object")): row for row in found}.values())
    rows.sort(key=lambda row: (not row["seen"], row["network"], row["air"] == ALL, row["air"]))
    for row in rows:
        row["low"], row["high"] = wilson_interval(row["boosted"], row["n"])
    write_table(Path(table), rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
