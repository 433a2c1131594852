"""Compare ways of training on networks that were not trained: refined_cells.py CSV WORKSPACE, see run-refined.

Each run in WORKSPACE/eval is one of `toolkit eval captures`, with sources `sim-FORM-FILL`. A form is compared with the
bare object, and with the form `plain`, pose by pose. Forms of the CSV that were not run again stay. The workspace's
sweeps of the distance go into distances.csv beside it.
"""

import csv
import sys
from collections import defaultdict
from pathlib import Path

from PIL import Image, ImageDraw
from tables import DOCS, Row, list_sweeps, read_others, read_summaries, write_table

from toolkit.core.statistics import mcnemar_p, wilson_interval
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.imaging.plots import read_font
from toolkit.imaging.style import INK
from toolkit.objects.records import read_patch

FIGURES = DOCS / "figures"
PLAIN, BARE = "plain", "unpatched"
SHOWN = {
    PLAIN: "as it is",
    "flat": "flat, SAM",
    "path": "10 checkpoints",
    "robust": "robust, 0.25",
    "robust1": "robust, 1",
}
TILE_PX, CAPTION_PX = 144, 28
Answers = dict[tuple[str, str], bool]
"""Whether a network is right, by object and pose."""


def read_answers(file: Path) -> dict[tuple[str, str, str], Answers]:
    """By form, fill and variant."""
    found: dict[tuple[str, str, str], Answers] = defaultdict(dict)
    with file.open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            _, form, fill = row["source"].split("-")
            found[form, fill, row["variant"]][row["object"], row["pose_id"]] = row["correct_top1"] == "1"
    return found


def compare(answers: Answers, others: Answers, prefix: str = "") -> Row:
    """Right of the others, gained and lost against them, and McNemar's exact p."""
    gained, lost = (sum(answers[key] is wins and others[key] is not wins for key in answers) for wins in (True, False))
    return {
        f"{prefix}right": sum(others[key] for key in answers), f"{prefix}gained": gained, f"{prefix}lost": lost,
        f"{prefix}p": mcnemar_p(gained, lost),
    }  # fmt: skip


def draw_patches(space: Workspace) -> Image.Image:
    """The patches of some forms, an object in each row."""
    objects = ("racer", "warplane", "coffeepot", "eggnog")
    sheet = Image.new("RGB", (len(SHOWN) * TILE_PX, len(objects) * TILE_PX + CAPTION_PX), "white")
    for column, (form, caption) in enumerate(SHOWN.items()):
        ImageDraw.Draw(sheet).text((column * TILE_PX, 4), caption, fill=INK, font=read_font("plain", 16))
        for row, name in enumerate(objects):
            patch = read_patch(space.root / "print" / "patches" / form / f"{name}.png")
            picture = Image.fromarray(patch.pixels).resize((TILE_PX - 4, TILE_PX - 4), Image.Resampling.LANCZOS)
            sheet.paste(picture, (column * TILE_PX, row * TILE_PX + CAPTION_PX))
    return sheet


def main(table: str, folder: str) -> None:
    """Write the table, and a picture of the patches beside the other figures."""
    space, rows = open_workspace(Path(folder)), []
    for run, summary in read_summaries(space).items():
        found = read_answers(space.eval_dir / run / "predictions.csv")
        for (form, fill, variant), right in found.items():
            for name in ("all", *sorted({one for one, _ in right})) if variant != BARE else ():
                some = {key: is_right for key, is_right in right.items() if name in ("all", key[0])}
                hits = sum(some.values())
                low, high = wilson_interval(hits, len(some))
                rows.append({
                    "form": form, "fill": fill, "network": summary["model"]["name"], "object": name, "n": len(some),
                    "sha256": summary["model"]["sha256"][:16], "boosted": hits, "low": low, "high": high,
                    **compare(some, found[form, fill, BARE], "bare_"),
                    **compare(some, found[PLAIN, fill, variant], "plain_"),
                })  # fmt: skip
    write_table(Path(table), rows + read_others(Path(table), rows, "form"))
    write_table(Path(table).with_name("distances.csv"), list(list_sweeps(space)))
    draw_patches(space).save(FIGURES / "refined-patches.jpg", quality=80)


if __name__ == "__main__":
    main(*sys.argv[1:])
