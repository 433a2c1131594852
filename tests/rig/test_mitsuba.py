"""The path tracer against the ray caster: the same geometry and about the same light, by code that shares nothing."""

from dataclasses import replace
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest
from texture_parts import VIEWS, crate_config, make_crate
from tiny_network import tiny_classifier
from walled_field import make_field

from toolkit.boosters.linear_view import batch_views, show_texture
from toolkit.boosters.pixels import from_picture
from toolkit.boosters.texture import train_texture
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.models.load import load_classifier
from toolkit.models.predict import predict
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Material
from toolkit.rig import mitsuba
from toolkit.rig.camera import Camera, look_at, orbit_pose
from toolkit.rig.mitsuba import SAMPLES, MitsubaRenderer, choose_variant, denoise, describe_mitsuba, mitsuba_trouble
from toolkit.rig.plan import Pattern, plan_poses
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderers import describe_cost, make_renderer
from toolkit.rig.scene import Stand
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import make_studio
from toolkit.rig.views import TRAIN, PaintableObject, render_block
from toolkit.rooms.worlds.place import find_spot, place_object
from toolkit.rooms.worlds.sky import make_sky

CAMERA = Camera.from_fov(96, 72, 40)
ASIDE = replace(CAMERA, cx=CAMERA.cx + 20, cy=CAMERA.cy - 12)
POSE = orbit_pose((0, 0, 20), 30, 40, 300)
STAND = Stand((15.0, -10.0, 0.0), 70.0)


@pytest.fixture(scope="module")
def needs_mitsuba():
    if (trouble := mitsuba_trouble()) is not None:
        pytest.skip(f"needs the extra mitsuba: {trouble}")


@pytest.fixture(scope="module")
def studio():
    return make_studio(0, 100, "white")


def painted(mesh, code, roughness=1.0):
    texture = np.full((4, 4, 3), code, np.uint8)
    return replace(mesh, materials=tuple(replace(one, texture=texture, roughness=roughness) for one in mesh.materials))


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, ASIDE], ids=["middle", "aside"])
def test_silhouettes_and_normals_are_the_ray_casters(needs_mitsuba, make_box, studio, camera):
    """A red box: what has its colour is the object, and its top looks up."""
    box = painted(make_box(), (200, 0, 0))
    renderer = MitsubaRenderer(box, studio, STAND, samples=16)
    _, albedo, normal = renderer.trace(camera, POSE)
    theirs = albedo[..., 0] - albedo[..., 2] > 0.3
    found = renderer.buffers(camera, POSE)
    ours = found["material"] >= 0
    assert ours.sum() > 400
    # pixels on the rim are part object: half of one row all round at most
    assert (ours & theirs).sum() / (ours | theirs).sum() > 0.93
    moment = [np.argwhere(mask).mean(axis=0) for mask in (ours, theirs)]
    assert np.abs(moment[0] - moment[1]).max() < 0.15
    top = ours & theirs & (normal[..., 2] > 0.99)
    assert top.sum() > 100


