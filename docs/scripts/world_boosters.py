"""Boosters of several `world-eval` runs in one table and one figure.

Called as world_boosters.py CSV PNG NAME=RUN/summary.json[:VARIANT] …; each NAME is a booster, as its run's VARIANT
(default `textured`), and the bare object is that of the first run of a network. The figure shows the first four.
"""

import csv
import json
import sys
from pathlib import Path

from toolkit.imaging.plots import encode_figure, make_figure, with_default_style
from toolkit.imaging.style import COLOURS, UNPATCHED_COLOUR, name_network, style_panel
from toolkit.rooms.worlds.evaluation.world_report import draw_line
from toolkit.rooms.worlds.fog import CONTRAST_LOG

MOST_DRAWN, BARE = 5, "bare"
DRAWN = (
    BARE,
    "texture from the studio",
    "texture from the city",
    "texture from the city in weather",
    "patch from the city in weather",
)
COLUMNS = (
    "network", "world", "place", "object", "booster", "weather", "severity", "visibility_m", "n", "top1", "top5",
    "top5_low", "top5_high", "mean_true_prob",
)  # fmt: skip


def read_rows(booster: str, file: Path, variant: str) -> list[dict]:
    """The rows of a variant of a run, as the table has them."""
    summary = json.loads(file.read_text())
    rows = []
    for group in summary["groups"]:
        if group["variant"] != variant:
            continue
        low, high = group["top5_ci95"]
        figures = {"top1": group["top1"], "top5": group["top5"], "top5_low": low, "top5_high": high}
        rows.append(
            {name: group[name] for name in COLUMNS if name in group}
            | {"network": summary["model"]["name"], "booster": booster}
            | {name: round(value, 4) for name, value in figures.items()}
            | {"mean_true_prob": round(group["mean_true_prob"], 4)}
        )
    return rows


def read_table(file: Path) -> list[dict]:
    """The rows of a written table, with numbers, for `draw`: those of the boosters that the page shows."""
    numbers = ("visibility_m", "top5", "top5_low", "top5_high")
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    return [row | {name: float(row[name] or 0) for name in numbers} for row in rows if row["booster"] in DRAWN]


@with_default_style
def draw(rows: list[dict]) -> bytes:
    """PNG: top-5 of every booster over the extinction of fog and of dust; a row of panels for each network."""
    networks = list(dict.fromkeys(row["network"] for row in rows))
    boosters = list(dict.fromkeys(row["booster"] for row in rows))[:MOST_DRAWN]
    colours = dict(zip(boosters, (UNPATCHED_COLOUR, *COLOURS), strict=False))
    figure = make_figure(9.4, 3.6 * len(networks))
    panels = figure.subplots(len(networks), 2, squeeze=False, sharey=True)
    for line, network in zip(panels, networks, strict=True):
        for panel, kind in zip(line, ("fog", "dust"), strict=True):
            for booster in boosters:
                own = [
                    row
                    for row in rows
                    if (row["network"], row["booster"], row["place"]) == (network, booster, "all")
                    and row["weather"] in ("clear", kind)
                ]
                x = [1e3 * CONTRAST_LOG / row["visibility_m"] if row["visibility_m"] else 0 for row in own]
                known = [row | {"top5_ci95": (row["top5_low"], row["top5_high"])} for row in own]
                draw_line(panel, x, known, colours[booster], "unmodified" if booster == BARE else booster)
            ticks = ["clear" if not row["visibility_m"] else f"{row['visibility_m']:g}" for row in own]
            panel.set_xticks(x, ticks, fontsize=8, rotation=45)
            panel.set_xlabel(f"{kind}: visibility, m (evenly by extinction)")
            panel.set_title(f"{name_network(network)} (n = {own[0]['n']} per point)")
            style_panel(panel)
            panel.set_axisbelow(True)
        line[0].set_ylabel("top-5 correct (%),\nhigher is better")
    panels[0][1].legend(frameon=False, fontsize=8)
    return encode_figure(figure)


def main() -> None:
    """Write the table and the figure."""
    table, picture, *runs = sys.argv[1:]
    rows: list[dict] = []
    for run in runs:
        booster, _, place = run.partition("=")
        file, _, variant = place.partition(":")
        network = json.loads(Path(file).read_text())["model"]["name"]
        if network not in {row["network"] for row in rows}:
            rows += read_rows(BARE, Path(file), "unpatched")
        rows += read_rows(booster, Path(file), variant or "textured")
    with Path(table).open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    Path(picture).write_bytes(draw(rows))


if __name__ == "__main__":
    main()
