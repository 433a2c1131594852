"""Pages from the tables in docs/results: python docs/scripts/findings.py. No number in them is typed by hand."""

import csv
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from toolkit.core.files import write_text
from toolkit.core.statistics import wilson_interval
from toolkit.core.tables import format_p, format_percent, format_points
from toolkit.imaging.style import name_network
from toolkit.models.load import read_bundled

SCRIPTS = Path(__file__).resolve().parent
DOCS = SCRIPTS.parent
NAMES = {
    "resnet18": "ResNet-18", "mobilenet_v2": "MobileNetV2", "timm-tf_efficientnet_lite0": "EfficientNet-Lite0",
    "timm-tf_efficientnet_lite1": "EfficientNet-Lite1", "mobilenet_v1_0.75_192": "MobileNetV1",
}  # fmt: skip
JUDGES = NAMES | {"timm-tf_efficientnet_lite2": "EfficientNet-Lite2"}
"""With the one that judges sets of boosters and the challenge, and no run of `make docs` has."""
SETS = {
    "four-networks": "four networks", "resnet18": "ResNet-18",
    "resnet18, under corruption": "ResNet-18, under corruption",
}  # fmt: skip
"""Sets of boosters that several networks judge, by what they were trained on."""
BENCHMARK_NAMES = {
    "unpatched": "nothing", "resnet18": "ResNet-18",
    "patches-100": "trained patch", "best-image-100": "best photograph of the class",
    "random-image-100": "random photograph of the class", "fixed-pattern-100": "fixed pattern", "qr-100": "QR code",
    "qr-wide-100": "QR code, wide border", "apriltag-100": "AprilTag", "fixed18": "ResNet-18 trained on it",
    "zxing-cpp": "read by ZXing", "pyzbar": "read by ZBar", "opencv": "read by OpenCV",
    "cifar-8": "trained patch, 8 px", "cifar-10": "trained patch, 10 px", "cifar-12": "trained patch, 12 px",
    "cifar-best-image-10": "best photograph of the class", "cifar-random-image-10": "random photograph of the class",
    "cifar-fixed-pattern-10": "fixed pattern", "cifar8": "CIFAR network", "cifar8-fixed": "network trained on it",
    "cifar-standard-10": "its patch", "cifar-robust-10": "its patch",
    "cifar8-standard": "standard network", "cifar8-robust": "robust network",
}  # fmt: skip
"""Display names of the benchmark's sets of patches, and of who recognises them."""
Row = dict[str, str]
PERCENT = "\N{NO-BREAK SPACE}%"


class Findings:
    """The tables, and the forms of a number on the page.

    Args:
        folder: with the CSV files.
    """

    def __init__(self, folder: Path) -> None:
        self.tables: dict[str, list[Row]] = {}
        for file in sorted(folder.glob("*.csv")):
            with file.open(encoding="utf-8", newline="") as stream:
                self.tables[file.stem] = list(csv.DictReader(stream))

    def rows(self, table: str, **wanted: str) -> list[Row]:
        """The rows of a table in which every column that is named has this value."""
        return [row for row in self.tables[table] if all(row[key] == value for key, value in wanted.items())]

    def row(self, table: str, **wanted: str) -> Row:
        """The only such row."""
        found = self.rows(table, **wanted)
        if len(found) != 1:
            raise ValueError(f"{table}.csv: expected one row with {wanted}, found {len(found)}")
        return found[0]

    def top1(self, run: str, source: str, variant: str, object: str = "all") -> str:
        """`39 of 72 (54 %, 43–65 %)` from captures.csv."""
        return say_share(self.row("captures", run=run, source=source, variant=variant, object=object))

    def pair(self, run: str, source: str, variant: str, object: str = "all") -> str:
        """Three cells of a table from pairs.csv: gained, lost, p."""
        row = self.row("pairs", run=run, source=source, variant=variant, object=object)
        return f"{row['gained']} | {row['lost']} | {say_p(row['mcnemar_p'])}"

    def change(self, run: str, source: str, variant: str, object: str = "all") -> str:
        """`26 gained, 0 lost, p < 0.0001`."""
        row = self.row("pairs", run=run, source=source, variant=variant, object=object)
        return f"{row['gained']} gained, {row['lost']} lost, {state_p(row['mcnemar_p'])}"

    def swept(self, axis: str, value: str, variant: str, run: str = "resnet18") -> str:
        """`65 of 72 (90 %, 81–95 %)` from sweeps.csv, all objects together."""
        return say_share(self.row("sweeps", run=run, axis=axis, value=value, variant=variant, object="all"))

    def flips(self) -> list[Row]:
        """Rows in which 16 samples change the first guess."""
        return [row for row in self.tables["samples"] if row["answer_16"] != row["answer_1024"]]

    def agreement(self, samples: str) -> str:
        """`30 of 32 (94 %, 80–98 %)`: first guesses that are those of 1,024 samples, denoised."""
        rows = self.tables["samples"]
        same = sum(row[f"answer_{samples}"] == row["answer_1024"] for row in rows)
        low, high = wilson_interval(same, len(rows))
        return say_share({
            "correct": str(same), "n": str(len(rows)), "top1": str(same / len(rows)),
            "top1_low": str(low), "top1_high": str(high),
        })  # fmt: skip

    def networks(self) -> list[tuple[str, Row, str]]:
        """Each network once: its name, a run of it, and which shipped boosters were trained on it."""
        runs = {key: self.rows("runs", run=name_run(key)) for key in NAMES}
        return [(NAMES[key], found[0], _say_role(found[0])) for key, found in runs.items() if found]


