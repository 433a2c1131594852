"""Frames per second of the rig against pyrender and a plain Open3D loop: same mesh, table, poses and shadows.

Each renderer runs in a process of its own; the rounds alternate, so that drift of the machine hits all alike. Building
the scene is left out for all and told apart. Also: what each part of a frame costs, how the cost grows with the mesh,
and how long a scene takes to set up.
"""

import json
import os
import sys
import time
from dataclasses import replace

import numpy as np

from benchmarks.peers import measure_in_turn
from toolkit.objects.mesh import Mesh

SIZES = ((224, 224), (640, 480))
ROUNDS, FRAMES = 3, 12
OBJECT, CUTS = "racer", 3
"""What is drawn, and how often each of its triangles is cut in four where the cost of more of them is measured."""
OBJECTS = ("eggnog", "racer", "warplane", "coffeepot")


def _scene(width: int, height: int):
    from toolkit.core.workspace import PACKAGE_DATA
    from toolkit.objects.load import load_object
    from toolkit.rig.camera import Camera, distance_to_fill, orbit_pose
    from toolkit.rig.studio import make_studio

    mesh = load_object(PACKAGE_DATA / "objects" / f"{OBJECT}.toml").mesh
    camera = Camera.from_fov(width, height)
    target = np.array([0, 0, mesh.size_mm[2] / 2])
    poses = []
    for i in range(FRAMES):
        azimuth, elevation = 360 * i / FRAMES, 25 + 40 * (i % 3) / 2
        distance = distance_to_fill(camera, mesh.vertices, target, azimuth, elevation, 0.8)
        poses.append(orbit_pose(target, azimuth, elevation, distance))
    return mesh, camera, poses, make_studio(0, 270.0, "oak")


def _parts(mesh):
    """Vertices, normals, uv, faces, material of each part, the table last."""
    for index, material in enumerate(mesh.materials):
        faces = mesh.faces[mesh.face_material == index]
        if len(faces):
            used, inverse = np.unique(faces, return_inverse=True)
            yield mesh.vertices[used], mesh.normals[used], mesh.uv[used], inverse.reshape(-1, 3), material


def _table(studio):
    x, y = (side / 2 for side in studio.table.size_mm)
    vertices = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], np.float32)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    return vertices, np.repeat([[0, 0, 1.0]], 4, 0), uv, np.array([[0, 1, 2], [0, 2, 3]])


def rig(width: int, height: int):
    from toolkit.rig.raycast import RaycastRenderer
    from toolkit.rig.shading import tone_map

    mesh, camera, poses, studio = _scene(width, height)
    renderer = RaycastRenderer(mesh, studio)

    def frames(some):
        return [tone_map(light, (0,)) for light in renderer.render_many((camera, pose) for pose in some)]

    return poses, frames


def rig_filament(width: int, height: int):
    from toolkit.rig.filament import FilamentRenderer
    from toolkit.rig.shading import tone_map

    mesh, camera, poses, studio = _scene(width, height)
    renderer = FilamentRenderer(mesh, studio)
    return poses, lambda some: [tone_map(renderer.render(camera, pose), (0,)) for pose in some]


def open3d_defaults(width: int, height: int):
    """OffscreenRenderer as its documentation shows it: every setting at its default."""
    import open3d as o3d

    from toolkit.rig.graphics import go_surfaceless

    go_surfaceless()
    rendering = o3d.visualization.rendering
    mesh, camera, poses, studio = _scene(width, height)
    renderer = rendering.OffscreenRenderer(width, height)

    def add(name, vertices, normals, uv, faces, texture):
        shape = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(vertices.astype(float)), o3d.utility.Vector3iVector(faces.astype(np.int32))
        )
        shape.vertex_normals = o3d.utility.Vector3dVector(np.asarray(normals, float))
        shape.triangle_uvs = o3d.utility.Vector2dVector(uv[faces].reshape(-1, 2).astype(float))
        look = rendering.MaterialRecord()
        look.shader = "defaultLit"
        look.albedo_img = o3d.geometry.Image(np.ascontiguousarray(texture))
        renderer.scene.add_geometry(name, shape, look)

    for i, (vertices, normals, uv, faces, material) in enumerate(_parts(mesh)):
        add(f"part{i}", vertices, normals, uv, faces, material.texture)
    add("table", *_table(studio), studio.table.picture)
    renderer.scene.scene.set_sun_light([-0.4, -0.3, -0.8], [1, 1, 1], 60000)
    renderer.scene.scene.enable_sun_light(True)

    def frame(pose):
        renderer.setup_camera(camera.matrix, np.linalg.inv(pose), width, height)
        return np.asarray(renderer.render_to_image())

    return poses, lambda some: [frame(pose) for pose in some]


