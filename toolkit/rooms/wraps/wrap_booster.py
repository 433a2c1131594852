"""A wrap's pieces, stuck on an object."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.rig.applied.base import AppliedBooster, BoosterKind, Pieces, StoredBooster, StoredTraining
from toolkit.rooms.wraps.config import Misfit
from toolkit.rooms.wraps.wrap import (
    MAP_FILE,
    RECORD_FILE,
    Wrap,
    WrapRecord,
    check_wrap,
    find_wrap,
    hash_wrap,
    piece_name,
    read_wrap,
    wrap_folder,
)
from toolkit.rooms.wraps.wrapped import draw_places, fill_canvas, wear_wrap


@dataclass(frozen=True)
class WrapBooster(AppliedBooster):
    """A wrap's canvas, on pieces that are stuck on the object."""

    wrap: Wrap = field(kw_only=True)  # whose pieces they are
    # of their places; None if each lies exactly in its own
    misfit: Misfit | None = field(default_factory=Misfit, kw_only=True)
    seed: int = field(default=0, kw_only=True)  # of how each misfits
    # share of what cameras see that was asked for; None: all that there is
    coverage: float | None = field(default=None, kw_only=True)

    def apply(self, item: TableObject) -> Mesh:
        """Return the object with the pieces on it."""
        places = draw_places(self.wrap, self.misfit, Draws(self.seed, 0, f"stick {item.name}"))
        return wear_wrap(item.mesh, self.wrap, self.pixels, places)

    def describe(self, item: TableObject) -> dict[str, Any]:
        """Return the wrap's hash, the map of its pieces, and how they misfit."""
        covers = {} if self.coverage is None else {"coverage": self.coverage}
        return {"wrap": self.sha256, "map": self.wrap.record.map_sha256, **covers, **self._describe_misfit()}

    def note(self) -> dict[str, Any]:
        """Return its name, the number of its pieces, and how they misfit."""
        return {"booster": self.name, "pieces": len(self.wrap.pieces), **self._describe_misfit()}

    @property
    def texel_mm(self) -> float:
        """Side of a texel of the canvas, in mm."""
        return self.wrap.record.texel_mm

    @property
    def covered(self) -> float | None:
        """Share of what cameras see that its pieces cover; None if all of them are on."""
        return None if self.coverage is None else self.wrap.record.covered

    def covering(self, item: TableObject, share: float) -> "WrapBooster":
        """Return the wrap with its best pieces alone, up to so large a share of what cameras see."""
        from toolkit.rooms.wraps.wrap_plan import take_best  # brings the renderer, which most commands do without

        return replace(self, wrap=take_best(self.wrap, item, share), coverage=share)

    def draw_guide(self, item: TableObject) -> Callable[[Any, Any], None]:
        """Return what draws the object from six sides, its pieces numbered."""
        from toolkit.rooms.wraps.printing.wrap_views import draw_sides, place_sides  # bring the page

        return partial(place_sides, views=draw_sides(item.mesh, self.wrap))

    def list_facts(self) -> dict[str, str]:
        """Return number and material of its pieces, and what they cover."""
        record = self.wrap.record
        return {"pieces": f"{len(record.pieces)} of {record.material}, {record.covered:.0%} of what is seen"}

    def _describe_misfit(self) -> dict[str, Any]:
        if self.misfit is None:
            return {"misfit": None}
        return {"misfit": self.misfit.record(), "misfit_seed": self.seed}


def find_wrap_booster(
    workspace: Workspace, item: TableObject, variant: str, perfect: bool = False, seed: int = 0
) -> WrapBooster:
    """Return an object's wrap, its pieces a little beside their places, or exactly in them with `perfect`.

    Raises:
        ToolkitError: the wrap is missing or broken, or nothing is trained on it.
    """
    wrap = find_wrap(workspace, item)
    if wrap.record.booster is None and wrap.record.picture is None:
        raise ToolkitError(
            f"wrap '{wrap.record.name}' of object '{item.name}' is a plan with nothing trained on it: train it "
            f"with 'toolkit train-wrap --object {item.name}', or leave the variant wrapped out"
        )
    pixels = fill_canvas(wrap, len(item.mesh.faces))
    misfit = None if perfect else Misfit()
    return WrapBooster(pixels, hash_wrap(wrap.record), wrap.record.name, wrap=wrap, misfit=misfit, seed=seed)


def list_wrap_files(workspace: Workspace, item: TableObject) -> list[Path]:
    """Return record, map and pictures of an object's wrap."""
    folder = wrap_folder(workspace, item)
    if folder is None:
        return []
    return _list_files(folder, read_json(folder / RECORD_FILE, WrapRecord))


def _list_files(folder: Path, record: WrapRecord) -> list[Path]:
    return [folder / name for name in (RECORD_FILE, MAP_FILE, *(piece_name(piece.number) for piece in record.pieces))]


def read_stored_wrap(folder: Path) -> StoredBooster:
    """Read a wrap; raises as `read_wrap`, or if nothing is trained on it."""
    wrap = read_wrap(folder)
    record, training = wrap.record, wrap.record.booster
    if training is None:
        raise ToolkitError(f"{folder}: is a plan with nothing trained on it: expected a trained wrap")
    assert wrap.pixels is not None  # `read_wrap` reads them
    return StoredBooster(
        wrap.pixels, hash_wrap(record), record.class_name, training.class_index, training.networks,
        _list_files(folder, record), check=partial(check_wrap, wrap),
    )  # fmt: skip


def list_wrap_trainings(workspace: Workspace) -> Iterator[StoredTraining]:
    """Yield the training of every trained wrap."""
    for folder in workspace.wraps().values():
        with suppress(ToolkitError):
            wrap = read_json(folder / RECORD_FILE, WrapRecord)
            if wrap.booster is not None:
                yield StoredTraining(hash_wrap(wrap), wrap.name, wrap.class_name or "", wrap.booster.networks)


def find_wrap_pieces(workspace: Workspace, item: TableObject) -> Pieces | None:
    """Return the pieces of an object's wrap; None without a wrap. Raises as `find_wrap` if the wrap is broken."""
    if (folder := wrap_folder(workspace, item)) is None:
        return None
    wrap = read_wrap(folder)
    check_wrap(wrap, item)
    record, placed = wrap.record, list(zip(wrap.pieces, wrap.record.pieces, strict=True))
    return Pieces(
        record.name, record.booster is not None or record.picture is not None, fill_canvas(wrap, len(item.mesh.faces)),
        record.texel_mm, faces=tuple(piece.faces for piece, _ in placed),
        corners_px=tuple(np.array(at.origin_px) + piece.flat_mm / record.texel_mm for piece, at in placed),
    )  # fmt: skip


WRAP = BoosterKind(
    "wrapped", "wrap", find_wrap_booster, files=list_wrap_files, read=read_stored_wrap,
    list_trainings=list_wrap_trainings, find_pieces=find_wrap_pieces, folder="print/wraps/{object}",
    print_options="--wrap {object}",
)  # fmt: skip
