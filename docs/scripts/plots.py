"""Figures that follow from the tables in docs/results and the records in docs/records: python docs/scripts/plots.py."""

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

from findings import BENCHMARK_NAMES, JUDGES, Findings, Row
from tables import DOCS, RECORDS, TABLES
from world_boosters import draw as draw_worlds
from world_boosters import read_table

from toolkit.core.files import write_bytes
from toolkit.core.workspace import open_workspace
from toolkit.imaging.plots import make_figure, with_default_style
from toolkit.imaging.style import BLUE, CORRECT, GREEN, ORANGE, UNPATCHED_COLOUR, style_panel
from toolkit.objects.load import load_object
from toolkit.rooms.benchmarks.corruptions.benchmark_figures import draw_overview, draw_variant
from toolkit.rooms.benchmarks.corruptions.benchmark_summary import read_summary
from toolkit.rooms.benchmarks.sweeps.axes import AXES
from toolkit.rooms.benchmarks.sweeps.sweep_rows import draw_sweep
from toolkit.rooms.landing.flight_report import OUTCOME_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = DOCS / "figures"
BOOSTERS = {"none": UNPATCHED_COLOUR, "patch": BLUE, "wrap": ORANGE, "texture": GREEN}
OUTCOMES = ("success", "missed", "crashed", "lost", "timed_out")
SNOW = (("clear", "0", "clear conditions"), ("snow", "2", "35 % of the ground white"))
PADS = {
    "plain pad": ("plain", "both"), "boosted pad": ("snow", "both"),
    "boosted pad,\nregressor trained on it": ("snow", "boths"),
}  # fmt: skip
CONDITIONS = {"clear": "clear conditions", "fog 3": "fog of severity 3"}


def draw_benchmarks() -> None:
    """Write an overview of each kept run of the corruption benchmark, and the trained patch by severity."""
    for name in ("photographs", "cifar", "robust"):
        summary = read_summary(RECORDS / "benchmark" / f"{name}.json")
        write_bytes(FIGURES / f"benchmark-{name}.png", draw_overview(summary, BENCHMARK_NAMES))
        if name == "photographs":
            (row,) = (one for one in summary.variants if one.variant == "patches-100")
            picture = draw_variant(summary, row, BENCHMARK_NAMES[row.variant].capitalize())
            write_bytes(FIGURES / "benchmark-photographs-patches.png", picture)


@with_default_style
def draw_transfer(of: Findings) -> bytes:
    """SVG: correct images of six networks without and with each booster of four networks, clear and in fog."""
    figure = make_figure(9.0, 5.2)
    panels = figure.subplots(2, 1, sharex=True)
    for panel, (air, title) in zip(panels, CONDITIONS.items(), strict=True):
        for k, network in enumerate(JUDGES):
            for i, (booster, colour) in enumerate(BOOSTERS.items()):
                row = _judged(of, network, air, "patch" if booster == "none" else booster)
                count, n = int(row["bare" if booster == "none" else "boosted"]), int(row["n"])
                x = k + 0.2 * (i - 1.5)
                panel.bar(x, 100 * count / n, 0.18, color=colour, label=booster if k == 0 else None, zorder=2)
                panel.annotate(
                    str(count), (x, 100 * count / n), (0, 1), textcoords="offset points", ha="center", fontsize=7
                )
        style_panel(panel, 0, 112)
        panel.set_axisbelow(True)
        panel.set_title(f"{title} (n = 72 per bar)", loc="left")
        panel.set_ylabel("correct (%)")
        panel.axvline(3.5, color=UNPATCHED_COLOUR, lw=0.8, ls=":")
    names = [
        f"{name}\n{'unseen' if _judged(of, key, 'clear', 'patch')['seen'] == 'False' else 'in training'}"
        for key, name in JUDGES.items()
    ]
    panels[1].set_xticks(range(len(JUDGES)), names, fontsize=9)
    panels[1].tick_params(axis="x", length=0)
    handles, labels = panels[0].get_legend_handles_labels()
    title = f"{CORRECT}; numbers: correct images of 72"
    figure.legend(handles, labels, title=title, loc="outside upper center", ncols=4, frameon=False)
    return encode_svg(figure)


