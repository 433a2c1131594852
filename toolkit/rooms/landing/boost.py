"""`toolkit landing boost`: the pad's picture goes down a regressor's error, through rendered views, air and camera.

Light that comes from the pad is linear in its colours, so that the gradient through the render is exact (Algorithm 1 of
Salman et al. 2021 with the squared error of appendix B.3).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from toolkit import __version__
from toolkit.boosters.linear_view import ViewBatch, batch_views, show_texture
from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.files import write_bytes
from toolkit.core.threads import map_ahead
from toolkit.core.work import INPUTS, Work, find_made
from toolkit.core.workspace import Workspace
from toolkit.objects.records import NetworkRecord, Patch, read_patch, write_patch
from toolkit.printing import PrintSettings
from toolkit.printing.document import build_pdf
from toolkit.rooms.landing.config import BoostConfig, CameraConfig, PadPrintConfig
from toolkit.rooms.landing.episodes import draw_in_cone, place_cameras
from toolkit.rooms.landing.regressor import Regressor, load_regressor
from toolkit.rooms.landing.site import Pad, PadSite, SiteView, draw_pad, find_sky, find_world, plan_places
from toolkit.rooms.landing.train import LEAST_HEIGHT_M
from toolkit.rooms.worlds.conditions import CLEAR, name_weather
from toolkit.rooms.worlds.particles import DepthView
from toolkit.rooms.worlds.weathered import Weathered
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import FitConfig, History, TrainingTask, fit

CLASS_NAME = "landing pad"
FALLOFF = 0.12
CHECKPOINT_EVERY_S = 15.0
COMPARED = 48
"""Photographs of each pad in each weather that pads are compared on."""


@dataclass(frozen=True)
class PadView:
    """A rendered view of the pad."""

    site: PadSite  # site, pose: from where
    pose: np.ndarray
    offset: np.ndarray  # offset, height: truth, metres
    height: float


class PadTask(TrainingTask[Patch]):
    """The pixels of a pad go down the squared error of a frozen regressor, as a share of the height."""

    work = Work("landing-pad", 1, old_at=3)
    recent = 20

    def __init__(
        self, config: BoostConfig, regressor: Regressor, views: Sequence[PadView], *, seed: int, folder: Path,
        name: str,
    ) -> None:  # fmt: skip
        """Start the picture.

        Args:
            views: on sites whose pad is `start_picture` of the config.
        """
        self.config, self.regressor, self.views, self.seed = config, regressor, tuple(views), seed
        self.folder, self.name = folder, name
        self.title = f"Boosting {name}"
        picture = start_picture(config, seed)
        # the pad's texels are the parameters, in [0, 1]
        self.theta = torch.from_numpy(picture.transpose(2, 0, 1).copy()).float().div(255).requires_grad_(True)

    @cached_property
    def _rendered(self) -> list[tuple[Any, DepthView]]:
        """Linear view and depth of each view."""
        made = []

        def render(view: PadView) -> tuple[Any, DepthView]:
            texture = view.site.mesh.materials[0].texture
            return view.site.renderer.render_linear(view.site.camera, view.pose, texture), view.site.look(view.pose)[0]

        with progress("Rendering views", len(self.views)) as bar:
            for linear_view in map_ahead(render, self.views):
                made.append(linear_view)
                bar.advance()
        return made

    def list_inputs(self) -> list[Any]:
        """The regressor, the world, and every setting."""
        world_sha256 = self.views[0].site.world.sha256
        return [self.regressor.record.sha256, world_sha256, self.seed, self.config.record()]

    def parameters(self) -> dict[str, torch.Tensor]:
        """The pixels, (3, n, n) sRGB-encoded in [0, 1]."""
        return {"pad": self.theta}

    def constrain(self) -> None:
        """Pixels stay colours."""
        self.theta.clamp_(0, 1)

    def find_finished(self) -> Patch | None:
        """The pad, where it is whole and of the same inputs."""
        file = self.folder / f"{self.name}.png"
        return find_made(
            self.key, lambda: read_patch(file), lambda made: made.record.settings.get(INPUTS),
            file, file.with_suffix(".json"),
        )  # fmt: skip

    def describe(self) -> list[str]:
        """The weather in the loop."""
        return Weathered(weathers=self.config.weathers).lines() if self.config.weathers else []

    def photograph(self, chosen: np.ndarray, draws: Draws) -> torch.Tensor:
        """(b, 3, h, w) views of the pad through drawn weather, light and noise; differentiable."""
        some = [self._rendered[int(k)] for k in chosen]
        views = batch_views([view for view, _ in some], "cpu")
        batch = through_air(views, [depth for _, depth in some], self.config, draws)
        light = torch.from_numpy(draws.of("light").uniform(*self.config.light, (len(some), 1, 1, 1))).float()
        photos = show_texture(self.theta, batch, light=light)
        generator = torch.Generator().manual_seed(int(draws.of("noise").integers(1 << 62)))
        return (photos + self.config.noise * torch.randn(photos.shape, generator=generator)).clamp(0, 1)

    def loss(self, step: int) -> tuple[torch.Tensor, dict[str, float]]:
        """Mean square error as a share of the height, and its mean in cm."""
        draws = Draws(self.seed, step, self.work.kind)
        chosen = draws.of("views").choice(len(self.views), min(self.config.batch, len(self.views)), replace=False)
        out = self.regressor.outputs(self.photograph(chosen, draws))[:, :2].cpu()
        wanted = torch.from_numpy(np.stack([self.views[int(k)].offset for k in chosen])).float()
        height = torch.tensor([max(self.views[int(k)].height, LEAST_HEIGHT_M) for k in chosen]).float()
        error = out - wanted
        # a share of the height: a pixel's error is metres in proportion to it
        loss = (error / height[:, None]).square().mean()
        return loss, {"error_cm": 100 * float(error.detach().norm(dim=1).mean())}

    def finish(self, history: History) -> Patch:
        """Write `NAME.png` and its record."""
        pixels = (self.theta.detach().numpy().transpose(1, 2, 0) * 255).round().astype(np.uint8)
        made = self.regressor.record
        record = {
            "name": self.name, "class_name": CLASS_NAME, "class_index": 0, "size_mm": round(made.size_m * 1000, 3),
            "networks": [NetworkRecord(arch=made.arch, weights=f"{made.name}.safetensors", sha256=made.sha256)],
            "data": {"world": self.config.world, "views": len(self.views)}, "seed": self.seed,
            "settings": self.config.record() | {INPUTS: self.key}, "final": history.recent(self.recent),
            "toolkit_version": __version__,
        }  # fmt: skip
        return write_patch(self.folder, pixels, record)


def start_picture(config: BoostConfig, seed: int) -> np.ndarray:
    """(n, n, 3) uint8 that a training starts from."""
    picture = draw_pad(config.start, seed=seed).picture
    return cv2.resize(picture, (config.size_px, config.size_px), interpolation=cv2.INTER_AREA)


def through_air(batch: ViewBatch, depths: Sequence[DepthView], config: BoostConfig, draws: Draws) -> ViewBatch:
    """Views through drawn weather and the lens's falloff."""
    height, width = depths[0].depth_m.shape
    factor, offset = torch.ones(len(depths), height, width, 3), torch.zeros(len(depths), height, width, 3)
    if config.weathers and config.weather_probability:
        weathered = Weathered(weathers=config.weathers, probability=config.weather_probability)
        factor, offset = weathered.draw_light(list(depths), draws.of("weather"))
    y, x = torch.meshgrid(torch.linspace(-1, 1, height), torch.linspace(-1, 1, width), indexing="ij")
    # the falloff of `tone_map`, here with a gradient
    kept = (1 - FALLOFF * (x * x + y * y) / 2)[None, :, :, None]
    return batch.through(factor * kept, offset * kept)


