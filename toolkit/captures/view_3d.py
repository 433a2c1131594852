"""`toolkit view`: an object with planned cameras, captures and the pieces of its boosters, in a 3D viewer."""

import contextlib
import io
import socket
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from toolkit.captures.capture import Capture
from toolkit.captures.read import Selection, read_captures
from toolkit.core.errors import FieldError
from toolkit.core.extras import import_package
from toolkit.core.text import count_of
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import UnreadableImage, find_files, read_image
from toolkit.objects.atlas import split_vertices
from toolkit.objects.export_mesh import MM_PER_M, T_GLTF_WORLD, to_glb
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import Material, Mesh
from toolkit.rig.applied.base import Pieces
from toolkit.rig.applied.kinds import KINDS
from toolkit.rig.camera import as_quaternion
from toolkit.rig.plan import read_plan

if TYPE_CHECKING:
    import viser

PICTURE_PX = 240
"""Longer side of the images in the frusta: the browser gets hundreds of them."""
FRUSTUM = 0.12
"""Size of a frustum, as a share of the camera's distance."""
LIFT_MM = 0.4
"""Height of pieces above the surface, so that it does not hide them."""
PLAN_COLOUR = (140, 146, 156)
CAPTURE_COLOURS = ((22, 130, 62), (30, 100, 200), (190, 90, 20), (150, 40, 150))
DEFAULT_PORT = 8770


@dataclass(frozen=True)
class Frustum:
    """A camera about the object.

    Attributes:
        name: name of its node, such as `/captures/sim/patched/pose 1`.
        T_world_camera: (4, 4), OpenCV axes, millimetres.
        fov: vertical field of view, radians.
        capture: image in the frustum; None for a pose of the plan.
    """

    name: str
    T_world_camera: np.ndarray
    fov: float
    aspect: float
    capture: Capture | None = None


@dataclass(frozen=True)
class View3d:
    """Scene of the viewer.

    Attributes:
        pieces: pieces on the object, by what people call their kind of booster, such as `wrap`.
    """

    item: TableObject
    frusta: tuple[Frustum, ...]
    pieces: Mapping[str, Pieces] = field(default_factory=dict)
    left_out: tuple[tuple[str, str], ...] = field(default=())

    def lines(self) -> Iterator[str]:
        """Yield the numbers of poses, images and pieces."""
        captures = sum(frustum.capture is not None for frustum in self.frusta)
        parts = [count_of(len(self.frusta) - captures, "planned pose"), count_of(captures, "image")]
        parts += [f"{count_of(len(pieces.faces), 'piece')} of its {noun}" for noun, pieces in self.pieces.items()]
        yield f"{self.item.name}: {', '.join(parts)}"


def gather_view(workspace: Workspace, name: str | None = None, sources: Sequence[str] = ()) -> View3d:
    """Read plan, captures and pieces of an object.

    Raises:
        ToolkitError: there is no such object, source or plan, or a file is broken.
    """
    plan = read_plan(workspace.plan_file) if workspace.plan_file.is_file() else None
    if name is None and plan is None:
        raise FieldError("which object? there is no plan yet, so name it with {object_name}", {})
    # without a name the plan's first object
    item = load_object(workspace.object_spec(name or next(iter(plan.objects))))  # type: ignore[union-attr]
    # planned cameras, as pyramids of the vertical field of view
    frusta = []
    if plan is not None:
        camera = plan.camera
        fov, aspect = 2 * float(np.arctan(camera.height / (2 * camera.fy))), camera.width / camera.height
        poses = plan.objects.get(item.name, ())
        frusta = [Frustum(f"/plan/pose {pose.id}", pose.matrix(), fov, aspect) for pose in poses]
    # images with a known camera
    left_out = list[tuple[str, str]]()
    # without a source named, all that lie there
    if sources or (workspace.captures_dir.is_dir() and find_files(workspace.captures_dir).images):
        found = read_captures(workspace.captures_dir, Selection(tuple(sources), (), ()))
        for capture in found.captures:
            if capture.object != item.name:
                continue
            frustum = _place(capture)
            if isinstance(frustum, str):
                left_out.append((capture.path, frustum))
            else:
                frusta.append(frustum)
    pieces = {kind.noun: kind.find_pieces(workspace, item) for kind in KINDS if kind.find_pieces is not None}
    there = {noun: found for noun, found in pieces.items() if found is not None}
    return View3d(item, tuple(frusta), there, tuple(left_out))


