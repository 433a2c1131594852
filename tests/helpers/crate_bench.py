"""A crate on a printed board for the tests of the gates: its workspace, and what a camera makes of it."""

from dataclasses import dataclass
from pathlib import Path

import board_photos as bp
import numpy as np

from toolkit.core.workspace import Workspace, make_workspace
from toolkit.objects.mesh import Mesh
from toolkit.rig.board import CharucoBoard
from toolkit.rig.board_file import write_board
from toolkit.rig.camera import Camera
from toolkit.rooms.photos.gates.check_photo import ExpectationBuilder
from toolkit.rooms.photos.gates.check_set import PatchLines

BOARD, CAMERA = CharucoBoard(9, 9, 25.0, 18.75), Camera.from_fov(640, 480, 40.0)


def by_name(results) -> dict:
    return {result.name: result for result in results}


def lines_to(points: np.ndarray, origin: np.ndarray, rng: np.random.Generator | None = None) -> PatchLines:
    """Lines of sight to points (n, 3), which a generator moves by 0.3 mm."""
    away = points - origin + (0 if rng is None else rng.normal(0, 0.3, points.shape))
    return PatchLines(origin, away / np.linalg.norm(away, axis=1, keepdims=True), np.ones(len(points), bool))


@dataclass(frozen=True)
class CrateBench:
    """A workspace with a crate and a board; a test's own bench adds what is on the crate."""

    space: Workspace
    expecter: ExpectationBuilder

    @classmethod
    def make(cls, folder: Path, crate: Mesh, sheets: str = "") -> "CrateBench":
        """In a folder; `sheets` are the tables [patch] of its spec."""
        space = make_workspace(folder)
        lines = [f"v {x} {y} {z}" for x, y, z in crate.vertices] + [f"f {a} {b} {c}" for a, b, c in crate.faces + 1]
        (space.objects_dir / "crate.obj").write_text("\n".join(lines) + "\n")
        (space.objects_dir / "crate.toml").write_text(
            f'class = "racer"\nmesh = "crate.obj"\nlength_mm = {crate.size_mm.max():.0f}\n{sheets}'
        )
        write_board(space, BOARD)
        return cls(space, ExpectationBuilder(space))

    def photograph(self, mesh: Mesh | None, T_world_camera: np.ndarray, light: str = "studio") -> np.ndarray:
        """Pixels, not to be written to."""
        return bp.photograph(mesh, BOARD, CAMERA, T_world_camera, light=light, px_per_mm=2.5, seed=1)