def plan_views(config: BoostConfig, regressor: Regressor, pad: Pad, seed: int, own: int = 2_000_003) -> list[PadView]:
    """Cameras in the cone over places of the config's world, drawn by (seed, number)."""
    # the camera is that of the regressor, or the pad would be boosted for other views
    optics = CameraConfig(image_px=regressor.record.image_px, fov_deg=regressor.record.fov_deg)
    world, sky = find_world(config.world, config.world_seed), find_sky(config.time)
    places = plan_places(world, pad.size_m, config.places, seed + own, config.ground)
    sites = [PadSite(world, place, sky, pad, optics) for place in places]
    views = []
    # places take turns, so each is seen equally often
    for number in range(config.views):
        site, rng = sites[number % len(sites)], Draws(seed + own, number, "landing").of("camera")
        offset, yaw = draw_in_cone(rng, config.height_m, config.half_angle_deg)
        pose = place_cameras((site.centre + offset)[None], np.cos([yaw]), np.sin([yaw]), np.zeros((1, 2)))[0]
        # the truth: where the pad lies from the camera
        x, y, z = site.truth(pose)
        views.append(PadView(site, pose, np.array([x, y]), float(z)))
    return views


@dataclass(frozen=True)
class Boosted:
    """What `boost_pad` made."""

    file: Path  # the picture; its record lies beside it
    patch: Patch  # both, read
    pdf: Path  # pages at true size
    pages: int  # of the PDF, the map among them
    was_finished: bool  # whether there was nothing left to do
    # mean error as a share of height, by pad and weather, on views that were not trained on
    errors: dict[str, dict[str, float]]