def _place(capture: Capture) -> Frustum | str:
    """Return the camera of an image, or why it is not known."""
    if capture.T_world_camera is None or capture.focal_length is None:
        return "its camera is not known"
    try:
        height, width = read_image(capture.file, PICTURE_PX).shape[:2]
    except UnreadableImage as error:
        return error.reason
    fov = 2 * np.arctan(height / (2 * capture.focal_length * max(width, height)))
    number = capture.file.stem if capture.pose_id is None else f"pose {capture.pose_id}"
    name = f"/captures/{capture.source}/{capture.variant}/{number}"
    return Frustum(name, np.array(capture.T_world_camera), float(fov), width / height, capture)


def show_view(server: "viser.ViserServer", view: View3d) -> None:
    """Fill a viewer's scene: object, pieces with their numbers, cameras; metres, z up.

    Only the images of the first source and variant are visible, as images of a pair have the same place. The viewer's
    list of nodes shows the others.
    """
    scene = server.scene
    scene.set_up_direction("+z")
    # distance of the farthest camera, metres, and at least twice the object's longest side
    far = [float(np.linalg.norm(frustum.T_world_camera[:3, 3])) for frustum in view.frusta]
    # in millimetres; the viewer's scene is in metres
    reach = max([*far, 2 * float(view.item.mesh.size_mm.max())]) / MM_PER_M
    scene.add_grid("/table", width=2 * reach, height=2 * reach, cell_size=reach / 20, section_size=reach / 4)
    server.initial_camera.position = (1.5 * reach, 0.9 * reach, 0.9 * reach)
    server.initial_camera.look_at = (0.0, 0.0, reach / 4)
    _add_mesh(scene, "/object", view.item.mesh)
    for noun, pieces in view.pieces.items():
        _add_pieces(scene, view.item, noun, pieces)
    groups = list(dict.fromkeys(item.name.rsplit("/", 1)[0] for item in view.frusta if item.capture is not None))
    # cameras in the colour of their group
    for frustum in view.frusta:
        group = frustum.name.rsplit("/", 1)[0]
        _add_frustum(scene, frustum, groups.index(group) if group in groups else None)
    for number, group in enumerate(groups):
        scene.add_frame(group, show_axes=False, visible=number == 0)


def _add_frustum(scene: "viser.SceneApi", frustum: Frustum, group: int | None) -> None:
    place = frustum.T_world_camera[:3, 3]
    size = FRUSTUM * float(np.linalg.norm(place)) / MM_PER_M
    image = None
    if frustum.capture is not None:
        pixels = read_image(frustum.capture.file, PICTURE_PX)
        step = max(1, max(pixels.shape[:2]) // PICTURE_PX)
        image = pixels[::step, ::step]
    scene.add_camera_frustum(
        frustum.name, fov=frustum.fov, aspect=frustum.aspect, scale=size, thickness=0.01, image=image,
        color=PLAN_COLOUR if group is None else CAPTURE_COLOURS[group % len(CAPTURE_COLOURS)],
        wxyz=as_quaternion(frustum.T_world_camera[:3, :3]), position=place / MM_PER_M,
    )  # fmt: skip


def _add_pieces(scene: "viser.SceneApi", item: TableObject, noun: str, pieces: Pieces) -> None:
    """Add each piece as a mesh, a little above the surface, with its number."""
    mesh, look = item.mesh, (Material(noun, pieces.canvas),)
    for number, (faces, corners_px) in enumerate(zip(pieces.faces, pieces.corners_px, strict=True), 1):
        part = replace(mesh, faces=mesh.faces[faces], face_material=np.zeros(len(faces), np.int32), materials=look)
        part = split_vertices(part, (corners_px / len(pieces.canvas)).astype(np.float32))
        lifted = replace(part, vertices=part.vertices + LIFT_MM * part.normals)
        _add_mesh(scene, f"/{noun}/piece {number}", lifted)
        middle = lifted.vertices[lifted.faces].mean(axis=(0, 1)) / MM_PER_M
        scene.add_label(f"/{noun}/numbers/{number}", str(number), position=middle, font_screen_scale=0.6)


def _add_mesh(scene: "viser.SceneApi", name: str, mesh: Mesh) -> None:
    # GLB has y up: turn it back into the world
    scene.add_glb(name, to_glb(mesh, name.rsplit("/", 1)[-1]), wxyz=as_quaternion(T_GLTF_WORLD.T))


def open_viewer(port: int | None = None) -> "viser.ViserServer":
    """Start a viewer for this machine alone; stop it with its `stop`.

    Raises:
        ToolkitError: viser is not installed, or the port is taken.
    """
    viser = import_package("viser", "view", "toolkit view")
    # its own banner repeats the output of the command
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host="127.0.0.1", port=_choose_port(port), label="toolkit", verbose=False)


def _choose_port(port: int | None) -> int:
    for number in (port,) if port is not None else (DEFAULT_PORT, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", number))
                return int(probe.getsockname()[1])
            except OSError:
                continue
    raise FieldError("is taken by another program: name another port, or none", {"port": port})
