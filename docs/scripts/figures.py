"""The figures of README and docs that a finished workspace makes: captures with their verdicts, pages, reports.

Called as figures.py WORKSPACE RUN FILE: `draw_pairs` of the textures in a run.
"""

import csv
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from drawn import draw_city, draw_everyday, draw_parts, draw_skies
from PIL import Image, ImageDraw, ImageFont

from toolkit.captures.capture import UNPATCHED
from toolkit.captures.render import render
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.evaluation.metrics import TEXTURED
from toolkit.imaging.plots import read_font
from toolkit.imaging.style import INK, name_variant
from toolkit.objects.load import BUILTIN, load_object
from toolkit.objects.records import read_patch, read_texture
from toolkit.rig import PAIR, Pattern
from toolkit.rig.camera import Camera
from toolkit.rig.plan import plan_poses

RIGHT, WRONG = "#00734f", "#b34700"
"""Green and orange of the style, dark enough for white letters."""
NEAR = Path(__file__).resolve().parents[2] / "rig/textures/near/eggnog.png"
CLEAR, FOGGY, TEXTURES = "sim-textures", "sim-textures-fog", "textures-"
TILE, STRIP, LETTER_PX = (400, 300), 46, 28
LOOKS_PX, LOOKS_CAPTION_PX = 300, 22


def make_sheet(columns: int, lines: int) -> Image.Image:
    """White paper for so many tiles."""
    return Image.new("RGB", (columns * TILE[0], lines * (TILE[1] + STRIP)), "white")


def paste_tile(
    sheet: Image.Image, space: Workspace, row: dict[str, str], column: int, line: int, font: ImageFont.FreeTypeFont
) -> None:
    """Paste the capture of a row of `predictions.csv`; its strip is green where the guess is right, else red."""
    (width, height), draw = TILE, ImageDraw.Draw(sheet)
    left, top = column * width, line * (height + STRIP)
    picture = Image.open(space.captures_dir / row["path"]).convert("RGB")
    sheet.paste(picture.resize(TILE, Image.Resampling.LANCZOS), (left, top))
    right = is_correct(row)
    text = f"{'✓' if right else '✗'} {row['top1_label']}  {float(row['top1_prob']):.0%}"
    draw.rectangle((left, top + height, left + width, top + height + STRIP), fill=RIGHT if right else WRONG)
    draw.text((left + 12, top + height + 5), text, fill="white", font=font)


def read_predictions(space: Workspace, run: str) -> list[dict[str, str]]:
    """Rows of a run's predictions."""
    with (space.eval_dir / run / "predictions.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def draw_pairs(
    space: Workspace, rows: list[dict[str, str]], names: Sequence[str] = BUILTIN, boosted: str = "patched"
) -> Image.Image:
    """Draw each object without its booster above and with it below, at the first pose that changes, else at pose 1."""
    sheet, font = make_sheet(len(names), 2), read_font("plain", LETTER_PX)
    for column, name in enumerate(names):
        by_pose: dict[int, dict[str, dict[str, str]]] = {}
        for row in rows:
            if row["object"] == name and row["pose_id"]:
                by_pose.setdefault(int(row["pose_id"]), {})[row["variant"]] = row
        pairs = [pair for _, pair in sorted(by_pose.items()) if {boosted, UNPATCHED} <= pair.keys()]
        differs = [pair for pair in pairs if pair[boosted]["correct_top1"] != pair[UNPATCHED]["correct_top1"]]
        chosen = (differs or pairs)[0]
        for line, variant in enumerate((UNPATCHED, boosted)):
            paste_tile(sheet, space, chosen[variant], column, line, font)
    return sheet


