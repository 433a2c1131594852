"""Captures in rows and columns, each over a strip with the network's first guess."""

from PIL import Image, ImageDraw

from toolkit.core.workspace import Workspace

RIGHT, WRONG = (34, 139, 74), (196, 48, 48)
TILE, STRIP = (400, 300), 34


def make_sheet(columns: int, lines: int) -> Image.Image:
    """White paper for so many tiles."""
    return Image.new("RGB", (columns * TILE[0], lines * (TILE[1] + STRIP)), "white")


def paste_tile(sheet: Image.Image, space: Workspace, row: dict[str, str], column: int, line: int, font) -> None:
    """Paste the capture of a row of `predictions.csv`; its strip is green where the guess is right, else red."""
    (width, height), draw = TILE, ImageDraw.Draw(sheet)
    left, top = column * width, line * (height + STRIP)
    picture = Image.open(space.captures_dir / row["path"]).convert("RGB")
    sheet.paste(picture.resize(TILE, Image.Resampling.LANCZOS), (left, top))
    right = row["correct_top1"] in ("1", "True", "true")
    text = f"{'✓' if right else '✗'} {row['top1_label']}  {float(row['top1_prob']):.0%}"
    draw.rectangle((left, top + height, left + width, top + height + STRIP), fill=RIGHT if right else WRONG)
    draw.text((left + 12, top + height + 6), text, fill="white", font=font)