def pyrender_shadows(width: int, height: int):
    """Its directional light with shadows, multisampled edges."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    setattr(np, "infty", np.inf)  # noqa: B010 - pyrender 0.1.45 was written for NumPy 1
    import pyrender
    import trimesh
    from PIL import Image

    mesh, camera, poses, studio = _scene(width, height)
    scene = pyrender.Scene(ambient_light=[0.3, 0.3, 0.3])

    def add(vertices, normals, uv, faces, texture):
        look = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(texture))
        piece = trimesh.Trimesh(vertices, faces, vertex_normals=normals, visual=look, process=False)
        scene.add(pyrender.Mesh.from_trimesh(piece))

    for vertices, normals, uv, faces, material in _parts(mesh):
        add(vertices, normals, uv, faces, material.texture)
    add(*_table(studio), studio.table.picture)
    light = np.eye(4)
    light[:3, :3] = trimesh.geometry.align_vectors([0, 0, 1], [0.4, 0.3, 0.8])[:3, :3]
    light[:3, 3] = np.array([0.4, 0.3, 0.8]) * 600
    scene.add(pyrender.DirectionalLight(intensity=4.0), pose=light)
    lens = pyrender.IntrinsicsCamera(camera.fx, camera.fx, width / 2, height / 2, znear=10, zfar=5000)
    node = scene.add(lens)
    renderer = pyrender.OffscreenRenderer(width, height)

    def frame(pose):
        scene.set_pose(node, pose @ np.diag([1.0, -1, -1, 1]))
        return renderer.render(scene, flags=pyrender.RenderFlags.SHADOWS_DIRECTIONAL)[0]

    return poses, lambda some: [frame(pose) for pose in some]


RENDERERS = {"rig": rig, "rig filament": rig_filament, "open3d": open3d_defaults, "pyrender": pyrender_shadows}


def measure(name: str, width: int, height: int, picture: str | None = None) -> dict[str, float]:
    """Seconds to build and frames per second, in this process."""
    start = time.perf_counter()
    poses, frames = RENDERERS[name](width, height)
    frames(poses[:1])
    built = time.perf_counter() - start
    start = time.perf_counter()
    images = frames(poses)
    rate = len(poses) / (time.perf_counter() - start)
    if picture:
        from PIL import Image

        Image.fromarray(np.ascontiguousarray(images[1])).save(picture)
    return {"build_s": built, "fps": rate}


def measure_parts(width: int, height: int) -> dict[str, float]:
    """Share of each part of a frame, on one core."""
    from toolkit.rig import raycast, trace
    from toolkit.rig.shading import tone_map

    mesh, camera, poses, studio = _scene(width, height)
    renderer = raycast.RaycastRenderer(mesh, studio)
    spent = dict.fromkeys(("first hits", "edges", "object", "table and room", "development"), 0.0)

    def timed(part, function):
        def run(*arguments, **named):
            start = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                spent[part] += time.thread_time() - start

        return run

    kept = trace.mark_edges, raycast.paint_mesh, raycast.paint_background, trace.LitBody.see
    trace.mark_edges, raycast.paint_mesh = timed("edges", kept[0]), timed("object", kept[1])
    raycast.paint_background, trace.LitBody.see = timed("table and room", kept[2]), timed("first hits", kept[3])
    develop, start = timed("development", tone_map), time.thread_time()
    try:
        for pose in poses:
            develop(renderer.render(camera, pose), (0,))
    finally:
        trace.mark_edges, raycast.paint_mesh, raycast.paint_background, trace.LitBody.see = kept
    whole = time.thread_time() - start
    shares = {part: seconds / whole for part, seconds in spent.items()}
    return shares | {"the rest": 1 - sum(shares.values()), "ms": 1000 * whole / len(poses)}


def subdivide(mesh: Mesh) -> Mesh:
    """Each triangle as four."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    pairs, index = np.unique(edges[:, 0] * np.int64(len(mesh.vertices)) + edges[:, 1], return_inverse=True)
    first, second = np.divmod(pairs, len(mesh.vertices))
    (a, b, c), n = index.reshape(3, -1), len(mesh.vertices)
    middle = [np.concatenate([one, (one[first] + one[second]) / 2]) for one in (mesh.vertices, mesh.normals, mesh.uv)]
    i, j, k = mesh.faces.T
    faces = np.stack([[i, a + n, c + n], [a + n, j, b + n], [c + n, b + n, k], [a + n, b + n, c + n]])
    return replace(
        mesh, vertices=middle[0], normals=middle[1], uv=middle[2],
        faces=faces.transpose(0, 2, 1).reshape(-1, 3).astype(np.int32), face_material=np.tile(mesh.face_material, 4),
    )  # fmt: skip


