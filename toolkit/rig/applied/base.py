"""The protocol of boosters on an object: what each kind does to it, and what is written of it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from toolkit.core.errors import ToolkitError
from toolkit.core.files import read_json
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject
from toolkit.objects.mesh import Mesh
from toolkit.objects.records import BoosterRecord, NetworkRecord
from toolkit.rig.mount import MountedSheet, PaperMargin

GREY = 128
"""Code of the grey that controls are made of."""


@dataclass(frozen=True)
class AppliedBooster(ABC):
    """A booster that is put on an object, such as the printed patch of the variant `patched`.

    To add a kind, derive a class, write a `find` function, and register both:

        register(BoosterKind("banded", "band", find_band))

    A room offers its kind as `variant:banded` in place of the call.
    """

    pixels: np.ndarray  # (n, n, 3) uint8 sRGB
    sha256: str  # of its PNG, or of its record
    name: str  # of the patch, of the texture, or of the control
    # side of each sheet of paper, in the order of the object's mounts; empty if it is on no sheets
    sizes_mm: tuple[float, ...] = ()
    alone: bool = False  # lies flat on the table, and the object is not there
    margin: PaperMargin = "white"  # what is on the paper around the patch on each sheet

    @abstractmethod
    def apply(self, item: TableObject) -> Mesh:
        """Return the mesh to photograph; raises a `ToolkitError` if the booster does not fit the object."""

    @abstractmethod
    def describe(self, item: TableObject) -> dict[str, Any]:
        """Return all that, beside the object's mesh, decides how the object looks: what a picture's hash is made of."""

    @abstractmethod
    def note(self) -> dict[str, Any]:
        """Return what a manifest states of the booster besides its hash."""

    @property
    def texel_mm(self) -> float | None:
        """Side of a texel on paper, in mm; None if the booster is not printed."""
        return None

    def printed(self, change: Callable[[np.ndarray], np.ndarray]) -> "AppliedBooster":
        """Return what is printed of it in the colours of a printer, on that printer's paper.

        Args:
            change: from (n, n, 3) uint8 sRGB of a file to the colours on paper; white becomes bare paper.
        """
        red, green, blue = change(np.full((1, 1, 3), 255, np.uint8))[0, 0].tolist()
        margin: PaperMargin = "bleed" if self.margin == "bleed" else (red, green, blue)
        return replace(self, pixels=change(self.pixels), margin=margin)

    @property
    def covered(self) -> float | None:
        """Share of what cameras see that it covers; None if nobody asked for a share."""
        return None

    def sheets(self, item: TableObject) -> list[MountedSheet]:
        """Return each sheet of paper where the object's spec places it; raises as `apply`."""
        return []

    def describe_place(self, item: TableObject) -> dict[str, Any]:
        """Return size and place of its sheets, which two images of a pair must share."""
        return {}

    def covering(self, item: TableObject, share: float) -> "AppliedBooster":
        """Return the booster on so large a share of what cameras see; itself if its kind has no parts to leave off."""
        return self

    def draw_guide(self, item: TableObject) -> Callable[[Any, Any], None] | None:
        """Return what draws on a `Pdf`, in a `Rect`, where its pieces go; None if it has no pieces."""
        return None

    def list_facts(self) -> dict[str, str]:
        """Return what its card tells of it beside sizes and hashes."""
        return {}


@dataclass(frozen=True)
class Pieces:
    """Flat pieces on an object's surface, numbered from 1, and the canvas of their pictures.

    Attributes:
        name: of the booster.
        is_finished: whether a picture was made for them; else they are a plan in the object's own paint.
        canvas: (n, n, 3) uint8 sRGB, row 0 is v = 1.
        texel_mm: side of a texel.
        faces: of each piece, (k,) int32 rows of the object's mesh.
        corners_px: of each piece, (k, 3, 2) float64 places of its faces' corners on the canvas, right and up.
    """

    name: str
    is_finished: bool
    canvas: np.ndarray
    texel_mm: float
    faces: tuple[np.ndarray, ...]
    corners_px: tuple[np.ndarray, ...]


class StoredTraining(NamedTuple):
    """The training of a booster that has files: its hash as in manifests, its name and class, and the networks."""

    sha256: str
    name: str
    class_name: str
    networks: Sequence[NetworkRecord]


@dataclass(frozen=True)
class StoredBooster:
    """A booster that was read from its files, whatever object it is for.

    Attributes:
        pixels: (n, n, 3) uint8 sRGB.
        sha256: as in manifests.
        class_name, class_index: class of its training.
        networks: that trained it.
        files: its record, and all that belongs to it.
        check: raises a `ToolkitError` if it is for another mesh.
        size_mm: printed side of a patch; None for other kinds.
    """

    pixels: np.ndarray
    sha256: str
    class_name: str | None
    class_index: int
    networks: Sequence[NetworkRecord]
    files: Sequence[Path]
    check: Callable[[TableObject], object]
    size_mm: float | None = None


Find = Callable[[Workspace, TableObject, str, bool, int], AppliedBooster]
"""(workspace, object, variant, perfect, seed) -> what is put on; with `perfect` exactly in its place."""


@dataclass(frozen=True)
class BoosterKind:
    """A kind of booster, as commands, reports and pages know it."""

    variant: str  # name of the folder that its images lie in, such as `patched`
    noun: str  # what people call it, such as `patch`
    find: Find  # finds what a workspace has of it for an object, and its controls
    controls: tuple[str, ...] = ()  # variants that ask whether it is this booster, in the order of tables
    is_on_paper: bool = False  # it and its controls are on sheets at the place that the object's spec names
    is_painted: bool = False  # it and its controls are the object's own surface, so that nobody can stick them on
    # lists the files of an object's booster, its record first; None if it has none
    files: Callable[[Workspace, TableObject], list[Path]] | None = None
    # reads a booster from its PNG or folder, checked against its record; None if it has no files
    read: Callable[[Path], StoredBooster] | None = None
    # yields the training of each booster of a workspace; broken records are reported when they are used
    list_trainings: Callable[[Workspace], Iterator[StoredTraining]] | None = None
    # finds the pieces that an object's booster consists of, if it has any yet; None if the kind has no pieces
    find_pieces: Callable[[Workspace, TableObject], Pieces | None] | None = None
    folder: str = ""  # of its files in a workspace; {object} is the object's name
    print_options: str = ""  # of `toolkit print`; empty if it is not printed


def draw_control(variant: str, item: TableObject, n: int) -> np.ndarray:
    """(n, n, 3) uint8 pixels of a control: middle grey, or noise that is drawn for the object's name alone."""
    if variant.startswith("grey-"):
        return np.full((n, n, 3), GREY, np.uint8)
    return np.random.default_rng(list(item.name.encode())).integers(0, 256, (n, n, 3), dtype=np.uint8)


def read_trainings(pngs: Iterable[Path], model: type[BoosterRecord]) -> Iterator[StoredTraining]:
    """Yield the training of each picture whose record can be read."""
    for png in pngs:
        with suppress(ToolkitError):
            record = read_json(png.with_suffix(".json"), model)
            yield StoredTraining(record.png_sha256, record.name, record.class_name, record.networks)