def draw_contact_sheet(space: Workspace, rows: list[dict[str, str]]) -> Image.Image:
    """Every capture of the sim source: a row per object and variant, a column per pose, each with ✓ or ✗."""
    names, poses = list_names(rows), sorted({int(row["pose_id"]) for row in rows if row["pose_id"]})
    w, h, frame, margin, head = 128, 96, 4, 230, 50
    step, rise = w + 2 * frame, h + 2 * frame
    sheet = Image.new("RGB", (margin + len(poses) * step, head + len(names) * 2 * rise), "white")
    draw, font, mark = ImageDraw.Draw(sheet), read_font("plain", 36), read_font("sans", 30)
    for column, pose in enumerate(poses):
        draw.text((margin + (column + 0.5) * step, head / 2), str(pose), INK, font, "mm")
    draw.text((margin - 12, head / 2), "pose", INK, font, "rm")
    for line, (name, variant) in enumerate((name, one) for name in names for one in (UNPATCHED, "patched")):
        draw.text(
            (margin - 12, head + (line + 0.5) * rise),
            f"{name}\n{name_variant(variant)}",
            INK,
            font,
            "rm",
            align="right",
        )
    for row in rows:
        if not row["pose_id"]:
            continue
        line = 2 * names.index(row["object"]) + (row["variant"] == "patched")
        left, top = margin + poses.index(int(row["pose_id"])) * step, head + line * rise
        right = is_correct(row)
        sheet.paste(RIGHT if right else WRONG, (left, top, left + step, top + rise))
        picture = Image.open(space.captures_dir / row["path"]).convert("RGB")
        sheet.paste(picture.resize((w, h), Image.Resampling.LANCZOS), (left + frame, top + frame))
        draw.rectangle((left, top, left + 40, top + 40), RIGHT if right else WRONG)
        draw.text((left + 20, top + 20), "✓" if right else "✗", "white", mark, "mm")
    return sheet


def list_names(rows: list[dict[str, str]]) -> list[str]:
    """The objects of the rows, in order."""
    return sorted({row["object"] for row in rows})


def is_correct(row: dict[str, str]) -> bool:
    """Whether the top-1 prediction of a row is the true class."""
    return row["correct_top1"] in ("1", "True", "true")


def draw_patches(space: Workspace) -> Image.Image:
    """The shipped patches side by side, pixel for pixel."""
    side, gap = 300, 16
    sheet = Image.new("RGB", (len(BUILTIN) * (side + gap) - gap, side), "white")
    for i, name in enumerate(BUILTIN):
        pixels = read_patch(space.patch(name)).pixels
        sheet.paste(Image.fromarray(pixels).resize((side, side), Image.Resampling.NEAREST), (i * (side + gap), 0))
    return sheet


def draw_page(space: Workspace, name: str) -> Image.Image:
    """The printed page as a picture."""
    import pypdfium2

    page = pypdfium2.PdfDocument(space.print_dir / f"{name}.pdf")[0]
    return page.render(scale=1.6).to_pil()


def draw_shot_list(space: Workspace) -> Image.Image:
    """The first two pages of the shot list, side by side."""
    import pypdfium2

    document = pypdfium2.PdfDocument(space.print_dir / "shot_list.pdf")
    pages = [document[number].render(scale=1.3).to_pil() for number in range(2)]
    sheet = Image.new("RGB", (sum(page.width for page in pages), pages[0].height), "white")
    for number, page in enumerate(pages):
        sheet.paste(page, (number * pages[0].width, 0))
    return sheet


