"""A sheet of paper on an object: flat where it can be, bent without stretching where not, never through the object."""

import numpy as np
import pytest

from toolkit.core.errors import ToolkitError
from toolkit.objects.mesh import merge_meshes, place_on_table
from toolkit.objects.records import TAPE_MARGIN_MM
from toolkit.objects.spec import PatchMount
from toolkit.rig.camera import Camera, orbit_pose, project
from toolkit.rig.mount import BACK_MATERIAL, PAPER_MATERIAL, attach, mount_patch, print_on_paper
from toolkit.rooms.worlds.content.modelling import assemble, box, revolve

QUADRANTS = np.array([[[220, 20, 20], [20, 200, 20]], [[20, 20, 220], [210, 200, 10]]], np.uint8)
"""Upper left red, upper right green, lower left blue, lower right yellow."""
PX = QUADRANTS.repeat(8, 0).repeat(8, 1)


def build(parts):
    return place_on_table(assemble(parts, {"paint": (0.8, 0.0)}, 128))


@pytest.fixture(scope="module")
def cube():
    return build(box((100, 100, 100)))


@pytest.fixture(scope="module")
def curved():
    """Shapes that a sheet must bend over, all watertight."""
    lying = revolve([(0, -60), (30, -60), (30, 60), (0, 60)], segments=96)
    roof = box((70, 70, 120))
    return {
        "cylinder along x": build([lying.rotated("y", 90)]),
        "cylinder along y": build([lying.rotated("x", 90)]),
        "standing cylinder": build([lying]),
        "ridge": build([part.rotated("x", 45) for part in roof]),
        "narrow top": build(box((46, 46, 120))),
        "tilted slab": build([part.rotated("y", 25) for part in box((150, 100, 20))]),
    }


CURVED = ["cylinder along x", "cylinder along y", "standing cylinder", "ridge", "narrow top", "tilted slab"]


def front_face(sheet):
    """Vertices and uv of the printed face."""
    mesh = sheet.mesh
    paper = [m.name for m in mesh.materials].index(PAPER_MATERIAL)
    faces = mesh.faces[mesh.face_material == paper]
    used = np.unique(faces)
    return mesh.vertices[used].astype(float), mesh.uv[used].astype(float), np.searchsorted(used, faces)


def place_of(sheet, u, v):
    """The point of the printed face that shows texture coordinate (u, v)."""
    vertices, uv, faces = front_face(sheet)
    corners = uv[faces]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    weights = np.linalg.solve(edges, (np.array([u, v]) - corners[:, 0])[..., None])[..., 0]
    inside = np.flatnonzero((weights > -1e-6).all(axis=1) & (weights.sum(axis=1) < 1 + 1e-6))[0]
    a, b, c = vertices[faces[inside]]
    return a + weights[inside, 0] * (b - a) + weights[inside, 1] * (c - a)


def test_on_a_flat_top_it_is_flat_and_exactly_where_asked_for(cube):
    sheet = mount_patch(cube, PX, 40.0, PatchMount(offset_mm=(7, -4)))
    vertices, _, _ = front_face(sheet)
    half = 20 + TAPE_MARGIN_MM
    np.testing.assert_allclose(vertices.min(axis=0)[:2], [7 - half, -4 - half], atol=1e-3)
    np.testing.assert_allclose(vertices.max(axis=0)[:2], [7 + half, -4 + half], atol=1e-3)
    assert np.ptp(vertices[:, 2]) < 1e-3
    assert 100 < vertices[0, 2] < 101  # on the face, not in it
    np.testing.assert_allclose(place_of(sheet, 0.5, 0.5)[:2], [7, -4], atol=1e-3)


@pytest.mark.parametrize("name", CURVED)
def test_no_length_on_the_paper_changes(curved, name):
    """Every edge of every triangle is as long on the object as on the paper: the sheet is bent, not stretched."""
    sheet = mount_patch(curved[name], PX, 40.0, PatchMount())
    vertices, uv, faces = front_face(sheet)
    side = 40 + 2 * TAPE_MARGIN_MM
    for a, b in ((0, 1), (1, 2), (2, 0)):
        bent = np.linalg.norm(vertices[faces[:, a]] - vertices[faces[:, b]], axis=1)
        flat = np.linalg.norm(uv[faces[:, a]] - uv[faces[:, b]], axis=1) * side
        np.testing.assert_allclose(bent, flat, atol=0.1)
    along = np.unique(uv[:, 0]) if len(np.unique(uv[:, 0])) > 2 else np.unique(uv[:, 1])
    axis = 0 if len(np.unique(uv[:, 0])) > 2 else 1
    border = vertices[uv[:, 1 - axis] == 0][np.argsort(uv[uv[:, 1 - axis] == 0][:, axis])]
    assert len(border) == len(along)
    assert np.linalg.norm(np.diff(border, axis=0), axis=1).sum() == pytest.approx(side, abs=0.1)


