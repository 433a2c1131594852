"""Plan, captures and the pieces of a wrap about their object, in a live 3D viewer: what `toolkit view` shows."""

import contextlib
import io
import socket
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from toolkit.captures.capture import Capture
from toolkit.captures.read import Selection, read_captures
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.text import count_of
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import UnreadableImage, find_files, read_image
from toolkit.objects.atlas import split_vertices
from toolkit.objects.export_mesh import MM_PER_M, T_GLTF_WORLD, to_glb
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import Material, Mesh
from toolkit.objects.wrap import Wrap, find_wrap, wrap_folder
from toolkit.rig.plan import CapturePlan, open_plan
from toolkit.rig.wrapped import fill_canvas

if TYPE_CHECKING:
    import viser

NEEDS_EXTRA = "toolkit view needs viser, which is not installed: pip install '.[view]' in the kit's folder"
PICTURE_PX = 240
"""Longer side of the pictures in the frusta: hundreds of them are sent to the browser."""
FRUSTUM = 0.12
"""Size of a frustum, as a share of the camera's distance."""
LIFT_MM = 0.4
"""Pieces float this far above the surface, so that none is hidden by it."""
PLAN_COLOUR = (140, 146, 156)
CAPTURE_COLOURS = ((22, 130, 62), (30, 100, 200), (190, 90, 20), (150, 40, 150))
DEFAULT_PORT = 8770


@dataclass(frozen=True)
class Frustum:
    """A camera about the object.

    Attributes:
        name: of its node, such as `/captures/sim/patched/pose 1`.
        T_world_camera: (4, 4), OpenCV axes, millimetres.
        fov: vertical, radians.
        aspect: width / height.
        capture: whose picture it shows; None for a pose of the plan.
    """

    name: str
    T_world_camera: np.ndarray
    fov: float
    aspect: float
    capture: Capture | None = None


@dataclass(frozen=True)
class View3d:
    """What is shown of one object.

    Attributes:
        item: the object.
        frusta: of the plan and of the captures.
        wrap: whose pieces are shown; None where the object has none.
        left_out: (path, reason) of images that are not shown.
    """

    item: TableObject
    frusta: tuple[Frustum, ...]
    wrap: Wrap | None = None
    left_out: tuple[tuple[str, str], ...] = field(default=())

    def lines(self) -> Iterator[str]:
        """How much there is to see."""
        captures = sum(frustum.capture is not None for frustum in self.frusta)
        parts = [count_of(len(self.frusta) - captures, "planned pose"), count_of(captures, "image")]
        parts += [] if self.wrap is None else [f"{count_of(len(self.wrap.pieces), 'piece')} of its wrap"]
        yield f"{self.item.name}: {', '.join(parts)}"


def gather_view(workspace: Workspace, name: str | None = None, sources: Sequence[str] = ()) -> View3d:
    """Read what there is of an object: its plan, its captures and its wrap.

    Args:
        workspace: whose object it is.
        name: of the object; by default the plan's first.
        sources: only images of these; by default all.

    Raises:
        ToolkitError: there is no such object, source or plan, or a file is broken.
    """
    plan = open_plan(workspace, [name] if name else None) if workspace.plan_file.is_file() else None
    if name is None and plan is None:
        raise FieldError("which object? there is no plan yet, so name it with {object_name}", {})
    item = load_object(workspace.object_spec(name or next(iter(plan.objects))))  # type: ignore[union-attr]
    frusta = [] if plan is None or item.name not in plan.objects else _list_plan(plan, item.name)
    left_out = list[tuple[str, str]]()
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
    wrap = find_wrap(workspace, item) if wrap_folder(workspace, item) is not None else None
    return View3d(item, tuple(frusta), wrap, tuple(left_out))


def _list_plan(plan: CapturePlan, name: str) -> list[Frustum]:
    camera = plan.camera
    fov = 2 * np.arctan(camera.height / (2 * camera.fy))
    aspect = camera.width / camera.height
    return [Frustum(f"/plan/pose {pose.id}", pose.matrix(), float(fov), aspect) for pose in plan.objects[name]]