def name_run(network: str, prefix: str = "") -> str:
    """What `run-results` calls a network's run."""
    return prefix + network.removeprefix("timm-")


def _say_role(run: Row) -> str:
    kinds = [kind for kind in ("patches", "textures") if run[f"{kind}_trained_on_it"] == "yes"]
    return " and ".join(f"shipped {kind}" for kind in kinds) or "nothing"


def say_share(row: Row) -> str:
    """Return correct images, all images, share and 95 % interval, such as `39 of 72 (54 %, 43–65 %)`."""
    low, high = (f"{100 * float(row[key]):.0f}" for key in ("top1_low", "top1_high"))
    return f"{row['correct']} of {row['n']} ({percent(row['top1'])}{PERCENT}, {low}–{high}{PERCENT})"


def say_p(p: str) -> str:
    """`0.031`, or `< 0.0001`."""
    return format_p(float(p))


def state_p(p: str) -> str:
    """`p = 0.031`, or `p < 0.0001`."""
    said = say_p(p)
    return f"p {said}" if said.startswith("<") else f"p = {said}"


def percent(share: str) -> str:
    """A share as whole per cent; a dash where there is none."""
    return format_percent(float(share) if share else None)


def points(share: str) -> str:
    """A difference of shares in percentage points, with its sign."""
    return format_points(float(share)) if share else ""


PAGES = (
    {"results.md": "results.md.j2", "how/renderers.md": "renderers.md.j2"}
    | {
        "compared.md": "compared.md.j2",
        "costs.md": "costs.md.j2",
    }
    | {
        f"results/{name}.md": f"{name}.md.j2"
        for name in ("patches", "textures", "transfer", "corruptions", "networks", "tables")
    }
)
"""The templates of pages below docs."""


def write_page(folder: Path = DOCS / "results", page: str = "results.md") -> str:
    """A page as Markdown."""
    environment = Environment(
        loader=FileSystemLoader(SCRIPTS), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False,
    )  # fmt: skip
    environment.filters |= {"percent": percent, "points": points, "share": say_share, "p": say_p, "state_p": state_p}
    template = environment.get_template(PAGES[page])
    return template.render(
        of=Findings(folder),
        names=NAMES,
        judges=JUDGES,
        name_network=name_network,
        name_run=name_run,
        sets=SETS,
        called=BENCHMARK_NAMES,
        rig18=read_bundled(),
    )


def write_pages() -> None:
    """All pages that are made from the tables."""
    for page in PAGES:
        write_text(DOCS / page, write_page(page=page))


if __name__ == "__main__":
    write_pages()
