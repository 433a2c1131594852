"""What is printed on the eggnog carton: four panels, the roof, the gable ends and the fin."""

import numpy as np
from PIL import Image

from toolkit.objects.eggnog_art import draw_holly, draw_mug, draw_nutmeg
from toolkit.objects.eggnog_canvas import Canvas, Colour

RED: Colour = (158, 20, 30)
DARK_RED: Colour = (98, 8, 18)
GREEN: Colour = (18, 78, 46)
CREAM: Colour = (255, 244, 214)
GOLD: Colour = (222, 170, 72)
BOARD: Colour = (238, 233, 222)
CAP: Colour = (250, 246, 236)
CAP_FLANGE: Colour = (240, 236, 226)
SERIF = "DejaVuSerif-BoldItalic.ttf"
SANS = "DejaVuSans.ttf"
BOLD = "DejaVuSans-Bold.ttf"


def paint_walls(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The band of four panels: front, left, back, right."""
    band = Image.new("RGB", (width, height))
    edges = np.linspace(0, width, 5).round().astype(int)
    sides = np.diff(edges)
    front = draw_front(int(sides[0]), height, px_per_mm)
    facts = draw_facts(int(sides[1]), height, px_per_mm)
    story = draw_story(int(sides[3]), height, px_per_mm)
    for left, panel in zip(edges, (front, facts, front.resize((int(sides[2]), height)), story), strict=False):
        band.paste(panel, (int(left), 0))
    return band


def draw_front(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The main panel: the name over a glass mug of eggnog."""
    canvas = _lay_ground(width, height, px_per_mm, glow=0.64)
    w, h = canvas.size_mm
    _letter_name(canvas, w / 2, 28, 22)
    _draw_ribbon(canvas, 60, "RICH & CREAMY")
    draw_mug(canvas, w / 2 - 1, 0.65 * h, 98)
    draw_holly(canvas, 0.19 * w, 0.875 * h, 16, -20)
    draw_nutmeg(canvas, 0.87 * w, 0.885 * h, 12)
    _draw_foot(canvas, "HALF GALLON  (1.89 L)")
    return canvas.image()


def draw_facts(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The left panel: a smaller mug and the nutrition facts."""
    canvas = _lay_ground(width, height, px_per_mm, glow=0.28)
    w = canvas.size_mm[0]
    draw_mug(canvas, w / 2 + 1, 46, 66)
    _draw_nutrition(canvas, 16, 92, w - 32, 86)
    _draw_foot(canvas, "KEEP REFRIGERATED")
    return canvas.image()


def draw_story(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The right panel: the name, a mug, how to serve it, and the bar code."""
    canvas = _lay_ground(width, height, px_per_mm, glow=0.42)
    w = canvas.size_mm[0]
    _letter_name(canvas, w / 2, 20, 16)
    draw_mug(canvas, w / 2 + 1, 82, 74)
    canvas.fill(canvas.soften(canvas.ellipse(w / 2, 143, 44, 17), 4), DARK_RED)  # no snow behind the words
    lines = [
        "Serve well chilled,",
        "stir, and grate a little",
        "nutmeg over the foam.",
        "Warm it gently for",
        "a winter evening.",
    ]
    for i, line in enumerate(lines):
        canvas.text(w / 2, 130 + 6.2 * i, line, 4.6, CREAM, "DejaVuSerif-Italic.ttf")
    _draw_bar_code(canvas, w / 2 - 19, 163, 38, 18)
    _draw_foot(canvas, "GRADE A · PASTEURIZED")
    return canvas.image()


def paint_roof(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The front slope of the roof: the name between gold lines."""
    canvas = _lay_roof(width, height, px_per_mm)
    w, h = canvas.size_mm
    _letter_name(canvas, w / 2, h * 0.5, 17, one_line=True)
    return canvas.image()


def paint_rear_roof(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The rear slope: holly either side of the cap."""
    canvas = _lay_roof(width, height, px_per_mm)
    w, h = canvas.size_mm
    for x, turn_deg in ((0.15 * w, -8), (0.85 * w, 8)):
        draw_holly(canvas, x, h * 0.5, 13, turn_deg)
    return canvas.image()


def _lay_roof(width: int, height: int, px_per_mm: float) -> Canvas:
    canvas = Canvas(width, height, px_per_mm, RED)
    w, h = canvas.size_mm
    _draw_snow(canvas, 40, 3)
    for y in (4.0, h - 4.0):
        canvas.fill(canvas.box(0, y - 0.7, w, 1.4), GOLD)
    return canvas


def paint_gable(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The triangle folded in under the roof."""
    canvas = Canvas(width, height, px_per_mm, DARK_RED)
    draw_holly(canvas, canvas.size_mm[0] / 2, canvas.size_mm[1] * 0.72, 15, 0)
    return canvas.image()


def paint_fin(width: int, height: int, px_per_mm: float) -> Image.Image:
    """The sealed fin: bare board with a green foot and the date stamped on it."""
    canvas = Canvas(width, height, px_per_mm, CREAM)
    w, h = canvas.size_mm
    canvas.fill(canvas.box(0, h - 5.5, w, 5.5), GREEN)
    canvas.text(w / 2, h * 0.36, "BEST BY  DEC 24   L2 07:41", 5.0, (40, 40, 50), "DejaVuSansMono-Bold.ttf")
    return canvas.image()


def _lay_ground(width: int, height: int, px_per_mm: float, glow: float) -> Canvas:
    """Red with a warm glow around the picture, falling snow, and a border of stripes at the top."""
    canvas = Canvas(width, height, px_per_mm, RED)
    w, h = canvas.size_mm
    distance = np.hypot((canvas.x - w / 2) / (0.62 * w), (canvas.y - glow * h) / (0.62 * w))
    canvas.fill(np.clip(distance - 0.5, 0, 1) * 0.8, DARK_RED)
    canvas.fill(np.exp(-((distance / 0.62) ** 2)), (236, 150, 62), 0.75)
    _draw_snow(canvas, 70, round(glow * 100))
    return canvas


def _draw_snow(canvas: Canvas, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    w, h = canvas.size_mm
    for x, y, radius in zip(
        rng.uniform(0, w, count), rng.uniform(0, h, count), rng.uniform(0.25, 0.9, count), strict=True
    ):
        canvas.spot(x, y, radius, radius, (255, 250, 245), 0.8)


def _letter_name(canvas: Canvas, x: float, y: float, size: float, one_line: bool = False) -> None:
    lines = [("EGG NOG", y)] if one_line else [("Egg", y - 0.47 * size), ("Nog", y + 0.47 * size)]
    for words, line_y in lines:
        canvas.text(x + 0.05 * size, line_y + 0.05 * size, words, size, DARK_RED, SERIF, DARK_RED, 0.09 * size)
        canvas.text(x, line_y, words, size, CREAM, SERIF, DARK_RED, 0.05 * size)


def _draw_ribbon(canvas: Canvas, y: float, words: str) -> None:
    w = canvas.size_mm[0]
    canvas.fill(
        canvas.polygon([(8, y - 4.5), (w - 8, y - 4.5), (w - 12, y), (w - 8, y + 4.5), (8, y + 4.5), (12, y)]), GREEN
    )
    canvas.text(w / 2, y, words, 5.4, CREAM, BOLD)


def _draw_foot(canvas: Canvas, words: str) -> None:
    w, h = canvas.size_mm
    canvas.fill(canvas.box(0, h - 11, w, 11), GREEN)
    canvas.fill(canvas.box(0, h - 11.8, w, 0.8), GOLD)
    canvas.text(w / 2, h - 5.6, words, 4.6, CREAM, BOLD)


def _draw_nutrition(canvas: Canvas, x: float, y: float, width: float, height: float) -> None:
    ink: Colour = (24, 22, 24)
    canvas.fill(canvas.box(x, y, width, height), ink)
    canvas.fill(canvas.box(x + 0.5, y + 0.5, width - 1, height - 1), (252, 248, 238))
    canvas.text(x + 2, y + 2, "Nutrition Facts", 7.0, ink, BOLD, anchor="la")
    rows = [
        ("16 servings, ½ cup (120 mL)", ""), ("Calories", "180"),
        ("Total Fat 9 g", "12%"), ("Saturated Fat 5 g", "25%"),
        ("Cholesterol 70 mg", "23%"), ("Sodium 70 mg", "3%"), ("Total Carbs 20 g", "7%"), ("Sugars 19 g", "38%"),
        ("Protein 5 g", ""), ("Vitamin D 1 mcg", "6%"), ("Calcium 160 mg", "10%"),
    ]  # fmt: skip
    step = (height - 15) / len(rows)
    for i, (name, amount) in enumerate(rows):
        line = y + 12 + step * i
        canvas.fill(canvas.box(x + 2, line, width - 4, 0.35), ink)
        font = BOLD if name in ("Calories", "Protein 5 g") else SANS
        canvas.text(x + 2, line + step / 2, name, 3.5, ink, font, anchor="lm")
        canvas.text(x + width - 2, line + step / 2, amount, 3.5, ink, BOLD, anchor="rm")


def _draw_bar_code(canvas: Canvas, x: float, y: float, width: float, height: float) -> None:
    canvas.fill(canvas.box(x, y, width, height), (252, 250, 246))
    rng = np.random.default_rng(12)
    place = x + 3
    while place < x + width - 4:
        bar = float(rng.choice([0.35, 0.7, 1.05]))
        canvas.fill(canvas.box(place, y + 2, bar, height - 6.5), (20, 20, 22))
        place += bar + float(rng.choice([0.35, 0.7]))
    canvas.text(x + width / 2, y + height - 2.3, "0 41271 02419 6", 3.0, (20, 20, 22), "DejaVuSansMono.ttf")
