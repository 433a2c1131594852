"""Outlines for cutting machines, in millimetres: SVG and DXF."""

from dataclasses import dataclass
from io import StringIO

import numpy as np


@dataclass(frozen=True)
class CutSheet:
    """What is cut from one sheet.

    Attributes:
        width_mm, height_mm: of the sheet.
        rings_mm: by number of a piece, its closed rings (k, 2), the outer one first, from the sheet's lower left.
    """

    width_mm: float
    height_mm: float
    rings_mm: dict[int, list[np.ndarray]]


def write_svg(sheet: CutSheet, layer: str) -> bytes:
    """An SVG of the sheet's size; a path for each piece, called `piece-NUMBER`, in a group of the layer's name."""
    width, height = f"{sheet.width_mm:g}", f"{sheet.height_mm:g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f'<g id="{layer}" fill="none" stroke="#f0f" stroke-width="0.09">',
    ]
    for number, rings in sheet.rings_mm.items():
        # SVG counts downwards
        # the last point of a ring repeats the first: the path closes itself
        turns = (" L".join(f"{x:.4f},{sheet.height_mm - y:.4f}" for x, y in ring[:-1].tolist()) for ring in rings)
        lines.append(f'<path id="piece-{number}" d="{" ".join(f"M{turn} Z" for turn in turns)}"/>')
    return "\n".join([*lines, "</g>", "</svg>", ""]).encode()


def write_dxf(sheet: CutSheet, layer: str) -> bytes:
    """A DXF (R2010) in millimetres: closed polylines on the layer, those of a piece in a group `piece-NUMBER`."""
    import ezdxf
    from ezdxf import units

    ezdxf.options.write_fixed_meta_data_for_testing = True  # else it writes the time of day and a random number
    document = ezdxf.new("R2010", units=units.MM)
    document.layers.add(layer, color=6)
    space = document.modelspace()
    for number, rings in sheet.rings_mm.items():
        lines = [space.add_lwpolyline(ring[:-1].tolist(), close=True, dxfattribs={"layer": layer}) for ring in rings]
        document.groups.new(f"piece-{number}").extend(lines)
    text = StringIO()
    document.write(text)
    return text.getvalue().encode()
