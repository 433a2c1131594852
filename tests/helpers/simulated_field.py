"""The small walled world of the tests as a simulator shows it: drawn from what stands behind the fake's port."""

import numpy as np
import open3d as o3d
from fake_airsim import SKY_M, Drawn, FakeAirSim, matrix_of
from walled_field import PX, make_field

from toolkit.objects.mesh import Mesh

FOG, OBJECT_COLOUR = 7, (153, 108, 6)
SWAP = np.array([(0.0, 1, 0), (1, 0, 0), (0, 0, -1)])


def cast(mesh: Mesh, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    scene = o3d.t.geometry.RaycastingScene()
    faces = np.ascontiguousarray(mesh.faces.astype(np.uint32))
    scene.add_triangles(o3d.core.Tensor(np.ascontiguousarray(mesh.vertices)), o3d.core.Tensor(faces))
    rays = np.concatenate([np.broadcast_to(origins, directions.shape), directions], axis=1).astype(np.float32)
    return scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()


def make_simulated_field(meshes: dict[str, Mesh], **settings: object) -> FakeAirSim:
    """A fake whose level is the field; assets are meshes in metres, by name, each in a red of its own."""
    ground = make_field().mesh

    def draw(fake: FakeAirSim) -> Drawn:
        side = fake.side_px
        focal = side / 2 / np.tan(np.radians(fake.fov_deg) / 2)
        v, u = np.mgrid[:side, :side] + 0.5
        body = np.stack([np.ones(u.shape), (u - side / 2) / focal, (v - side / 2) / focal], axis=-1).reshape(-1, 3)
        camera = matrix_of(fake.shown_pose)
        ned = body @ camera[:3, :3].T / np.linalg.norm(body, axis=1, keepdims=True)
        depth = cast(ground, camera[:3, 3] @ SWAP.T, ned @ SWAP.T)
        picture = np.where(np.isfinite(depth)[:, None], (90, 110, 90), (140, 170, 220)).astype(float)
        colours = np.zeros((side * side, 3), np.uint8)
        for name, pose in fake.actors.items():
            mesh = next(mesh for key, mesh in meshes.items() if name.startswith(key))
            actor = matrix_of(pose)
            at, towards = actor[:3, :3].T @ (camera[:3, 3] - actor[:3, 3]), ned @ actor[:3, :3]
            way = cast(mesh, at @ SWAP.T, towards @ SWAP.T)
            nearer = way < depth
            depth = np.where(nearer, way, depth)
            picture[nearer] = 60 * list(meshes).index(next(key for key in meshes if name.startswith(key))) + 100, 20, 20
            colours[nearer] = OBJECT_COLOUR
        veil = np.exp(-fake.weather.get(FOG, 0.0) * np.minimum(depth, 1e4) / 10)[:, None]
        seen = picture * veil + 200 * (1 - veil)
        far = np.where(np.isfinite(depth), depth, SKY_M)
        return (
            seen.round().astype(np.uint8).reshape(side, side, 3),
            far.reshape(side, side),
            colours.reshape(side, side, 3),
        )

    return FakeAirSim(draw=draw, assets=tuple(meshes), side_px=PX, **settings)  # type: ignore[arg-type]
