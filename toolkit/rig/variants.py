"""What is put on an object in each variant: its patch, wrap or texture, a control, or nothing; and its files."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import read_json, sha256_bytes, write_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.atlas import Atlas, apply_texture, make_atlas
from toolkit.objects.export_mesh import Soundness, examine_solid, to_3mf, to_glb, to_obj
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import (
    COMMAND,
    Patch,
    Texture,
    TexturedObjectRecord,
    TextureRecord,
    encode_png,
    read_patch,
    read_texture,
    read_usable,
)
from toolkit.objects.spec import ObjectSpec
from toolkit.objects.wrap import Wrap, find_wrap, hash_wrap
from toolkit.rig import Misfit
from toolkit.rig.mount import MountedSheet, make_flat_sheet, mount_sheets, wear_sheets
from toolkit.rig.wrapped import draw_places, fill_canvas, wear_wrap


def find_texture(workspace: Workspace, item: TableObject) -> Texture:
    """The texture of an object: the one that bears its name, else the first by name that was trained on it.

    Broken textures of other names are left out, see `read_usable`.

    Raises:
        ToolkitError: there is none, its files do not match, or the object's mesh is another than it was trained on.
    """
    textures = dict(sorted(workspace.textures().items()))
    for name, record in read_usable(_read_texture_record, textures, item.name):
        # one that lacks its record is refused by `read_texture`, and only where it is the object's by its name
        if name == item.name if record is None else record.entry(item.name):
            texture = read_texture(textures[name])
            check_fit(item, texture)
            return texture
    raise ToolkitError(
        f"no texture for object '{item.name}': train one with '{COMMAND} --object {item.name}', or leave the variants "
        "with textures out"
    )


def _read_texture_record(png_file: Path) -> TextureRecord | None:
    record_file = png_file.with_suffix(".json")
    return read_json(record_file, TextureRecord) if record_file.is_file() else None


def check_fit(item: TableObject, texture: Texture) -> TexturedObjectRecord:
    """What the record says of an object, if the object is still the one that the texture was trained on.

    Raises:
        ToolkitError: the texture is not for it, or its mesh changed.
    """
    name, again = texture.record.name, f"train again with '{COMMAND} --object {item.name}'"
    entry = texture.record.entry(item.name)
    if entry is None:
        raise ToolkitError(f"texture '{name}' was not trained on object '{item.name}': {again}")
    if not item.has_shape(entry.mesh_sha256):
        raise ToolkitError(f"{item.name}: the object's mesh changed after training of its texture '{name}': {again}")
    corner_uv = texture.corner_uv.get(item.name)
    if corner_uv is not None and len(corner_uv) != len(item.mesh.faces):
        raise ToolkitError(
            f"{item.name}: texture '{name}' has coordinates of {len(corner_uv)} triangles, the object has "
            f"{len(item.mesh.faces)}: {again}"
        )
    return entry


def fit_texture(item: TableObject, texture: Texture) -> Atlas:
    """The atlas that a texture was trained on, rebuilt from the object's mesh and what is stored beside the texture.

    Raises:
        ToolkitError: as `check_fit`.
    """
    entry = check_fit(item, texture)
    return make_atlas(
        item.mesh, texture.record.n_px, entry.keep, texture.keep_images.get(item.name),
        unwrap=entry.unwrapped, corner_uv=texture.corner_uv.get(item.name),
    )  # fmt: skip


def paint_object(item: TableObject, texture: Texture, pixels: np.ndarray) -> Mesh:
    """The object with pixels (n, n, 3) uint8 sRGB where a texture of it has its own; raises as `check_fit`."""
    return apply_texture(fit_texture(item, texture), pixels)


CONTROLS_OF = {
    "patched": ("wrong-patch", "random-patch", "grey-patch", "patch-alone"),
    "textured": ("random-texture", "grey-texture"),
}
CONTROLS = tuple(control for controls in CONTROLS_OF.values() for control in controls)
WRAPPED = "wrapped"
VARIANTS = ("unpatched", *CONTROLS_OF, WRAPPED, *CONTROLS)
ON_PAPER = ("patched", *CONTROLS_OF["patched"])
GREY = 128


@dataclass(frozen=True)
class Booster:
    """A square of pixels that goes on an object.

    Attributes:
        pixels: (n, n, 3) uint8 sRGB.
        sha256: of its PNG.
        name: of the patch, of the texture, or of the control.
    """

    pixels: np.ndarray
    sha256: str
    name: str


@dataclass(frozen=True)
class Print(Booster):
    """A booster on paper.

    Attributes:
        sizes_mm: side on each sheet of paper, in the order of the object's mounts.
        alone: lies flat on the table, and the object is not there.
    """

    sizes_mm: tuple[float, ...]
    alone: bool = False


@dataclass(frozen=True)
class Paint(Booster):
    """A booster all over the object: its pixels take the place that a texture has there."""

    texture: Texture


@dataclass(frozen=True)
class Sheets(Booster):
    """A wrap's canvas, on pieces that are stuck on the object.

    Attributes:
        wrap: whose pieces they are.
        misfit: of their places; None where each lies exactly in its own.
        seed: of how each misfits.
        coverage: share of what cameras see that was asked for; None: all that there is.
    """

    wrap: Wrap
    misfit: Misfit | None = field(default_factory=Misfit)
    seed: int = 0
    coverage: float | None = None


Worn = Print | Paint | Sheets
"""What a variant puts on an object."""


def find_booster(
    workspace: Workspace, item: TableObject, variant: str, *, perfect: bool = False, seed: int = 0
) -> Worn | None:  # fmt: skip
    """What is put on `item` in a variant; None for `unpatched`.

    - `patched`: its own patch, on each of its sheets; `patch-alone`: the first, flat on the table without the object.
    - `wrong-patch`: the next patch by name that was trained for another class.
    - `textured`: its own texture.
    - `wrapped`: its own wrap, its pieces a little beside their places; with `perfect` exactly in them.
    - `random-patch`, `random-texture`: noise with the colours of neither, drawn for the object's name alone;
      `grey-patch`, `grey-texture`: middle grey; in the place and with the texels of the object's own.

    Args:
        workspace, item, variant: as above.
        perfect: nothing is stuck on askew.
        seed: of how a wrap's pieces misfit.

    Raises:
        ToolkitError: an unknown variant, or the patch, wrap or texture that it needs is missing or broken.
    """
    if variant not in VARIANTS:
        raise one_of("variant", variant, list(VARIANTS))
    if variant == "unpatched":
        return None
    if variant == "textured" or variant in CONTROLS_OF["textured"]:
        return _find_paint(workspace, item, variant)
    if variant == WRAPPED:
        wrap = find_wrap(workspace, item)
        if wrap.record.booster is None:
            raise ToolkitError(
                f"wrap '{wrap.record.name}' of object '{item.name}' is a plan with nothing trained on it: train it "
                f"with 'toolkit train-wrap --object {item.name}', or leave the variant wrapped out"
            )
        pixels = fill_canvas(wrap, len(item.mesh.faces))
        return Sheets(pixels, hash_wrap(wrap.record), wrap.record.name, wrap, None if perfect else Misfit(), seed)
    own = find_patch(workspace, item)
    sizes_mm = item.spec.sizes_mm(own.size_mm)
    if variant == "patch-alone":
        return Print(own.pixels, own.record.png_sha256, own.record.name, sizes_mm[:1], alone=True)
    if variant == "patched":
        return Print(own.pixels, own.record.png_sha256, own.record.name, sizes_mm)
    if variant == "wrong-patch":
        wrong = _next_patch(workspace, own)
        return Print(wrong.pixels, wrong.record.png_sha256, wrong.record.name, sizes_mm)
    pixels = _control_pixels(variant, item, own.record.n_px)
    return Print(pixels, sha256_bytes(encode_png(pixels)), variant, sizes_mm)


def _find_paint(workspace: Workspace, item: TableObject, variant: str) -> Paint:
    own = find_texture(workspace, item)
    if variant == "textured":
        return Paint(own.pixels, own.record.png_sha256, own.record.name, own)
    pixels = _control_pixels(variant, item, own.record.n_px)
    return Paint(pixels, sha256_bytes(encode_png(pixels)), variant, own)


def _control_pixels(variant: str, item: TableObject, n: int) -> np.ndarray:
    if variant.startswith("grey-"):
        return np.full((n, n, 3), GREY, np.uint8)
    return np.random.default_rng(list(item.name.encode())).integers(0, 256, (n, n, 3), dtype=np.uint8)


def describe_booster(item: TableObject, booster: Worn) -> dict[str, Any]:
    """All that, beside the object's mesh, decides how it looks with a booster: what a picture's hash is made of."""
    if isinstance(booster, Paint):
        entry = check_fit(item, booster.texture)
        atlas = entry.model_dump(include={"unwrapped", "uv_sha256", "keep", "keep_image_sha256"})
        return {"texture": booster.sha256, "atlas": atlas}
    if isinstance(booster, Sheets):
        covers = {} if booster.coverage is None else {"coverage": booster.coverage}
        return {"wrap": booster.sha256, "map": booster.wrap.record.map_sha256, **covers, **_describe_misfit(booster)}
    mounts = [mount.model_dump() for mount in item.spec.mounts]
    if len(mounts) == 1 or booster.alone:
        return {"patch": booster.sha256, "mm": booster.sizes_mm[0], "mount": mounts[0]}
    return {"patch": booster.sha256, "mm": list(booster.sizes_mm), "mount": mounts}


def note_booster(booster: Worn | None) -> dict[str, Any]:
    """What a manifest says of a booster besides its hash: its name, and its side in mm of paper or in texels.

    Of several sheets their sides are a list; of a wrap it is said how its pieces misfit.
    """
    if isinstance(booster, Paint):
        return {"booster": booster.name, "booster_px": len(booster.pixels)}
    if isinstance(booster, Sheets):
        return {"booster": booster.name, "pieces": len(booster.wrap.pieces), **_describe_misfit(booster)}
    if booster is None:
        return {"booster": None, "booster_mm": None}
    sizes_mm = booster.sizes_mm
    return {"booster": booster.name, "booster_mm": sizes_mm[0] if len(sizes_mm) == 1 else list(sizes_mm)}


def _describe_misfit(booster: Sheets) -> dict[str, Any]:
    if booster.misfit is None:
        return {"misfit": None}
    return {"misfit": booster.misfit.record(), "misfit_seed": booster.seed}


def apply_booster(item: TableObject, booster: Worn | None) -> Mesh:
    """The mesh to photograph: the object, the object with its sheets or pieces on it or painted, or a sheet alone."""
    if booster is None:
        return item.mesh
    if isinstance(booster, Paint):
        return paint_object(item, booster.texture, booster.pixels)
    if isinstance(booster, Sheets):
        places = draw_places(booster.wrap, booster.misfit, Draws(booster.seed, 0, f"stick {item.name}"))
        return wear_wrap(item.mesh, booster.wrap, booster.pixels, places)
    if booster.alone:
        return make_flat_sheet(booster.pixels, booster.sizes_mm[0])
    return wear_sheets(item.mesh, mount_printed(item, booster))[0]


def mount_printed(item: TableObject, booster: Print) -> list[MountedSheet]:
    """Each sheet of a booster where the object's spec says; raises as `mount_sheets`."""
    return mount_sheets(item.mesh, booster.pixels, item.spec.mounts, booster.sizes_mm, item.name)


