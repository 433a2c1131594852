"""Boxes of different sizes on as few pages as can be."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

from toolkit.printing.page import Rect

PER_MM = 20
"""The packer counts in whole steps: twentieths of a millimetre."""
STRIP_STEP = 1.01
"""By how much a strip is made longer until all boxes fit on it."""


@dataclass(frozen=True)
class Nested:
    """A box on a page.

    Attributes:
        index: which of the boxes.
        area: what it covers, in the page's millimetres.
        turned: by a quarter, counter-clockwise.
    """

    index: int
    area: Rect
    turned: bool


def nest(sizes_mm: Sequence[tuple[float, float]], room: Rect) -> list[list[Nested]]:
    """Place boxes, turned by a quarter where that helps, on as few pages as is found; each fits on a page.

    Several rules of the packer are tried (Jylänki 2010, A Thousand Ways to Pack the Bin); of equal ones the first with
    the emptiest last page is taken.
    """
    import rectpack

    rules = (rectpack.MaxRectsBssf, rectpack.MaxRectsBaf, rectpack.MaxRectsBl, rectpack.GuillotineBssfSas)
    orders = (rectpack.SORT_AREA, rectpack.SORT_LSIDE, rectpack.SORT_SSIDE, rectpack.SORT_PERI)
    packed = [
        pages for rule, order in product(rules, orders) if (pages := _pack(sizes_mm, room, rule, order)) is not None
    ]
    return min(packed, key=lambda pages: (len(pages), sum(_area(one) for one in pages[-1])))


def nest_on_strip(sizes_mm: Sequence[tuple[float, float]], width_mm: float, most_mm: float) -> list[list[Nested]]:
    """Place boxes on the shortest strip of a width that is found; on several where one would be too long."""
    total = sum(width * height for width, height in sizes_mm)
    length = max(total / width_mm, *(min(size) for size in sizes_mm))
    while length < most_mm:
        fits = all(_fits(size, width_mm, length) for size in sizes_mm)
        pages = nest(sizes_mm, Rect(0, 0, width_mm, length)) if fits else []
        if len(pages) == 1:
            return pages
        length *= STRIP_STEP
    return nest(sizes_mm, Rect(0, 0, width_mm, most_mm))


def _fits(size_mm: tuple[float, float], width_mm: float, height_mm: float) -> bool:
    return min(size_mm) <= min(width_mm, height_mm) and max(size_mm) <= max(width_mm, height_mm)


def fits_in(size_mm: tuple[float, float], room: Rect) -> bool:
    """Whether a box fits on a page, turned or not."""
    return _fits(size_mm, room.width, room.height)


def _area(one: Nested) -> float:
    return one.area.width * one.area.height


def _pack(sizes_mm: Sequence[tuple[float, float]], room: Rect, rule: type, order: object) -> list[list[Nested]] | None:
    import rectpack

    packer = rectpack.newPacker(pack_algo=rule, sort_algo=order, rotation=True)
    steps = [(-int(-width * PER_MM // 1), -int(-height * PER_MM // 1)) for width, height in sizes_mm]
    for index, (width, height) in enumerate(steps):
        packer.add_rect(width, height, rid=index)
    packer.add_bin(int(room.width * PER_MM), int(room.height * PER_MM), count=float("inf"))
    packer.pack()
    placed = packer.rect_list()
    if len(placed) < len(sizes_mm):
        return None
    pages: list[list[Nested]] = [[] for _ in range(1 + max(number for number, *_ in placed))]
    for number, x, y, width, height, index in sorted(placed, key=lambda one: one[5]):
        # the packer begins below, a page is read from above
        top = room.top - y / PER_MM
        area = Rect(room.x + x / PER_MM, top - height / PER_MM, width / PER_MM, height / PER_MM)
        pages[number].append(Nested(index, area, (width, height) != steps[index]))
    return pages
