"""What a workspace's runs say of its patches, set by set, in one table: patch_cells.py CSV WORKSPACE [SWEEPS].

Each run in WORKSPACE/eval is one of `toolkit eval captures`: of sets of patches as they are rendered,
`captures/sim-SET`, and through the whole chain, `captures/sim-SET-rehearsed`; those that are no set, `captures/sim`.
SWEEPS: a table of the workspace's sweeps.
"""

import sys
from pathlib import Path

from tables import list_groups, list_pairs, list_sweeps, read_summaries, write_table

from toolkit.captures.read import UNPATCHED
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
        right = {(one["source"], one["object"], one["variant"]): one["correct"] for one in list_groups(run, summary)}
        for pair in list_pairs(run, summary):
            source, name = pair["source"], pair["object"]
            patched = right[source, name, pair["variant"]]
            low, high = wilson_interval(patched, pair["n_pairs"])
            rows.append({
                "set": source.removesuffix(CHAIN).partition("-")[2], "rehearsed": source.endswith(CHAIN),
                "network": summary["model"]["name"], "sha256": summary["model"]["sha256"][:16], "object": name,
                "n": pair["n_pairs"], "bare": right[source, name, UNPATCHED], "patched": patched,
                "gained": pair["gained"], "lost": pair["lost"], "p": pair["mcnemar_p"], "low": low, "high": high,
            })  # fmt: skip
    write_table(Path(table), rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
