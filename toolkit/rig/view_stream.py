"""Random views of objects taken apart, rendered in worker processes ahead of whoever uses them.

A *block* is one object in one studio: a backdrop, a light, and a turn towards the light. Block b of a seed depends on
(seed, kind, b) alone, through NumPy's `SeedSequence`, so it does not matter which process renders it, nor when.
"""

import multiprocessing
import os
import signal
import threading
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from types import TracebackType

import numpy as np

from toolkit.errors import ToolkitError
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera
from toolkit.rig.finish import develop
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.studio import LIGHTS, make_studio
from toolkit.rig.textured import TexturedView
from toolkit.rig.training import NEAR_VIEWS, ViewRanges, random_pose, turn_mesh

FOV_DEG = 30.5
"""Of the square picture: what the middle of a 4:3 frame of 40° shows."""
DETAIL = BakeDetail(key_rays=16, room_rays=64, surface_spacing=0.022, table_spacing=0.02)
"""Light for pictures of a few hundred pixels."""
TRAIN, HELD_OUT = 0, 1
"""Kinds of blocks: what is trained on and what is held out share no draw."""


@dataclass(frozen=True)
class Subject:
    """An object whose texture is left out.

    Attributes:
        mesh: on the table, some of its materials sharing the texture to be left out, none of these metallic.
        material: index of one that has it.
        bare: the object in its own paint, for comparison.
    """

    mesh: Mesh
    material: int
    bare: Mesh


@dataclass(frozen=True)
class ViewSettings:
    """How views are drawn.

    Attributes:
        ranges: where the camera may stand.
        image_px: side of the square pictures.
        studios: blocks that are used together; successive blocks show successive subjects.
        per_studio: views of each.
    """

    ranges: ViewRanges = NEAR_VIEWS
    image_px: int = 224
    studios: int = 4
    per_studio: int = 24


@dataclass(frozen=True)
class StreamedView:
    """A view, and the same picture of the object in its own paint where that was asked for, (s, s, 3) uint8 sRGB."""

    subject: int
    view: TexturedView
    bare: np.ndarray | None


def render_block(
    subjects: tuple[Subject, ...], settings: ViewSettings, seed: int, kind: int, block: int
) -> list[StreamedView]:
    """The views of one block; those held out with the object's own paint beside them."""
    draws = np.random.SeedSequence(seed, spawn_key=(kind, block))
    of_studio, *of_views = draws.spawn(1 + settings.per_studio)
    rng = np.random.default_rng(of_studio)
    subject = subjects[block % len(subjects)]
    light, turn = str(rng.choice(list(LIGHTS))), float(rng.uniform(0, 360))
    studio_seed = tuple(int(n) for n in of_studio.generate_state(2))
    studio = make_studio(studio_seed, float(subject.mesh.size_mm.max()), light=light)
    camera = Camera(settings.image_px, settings.image_px, FOV_DEG)
    mesh = turn_mesh(subject.mesh, turn)
    renderer = RaycastRenderer(mesh, studio, DETAIL)
    own_paint = RaycastRenderer(turn_mesh(subject.bare, turn), studio, DETAIL) if kind == HELD_OUT else None
    texture = mesh.materials[subject.material].texture
    views = []
    for i, of_view in enumerate(of_views):
        pose = random_pose(np.random.default_rng(of_view), mesh, camera, settings.ranges)
        bare = None if own_paint is None else develop(own_paint.render(camera, pose), (seed, kind, block, i))
        views.append(StreamedView(block % len(subjects), _pack(renderer.take_apart(camera, pose, texture)), bare))
    return views


def _pack(view: TexturedView) -> TexturedView:
    """Light and shares in half precision: a group of views is kept in memory."""
    half = {name: getattr(view, name).astype(np.float16) for name in ("behind", "dark", "coverage", "gain", "lod")}
    return replace(view, **half)


class ViewStream:
    """Groups of `settings.studios` blocks, in order, each rendered while the one before it is used.

    A context manager: leaving it ends the workers. Without workers the blocks are rendered when they are asked for.
    """

    def __init__(
        self, subjects: list[Subject], settings: ViewSettings, seed: int, groups: int, workers: int | None = None
    ) -> None:
        """Prepare `groups` groups of training views.

        Args:
            subjects: at least one.
            settings: how views are drawn.
            seed: of all draws.
            groups: how many there are; none is rendered beyond.
            workers: processes; None: one for each core but one, at least one.
        """
        self._subjects, self.settings, self._seed, self._groups = tuple(subjects), settings, seed, groups
        self._workers = count_workers() if workers is None else workers
        self._pool: ProcessPoolExecutor | None = None
        self._waiting: dict[int, list[Future]] = {}
        self._current: tuple[int, list[StreamedView]] | None = None

    def __enter__(self) -> "ViewStream":
        if self._workers:
            self._pool = ProcessPoolExecutor(
                self._workers, multiprocessing.get_context("spawn"), _start_worker, (self._subjects, self.settings)
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None
        self._waiting.clear()

    @property
    def views_per_group(self) -> int:
        """How many views a group has."""
        return self.settings.studios * self.settings.per_studio

    def group(self, number: int) -> list[StreamedView]:
        """The views of a group, and a beginning made with those after it."""
        if self._current is None or self._current[0] != number:
            self._current = None  # frees the group before
            for stale in [n for n in self._waiting if n < number]:
                del self._waiting[stale]
            views = [view for block in self._render(number, TRAIN) for view in block]
            self._current = number, views
        return self._current[1]

    def held_out(self, blocks: int) -> list[StreamedView]:
        """Views that no group holds, each beside the object in its own paint."""
        numbers = range(blocks)
        if self._pool is None:
            found = [render_block(self._subjects, self.settings, self._seed, HELD_OUT, b) for b in numbers]
        else:
            found = self._collect([self._pool.submit(_render_in_worker, self._seed, HELD_OUT, b) for b in numbers])
        return [view for block in found for view in block]

    def _render(self, number: int, kind: int) -> list[list[StreamedView]]:
        count = self.settings.studios
        if self._pool is None:
            numbers = range(number * count, (number + 1) * count)
            return [render_block(self._subjects, self.settings, self._seed, kind, b) for b in numbers]
        ahead = 1 + -(-self._workers // count)
        for n in range(number, min(number + 1 + ahead, self._groups)):
            if n not in self._waiting:
                blocks = range(n * count, (n + 1) * count)
                self._waiting[n] = [self._pool.submit(_render_in_worker, self._seed, kind, b) for b in blocks]
        return self._collect(self._waiting.pop(number))

    def _collect(self, futures: list[Future]) -> list[list[StreamedView]]:
        try:
            return [future.result() for future in futures]
        except BrokenProcessPool:
            raise ToolkitError(
                "a process that renders views was ended from outside, most likely for want of memory: the same command "
                "goes on from the last checkpoint; --workers 1 or a smaller --batch needs less"
            ) from None


def count_workers() -> int:
    """One process for each core that this one may use, but one; at least one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, cores - 1)


_worker: tuple[tuple[Subject, ...], ViewSettings] | None = None
"""What this process renders, where it is a worker."""


def _start_worker(subjects: tuple[Subject, ...], settings: ViewSettings) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    threading.Thread(target=_die_with_parent, daemon=True).start()
    _worker = subjects, settings


def _die_with_parent() -> None:
    """A worker whose parent was killed would wait for ever to hand over its views."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _render_in_worker(seed: int, kind: int, block: int) -> list[StreamedView]:
    if _worker is None:
        raise RuntimeError("the process was not started by ViewStream")
    subjects, settings = _worker
    return render_block(subjects, settings, seed, kind, block)
