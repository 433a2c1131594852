"""The variants of an object, from the table of booster kinds: what is on it in each, and its files for others."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from toolkit.core.errors import FieldError, one_of
from toolkit.core.files import read_bytes, write_bytes, write_text
from toolkit.core.rooms import explain_missing
from toolkit.core.workspace import Workspace
from toolkit.objects.export_mesh import Soundness, examine_solid, to_3mf, to_glb, to_obj
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import MOST_RECORDED_BYTES
from toolkit.objects.usdz import to_usdz
from toolkit.rig.applied.base import AppliedBooster
from toolkit.rig.applied.kinds import KINDS
from toolkit.rig.applied.tag import find_tag_booster, parse_tag
from toolkit.rig.booster_card import write_card

KIND_OF = {variant: kind for kind in KINDS for variant in (kind.variant, *kind.controls)}
"""Each variant but `unpatched` -> its kind, or the kind that it is a control of."""
CONTROLS_OF = {kind.variant: kind.controls for kind in KINDS if kind.controls}
CONTROLS = tuple(control for controls in CONTROLS_OF.values() for control in controls)
NOUNS = {kind.variant: kind.noun for kind in KINDS}
"""Variant of each kind -> what people call it."""
VARIANTS = ("unpatched", *NOUNS, *CONTROLS)
IN_PIECES = tuple(kind.variant for kind in KINDS if kind.find_pieces is not None)
"""Variants of boosters that are stuck on in flat pieces."""
ON_PAPER = tuple(variant for variant, kind in KIND_OF.items() if kind.is_on_paper)


def find_booster(
    workspace: Workspace, item: TableObject, variant: str, *, perfect: bool = False, seed: int = 0
) -> AppliedBooster | None:
    """Return what is put on `item` in a variant; None for `unpatched`.

    Args:
        variant: as `VARIANTS` lists them, or a tag as `parse_tag` takes it; the functions that find a kind say what its
            controls are.
        perfect: nothing is stuck on askew.
        seed: of how pieces misfit.

    Raises:
        ToolkitError: an unknown variant, or the booster that it needs is missing or broken.
    """
    # tags have no end of names, so that no table lists them
    if (tag := parse_tag(variant)) is not None:
        return find_tag_booster(item, variant, tag)
    if variant not in VARIANTS:
        raise explain_missing(f"variant:{variant}") or one_of("variant", variant, list(VARIANTS))
    return None if variant == "unpatched" else KIND_OF[variant].find(workspace, item, variant, perfect, seed)


def note_booster(booster: AppliedBooster | None) -> dict[str, Any]:
    """Return what a manifest states of a booster besides its hash."""
    return {"booster": None, "booster_mm": None} if booster is None else booster.note()


def apply_booster(item: TableObject, booster: AppliedBooster | None) -> Mesh:
    """Return the mesh to photograph: the object, with its booster on it."""
    return item.mesh if booster is None else booster.apply(item)


MeshFormat = Literal["glb", "obj", "3mf", "usdz"]
WRITERS = {"glb": to_glb, "3mf": to_3mf, "usdz": to_usdz}


@dataclass(frozen=True)
class ExportedObjects:
    """Objects that were written: of each its name, its files and how it stands to being printed in 3D."""

    variant: str
    made: tuple[tuple[str, list[Path], Soundness], ...]
    skipped: tuple[tuple[str, str], ...] = ()

    def as_json(self) -> list[dict[str, Any]]:
        """All of it for a script."""
        return [
            {"object": name, "variant": self.variant, "files": [str(file) for file in files], **asdict(solid)}
            for name, files, solid in self.made
        ]

    def lines(self) -> Iterator[str]:
        """A sentence for each."""
        for _, files, solid in self.made:
            yield f"{', '.join(str(file) for file in files)}: {solid.describe()}"


def export_objects(
    workspace: Workspace, names: Sequence[str], formats: Sequence[str], variant: str, out: Path | None,
    card: bool = False,
) -> ExportedObjects:  # fmt: skip
    """`export_object` of each."""
    made = ((name, *export_object(workspace, name, formats, variant, out, card)) for name in dict.fromkeys(names))
    return ExportedObjects(variant, tuple(made))


def export_object(
    workspace: Workspace, name: str, formats: Sequence[str] = ("glb",), variant: str = "unpatched",
    out: Path | None = None, card: bool = False,
) -> tuple[list[Path], Soundness]:  # fmt: skip
    """Write an object as GLB or USDZ (metres), OBJ or 3MF (millimetres).

    Args:
        formats: each becomes `NAME.FORMAT`; of another variant `NAME-VARIANT.FORMAT`.
        variant: what is on it, as `find_booster` knows it.
        card: whether all is written into a separate folder, with the booster's files and its card `README.md`.

    Returns:
        The files, pictures beside an OBJ not counted, and how the surface stands to being printed in 3D.

    Raises:
        ToolkitError: no such object, format or variant, or a file cannot be written.
    """
    # formats are checked before anything is written
    for form in formats:
        if form not in get_args(MeshFormat):
            raise one_of("format", form, list(get_args(MeshFormat)))
    item = load_object(workspace.object_spec(name))
    booster = find_booster(workspace, item, variant)
    mesh = apply_booster(item, booster)
    # an object with something on it gets a name of its own
    stem, folder = name if booster is None else f"{name}-{variant}", out or workspace.print_dir
    if folder.is_file():
        raise FieldError("expected a folder", {"out": folder})
    files = []
    if card:
        folder = folder / stem
        files = _write_card(workspace, item, variant, booster, folder)
    # an OBJ brings its pictures and materials: only its mesh is listed
    for form in dict.fromkeys(formats):
        contents = to_obj(mesh, stem) if form == "obj" else {f"{stem}.{form}": WRITERS[form](mesh, stem)}
        for file, content in contents.items():
            write_bytes(folder / file, content)
        files.append(folder / f"{stem}.{form}")
    # the bare object is examined: paper is no solid
    return files, examine_solid(item.mesh)


def _write_card(
    workspace: Workspace, item: TableObject, variant: str, booster: AppliedBooster | None, folder: Path
) -> list[Path]:
    """Copy the files of a booster, and write its card; returns the card."""
    kind = KIND_OF.get(variant)
    if booster is None or kind is None or kind.files is None or variant != kind.variant:
        raise FieldError(f"has no card: expected {', '.join(NOUNS)}", {"variant": variant})
    files = kind.files(workspace, item)
    record = json.loads(read_bytes(files[0], MOST_RECORDED_BYTES))  # it was validated when the booster was found
    for file in files:
        write_bytes(folder / file.name, read_bytes(file, MOST_RECORDED_BYTES), folder)
    return [write_text(folder / "README.md", write_card(item, kind, booster, record, files), folder)]
