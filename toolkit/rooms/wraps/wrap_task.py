"""Train what is on the pieces of a wrap: what `toolkit train-wrap` runs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from toolkit.boosters.booster import BoosterFiles, TrainedBooster, train_booster
from toolkit.boosters.detectors import meet_networks
from toolkit.boosters.linear_view import ViewBatch, batch_views, show_texture
from toolkit.boosters.pixels import Network, Target, from_picture, list_networks
from toolkit.boosters.texture import CHECKPOINT_EVERY_S, SurfaceTask, say_held_out
from toolkit.boosters.texture_objects import TexturedObject, choose_class, load_inputs
from toolkit.boosters.validation import WeatherValidation
from toolkit.core.console import notice, progress
from toolkit.core.draws import Draws
from toolkit.core.files import write_bytes
from toolkit.core.work import INPUTS, Work, find_made
from toolkit.core.workspace import PACKAGE_DATA, Workspace
from toolkit.objects.atlas import GROUND, Atlas
from toolkit.objects.load import TableObject, load_object, scale_to_world
from toolkit.objects.mesh import Mesh
from toolkit.rig.views import PaintableObject, RenderedView
from toolkit.rooms.wraps.config import Misfit
from toolkit.rooms.wraps.livery import read_livery
from toolkit.rooms.wraps.wrap import (
    MAP_FILE,
    RECORD_FILE,
    RankedPiece,
    Wrap,
    WrapRecord,
    WrapTraining,
    check_wrap,
    choose_pieces,
    read_wrap,
    wrap_folder,
    write_wrap,
)
from toolkit.rooms.wraps.wrap_config import WrapTrainConfig
from toolkit.rooms.wraps.wrap_plan import draw_paint, measure_cover, plan_wrap
from toolkit.rooms.wraps.wrapped import draw_places, find_canvas, wear_wrap

BATCH = 12
"""Views that are shown together when pieces are ranked."""


@dataclass(frozen=True)
class StuckObject(PaintableObject):
    """An object that wears a wrap: as it should be, and in each block of views as a hand sticks it on.

    Attributes:
        stick: the mesh with the pieces where the draws of a block let them lie.
    """

    stick: Callable[[Draws], Mesh]

    def for_block(self, draws: Draws) -> PaintableObject:
        """With the pieces where these draws let them lie."""
        return replace(self, mesh=self.stick(draws))


@dataclass(frozen=True)
class WrappedObject(TexturedObject):
    """An object with the pieces of a wrap, whose canvas is trained; `atlas.mesh` has each exactly in its place."""

    wrap: Wrap
    misfit: Misfit | None

    def subject(self, at_real_size: bool = False) -> PaintableObject:
        """The object for the view stream; each block sticks the pieces on another way."""
        perfect, spec = super().subject(at_real_size), self.item.spec

        def stick(draws: Draws) -> Mesh:
            mesh = wear_grey(self.item, self.wrap, self.misfit, draws)
            return scale_to_world(mesh, spec, spec.real_length_m) if at_real_size else mesh

        return StuckObject(perfect.mesh, perfect.material, perfect.bare, stick)

    def paint(self) -> np.ndarray:
        """(n, n, 3) uint8 sRGB, the object's own paint on the pieces."""
        return draw_paint(self.wrap, self.item.mesh)

    def describe(self) -> str:
        """How many pieces cover how much of it."""
        record = self.wrap.record
        return (
            f"{self.name}, {len(record.pieces)} pieces of {record.material} on {record.covered:.0%} of what cameras "
            f"see of it, {record.texel_mm:g} mm a texel"
        )


def wear_grey(item: TableObject, wrap: Wrap, misfit: Misfit | None, draws: Draws) -> Mesh:
    """An object with a grey wrap on it, whose canvas is the texture of the material after the object's own."""
    # grey: the light that it throws back is that of a mean colour, whatever is trained
    canvas = np.full((wrap.record.n_px, wrap.record.n_px, 3), GROUND, np.uint8)
    return wear_wrap(item.mesh, wrap, canvas, draw_places(wrap, misfit, draws))