def _place(capture: Capture) -> Frustum | str:
    """The camera of an image, or why it has no place."""
    if capture.T_world_camera is None or capture.focal_length is None:
        return "no camera is known of it"
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

    Only the images of one source and variant are visible at first: those of a pair have the same place. The viewer's
    list of nodes switches the others on.
    """
    scene = server.scene
    scene.set_up_direction("+z")
    reach = _measure_reach(view)
    scene.add_grid("/table", width=2 * reach, height=2 * reach, cell_size=reach / 20, section_size=reach / 4)
    server.initial_camera.position = (1.5 * reach, 0.9 * reach, 0.9 * reach)
    server.initial_camera.look_at = (0.0, 0.0, reach / 4)
    _add_mesh(scene, "/object", view.item.mesh)
    if view.wrap is not None:
        _add_pieces(scene, view.item, view.wrap)
    groups = list(dict.fromkeys(one.name.rsplit("/", 1)[0] for one in view.frusta if one.capture is not None))
    for frustum in view.frusta:
        group = frustum.name.rsplit("/", 1)[0]
        _add_frustum(scene, frustum, groups.index(group) if group in groups else None)
    for number, group in enumerate(groups):
        scene.add_frame(group, show_axes=False, visible=number == 0)


def _measure_reach(view: View3d) -> float:
    """How far from the object the farthest camera is, metres; at least twice the object's longest side."""
    far = [float(np.linalg.norm(frustum.T_world_camera[:3, 3])) for frustum in view.frusta]
    return max([*far, 2 * float(view.item.mesh.size_mm.max())]) / MM_PER_M


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


def _add_pieces(scene: "viser.SceneApi", item: TableObject, wrap: Wrap) -> None:
    """Each piece a mesh of its own, a little above the surface, with its number."""
    mesh, canvas = item.mesh, fill_canvas(wrap, len(item.mesh.faces))
    corner_uv = wrap.corner_uv(len(mesh.faces))
    look = (Material("wrap", canvas),)
    for number, piece in enumerate(wrap.pieces, 1):
        part = replace(
            mesh, faces=mesh.faces[piece.faces], face_material=np.zeros(len(piece.faces), np.int32), materials=look
        )
        part = split_vertices(part, corner_uv[piece.faces])
        lifted = replace(part, vertices=part.vertices + LIFT_MM * part.normals)
        _add_mesh(scene, f"/wrap/piece {number}", lifted)
        middle = lifted.vertices[lifted.faces].mean(axis=(0, 1)) / MM_PER_M
        scene.add_label(f"/wrap/numbers/{number}", str(number), position=middle, font_screen_scale=0.6)


def _add_mesh(scene: "viser.SceneApi", name: str, mesh: Mesh) -> None:
    # GLB has y up: turned back into the world
    scene.add_glb(name, to_glb(mesh, name.rsplit("/", 1)[-1]), wxyz=as_quaternion(T_GLTF_WORLD.T))


def as_quaternion(rotation: np.ndarray) -> np.ndarray:
    """(4,) w x y z of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])


def open_viewer(port: int | None = None) -> "viser.ViserServer":
    """Start a viewer that this machine alone can reach; stop it with its `stop`.

    Args:
        port: by default `DEFAULT_PORT`, or a free one.

    Raises:
        ToolkitError: viser is not installed, or the port is taken.
    """
    try:
        import viser
    except ImportError:
        raise ToolkitError(NEEDS_EXTRA) from None
    # its own banner says the same as the command, and some of it twice
    with contextlib.redirect_stdout(io.StringIO()):
        return viser.ViserServer(host="127.0.0.1", port=_choose_port(port), label="toolkit", verbose=False)


def _choose_port(port: int | None) -> int:
    for one in (port,) if port is not None else (DEFAULT_PORT, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", one))
                return int(probe.getsockname()[1])
            except OSError:
                continue
    raise FieldError("is taken by another program: name another, or none", {"port": port})
