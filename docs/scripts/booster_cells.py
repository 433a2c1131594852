"""Write the results of a workspace's runs into one table, set by set: booster_cells.py CSV WORKSPACE [SWEEPS].

Each run in WORKSPACE/eval is one of `toolkit eval captures`: of sets as they are rendered, `captures/sim-SET`, and
through the whole chain, `captures/sim-SET-rehearsed`; those that are no set, `captures/sim`.
SWEEPS: a table of the workspace's sweeps.
"""

import sys
from pathlib import Path

from tables import BOOSTERS, list_changes, list_sweeps, read_summaries, write_table

from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import open_workspace

CHAIN = "-rehearsed"


def main(table: str, folder: str, sweeps: str | None = None) -> None:
    """Write the tables."""
    space = open_workspace(Path(folder))
    if sweeps is not None:
        write_table(Path(sweeps), list(list_sweeps(space)))
    rows = []
    for run, summary in read_summaries(space).items():
        model = summary["model"]
        for row in list_changes(run, summary):
            source, (low, high) = row["source"], wilson_interval(row["boosted"], row["n"])
            rows.append({
                "set": source.removesuffix(CHAIN).partition("-")[2], "rehearsed": source.endswith(CHAIN),
                "network": model["name"], "sha256": model["sha256"][:16],
                "booster": BOOSTERS[row["variant"]], "object": row["object"],
                "n": row["n"], "bare": row["bare"], "boosted": row["boosted"],
                "gained": row["gained"], "lost": row["lost"], "p": row["p"], "low": low, "high": high,
            })  # fmt: skip
    write_table(Path(table), rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