@pytest.mark.parametrize("name", CURVED)
def test_it_lies_on_the_surface_and_never_in_it(curved, name):
    import open3d as o3d

    mesh = curved[name]
    sheet = mount_patch(mesh, PX, 40.0, PatchMount())
    vertices, _, faces = front_face(sheet)
    triangles = vertices[faces]
    weights = np.random.default_rng(0).dirichlet(np.ones(3), size=(20, len(faces)))
    points = np.concatenate([vertices, np.einsum("kfc,fcx->kfx", weights, triangles).reshape(-1, 3)])
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices), o3d.core.Tensor(mesh.faces.astype(np.uint32)))
    distance = scene.compute_signed_distance(o3d.core.Tensor(points.astype(np.float32)), nsamples=3).numpy()
    assert distance.min() > -0.02  # mm
    assert distance.min() < 1.5  # touches


def test_it_bends_over_a_cylinder_across_its_axis_only(curved):
    for name, straight in (("cylinder along x", 0), ("cylinder along y", 1)):
        vertices, _, _ = front_face(mount_patch(curved[name], PX, 40.0, PatchMount()))
        assert np.ptp(vertices[:, straight]) == pytest.approx(50, abs=0.01)
        assert np.ptp(vertices[:, 1 - straight]) < 48.5  # the chord is shorter than the arc
        assert 6 < np.ptp(vertices[:, 2]) < 15  # a circle of radius 30 falls away by 9.9 over the arc of 25


def test_it_hangs_alike_on_both_sides_and_no_steeper_than_paper_does(curved):
    vertices, _, _ = front_face(mount_patch(curved["narrow top"], PX, 40.0, PatchMount()))
    axis = int(np.ptp(vertices[:, 1]) < np.ptp(vertices[:, 0]))
    assert vertices[:, :2].mean(axis=0) == pytest.approx([0, 0], abs=0.05)
    curve = vertices[vertices[:, 1 - axis] > 0]
    curve = curve[np.argsort(curve[:, axis])]
    steepness = np.degrees(np.arctan2(np.abs(np.diff(curve[:, 2])), np.diff(curve[:, axis])))
    assert steepness.max() < 39
    np.testing.assert_allclose(curve[:, 2], curve[::-1, 2], atol=0.05)
    assert vertices[:, 2].max() < 121.5


def test_tilting_with_the_surface_does_not_carry_it_sideways(curved):
    """Something tall beside the place raises the bounding box: the sheet still lies where the spec says."""
    slab = curved["tilted slab"]
    pole = build(box((4, 4, 260)))
    pole = type(pole)(**{**vars(pole), "vertices": pole.vertices + np.array([60, 45, 0], np.float32)})
    sheet = mount_patch(merge_meshes([slab, pole]), PX, 40.0, PatchMount())
    centre = place_of(sheet, 0.5, 0.5)
    np.testing.assert_allclose(centre[:2], [0, 0], atol=1.0)
    surface = slab.vertices[:, 2].max() / 2 + 10 / np.cos(np.radians(25))
    assert 0 < centre[2] - surface < 1.5


def test_the_other_face_is_white_and_just_behind(cube):
    sheet = mount_patch(cube, PX, 40.0, PatchMount())
    paper, back = sheet.mesh.materials
    assert (paper.name, back.name) == (PAPER_MATERIAL, BACK_MATERIAL)
    assert back.texture.min() > 230
    corners = sheet.mesh.vertices[sheet.mesh.faces].astype(float)
    upward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (upward[sheet.mesh.face_material == 0] > 0).all() and (upward[sheet.mesh.face_material == 1] < 0).all()
    assert corners[sheet.mesh.face_material == 1][..., 2].min() > 100
    assert len(attach(cube, sheet).faces) == len(cube.faces) + len(sheet.mesh.faces)


def test_a_print_over_the_margin_is_mirrored_at_the_patchs_edges():
    pixels = np.random.default_rng(0).integers(0, 256, (20, 20, 3), np.uint8)
    white, bleed = (print_on_paper(pixels, 40.0, margin) for margin in ("white", "bleed"))
    margin = round(TAPE_MARGIN_MM / 40 * len(white) / (1 + 2 * TAPE_MARGIN_MM / 40))
    inner = slice(margin, -margin)
    np.testing.assert_array_equal(white[inner, inner], bleed[inner, inner])
    for turned in (bleed, bleed[::-1], bleed.swapaxes(0, 1), bleed[:, ::-1]):
        np.testing.assert_array_equal(turned[:margin], turned[margin : 2 * margin][::-1])


@pytest.mark.parametrize("n", [2, 7, 100, 333, 1000])
@pytest.mark.parametrize("size", [20.0, 88.2])
def test_the_print_has_its_size_on_the_paper(n, size):
    ink = np.zeros((n, n, 3), np.uint8)
    side = size + 2 * TAPE_MARGIN_MM
    paper = print_on_paper(ink, size)
    inked = np.flatnonzero((paper == 0).all(axis=2).any(axis=0))
    texel = side / paper.shape[1]
    assert paper.shape[0] == paper.shape[1]
    assert len(inked) % n == 0  # whole texels per patch pixel: crisp
    assert len(inked) * texel == pytest.approx(size, abs=texel)
    assert inked[0] == paper.shape[1] - 1 - inked[-1]  # in the middle
    assert paper[0].min() > 230