def wrap_object(item: TableObject, wrap: Wrap, misfit: Misfit | None) -> WrappedObject:
    """An object made ready for training what is on its wrap."""
    # exactly in its places: the atlas is what the pieces show without a hand's misfit
    mesh = wear_grey(item, wrap, None, Draws(0, 0))
    trained = mesh.face_material == len(item.mesh.materials)
    covered, source = find_canvas(wrap, len(item.mesh.faces))
    return WrappedObject(item, Atlas(mesh, trained, covered, source, unwrapped=True), wrap, misfit)


def open_plan(workspace: Workspace, item: TableObject, whole: bool = False) -> Wrap:
    """The pieces of an object's wrap, without what is on them; they are planned by default where it has none.

    With `whole` those that were dropped are among them.

    Raises:
        ToolkitError: the plan is broken or of another mesh, or no piece lies flat.
    """
    found, own = wrap_folder(workspace, item), workspace.wraps_dir / item.name
    if found is not None:
        # pictures may be half written by a run that was killed
        wrap = read_wrap(found, with_pixels=False, whole_plan=whole)
        check_wrap(wrap, item)
        if found.is_relative_to(PACKAGE_DATA):
            # a wrap of fewer pieces keeps the map of all
            write_bytes(own / MAP_FILE, (found / MAP_FILE).read_bytes())
        return wrap
    wrap = write_wrap(own, plan_wrap(item))
    record = wrap.record
    notice(f"planned {len(record.pieces)} pieces on {record.covered:.0%} of what cameras see of '{item.name}'")
    return wrap


@dataclass(frozen=True, kw_only=True)
class TrainedWrap(TrainedBooster):
    """Result of a run.

    Attributes:
        wrap: pieces, canvas and record.
        validations: per network, on held-out views; empty when the wrap was finished before.
    """

    wrap: Wrap
    validations: list[WeatherValidation] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        return {
            "wrap": str(self.files.png.parent), "preview": str(self.files.preview),
            **self.describe_run(), "record": self.wrap.record.model_dump(),
        }  # fmt: skip

    def lines(self) -> Iterator[str]:
        """Lines on the wrap, its accuracy, and the next command."""
        record, files = self.wrap.record, self.files
        if self.was_finished:
            yield self.was_there(self.files.png)
        else:
            share = f"{record.covered:.0%} of what cameras see"
            yield f"{files.png.parent}: {len(record.pieces)} pieces on {share}; the object turning: {files.preview}"
            yield from self._say_ranking()
            yield from say_held_out(self.validations, "wrap")
        yield (
            f"next: toolkit print --wrap {record.name}, toolkit capture-sim --object {record.object} "
            "--variant unpatched --variant wrapped"
        )

    def _say_ranking(self) -> Iterator[str]:
        record = self.wrap.record
        ranking = record.booster.ranking if record.booster is not None else []
        if ranking:
            known = ", ".join(f"{count}: {piece.recognised:.0%}" for count, piece in enumerate(ranking, 1))
            yield f"recognised with so many of the best pieces, in views for this alone: {known}"
            yield f"{len(record.pieces)} of {len(ranking)} pieces are kept; numbers are by rank"


def paint_pieces(record: WrapRecord, pixels: np.ndarray, paint: np.ndarray, numbers: Sequence[int]) -> np.ndarray:
    """(n, n, 3) uint8 canvas with pixels on these pieces, the object's own paint on the others."""
    canvas = paint.copy()
    for number in numbers:
        left, low, right, high = record.box_px(record.pieces[number - 1])
        # boxes count from the bottom, rows from the top
        box = slice(record.n_px - high, record.n_px - low), slice(left, right)
        canvas[box] = pixels[box]
    return canvas