@pytest.mark.slow
@pytest.mark.parametrize("name", ["racer", "eggnog", "warplane", "coffeepot"])
def test_built_in_objects_have_the_ray_casters_outline_depth_and_texture(needs_mitsuba, name):
    """Rays through the pixels' centres, by Mitsuba's own search; above the table, which is at z = 0."""
    mi = mitsuba._load()
    if mi.variant() != "llvm_ad_rgb":
        pytest.skip("rays by the thousand need llvm_ad_rgb: see 'toolkit doctor'")
    item, camera = load_object(Workspace(Path()).object_spec(name)), Camera.from_fov(128, 128, 40)
    renderer = MitsubaRenderer(item.mesh, make_studio(0, float(item.mesh.size_mm.max())))
    row, column = np.mgrid[:128, :128] + 0.5
    local = np.stack([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, np.ones_like(row)], -1)
    for pose in plan_poses(item, camera, Pattern())[::6]:
        matrix = pose.matrix()
        rays = local.reshape(-1, 3) @ matrix[:3, :3].T
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        axes = [mi.Float(np.ascontiguousarray(axis, np.float32)) for axis in rays.T]
        met = renderer._built.ray_intersect(mi.Ray3f(mi.Point3f(*matrix[:3, 3].tolist()), mi.Vector3f(*axes)))
        found, far = renderer.buffers(camera, matrix), np.array(met.t)
        ours, theirs = (found["material"] >= 0).ravel(), np.isfinite(far) & (np.array(met.p.z) > 1e-3)
        both = ours & theirs
        assert both.sum() / (ours | theirs).sum() >= 0.9995
        # at an outline one of the two may just meet what lies behind
        assert np.quantile(np.abs(far[both] - found["depth"].ravel()[both]), 0.99) < 0.05
        sizes = np.array([one.texture.shape[1::-1] for one in item.mesh.materials])
        uv = np.stack([np.array(met.uv.x), 1 - np.array(met.uv.y)], -1)[both]
        apart = np.abs(uv - found["uv"].reshape(-1, 2)[both]) * sizes[found["material"].ravel()[both]]
        assert np.quantile(apart, 0.99) < 0.5


@pytest.mark.slow
def test_a_texture_lies_as_the_ray_caster_lays_it(needs_mitsuba, make_box, studio):
    """Red to the right, green upwards: mirrored or turned it would be another picture."""
    v, u = np.mgrid[63:-1:-1, 0:64] * 4
    ramp = np.stack([u, v, np.full(u.shape, 60)], axis=-1).astype(np.uint8)
    box = make_box()
    box = replace(box, materials=(Material("ramp", ramp, 1.0), *box.materials[1:]))
    renderer = MitsubaRenderer(box, studio, STAND, samples=4)
    albedo = renderer.trace(CAMERA, POSE)[1]
    found = renderer.buffers(CAMERA, POSE)
    # inside the object: a pixel's neighbours show it as well
    seen = found["material"] == 0
    inside = seen & np.roll(seen, 1, 0) & np.roll(seen, -1, 0) & np.roll(seen, 1, 1) & np.roll(seen, -1, 1)
    uv = found["uv"][inside]
    for channel in (0, 1):
        red = np.corrcoef(albedo[inside][:, channel], (uv[:, channel] % 1) ** 2.2)[0, 1]
        assert red > 0.97, channel


@pytest.mark.slow
@pytest.mark.parametrize("light", ["studio", "side", "dim"])
def test_exposure_key_and_room_are_the_scenes(needs_mitsuba, make_box, light):
    """Matt grey, so that its brightness is that of the light alone; bounces add a little to ours."""
    box = painted(make_box(), (128, 128, 128))
    studio = make_studio(0, 100, "white", light)
    dark = replace(studio.key, irradiance=(0.0, 0.0, 0.0))
    scenes = studio, replace(studio, exposure=studio.exposure / 2), replace(studio, key=dark)
    seen = RaycastRenderer(box, studio).buffers(CAMERA, POSE)["material"] >= 0
    for scene in scenes:
        ours = RaycastRenderer(box, scene).render(CAMERA, POSE)
        theirs = MitsubaRenderer(box, scene, samples=16).render(CAMERA, POSE)
        assert theirs[seen].mean() == pytest.approx(ours[seen].mean(), rel=0.15)
        assert theirs[~seen].mean() == pytest.approx(ours[~seen].mean(), rel=0.15)


@pytest.mark.slow
def test_pictures_are_denoised_and_the_same_each_time(needs_mitsuba, make_box, studio):
    box = painted(make_box(), (128, 128, 128))
    few = MitsubaRenderer(box, studio, samples=16)
    truth = MitsubaRenderer(box, studio, samples=400).trace(CAMERA, POSE)[0] * studio.exposure
    noisy, albedo, normal = few.trace(CAMERA, POSE)
    noisy = noisy * np.float32(studio.exposure)
    picture = few.render(CAMERA, POSE)
    assert np.array_equal(picture, denoise(noisy, albedo, normal))
    assert np.array_equal(picture, MitsubaRenderer(box, studio, samples=16).render(CAMERA, POSE))
    assert np.abs(picture - truth).mean() < 0.5 * np.abs(noisy - truth).mean()


