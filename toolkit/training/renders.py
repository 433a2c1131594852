"""Renders to train a classifier on: processes that each draw an object in a studio, kept as shards on disk."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import astuple, dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np

from toolkit.core.child import open_pool
from toolkit.core.errors import ToolkitError
from toolkit.core.files import write_bytes
from toolkit.core.rooms import ask_room
from toolkit.core.work import Work
from toolkit.objects.mesh import Mesh

EVERYDAY, RIG = "everyday", "rig"
RENDERS = Work("renders", 2)


@dataclass(frozen=True)
class RenderUnit:
    """Pictures of an object in a studio, the work of a process at a time.

    Attributes:
        source: `everyday`, or the path of an object's spec.
        label: of the class.
        seed: of all draws: the run's, the class's, whether they are held out, and the number of the object.
        views: how many pictures.
        px: their side.
    """

    source: str
    label: str
    seed: tuple[int, ...]
    views: int
    px: int

    @property
    def name(self) -> str:
        """File name of the shard; equal inputs have equal names."""
        return RENDERS.key(*astuple(self))[:20] + ".npy"


def render_unit(unit: RenderUnit) -> np.ndarray:
    """(views, px, px, 3) uint8 sRGB; depends on the unit alone."""
    from toolkit.rig.views import THUMBNAIL_STUDIO, WIDE_VIEWS, ViewSettings, render_pictures

    settings = ViewSettings(WIDE_VIEWS, unit.px, per_studio=unit.views)
    taken = render_pictures(
        _make_mesh(unit), unit.views, settings, unit.seed, setting=THUMBNAIL_STUDIO, threads=1
    )  # units are spread over processes
    return np.stack(list(taken))


def _make_mesh(unit: RenderUnit) -> Mesh:
    if unit.source != EVERYDAY:
        return _load_mesh(unit.source)
    from toolkit.objects.mesh import check_mesh, place_on_table

    # a draw of its own: the views have the unit's seed itself
    seed = int(np.random.default_rng([*unit.seed, 0x0B]).integers(2**31))
    mesh = ask_room(EVERYDAY)[unit.label](np.random.default_rng(seed))
    return place_on_table(check_mesh(mesh, f"everyday object '{unit.label}', seed {seed}"))


# units of the same object follow each other, and share its mesh
@lru_cache(maxsize=8)
def _load_mesh(spec_file: str) -> Mesh:
    from toolkit.objects.load import load_object

    return load_object(Path(spec_file)).mesh


def render_shards(units: Sequence[RenderUnit], folder: Path, workers: int, advance: Callable[[int], None]) -> None:
    """Render what is not there yet into `folder`, a file for each unit, each whole or absent.

    Args:
        units: what to render.
        folder: of the shards.
        workers: processes.
        advance: called with the number of pictures of each finished unit.

    Raises:
        ToolkitError: an object cannot be made, the disk is full, or a process was killed.
    """
    waiting = [unit for unit in units if not (folder / unit.name).is_file()]
    if not waiting:
        return
    pool = open_pool(min(workers, len(waiting)))
    try:
        running: dict[Future, RenderUnit] = {}
        todo = iter(waiting)
        while True:
            # few at a time, so that Ctrl-C does not wait for a long queue
            while len(running) < 2 * workers and (unit := next(todo, None)) is not None:
                running[pool.submit(_write_shard, unit, folder)] = unit
            if not running:
                return
            # finished in any order: each file has its own name
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                done.result()
                advance(running.pop(done).views)
    except BrokenProcessPool:
        raise ToolkitError(
            "a process that renders was killed (out of memory?): run the same command again, it goes on where it "
            "stopped; fewer workers need less memory"
        ) from None
    finally:
        # what is being rendered is finished and kept, what is queued is dropped
        pool.shutdown(wait=True, cancel_futures=True)


def _write_shard(unit: RenderUnit, folder: Path) -> None:
    buffer = BytesIO()
    np.save(buffer, render_unit(unit), allow_pickle=False)
    write_bytes(folder / unit.name, buffer.getvalue())