def measure_growth() -> dict[str, float]:
    """Cost of a frame of 2 M triangles (the racer's, each cut in 4 three times) against the racer's own, by size."""
    from toolkit.rig.lighting import BakeDetail
    from toolkit.rig.raycast import RaycastRenderer

    rough = BakeDetail(4, 16, 0.05, 0.05)  # how finely light was baked is nothing to a frame
    ratios = {}
    for width, height in SIZES:
        mesh, camera, poses, studio = _scene(width, height)
        large = mesh
        for _ in range(CUTS):
            large = subdivide(large)
        renderers = [RaycastRenderer(one, studio, rough) for one in (mesh, large)]
        spent = [0.0, 0.0]
        for pose in (*poses[:1], *poses):
            for k, renderer in enumerate(renderers):
                start = time.thread_time()
                renderer.render(camera, pose)
                spent[k] += time.thread_time() - start
        ratios[f"rig {width}x{height}: {len(large.faces) / 1e6:.1f} M to {len(mesh.faces) / 1e3:.0f} k triangles"] = (
            spent[1] / spent[0]
        )
    return ratios


def measure_set_up() -> dict[str, float]:
    """Seconds until the first frame can begin: for a shape that is new, and for one that was met in another paint."""
    from toolkit.core.workspace import PACKAGE_DATA
    from toolkit.objects.load import load_object
    from toolkit.rig.raycast import RaycastRenderer
    from toolkit.rig.studio import make_studio

    seconds = {}
    studio = make_studio(0, 270.0, "oak")
    for name in OBJECTS:
        mesh = load_object(PACKAGE_DATA / "objects" / f"{name}.toml").mesh
        painted = replace(mesh, materials=tuple(replace(m, texture=255 - m.texture) for m in mesh.materials))
        for what, one in (("new", mesh), ("in another paint", painted)):
            start = time.perf_counter()
            RaycastRenderer(one, studio)
            seconds[f"rig set-up, seconds: {name}, {what}"] = time.perf_counter() - start
    return seconds


def run(quiet: bool = False) -> dict[str, float]:
    """Median rates and ratios per size."""
    results: dict[str, float] = {}
    for width, height in SIZES:
        middle = measure_in_turn("bench_rig", RENDERERS, [str(width), str(height)], ROUNDS, quiet)
        for name, rate in middle.items():
            results[f"rig {width}x{height}: {name} frames/s"] = rate
        for peer in ("pyrender", "open3d"):
            if peer in middle:
                results[f"rig {width}x{height}: ratio to {peer}"] = middle["rig"] / middle[peer]
        for part, share in measure_parts(width, height).items():
            results[f"rig {width}x{height}: {'one core, ms' if part == 'ms' else 'share of ' + part}"] = share
    return results | measure_growth() | measure_set_up()


if __name__ == "__main__":
    name, width, height, *picture = sys.argv[1:]
    print(json.dumps(measure(name, int(width), int(height), *picture)))
