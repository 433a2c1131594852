"""Compare what the kit reads of glTFs with three.js, and with what optimisers make of the kit's own exports.

Both sides draw base colours without light from one camera, at pixel centres. three.js runs in a headless Chromium whose
WebGL needs no graphics card.
"""

import base64
import functools
import http.server
import io
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

from toolkit.core.console import quietly
from toolkit.core.errors import ToolkitError
from toolkit.imaging.colour import delta_e2000, lab_of_linear, linear_to_srgb, srgb_to_linear
from toolkit.objects.gltf.pictures import GltfPicture, look_up
from toolkit.objects.load import read_mesh
from toolkit.objects.mesh import Mesh, load_open3d, make_ray_scene

PACKAGES = ("three@0.187", "gltfpack@1", "@gltf-transform/cli@4")
SIZE, FOV_DEG = 384, 35.0
MOST_CODES, LEAST_IOU, MOST_DELTA_E = 2.0, 0.995, 1.0
TOGETHER = 1e-4
"""Of the way to a surface: what lies closer together is drawn in an order that rounding decides."""
UNKNOWN_TO_THREE = (b"KHR_materials_pbrSpecularGlossiness", b"Exif\0\0")
"""Without the first it paints white; browsers turn pictures as EXIF says, which glTF does not mean."""
OPTIMISERS = {
    "gltfpack": ("gltfpack", "-i", "{from}", "-o", "{to}"),
    "gltfpack-c": ("gltfpack", "-c", "-i", "{from}", "-o", "{to}"),
    "quantize": ("gltf-transform", "quantize", "{from}", "{to}"),
    "meshopt": ("gltf-transform", "meshopt", "{from}", "{to}"),
    "draco": ("gltf-transform", "draco", "{from}", "{to}"),
    "webp": ("gltf-transform", "webp", "{from}", "{to}", "--lossless", "true"),
    "optimize": ("gltf-transform", "optimize", "{from}", "{to}", "--simplify", "false"),
}


def check_gltf(modules: Path | None, folder: Path, exported: list[Path], others: list[Path]) -> list[str]:
    """What differs, a line each; lines that begin with "- " say what was passed over.

    Args:
        modules: folder of the Node packages, None where there is no npm.
        folder: where optimised files may be written.
        exported: GLBs of the kit's own, to be optimised too.
        others: any more glTFs.
    """
    browser, driver = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
    has_packages = modules is not None and all((modules / name.rpartition("@")[0]).is_dir() for name in PACKAGES)
    if modules is None or not has_packages or browser is None or driver is None:
        return ["- three.js: passed over, it needs npm, Chromium and its driver"]
    found: list[str] = []
    drawn: list[Path] = []
    for file in exported:
        whole = draw_albedo(read_mesh(file))
        drawn.append(file)
        for name, words in OPTIMISERS.items():
            made = folder / f"{file.stem}-{name}.glb"
            command = [word.replace("{from}", str(file)).replace("{to}", str(made)) for word in words]
            command[0] = str(modules / ".bin" / command[0])
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode or not made.is_file():
                found.append(f"- {made.name}: passed over, {words[0]} failed: {done.stderr.strip()[-100:]}")
                continue
            drawn.append(made)
            found += compare_optimised(made, whole)
    with draw_by_three(modules.parent, browser, driver) as draw:
        for file in [*drawn, *others]:
            found += compare_with_three(file, draw)
    return [f"- {len(drawn) + len(others)} glTFs were drawn by three.js", *found]


def compare_optimised(file: Path, whole: np.ndarray) -> list[str]:
    """What an optimised file shows otherwise than the picture `whole` of the file that it was made of."""
    try:
        shown = draw_albedo(read_mesh(file))
    except ToolkitError as error:
        return [str(error)]
    seen = [np.isfinite(one[..., 0]) for one in (shown, whole)]
    both = seen[0] & seen[1]
    lab = [lab_of_linear(srgb_to_linear(one[both])) for one in (shown, whole)]
    difference = float(delta_e2000(*lab).mean())
    iou = both.sum() / max((seen[0] | seen[1]).sum(), 1)
    if difference <= MOST_DELTA_E and iou >= LEAST_IOU:
        return []
    return [f"{file.name}: ΔE00 {difference:.2f}, silhouettes IoU {iou:.4f}, to the file it was made of"]


def compare_with_three(file: Path, draw: "functools.partial[np.ndarray | str]") -> list[str]:
    """What three.js shows otherwise; nothing for a file that the kit refuses."""
    if any(name in file.read_bytes() for name in UNKNOWN_TO_THREE):
        return []
    try:
        with quietly():
            mesh = read_mesh(file)
    except ToolkitError:
        return []
    ours, theirs = draw_albedo(mesh), draw(file, *view_of(mesh))
    if isinstance(theirs, str):
        return [f"- {file.name}: passed over, three.js says {theirs[:100]}"]
    seen = [np.isfinite(one[..., 0]) for one in (ours, theirs)]
    both = seen[0] & seen[1] & ~find_twofold(mesh)
    iou = (seen[0] & seen[1]).sum() / max((seen[0] | seen[1]).sum(), 1)
    codes = float(np.abs(ours[both] - theirs[both]).mean() * 255) if both.any() else np.inf
    if codes <= MOST_CODES and iou >= LEAST_IOU:
        return []
    return [f"{file.name}: {codes:.2f} codes, silhouettes IoU {iou:.4f}, to three.js"]