def find_patch(workspace: Workspace, item: TableObject) -> Patch:
    """The patch of an object: the one that bears its name, else one trained for its class.

    Raises:
        ToolkitError: there is none, or its files do not match.
    """
    file = find_patch_file(workspace, item.spec)
    if file is not None:
        return read_patch(file)
    chosen = workspace.patch_set
    where = f" --model {chosen} --out {workspace.patches_dir}" if chosen else ""
    raise ToolkitError(
        f"no patch for object '{item.name}' (class '{item.spec.class_name}'){f' in {chosen}' if chosen else ''}: train "
        f"one with 'toolkit train-patch --object {item.name}{where}', or shoot "
        "--variant unpatched"
    )


def find_patch_file(workspace: Workspace, spec: ObjectSpec) -> Path | None:
    """The PNG that `find_patch` reads; None where the object has no patch.

    Broken patches of other names are left out, see `read_usable`.
    """
    patches = workspace.patches()
    for name in (spec.name, str(spec.class_name).replace(" ", "_")):
        if name in patches:
            return patches[name]
    for name, patch in read_usable(read_patch, patches):
        if spec.class_name in (patch.record.class_name, patch.record.class_index):
            return patches[name]
    return None


def _next_patch(workspace: Workspace, own: Patch) -> Patch:
    patches = workspace.patches()
    names = sorted(patches)
    after = [name for name in names if name > own.record.name] + [name for name in names if name < own.record.name]
    for _, other in read_usable(read_patch, {name: patches[name] for name in after}):
        if other.record.class_index != own.record.class_index:
            return other
    raise ToolkitError("the variant wrong-patch needs a patch of another class: train one, or leave the variant out")