def boost_pad(
    space: Workspace, regressor_name: str, config: BoostConfig, printing: PadPrintConfig | None = None, *,
    seed: int = 0, device: str = "cpu", restart: bool = False,
) -> Boosted:  # fmt: skip
    """Train a pad for a regressor into `print/pads`, print it at true size, and measure it against the plain pad.

    Raises:
        ToolkitError: the regressor, the world or a checkpoint cannot be used.
    """
    regressor = load_regressor(space, regressor_name, device)
    name = config.name or f"{regressor.name}-boosted"
    size_m, folder = regressor.record.size_m, space.print_dir / "pads"
    # sites carry the start picture; rendering is linear in it, so every view is rendered once
    pad = Pad(name, start_picture(config, seed), size_m)
    views = plan_views(config, regressor, pad, seed)
    task = PadTask(config, regressor, views, seed=seed, folder=folder, name=name)
    fit_config = FitConfig(config.steps, config.lr, "linear", "sign", seed)
    fitted = fit(task, fit_config, Checkpoint(folder / ".training" / name, task.key, restart, CHECKPOINT_EVERY_S))
    patch, printing = fitted.made, printing or PadPrintConfig()
    # without a size of its own the page shows the pad at 0.5 m to 2 m
    side_mm = 1000 * (printing.print_size_m or min(max(size_m, 0.5), 2.0))
    document = build_pdf(patch, PrintSettings(size_mm=side_mm, paper=printing.paper))
    pdf = write_bytes(space.print_dir / f"pad-{name}.pdf", document.content)
    # measured beside the plain pad
    errors = compare_pads(config, regressor, [draw_pad("plain", size_m), Pad(name, patch.pixels, size_m)], seed)
    return Boosted(folder / f"{name}.png", patch, pdf, len(document.plan.pages), fitted.was_finished, errors)


def compare_pads(
    config: BoostConfig, regressor: Regressor, pads: Sequence[Pad], seed: int
) -> dict[str, dict[str, float]]:
    """Mean error as a share of the height, by pad and weather, on photographs of new cameras and places."""
    # a stream of its own: none of these views was trained on
    plan = plan_views(config.with_overrides(views=COMPARED), regressor, pads[0], seed, own=3_000_017)
    # three of the five severities are enough to show a trend
    weathers = [CLEAR, *(pair for pair in config.weathers if pair[1] in (1, 3, 5))]
    found: dict[str, dict[str, float]] = {}
    with progress("Comparing pads", len(pads) * len(weathers)) as bar:
        for pad in pads:
            # the same places and light with this pad
            worn = {id(view.site): view.site.with_pad(pad) for view in plan}
            found[pad.name] = {}
            for weather in weathers:
                views = [
                    (worn[id(view.site)], SiteView(view.pose, seed, 500_000 + k, weather))
                    for k, view in enumerate(plan)
                ]
                images = np.stack(list(map_ahead(lambda pair: pair[0].photograph(pair[1]), views)))
                errors = np.linalg.norm(regressor.predict(images) - np.stack([view.offset for view in plan]), axis=1)
                share = float((errors / [view.height for view in plan]).mean())
                found[pad.name][name_weather(*weather)] = round(share, 5)
                bar.advance()
    return found