def view_of(mesh: Mesh) -> tuple[list[float], list[float]]:
    """Eye and target that show a mesh as it stands in its file, from above on the front's left."""
    middle = mesh.bounds.mean(axis=0).astype(float)
    radius = float(np.linalg.norm(mesh.size_mm)) / 2
    direction = np.array([0.5, 0.45, 0.75]) / np.linalg.norm([0.5, 0.45, 0.75])
    eye = middle + direction * radius / np.sin(np.radians(FOV_DEG / 2)) * 1.05
    return eye.tolist(), middle.tolist()


def _cast(mesh: Mesh) -> tuple[Any, Any]:
    """(SIZE, SIZE, 6) rays through pixel centres, as Open3D takes them, and the mesh's ray scene."""
    eye, target = map(np.array, view_of(mesh))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0, 1, 0]) / np.linalg.norm(np.cross(ahead, [0, 1, 0]))
    steps = ((np.arange(SIZE) + 0.5) / SIZE * 2 - 1) * np.tan(np.radians(FOV_DEG / 2))
    x, y = np.meshgrid(steps, -steps)
    directions = ahead + x[..., None] * right + y[..., None] * np.cross(right, ahead)
    rays = np.concatenate([np.broadcast_to(eye, directions.shape), directions], axis=-1).astype(np.float32)
    return load_open3d().core.Tensor(np.ascontiguousarray(rays)), make_ray_scene(mesh)


def find_twofold(mesh: Mesh) -> np.ndarray:
    """(SIZE, SIZE) where two faces lie on one another: rounding decides which one is seen.

    Open3D does not list every hit of such a place, so that its neighbours count too.
    """
    tensor, scene = _cast(mesh)
    hits = scene.list_intersections(tensor)
    way, ray = hits["t_hit"].numpy(), hits["ray_ids"].numpy().astype(np.int64)
    first = np.full(SIZE * SIZE, np.inf)
    np.minimum.at(first, ray, way)
    near = np.bincount(ray[way <= first[ray] * (1 + TOGETHER)], minlength=SIZE * SIZE)
    twofold = (near.reshape(SIZE, SIZE) > 1).astype(np.uint8)
    return cv2.morphologyEx(twofold, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)) > 0


def draw_albedo(mesh: Mesh) -> np.ndarray:
    """(SIZE, SIZE, 3) sRGB-encoded base colour at pixel centres, NaN where there is nothing."""
    tensor, scene = _cast(mesh)
    hits = scene.cast_rays(tensor)
    met = np.isfinite(hits["t_hit"].numpy())
    face, second = hits["primitive_ids"].numpy()[met], hits["primitive_uvs"].numpy()[met]
    weights = np.column_stack([1 - second.sum(axis=1), second])
    uv = np.einsum("nk,nkd->nd", weights, mesh.uv[mesh.faces[face]].astype(float)) * [1, -1] + [0, 1]
    light = np.zeros((len(face), 3), np.float32)
    for number, material in enumerate(mesh.materials):
        chosen = mesh.face_material[face] == number
        light[chosen] = look_up(GltfPicture(material.texture, None), uv[chosen])
    picture = np.full((SIZE, SIZE, 3), np.nan, np.float32)
    picture[met] = linear_to_srgb(light)
    return picture


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def draw_by_three(tools: Path, browser: str, driver: str) -> Iterator["functools.partial[np.ndarray | str]"]:
    """A function of a file, an eye and a target that gives three.js's picture, or why there is none."""
    from selenium import webdriver

    page = Path(__file__).with_name("three.html")
    shutil.copy(page, tools / page.name)
    served = tools / "served"
    shutil.rmtree(served, ignore_errors=True)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(tools)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for word in ("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"):
        options.add_argument(word)
    try:
        with webdriver.Chrome(options=options, service=webdriver.ChromeService(driver)) as window:
            window.set_script_timeout(120)
            window.get(f"http://127.0.0.1:{server.server_port}/{page.name}")
            yield functools.partial(_draw_one, window, served)
    finally:
        server.shutdown()
        shutil.rmtree(served, ignore_errors=True)


def _draw_one(window: "object", served: Path, file: Path, eye: list[float], target: list[float]) -> np.ndarray | str:
    shutil.rmtree(served, ignore_errors=True)
    # the files that a .gltf names lie beside it
    shutil.copytree(file.parent, served) if file.suffix == ".gltf" else served.mkdir()
    shutil.copy(file, served / file.name)
    answer = window.execute_async_script(  # type: ignore[attr-defined]
        """const [url, how, done] = arguments;
        const wait = () => window.draw ? window.draw(url, how).then(done, error => done("! " + error))
                                       : setTimeout(wait, 50);
        wait();""",
        f"/served/{file.name}",
        {"eye": eye, "target": target, "fov": FOV_DEG, "size": SIZE},
    )
    if not str(answer).startswith("data:image/png;base64,"):
        return str(answer)
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(answer.partition(",")[2]))).convert("RGBA"))
    picture = pixels[..., :3].astype(np.float32) / 255
    picture[pixels[..., 3] == 0] = np.nan
    return picture