@pytest.mark.slow
def test_a_world_has_its_sky_where_the_ray_caster_has_it(needs_mitsuba, make_box):
    field, sky = make_field(), make_sky("noon", 0, 32)
    placed = place_object(make_box((4.0, 2.4, 1.6)), field, find_spot(field, "west"), sky)
    pose = look_at(np.array([-14.0, 3.0, 4.0]), np.array([-4.0, 0.0, 0.8]))
    renderers = [make_renderer(name, placed.mesh, placed.scene, stand=placed.stand) for name in ("raycast", "mitsuba")]
    ours, theirs = (renderer.render(Camera.from_fov(64, 48, 60), pose) for renderer in renderers)
    found = renderers[1].buffers(Camera.from_fov(64, 48, 60), pose)
    for mesh in (0, 1, 255):
        part = found["mesh"] == mesh
        assert part.sum() > 20
        assert theirs[part].mean(axis=0) == pytest.approx(ours[part].mean(axis=0), rel=0.25), mesh


@pytest.mark.slow
def test_a_texture_is_trained_on_its_pictures(needs_mitsuba, tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "w")
    made = train_texture(
        crate_config(2, renderer="mitsuba"), [tiny_classifier()], space, class_name="jet", workers=0
    ).texture  # fmt: skip
    assert made.record.settings["renderer"]["library"] == describe_mitsuba()[0]
    # the views show the texture, and the light of this renderer
    mesh, atlas = make_crate(space)
    subject = PaintableObject(atlas.mesh, int(atlas.mesh.face_material[atlas.trained][0]), mesh)
    views = [one.view for one in render_block((subject,), VIEWS, 0, TRAIN, 0, renderer="mitsuba")]
    texture = from_picture(made.pixels, "cpu")
    ours, theirs = (
        show_texture(texture, batch_views(some, "cpu")).numpy()
        for some in ([replace(view, repaint=None) for view in views], views)
    )
    assert 0.002 < np.abs(ours - theirs).mean() < 0.05
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.97


@pytest.fixture
def fresh():
    """Nothing is remembered of what starts here, before and afterwards."""
    remembered = mitsuba_trouble, choose_variant, mitsuba.probe_variant
    for function in remembered:
        function.cache_clear()
    yield
    for function in remembered:
        function.cache_clear()


@pytest.fixture
def probes(monkeypatch):
    """Codes and messages with which variants end, instead of processes; found are the variants that were tried."""
    ends = {"llvm_ad_rgb": (0, b""), "scalar_rgb": (0, b""), "tried": []}

    def run(code):
        variant = next((name for name in ends if repr(name) in code), "denoiser")
        ends["tried"].append(variant)
        return CompletedProcess([], ends.get(variant, (0, b""))[0], b"", ends.get(variant, (0, b""))[1])

    monkeypatch.setattr(mitsuba, "run_python", run)
    monkeypatch.setattr(mitsuba, "find_spec", lambda name: name)
    monkeypatch.setattr(mitsuba, "version", lambda name: "3.9.1")
    monkeypatch.delenv(mitsuba.VARIABLE, raising=False)
    return ends


def test_the_faster_variant_is_used_where_it_starts(fresh, probes):
    assert (choose_variant(), mitsuba_trouble()) == ("llvm_ad_rgb", None)
    assert describe_mitsuba() == ("mitsuba 3.9.1 llvm_ad_rgb", "")


def test_an_llvm_that_ends_the_process_costs_speed_alone(fresh, probes):
    """As LLVM 15 does with AVX-512: it aborts, which no exception tells of."""
    probes["llvm_ad_rgb"] = (-6, b"LLVM ERROR: Cannot select\nIn function: drjit_581444")
    assert (choose_variant(), mitsuba_trouble()) == ("scalar_rgb", None)
    library, faster = describe_mitsuba()
    assert library == "mitsuba 3.9.1 scalar_rgb" and "libllvm19" in faster and "DRJIT_LIBLLVM_PATH" in faster