MeshFormat = Literal["glb", "obj", "3mf"]


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
    workspace: Workspace, names: Sequence[str], formats: Sequence[str], variant: str, out: Path | None
) -> ExportedObjects:
    """`export_object` of each."""
    made = ((name, *export_object(workspace, name, formats, variant, out)) for name in dict.fromkeys(names))
    return ExportedObjects(variant, tuple(made))


def export_object(
    workspace: Workspace, name: str, formats: Sequence[str] = ("glb",), variant: str = "unpatched",
    out: Path | None = None,
) -> tuple[list[Path], Soundness]:  # fmt: skip
    """Write an object as GLB (metres), OBJ or 3MF (millimetres).

    Args:
        workspace: whose object it is.
        name: of the object.
        formats: each becomes `NAME.FORMAT`; of another variant `NAME-VARIANT.FORMAT`.
        variant: what is on it, as `find_booster` knows it.
        out: folder, `print/` by default.

    Returns:
        The files, pictures beside an OBJ not counted, and how the surface stands to being printed in 3D.

    Raises:
        ToolkitError: no such object, format or variant, or a file cannot be written.
    """
    for one in formats:
        if one not in get_args(MeshFormat):
            raise one_of("format", one, list(get_args(MeshFormat)))
    item = load_object(workspace.object_spec(name))
    booster = find_booster(workspace, item, variant)
    mesh = apply_booster(item, booster)
    stem, folder = name if booster is None else f"{name}-{variant}", out or workspace.print_dir
    if folder.is_file():
        raise FieldError("expected a folder", {"out": folder})
    files = []
    for one in dict.fromkeys(formats):
        if one == "obj":
            contents = to_obj(mesh, stem)
        else:
            contents = {f"{stem}.{one}": (to_glb if one == "glb" else to_3mf)(mesh, stem)}
        for file, content in contents.items():
            write_bytes(folder / file, content)
        files.append(folder / f"{stem}.{one}")
    return files, examine_solid(item.mesh)