@pytest.mark.parametrize("at", ["top", "front", "back", "left", "right"])
@pytest.mark.parametrize(("turn", "corner"), [(0, (0, 1)), (90, (1, 1)), (180, (1, 0)), (-90, (0, 0))])
def test_rotation_turns_the_print_counter_clockwise(cube, at, turn, corner):
    """After a turn by 90° the print's upper right corner is where the upper left one was, and so on."""
    straight = mount_patch(cube, PX, 40.0, PatchMount(at=at))
    turned = mount_patch(cube, PX, 40.0, PatchMount(at=at, rotation_deg=turn))
    np.testing.assert_allclose(place_of(turned, *corner), place_of(straight, 0, 1), atol=0.05)


@pytest.mark.parametrize(
    ("size", "mount", "words"),
    [
        (51.0, {}, r"crate: a patch of 51 mm is over half of .*\(100 mm\): .*size_mm = 33"),
        (40.0, {"offset_mm": (300, 0)}, r"crate: there is no surface below the patch at .*'top', offset_mm = \[300.0"),
        (40.0, {"at": "left", "offset_mm": (0, 300)}, "no surface below the patch at .*'left'"),
    ],
)
def test_a_place_that_cannot_be_is_refused(cube, size, mount, words):
    with pytest.raises(ToolkitError, match=words):
        mount_patch(cube, PX, size, PatchMount(**mount), "crate")


def test_a_slope_that_the_sheet_no_longer_meets_once_it_is_tilted_is_no_place():
    """From above the steep plate is under the sheet's edge; along its own slope it is beyond."""
    plate = build([part.rotated("y", 60) for part in box((60, 200, 1))])
    mount_patch(plate, PX, 60.0, PatchMount())
    with pytest.raises(ToolkitError, match="no surface below the patch"):
        mount_patch(plate, PX, 60.0, PatchMount(offset_mm=(40, 0)), "plate")


def test_large_objects_are_not_too_large():
    """A lorry of 12 m: rays start outside it, also where the sheet is tilted."""
    mesh = build([part.rotated("y", 40) for part in box((12_000, 6_000, 3_000))])
    sheet = mount_patch(mesh, PX, 5_000.0, PatchMount())
    vertices, _, _ = front_face(sheet)
    slope = np.degrees(np.arctan2(np.ptp(vertices[:, 2]), np.ptp(vertices[:, 0])))
    assert slope == pytest.approx(40, abs=1)


VIEWS = {
    "front": (0, 0), "left": (90, 0), "back": (180, 0), "right": (270, 0),
    "top": (270, 90),  # seen from above with the object's front at the right
}  # fmt: skip


@pytest.fixture(scope="module")
def papered(cube):
    """One scene: a sheet on each of five sides, in even white light."""
    from dataclasses import replace

    from toolkit.rig.raycast import RaycastRenderer
    from toolkit.rig.scene import KeyLight
    from toolkit.rig.studio import make_studio

    mesh = cube
    for at in VIEWS:
        mesh = attach(mesh, mount_patch(cube, PX, 40.0, PatchMount(at=at)))
    studio = make_studio(0, 100, "white")
    even = replace(
        studio, environment=np.ones_like(studio.environment), key=KeyLight(irradiance=(0, 0, 0)), exposure=1.0
    )
    return RaycastRenderer(mesh, even)


def colours_at(picture, pixels):
    """Which quadrant's colour each pixel has, by the nearest hue."""
    from toolkit.imaging.colour import srgb_to_linear

    inks = srgb_to_linear(QUADRANTS.reshape(4, 3) / 255)
    inks /= np.linalg.norm(inks, axis=1, keepdims=True)
    seen = np.stack([picture[int(y), int(x)] for x, y in pixels])
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    return (seen @ inks.T).argmax(axis=1).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("at", VIEWS)
def test_each_side_shows_the_print_upright_and_unmirrored(papered, at):
    camera = Camera.from_fov(96, 72, 40)
    azimuth, elevation = VIEWS[at]
    picture = papered.render(camera, orbit_pose(np.array([0, 0, 50.0]), azimuth, elevation, 300))
    step = 10 / 250 * camera.fx  # a quadrant's middle is 10 mm off, on a side that is 250 mm away
    x, y = np.array([-1, 1, -1, 1]) * step + 48, np.array([-1, -1, 1, 1]) * step + 36
    assert colours_at(picture, np.stack([x, y], axis=1)) == [0, 1, 2, 3]


@pytest.mark.parametrize("view", [(20, 40), (130, 60), (250, 75)])
def test_the_print_keeps_its_place_through_the_poses(papered, view):
    """Known places on the top (front is the print's right, left its upper edge) show their quadrant from everywhere."""
    camera = Camera.from_fov(160, 120, 40)
    T_world_camera = orbit_pose(np.array([0, 0, 50.0]), *view, 320)
    picture = papered.render(camera, T_world_camera)
    places = np.array([[-10, 10, 100.4], [10, 10, 100.4], [-10, -10, 100.4], [10, -10, 100.4]])
    pixels, _ = project(camera, T_world_camera, places)
    assert colours_at(picture, pixels) == [0, 1, 2, 3]