@pytest.mark.parametrize(
    ("end", "said"),
    [((-6, b"one\nof LLVM"), "it ended with code -6"), ((1, b"Traceback\nImportError: no GPU"), "no GPU")],
)
def test_a_variant_that_was_named_is_used_or_refused(fresh, probes, monkeypatch, end, said):
    monkeypatch.setenv(mitsuba.VARIABLE, "cuda_ad_rgb")
    probes["cuda_ad_rgb"] = end
    assert choose_variant() == "cuda_ad_rgb" and said in mitsuba_trouble()
    assert "scalar_rgb" not in probes["tried"] and describe_mitsuba()[1] == ""


def test_an_unknown_variant_is_refused_with_those_that_are_known(fresh, probes, monkeypatch):
    monkeypatch.setenv(mitsuba.VARIABLE, "scalar_spectral")
    assert mitsuba_trouble() == ("TOOLKIT_MITSUBA is 'scalar_spectral': expected llvm_ad_rgb, scalar_rgb, cuda_ad_rgb")
    assert probes["tried"] == []


@pytest.mark.slow
def test_without_a_good_llvm_it_starts_all_the_same(needs_mitsuba, fresh, monkeypatch, tmp_path):
    """The true processes: a folder is no library, so that LLVM's variant cannot start."""
    monkeypatch.delenv(mitsuba.VARIABLE, raising=False)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path))
    assert mitsuba.probe_variant("llvm_ad_rgb") is not None
    assert (choose_variant(), mitsuba_trouble()) == ("scalar_rgb", None)


def test_threads_of_llvm_share_no_pixel():
    """A task of its holds 2^14 rays: whole pixels only for a power of two; and the sampler's grid needs a square."""
    assert 2**14 % SAMPLES == 0 and round(SAMPLES**0.5) ** 2 == SAMPLES


@pytest.mark.slow
def test_the_samples_are_enough_for_the_answers(needs_mitsuba, real_weights):
    """A network answers alike at 256 samples: light, texture and outlines are those of 16, denoised."""
    camera, classifier = (
        Camera.from_fov(264, 264, 40),
        load_classifier("resnet18", next(real_weights.glob("resnet18-*.pth"))),
    )
    pictures: list[np.ndarray] = []
    for name in ("racer", "eggnog", "warplane"):
        item = load_object(Workspace(Path()).object_spec(name))
        pose = plan_poses(item, camera, Pattern())[3].matrix()
        scene = make_studio(0, float(item.mesh.size_mm.max()))
        pictures += [
            tone_map(MitsubaRenderer(item.mesh, scene, samples=n).render(camera, pose), (0, 1)) for n in (SAMPLES, 256)
        ]
    few, many = np.stack(pictures)[::2], np.stack(pictures)[1::2]
    assert np.abs(few.astype(int) - many).mean() < 2
    answers = predict(np.stack([resize_and_crop(one, classifier.preprocessing) for one in pictures]), classifier)
    guesses = answers.argmax(axis=1).reshape(3, 2)
    assert (guesses[:, 0] == guesses[:, 1]).all()


def test_what_it_cannot_do_is_one_line(make_box, studio, monkeypatch, fresh):
    monkeypatch.setattr("toolkit.rig.mitsuba.find_spec", lambda name: None)
    said = (
        r"mitsuba cannot start: mitsuba and pyoidn are not installed: run 'pip install .*mitsuba.*', or use .* raycast"
    )
    with pytest.raises(ToolkitError, match=said):
        make_renderer("mitsuba", make_box(), studio)
    # captures ask before they make one
    assert describe_mitsuba() == ("", "") and describe_cost("mitsuba", [640 * 480]) == ""
    pytest.importorskip("mitsuba")
    oblong = replace(CAMERA, fy=CAMERA.fy * 1.01)
    with pytest.raises(ToolkitError, match="the renderer mitsuba wants square pixels, and the camera has fx"):
        MitsubaRenderer(make_box(), studio).render(oblong, POSE)
