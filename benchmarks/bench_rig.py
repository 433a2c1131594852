"""Frames per second of the rig against pyrender and a plain Open3D loop: same mesh, table, poses and shadows.

Each renderer runs in a process of its own; the rounds alternate, so that drift of the machine hits all alike.
Building the scene is left out for all and told apart.
"""

import json
import os
import subprocess
import sys
import time

import numpy as np

SIZES = ((224, 224), (640, 480))
ROUNDS, FRAMES = 3, 12
OBJECT = "racer"


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


def rig(width: int, height: int, name: str = "raycast"):
    from toolkit.rig.renderer import make_renderer
    from toolkit.rig.shading import tone_map

    mesh, camera, poses, studio = _scene(width, height)
    renderer = make_renderer(name, mesh, studio)
    return poses, lambda pose: tone_map(renderer.render(camera, pose), (0,))


def rig_filament(width: int, height: int):
    return rig(width, height, "filament")


def open3d_defaults(width: int, height: int):
    """OffscreenRenderer as its documentation shows it: every setting at its default."""
    import open3d as o3d

    from toolkit.rig.egl import go_surfaceless

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

    return poses, frame


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

    return poses, frame


RENDERERS = {"rig": rig, "rig filament": rig_filament, "open3d": open3d_defaults, "pyrender": pyrender_shadows}


def measure(name: str, width: int, height: int, picture: str | None = None) -> dict[str, float]:
    """Seconds to build and frames per second, in this process."""
    start = time.perf_counter()
    poses, frame = RENDERERS[name](width, height)
    frame(poses[0])
    built = time.perf_counter() - start
    start = time.perf_counter()
    images = [frame(pose) for pose in poses]
    rate = len(poses) / (time.perf_counter() - start)
    if picture:
        from PIL import Image

        Image.fromarray(np.ascontiguousarray(images[1])).save(picture)
    return {"build_s": built, "fps": rate}


def run(quiet: bool = False) -> dict[str, float]:
    """Median rates and ratios per size."""
    results: dict[str, float] = {}
    for width, height in SIZES:
        rates: dict[str, list[float]] = {name: [] for name in RENDERERS}
        for _ in range(ROUNDS):
            for name in RENDERERS:
                command = [sys.executable, "-m", "benchmarks.bench_rig", name, str(width), str(height)]
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                if done.returncode:
                    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
                    if not quiet:
                        print(f"{name} did not run: {last[:160]}")
                    continue
                rates[name].append(json.loads(done.stdout.strip().splitlines()[-1])["fps"])
        middle = {name: float(np.median(values)) for name, values in rates.items() if values}
        for name, rate in middle.items():
            results[f"rig {width}x{height}: {name} frames/s"] = rate
        for peer in ("pyrender", "open3d"):
            if peer in middle:
                results[f"rig {width}x{height}: ratio to {peer}"] = middle["rig"] / middle[peer]
    return results


if __name__ == "__main__":
    name, width, height, *picture = sys.argv[1:]
    print(json.dumps(measure(name, int(width), int(height), *picture)))
