"""A small world by hand: flat ground with one wall on it, two wide places and a narrow one; and who looks at it."""

from pathlib import Path

import numpy as np
import torch

from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.network import Classifier
from toolkit.models.weights import WeightsFile
from toolkit.objects.mesh import Material, Mesh
from toolkit.rooms.worlds.evaluation import WorldEvalConfig
from toolkit.rooms.worlds.world import SceneClass, Spot, World

LABELS = ["crate", "jet", "pot", "cup", "car", "cat", "dog"]
WALL = np.array([(6.0, -8.0, 0.0, 7.0, 8.0, 5.0)])
PX = 32


def make_field() -> World:
    """Ground from -40 to 40 m at z = 0; a wall at x = 6 to 7 m, 16 m long and 5 m high."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    wall = WALL[0, :3] + corners * (WALL[0, 3:] - WALL[0, :3])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (1, 5, 7, 3), (0, 2, 6, 4)]
    quads = [np.array([(-40, -40, 0), (40, -40, 0), (40, 40, 0), (-40, 40, 0)], float)]
    quads += [wall[list(side)] for side in sides]
    vertices, normals, faces, classes = [], [], [], []
    for quad in quads:
        normal = np.cross(quad[1] - quad[0], quad[2] - quad[0])
        start = len(vertices)
        vertices += list(quad)
        normals += [normal / np.linalg.norm(normal)] * 4
        faces += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
        classes += [SceneClass.BUILDING if len(vertices) > 4 else SceneClass.GROUND] * 2
    rng = np.random.default_rng(0)
    pictures = [rng.integers(low, low + 60, (16, 16, 3), np.uint8) for low in (60, 150)]
    mesh = Mesh(
        np.array(vertices, np.float32), np.array(normals, np.float32),
        np.tile(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), (len(quads), 1)), np.array(faces, np.int32),
        np.array([0, 0] + [1] * (len(faces) - 2), np.int32),
        tuple(Material(f"m{k}", picture) for k, picture in enumerate(pictures)),
    )  # fmt: skip
    spots = (
        Spot("west", "square", (-4.0, 0.0, 0.0), 9.5, 90.0, "ground"),
        Spot("east", "street", (14.5, 0.0, 0.0), 7.2, 0.0, "ground"),
        Spot("gap", "street", (3.5, 0.0, 0.0), 2.0, 0.0, "ground"),
    )
    core = np.array([(-40.0, -40.0), (40.0, 40.0)])
    return World("field", 0, mesh, np.array(classes, np.uint8), spots, WALL, core)


class Onlooker(torch.nn.Module):
    """Random weights; `seen` counts the pictures that it was shown."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(3)
        self.layers = torch.nn.Sequential(
            torch.nn.Conv2d(3, 8, 5, 2), torch.nn.ReLU(), torch.nn.Conv2d(8, 8, 3, 2), torch.nn.ReLU(),
            torch.nn.AdaptiveAvgPool2d(2), torch.nn.Flatten(), torch.nn.Linear(32, len(LABELS)),
        )  # fmt: skip
        self.seen = 0

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        self.seen += len(batch)
        return 40 * self.layers(batch)


def make_onlooker() -> Classifier:
    """A network of random weights that tells `LABELS`."""
    how = Preprocessing(36, PX, (0.4, 0.4, 0.4), (0.3, 0.3, 0.3))
    file = WeightsFile(Path("onlooker.pth"), "0f" * 32, "onlooker.pth")
    return Classifier("onlooker", Onlooker().eval(), LABELS, how, file, "cpu", False)


def make_config(**changes: object) -> WorldEvalConfig:
    """Two variants of the crate, 4 m long, from 3 × 3 × 2 cameras at two places, in clear air and three fogs."""
    settings: dict[str, object] = {
        "object": "crate", "variants": ("unpatched", "patched"), "weathers": ("fog:1", "fog:3", "dust:5"),
        "places": 2, "grid": "3x3x2", "length_m": 4.0,
    }  # fmt: skip
    return WorldEvalConfig(**{**settings, **changes})


def stand_in(monkeypatch, is_drawn: bool = True) -> None:
    """Evaluate in the field, below a small sky; figures, which take most of the time of so little, only if wanted."""
    from toolkit.rooms.worlds.evaluation import world_report, world_run
    from toolkit.rooms.worlds.sky import make_sky

    monkeypatch.setattr(world_run, "open_world", lambda *given: make_field())
    monkeypatch.setattr(world_run, "make_sky", lambda time, seed: make_sky(time, seed, 32))
    for name in ("draw_sample", "draw_weathers", "draw_curves", "draw_cameras"):
        if not is_drawn:
            monkeypatch.setattr(world_report, name, lambda *given: b"drawn")
