"""Material libraries of Wavefront OBJ files: colours, pictures with their options, and what is left out."""

import codecs
import math
import re
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.objects.named_files import find_named

OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-bm": 1, "-boost": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2, "-o": 3,
    "-s": 3, "-t": 3, "-texres": 1, "-type": 1,
}  # fmt: skip
"""Options before a picture's name, with their numbers of values; the last two of a vector may be missing."""
VECTORS = ("-o", "-s", "-t")
PICTURES = ("map_", "bump", "disp", "decal", "refl", "norm")
BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF32_LE, "utf-32-le"), (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"),
)  # fmt: skip
"""UTF-32's stand first: the little-endian mark begins as UTF-16's does."""


@dataclass(frozen=True)
class PictureMap:
    """A picture that a material names.

    Attributes:
        name: its path, as the library has it.
        scale: factor of the texture coordinates.
        offset: added to the scaled texture coordinates.
        is_clamped: whether the picture's edge is extended, instead of repeating the picture.
    """

    name: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    is_clamped: bool = False


@dataclass
class ObjMaterial:
    """A material of a library.

    Attributes:
        folder: folder of the library, to which names of pictures are relative.
        colour: Kd, sRGB-encoded, 0 to 1, if any.
        picture: map_Kd.
        others: names of the pictures of other maps.
        shininess: Ns, the exponent of the highlight.
        roughness, metallic: Pr and Pm.
        left_out: statements that change the look and are not used.
    """

    folder: Path
    colour: tuple[float, float, float] | None = None
    picture: PictureMap | None = None
    others: list[str] = field(default_factory=list)
    shininess: float = 1.0
    roughness: float | None = None
    metallic: float = 0.0
    left_out: list[str] = field(default_factory=list)


def decode_text(content: bytes) -> str:
    r"""Decode an OBJ or MTL in any usual encoding, with `\n` at line ends, lines joined, and no comments after code."""
    text = _decode(content).replace("\r\n", "\n").replace("\r", "\n").replace("\t", " ")
    # a comment may end in a backslash: it is no continuation
    text = re.sub(r"^( *[^#\s].*)\\ *\n", r"\1 ", text, flags=re.MULTILINE) if "\\" in text else text
    # names may hold a #, as in `skin#2`
    return re.sub(r"^( *[^#\s].*?) +#(?: .*)?$", r"\1", text, flags=re.MULTILINE) if " #" in text else text


def _decode(content: bytes) -> str:
    for mark, encoding in BYTE_ORDER_MARKS:
        if content.startswith(mark):
            # a mark at the beginning states the encoding
            return content[len(mark) :].decode(encoding, "replace")
    zeros = [content[start : 1 << 12 : 2].count(0) for start in (0, 1)]
    if max(zeros) > len(content[: 1 << 12]) // 8:  # every other byte of English in UTF-16 is zero
        return content.decode("utf-16-be" if zeros[0] > zeros[1] else "utf-16-le", "replace")
    # otherwise UTF-8, unless it is no valid text
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def read_library(path: Path) -> dict[str, ObjMaterial]:
    """Read the materials of a library by name; runs of spaces in names become a single space."""
    materials: dict[str, ObjMaterial] = {}
    material: ObjMaterial | None = None
    for line in decode_text(path.read_bytes()).split("\n"):
        key, _, rest = line.strip().partition(" ")
        key, rest = key.lower(), rest.strip()
        if key == "newmtl":
            material = materials[" ".join(rest.split())] = ObjMaterial(path.parent)
        elif material is not None and rest:
            _read_statement(material, key, rest)
    return materials


def _read_statement(material: ObjMaterial, key: str, rest: str) -> None:
    values = _numbers(rest.split())
    if key == "kd":
        if values:
            material.colour = _read_colour(material, values)
        else:
            material.left_out.append(f"Kd {rest}")
    elif key == "map_kd":
        material.picture = _read_picture(material, rest)
    elif key.startswith(PICTURES):
        name = _split_options(rest)[1]
        material.others.append(name)
        material.left_out.append(f"{key} ({name})")
    elif values:
        _read_number(material, key, values)


def _read_number(material: ObjMaterial, key: str, values: list[float]) -> None:
    if key == "ns":
        material.shininess = max(values[0], 0.0)
    elif key == "pr":
        material.roughness = min(max(values[0], 0.0), 1.0)
    elif key == "pm":
        material.metallic = min(max(values[0], 0.0), 1.0)
    elif (key == "d" and values[0] < 1) or (key == "tr" and values[0] > 0):
        material.left_out.append(f"transparency ({key} {values[0]:g})")
    elif key == "ke" and max(values) > 0:
        material.left_out.append("emission (Ke)")


def _read_colour(material: ObjMaterial, values: list[float]) -> tuple[float, float, float]:
    """Return Kd in 0 to 1: a single value is grey; some programs write up to 255."""
    red, green, blue = values[:3] if len(values) >= 3 else values[:1] * 3
    if max(red, green, blue) > 1:
        material.left_out.append("Kd over 1 (taken as 0 to 255)")
        red, green, blue = red / 255, green / 255, blue / 255
    return (min(max(red, 0.0), 1.0), min(max(green, 0.0), 1.0), min(max(blue, 0.0), 1.0))


def _read_picture(material: ObjMaterial, rest: str) -> PictureMap | None:
    options, name = _split_options(rest)
    scale, offset = ([*_numbers(options.pop(key, [])), *usual][:2] for key, usual in (("-s", (1, 1)), ("-o", (0, 0))))
    is_clamped = options.pop("-clamp", ["off"]) == ["on"]
    material.left_out += [f"map_Kd {key}" for key in options]
    if not name:
        return None
    return PictureMap(name, (scale[0], scale[1]), (offset[0], offset[1]), is_clamped)


def _split_options(rest: str) -> tuple[dict[str, list[str]], str]:
    """Split options with their values from the picture's name, which may hold spaces."""
    options: dict[str, list[str]] = {}
    # the last word is the name, even if it looks like an option
    while match := re.match(r"(-[A-Za-z]+) +(?=\S)", rest):
        key = match[1].lower()
        rest = rest[match.end() :]
        values = options.setdefault(key, [])
        values.clear()
        # an option has up to as many values as its kind allows
        while len(values) < OPTIONS.get(key, 0) and (value := re.match(r"(\S+) +(?=\S)", rest)):
            if key in VECTORS and not _numbers([value[1]]):
                break
            values.append(value[1])
            rest = rest[value.end() :]
    return options, rest.strip().strip('"')


def _numbers(words: list[str]) -> list[float]:
    """Return the leading words that are finite numbers."""
    found: list[float] = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            break
        if not math.isfinite(value):
            break
        found.append(value)
    return found


def find_libraries(obj: Path, text: str) -> tuple[list[Path], list[str]]:
    """Find the material libraries that an OBJ of this text names, and the names of missing libraries.

    A line is a name, with its spaces, or, if there is no such file, several names.

    Raises:
        ToolkitError: a name leaves the folder.
    """
    found: dict[Path, None] = {}
    missing: list[str] = []
    for line in re.findall(r"^ *mtllib +(.*?) *$", text, re.MULTILINE):
        names = [line.strip('"')]
        # a name with spaces that is a file is a single name
        with suppress(ToolkitError):
            names = names if find_named(obj.parent, names[0]) is not None else names[0].split()
        for name in names:
            library = find_named(obj.parent, name)
            if library is None:
                missing.append(name)
            else:
                found[library] = None
    return list(found), missing
