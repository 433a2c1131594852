"""A wrap's pieces, stuck on an object."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.wrap import (
    MAP_FILE,
    RECORD_FILE,
    Wrap,
    WrapRecord,
    find_wrap,
    hash_wrap,
    piece_name,
    wrap_folder,
)
from toolkit.rig import Misfit
from toolkit.rig.applied.base import AppliedBooster, BoosterKind
from toolkit.rig.wrapped import draw_places, fill_canvas, wear_wrap


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
        from toolkit.rig.wrap_plan import take_best  # brings the renderer, which most commands do without

        return replace(self, wrap=take_best(self.wrap, item, share), coverage=share)

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
    pieces = read_json(folder / RECORD_FILE, WrapRecord).pieces
    return [folder / name for name in (RECORD_FILE, MAP_FILE, *(piece_name(piece.number) for piece in pieces))]


WRAP = BoosterKind("wrapped", "wrap", find_wrap_booster, files=list_wrap_files)