def rank_pieces(
    record: WrapRecord, pixels: np.ndarray, paint: np.ndarray, views: Sequence[RenderedView], targets: Sequence[Target]
) -> list[RankedPiece]:
    """Rank all pieces by greedy forward selection: next is the piece that most raises the class's probability.

    Args:
        record: of the plan.
        pixels, paint: (n, n, 3) uint8 sRGB canvases: what was trained, and what is there without a piece.
        views: of the object with all pieces stuck on.
        targets: the networks.
    """
    # views are batched once, and kept on the device: only the canvas changes
    batches = [
        batch_views([view.view for view in views[start : start + BATCH]], targets[0].classifier.device)
        for start in range(0, len(views), BATCH)
    ]
    left, ranked = [piece.number for piece in record.pieces], list[RankedPiece]()
    with progress("Ranking pieces", len(left) * (len(left) + 1) // 2) as bar:
        while left:
            tried = []
            for number in left:
                canvas = paint_pieces(record, pixels, paint, [*(piece.number for piece in ranked), number])
                sure, known = _judge(canvas, batches, targets)
                tried.append(RankedPiece(number=number, recognised=known, mean_log_prob=sure))
                bar.advance()
            # of equally good pieces the first by number, so that a ranking can be repeated
            best = max(tried, key=lambda piece: (piece.mean_log_prob, -piece.number))
            ranked.append(best)
            left.remove(best.number)
    return ranked


def _judge(canvas: np.ndarray, batches: "Sequence[ViewBatch]", targets: Sequence[Target]) -> tuple[float, float]:
    """Mean log probability of the class over views and networks, and the share of them that are right."""
    texture = from_picture(canvas, targets[0].classifier.device)
    sure, right = [], []
    with torch.inference_mode():
        for batch in batches:
            photos = show_texture(texture, batch)
            for target in targets:
                logits = target.predict(photos)
                sure.append(logits.log_softmax(1)[:, target.class_index])
                right.append(logits.argmax(1) == target.class_index)
    # rounded, so that float noise does not decide between equal pieces
    return round(float(torch.cat(sure).mean()), 6), round(float(torch.cat(right).float().mean()), 6)


def train_wrap(
    config: WrapTrainConfig, networks: Sequence[Network], workspace: Workspace, *, class_name: str | int | None = None,
    restart: bool = False, workers: int | None = None, checkpoint_every_s: float = CHECKPOINT_EVERY_S,
) -> TrainedWrap:  # fmt: skip
    """Train what is on a wrap, or take it up where an interrupted run of the same settings left it.

    Args:
        config: every setting, see `make_config` and `RECIPES`.
        networks: their labels and preprocessing; the first classifier's lead.
        workspace: whose folders and objects are used; a plan is made where the object has none.
        class_name: a label of the networks, an index, or a WordNet id; None: the class that the object's spec names.
        restart: forget what an earlier run left.
        workers: threads that render ahead; None: a thread for each core; 0: none.
        checkpoint_every_s: how much work a kill may cost.

    Raises:
        ToolkitError: the settings, the object, its plan, the photographs or a checkpoint cannot be used, or the disk
            is full.
    """
    config.check_backgrounds()
    item = load_object(workspace.object_spec(config.objects[0]))
    wrap = open_plan(workspace, item, whole=config.pieces is not None)
    worn = wrap_object(item, wrap, config.misfit)
    config, targets = meet_networks(config, networks, choose_class(class_name, [worn]))
    record = wrap.record
    # the plan decides the size of the picture and of a texel
    config = config.with_overrides(
        {"size_px": record.n_px} | ({"print_process.texel_mm": record.texel_mm} if config.print_process else {})
    )
    livery = None if config.start is None else read_livery(item, config.start, field="start")
    start = None if livery is None else draw_paint(wrap, livery.mesh)
    inputs = load_inputs(config, [worn], None, targets[0].classifier, workspace, start)
    if livery is not None and not livery.is_trained and inputs.paint is not None:
        inputs = replace(inputs, paint=start)  # what people made is what the object shall look like
    folder = workspace.wraps_dir
    files = BoosterFiles(
        folder / record.name / RECORD_FILE,
        folder / "previews" / f"{record.name}.png",
        folder / ".training" / record.name,
    )
    task = WrapTask(config, targets, inputs, files, workers)
    return train_booster(task, restart=restart, checkpoint_every_s=checkpoint_every_s)


class WrapTask(SurfaceTask[TrainedWrap]):
    """Training of a wrap: only the texels on its pieces are seen."""

    work = Work("wrap", SurfaceTask.work.version, old_at=0)
    _ranking: "Sequence[RankedPiece]" = ()
    _kept: Sequence[int] = ()

    def list_inputs(self) -> list[Any]:
        """Name, networks, the plan, the object and photographs, and every setting."""
        (worn,) = self.inputs.objects
        assert isinstance(worn, WrappedObject)
        record = worn.wrap.record
        return [
            record.name, list_networks(self.targets), record.map_sha256, record.texel_mm, record.n_px,
            self.hash_pixels(), self.config.settings(self.image_px),
        ]  # fmt: skip

    def find_finished(self) -> TrainedWrap | None:
        """The wrap, where its files are whole and of the same inputs."""
        files, skipped = self.files, self.inputs.backgrounds.skipped
        wrap = find_made(
            self.key, lambda: read_wrap(files.png.parent),
            lambda made: made.record.booster and made.record.booster.settings.get(INPUTS), files.preview, files.png,
        )  # fmt: skip
        return None if wrap is None else TrainedWrap(wrap=wrap, files=files, skipped=skipped)

    def reduce(self, pixels: np.ndarray) -> np.ndarray:
        """With the object's own paint on pieces that add nothing, where they are ranked."""
        assert isinstance(self.config, WrapTrainConfig)
        (worn,) = self.inputs.objects
        assert isinstance(worn, WrappedObject)
        if self.config.pieces is None:
            return pixels
        # views that are neither trained on nor reported
        views = self._stream.held_out(1, first=self.config.held_out)
        paint = worn.paint().reshape(-1, 3)[worn.atlas.source]
        self._ranking = rank_pieces(worn.wrap.record, pixels, paint, views, self.targets)
        low, high = (min(count, len(self._ranking)) for count in self.config.pieces)
        shares = [piece.recognised for piece in self._ranking[:high]]
        # the fewest pieces that reach the best share: more would add nothing
        enough = max(low, shares.index(max(shares)) + 1)
        self._kept = [piece.number for piece in self._ranking[:enough]]
        return paint_pieces(worn.wrap.record, pixels, paint, self._kept)

    def write(self, pixels: np.ndarray, record: dict[str, Any], validations: list[WeatherValidation]) -> TrainedWrap:
        """Write the pieces' pictures and the record."""
        (worn,) = self.inputs.objects
        assert isinstance(worn, WrappedObject)
        plan, misfit = worn.wrap, worn.misfit
        kept = {name: record[name] for name in WrapTraining.model_fields if name in record}
        if self.config.start is not None:
            kept["data"] = kept["data"] | {"start": self.config.start.name}
        trained = WrapTraining(**kept, misfit={} if misfit is None else misfit.record(), ranking=list(self._ranking))
        if self._kept:
            plan = choose_pieces(plan, self._kept, measure_cover(plan, worn.item, self._kept))
        changes = {"class_name": record["class_name"], "booster": trained, "picture": None}
        full = plan.record.model_copy(update=changes)
        wrap = write_wrap(self.files.png.parent, Wrap(full, plan.pieces, pixels))
        skipped = self.inputs.backgrounds.skipped
        return TrainedWrap(wrap=wrap, files=self.files, validations=validations, skipped=skipped)