def photograph_report(space: Workspace, run: str, target: Path) -> bool:
    """A picture of the report's top, where a Chromium is installed."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        return False
    report = (space.eval_dir / run / "report.html").resolve().as_uri()
    subprocess.run(
        [browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1200,1500",
         f"--screenshot={target}", report],
        check=True, capture_output=True,
    )  # fmt: skip
    return True


def photograph_studio(space: Workspace, target: Path) -> bool:
    """A picture of the studio's page as a phone shows it, where a Chromium is installed and there is a shot list."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None or not (space.root / "rig" / "shots.json").is_file():
        return False
    command = [sys.executable, "-m", "toolkit", "studio", "--workspace", str(space.root), "--port", "8797"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        address = server.stdout.readline().strip() if server.stdout else ""
        subprocess.run(
            [browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=430,1000",
             "--virtual-time-budget=15000", f"--screenshot={target}", address],
            check=True, capture_output=True,
        )  # fmt: skip
        server.terminate()
    return True


def draw_textures(space: Workspace, rows: list[dict[str, str]], font: ImageFont.FreeTypeFont) -> Image.Image:
    """Draw one pose of each object: unmodified, in its texture, and in fog, with the network's first guess."""
    views = ((CLEAR, "unpatched"), (CLEAR, "textured"), (FOGGY, "textured"))
    sheet = make_sheet(len(BUILTIN), len(views))
    for column, name in enumerate(BUILTIN):
        found = {
            (row["source"], row["variant"], int(row["pose_id"])): row
            for row in rows
            if row["object"] == name and row["pose_id"]
        }
        poses = sorted(pose for source, variant, pose in found if (source, variant) == views[0])
        differs = [pose for pose in poses if not is_correct(found[(*views[0], pose)])]
        for line, view in enumerate(views):
            row = found[(*view, (differs or poses)[0])]
            paste_tile(sheet, space, row, column, line, font)
    return sheet


def draw_looks(space: Workspace, font: ImageFont.FreeTypeFont) -> Image.Image:
    """Draw an object from two places: unmodified, in the texture that keeps its looks, and in the shipped texture."""
    kept = read_texture(NEAR)
    name = kept.record.name
    item = load_object(space.object_spec(name))
    columns = (("its own paint", None), ("--max-change 0.2", kept), ("free", read_texture(space.texture(name))))
    camera = Camera.from_fov(LOOKS_PX, LOOKS_PX)
    poses = plan_poses(item, camera, Pattern(count=2, fill=0.85))
    sheet = Image.new("RGB", (len(columns) * LOOKS_PX, len(poses) * LOOKS_PX + LOOKS_CAPTION_PX), "white")
    draw = ImageDraw.Draw(sheet)
    for column, (caption, texture) in enumerate(columns):
        draw.text((column * LOOKS_PX + 6, 2), caption, fill=INK, font=font)
        for line, picture in enumerate(render(item, poses, camera, texture)):
            sheet.paste(Image.fromarray(picture), (column * LOOKS_PX, LOOKS_CAPTION_PX + line * LOOKS_PX))
    return sheet


def draw_figures(space: Workspace, figures: Path, run: str) -> None:
    """Write all figures of a finished workspace; `run` is the evaluation that they show."""
    figures.mkdir(exist_ok=True)
    rows = [r for r in read_predictions(space, run) if r["source"] == "sim" and r["variant"] in PAIR]
    draw_pairs(space, rows).save(figures / "pairs.jpg", quality=90)
    draw_contact_sheet(space, rows).save(figures / "contact-sheet.jpg", quality=88)
    draw_patches(space).save(figures / "patches.png")
    draw_page(space, "warplane").save(figures / "page.png")
    if (space.print_dir / "shot_list.pdf").is_file():
        draw_shot_list(space).save(figures / "shot-list.png")
    bare = next(r["path"] for r in rows if (r["object"], r["variant"]) == (BUILTIN[0], UNPATCHED))
    with Image.open(space.captures_dir / bare) as photo:
        pixels = read_patch(space.patch(BUILTIN[0])).pixels
        draw_parts(pixels, photo.convert("RGB"), read_font("plain", 18)).save(figures / "parts.png")
    draw_everyday(read_font("plain", 13)).save(figures / "everyday.jpg", quality=90)
    draw_skies(read_font("plain", 18)).save(figures / "skies.jpg", quality=88)
    draw_city(read_font("plain", 18)).save(figures / "city.jpg", quality=85)
    draw_looks(space, read_font("plain", 16)).save(figures / "looks.jpg", quality=90)
    if (space.eval_dir / f"{TEXTURES}{run}").is_dir():
        rows = read_predictions(space, f"{TEXTURES}{run}")
        draw_textures(space, rows, read_font("plain", LETTER_PX)).save(figures / "textures.jpg", quality=90)
    photograph_report(space, run, figures / "report.png")
    photograph_studio(space, figures / "studio.png")


def main(folder: str, run: str, file: str) -> None:
    """Draw third-party objects, unmodified and in their textures."""
    space = open_workspace(Path(folder))
    rows = read_predictions(space, run)
    draw_pairs(space, rows, sorted({row["object"] for row in rows}), TEXTURED).save(file, quality=88)


if __name__ == "__main__":
    main(*sys.argv[1:])