@with_default_style
def draw_landings(of: Findings) -> bytes:
    """SVG: how 100 landings ended with each pad and regressor, on roofs and a field, in clear conditions and snow."""
    figure = make_figure(9.0, 5.6)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for line, (world, where) in zip(panels, (("city", "roofs"), ("grass", "field")), strict=True):
        for panel, (weather, severity, title) in zip(line, SNOW, strict=True):
            wanted = {"world": world, "time": "noon", "weather": weather, "severity": severity, "n": "100"}
            for y, (pad, regressor) in enumerate(PADS.values()):
                row, left = of.row("landing", pad=pad, regressor=regressor, **wanted), 0.0
                shares = {"success": 100 * float(row["success"]), **{one: float(row[one]) for one in OUTCOMES[1:]}}
                for outcome in OUTCOMES:
                    label = outcome.replace("_", " ") if y == 0 else None
                    panel.barh(y, shares[outcome], 0.6, left, color=OUTCOME_COLOURS[outcome], label=label)
                    left += shares[outcome]
                panel.annotate(f"{shares['success']:.0f}", (102, y), va="center", annotation_clip=False)
            panel.set_title(f"{where}, {title}", loc="left")
            panel.set(xlim=(0, 100), ylim=(len(PADS) - 0.5, -0.5))
            panel.set_yticks(range(len(PADS)), list(PADS))
            panel.spines[["top", "right", "left"]].set_visible(False)
            panel.tick_params(axis="y", length=0)
    for panel in panels[1]:
        panel.set_xlabel("landings of 100")
    handles, labels = panels[0][0].get_legend_handles_labels()
    title = "How landings end, n = 100 per bar; the number counts successes, higher is better"
    figure.legend(handles, labels, title=title, loc="outside upper center", ncols=len(OUTCOMES), frameon=False)
    return encode_svg(figure)


def encode_svg(figure: "Figure") -> bytes:
    """The figure as SVG, the same bytes for the same picture."""
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def _judged(of: Findings, network: str, air: str, booster: str) -> Row:
    return of.row("transfer", set="four-networks", network=network, booster=booster, air=air, object="all")


def draw_sweeps(of: Findings) -> None:
    """Write a figure for each network and axis in `sweeps.csv`; axes of the main network have its name alone."""
    for run, axis in dict.fromkeys((row["run"], row["axis"]) for row in of.rows("sweeps")):
        name = f"sweep-{axis}.png" if run == "resnet18" else f"sweep-{axis}-{run}.png"
        draw_sweep(FIGURES / name, read_sweep(of.rows("sweeps", run=run, axis=axis), run, axis))


def read_sweep(rows: list[Row], run: str, axis: str) -> SimpleNamespace:
    """Return what `draw_sweep` needs of a sweep whose images are not kept."""
    kind = AXES[axis]
    if axis == "coverage":  # the table does not hold what was reached
        kind = replace(kind, title="share (%) of the visible surface asked for; above a wrap's own, the whole wrap")
    values = {row["value"]: kind.parse(row["value"].removeprefix(kind.prefix).removesuffix(kind.unit)) for row in rows}
    sizes = find_shares(values, {row["object"] for row in rows}) if axis == "size" else {}
    return SimpleNamespace(
        axis=kind, model={"name": run}, values=values, note="", sizes=sizes, skipped=list(list_missing(rows, values)),
        objects=dict.fromkeys(sorted({row["object"] for row in rows} - {"all"})),
        variants=tuple(dict.fromkeys(row["variant"] for row in rows)),
        groups=[
            SimpleNamespace(
                source=row["value"], object=row["object"], variant=row["variant"], n=int(row["n"]),
                top1=float(row["top1"]), top1_ci95=(float(row["top1_low"]), float(row["top1_high"])),
            )
            for row in rows
        ],
    )  # fmt: skip


def find_shares(values: dict, names: set[str]) -> dict[tuple[str, str], tuple[float, float]]:
    """Return each printed side, and its share of each object's longest side; pooled if the objects agree."""
    space = open_workspace(DOCS.parent)
    longest = {name: float(max(load_object(space.object_spec(name)).mesh.size_mm)) for name in names - {"all"}}
    if len({round(side) for side in longest.values()}) == 1:
        longest["all"] = next(iter(longest.values()))
    return {(label, name): (mm, mm / side) for label, mm in values.items() for name, side in longest.items()}


def list_missing(rows: list[Row], values: dict) -> Iterator[tuple[str, str, str]]:
    """(value, object, reason) of each object that was not shot at a value."""
    shot = {(row["value"], row["object"]) for row in rows}
    for name in sorted({name for _, name in shot}):
        yield from ((value, name, "") for value in values if (value, name) not in shot)


def main() -> None:
    """Write them all."""
    of = Findings(TABLES)
    draw_benchmarks()
    draw_sweeps(of)
    write_bytes(FIGURES / "transfer.svg", draw_transfer(of))
    write_bytes(FIGURES / "landings.svg", draw_landings(of))
    write_bytes(FIGURES / "world-weathers.png", draw_worlds(read_table(Path(TABLES / "world-city-warplane.csv"))))


if __name__ == "__main__":
    main()
