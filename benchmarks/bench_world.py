"""Frames per second in a city of 200 k triangles against pyrender and Filament on the same GLB, with sun and shadow.

Each renderer runs in a process of its own; the rounds alternate, so that drift of the machine hits all alike. Setting
the scene up is left out for all. The rig also has the sky's light and antialiasing; Filament runs at its defaults.
Also: how the cost of a frame grows from 200 k to 2 M triangles.
"""

import json
import os
import sys
import time
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.peers import measure_in_turn

SIDE_PX, ROUNDS, FRAMES, FOV_DEG = 224, 3, 12, 60.0
SMALL, LARGE = (1, 2), (4, 5)
"""Blocks of the cities: 0.22 M and 1.9 M triangles."""
T_gltf_world = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], float)


@lru_cache(maxsize=1)
def _scene(blocks: tuple[int, int]):
    """World, sky, camera and poses: half of them from the street, half from the height of roofs."""
    from toolkit.rig.camera import Camera, look_at, orbit_direction
    from toolkit.rooms.worlds.content.city import build_city
    from toolkit.rooms.worlds.sky import make_sky
    from toolkit.rooms.worlds.viewpoints import LEVELS, find_places

    world, poses = build_city(0, blocks), []
    rng = np.random.default_rng(0)
    for level in (LEVELS["street"], LEVELS["roof"]):
        for place in find_places(world, level, rng)[: FRAMES // 2]:
            poses.append(look_at(place, place + orbit_direction(rng.uniform(0, 360), rng.uniform(*level.pitch_deg))))
    return world, make_sky("afternoon"), Camera.from_fov(SIDE_PX, SIDE_PX, FOV_DEG), poses


def _sun_direction(sky):
    from toolkit.rig.camera import orbit_direction

    return T_gltf_world[:3, :3] @ orbit_direction(sky.sun.azimuth_deg, sky.sun.elevation_deg)


def rig(_: Path):
    from toolkit.rig.shading import tone_map
    from toolkit.rooms.worlds.picture import leave_empty, make_renderer

    world, sky, camera, poses = _scene(SMALL)
    renderer = make_renderer(leave_empty(world, sky))
    return poses, lambda some: [tone_map(x, (0,)) for x in renderer.render_many((camera, pose) for pose in some)]


def filament(glb: Path):
    """OffscreenRenderer as its documentation shows it, with the sun's shadow; every other setting at its default."""
    import open3d as o3d

    from toolkit.rig.graphics import go_surfaceless

    go_surfaceless()
    rendering = o3d.visualization.rendering
    _, sky, camera, poses = _scene(SMALL)
    renderer = rendering.OffscreenRenderer(SIDE_PX, SIDE_PX)
    renderer.scene.add_model("world", o3d.io.read_triangle_model(str(glb)))
    renderer.scene.scene.set_sun_light(-_sun_direction(sky), [1, 1, 1], 60000)
    renderer.scene.scene.enable_sun_light(True)

    def frame(pose):
        renderer.setup_camera(camera.matrix, np.linalg.inv(T_gltf_world @ pose), SIDE_PX, SIDE_PX)
        return np.asarray(renderer.render_to_image())

    return poses, lambda some: [frame(pose) for pose in some]


def pyrender_shadows(glb: Path):
    """Its directional light with shadows, multisampled edges."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    setattr(np, "infty", np.inf)  # noqa: B010 - pyrender 0.1.45 was written for NumPy 1
    import pyrender
    import trimesh

    _, sky, camera, poses = _scene(SMALL)
    scene = pyrender.Scene(ambient_light=[0.3, 0.3, 0.3])
    for piece in trimesh.load_scene(glb).geometry.values():
        scene.add(pyrender.Mesh.from_trimesh(piece))
    towards = _sun_direction(sky)
    light = np.eye(4)
    light[:3, :3] = trimesh.geometry.align_vectors([0, 0, 1], towards)[:3, :3]
    light[:3, 3] = towards * 500
    scene.add(pyrender.DirectionalLight(intensity=4.0), pose=light)
    lens = pyrender.IntrinsicsCamera(camera.fx, camera.fx, SIDE_PX / 2, SIDE_PX / 2, znear=0.3, zfar=3000)
    node = scene.add(lens)
    renderer = pyrender.OffscreenRenderer(SIDE_PX, SIDE_PX)

    def frame(pose):
        scene.set_pose(node, T_gltf_world @ pose @ np.diag([1.0, -1, -1, 1]))
        return renderer.render(scene, flags=pyrender.RenderFlags.SHADOWS_DIRECTIONAL)[0]

    return poses, lambda some: [frame(pose) for pose in some]


RENDERERS = {"rig": rig, "pyrender": pyrender_shadows, "filament": filament}


def measure(name: str, glb: Path, picture: str | None = None) -> dict[str, float]:
    """Frames per second, in this process."""
    poses, frames = RENDERERS[name](glb)
    frames(poses[:1])
    start = time.perf_counter()
    images = frames(poses)
    rate = len(poses) / (time.perf_counter() - start)
    if picture:
        from PIL import Image

        Image.fromarray(np.ascontiguousarray(np.concatenate(images[:2] + images[-2:], axis=1))).save(picture)
    return {"fps": rate}


def measure_growth() -> dict[str, float]:
    """Processor time of a frame in the large city against one in the small, each from the same kinds of places."""
    from toolkit.rooms.worlds.picture import leave_empty, make_renderer

    spent, triangles = {}, {}
    for blocks in (SMALL, LARGE):
        world, sky, camera, poses = _scene(blocks)
        triangles[blocks] = len(world.mesh.faces)
        renderer = make_renderer(leave_empty(world, sky))
        renderer.render(camera, poses[0])
        start = time.thread_time()
        for pose in poses:
            renderer.render(camera, pose)
        spent[blocks] = (time.thread_time() - start) / len(poses)
    few, many = (triangles[blocks] / 1e6 for blocks in (SMALL, LARGE))
    return {
        "city: one core, ms": 1000 * spent[SMALL],
        f"city: cost of {many:.1f} M to {few:.2f} M triangles": spent[LARGE] / spent[SMALL],
    }


def run(quiet: bool = False) -> dict[str, float]:
    """Median rates, ratios, and the growth with the triangles."""
    from toolkit.objects.export_mesh import to_glb

    with TemporaryDirectory() as folder:
        glb = Path(folder) / "city.glb"
        glb.write_bytes(to_glb(_scene(SMALL)[0].mesh, "city", units_per_m=1.0))
        middle = measure_in_turn("bench_world", RENDERERS, [str(glb)], ROUNDS, quiet)
    results = {f"city {SIDE_PX}x{SIDE_PX}: {name} frames/s": rate for name, rate in middle.items()}
    for peer in ("pyrender", "filament"):
        if peer in middle and "rig" in middle:
            results[f"city: ratio to {peer}"] = middle["rig"] / middle[peer]
    return results | measure_growth()


if __name__ == "__main__":
    name, glb, *picture = sys.argv[1:]
    print(json.dumps(measure(name, Path(glb), *picture)))
