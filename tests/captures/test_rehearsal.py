"""Shots as print, tape, hand and phone will have them: each step against what it says, and the whole on disk."""

import json
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from copier import copier_profile, print_colours
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from toolkit.boosters.transforms.camera import CameraBlur, Exposure
from toolkit.boosters.transforms.printing import SHEEN, PrintProcess, use_profile
from toolkit.captures.manifest import read_manifest
from toolkit.captures.shoot import (
    Rehearsal,
    ShootSettings,
    describe_look,
    make_rehearsal,
    print_booster,
    shoot_plan,
    shoot_unit,
)
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.imaging.colour import delta_e2000, lab_of_linear, srgb_to_linear
from toolkit.imaging.printer import SOLIDS
from toolkit.objects.load import load_object
from toolkit.rig.applied.patch import PatchBooster
from toolkit.rig.camera import Camera, orbit_pose, project
from toolkit.rig.mount import PAPER, PAPER_MATERIAL, make_flat_sheet
from toolkit.rig.plan import read_plan
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.shading import tone_map
from toolkit.rig.studio import make_studio
from toolkit.rig.variants import apply_booster, find_booster
from toolkit.rig.views import THUMBNAIL_DETAIL
from toolkit.rooms.photos.gates.framing import BLUR, NETWORK_SIDE_PX

PLAIN = ShootSettings(backdrop="white")
REHEARSED = ShootSettings(backdrop="white", rehearsal=Rehearsal())


def red_print(n: int = 12) -> PatchBooster:
    return PatchBooster(np.tile(np.uint8([255, 0, 0]), (n, n, 1)), "0" * 64, "red", (40.0,))


def test_a_solid_comes_out_in_the_colour_of_its_inks():
    """An even printer on white paper; one at random, whose inks and paper are not quite those, comes near."""
    even = PrintProcess(white=(1, 1), tint=0, density=(1, 1), chroma=(1, 1), dot_gain=(0, 0), probability=1)
    printed = print_booster(red_print(), even, 0, "crate")
    np.testing.assert_allclose(printed.pixels[6, 6] / 255, SOLIDS[1, 0, 0], atol=1 / 255)
    assert (printed.sha256, printed.name, printed.sizes_mm) == ("0" * 64, "red", (40.0,)), "still that patch"
    first, again, other = (print_booster(red_print(), Rehearsal().printer, 3, name).pixels for name in ("a", "a", "b"))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    off = [np.abs(np.array(colour) - SOLIDS[1, 0, 0]).max() for colour in ((1.0, 0, 0), first[6, 6] / 255)]
    assert off[1] < off[0], "inks of any printer are nearer to these inks than the screen is"
    assert print_booster(None, even, 0, "crate") is None


def test_the_hand_strays_as_far_as_it_says():
    hand, pose = Rehearsal(stray_share=0.02, stray_deg=3.0), np.eye(4)
    pose[:3, 3] = 10, 20, 500
    rng = np.random.default_rng(1)
    strayed = np.array([hand.perturb_pose(pose, 400.0, rng) for _ in range(4000)])
    np.testing.assert_allclose(strayed[:, :3, 3].std(axis=0), 8.0, rtol=0.05)
    np.testing.assert_allclose(strayed[:, :3, 3].mean(axis=0), pose[:3, 3], atol=0.5)
    turns = Rotation.from_matrix(strayed[:, :3, :3]).as_rotvec(degrees=True)
    np.testing.assert_allclose(turns.std(axis=0), 3.0, rtol=0.05)
    assert np.array_equal(Rehearsal(stray_share=0, stray_deg=0).perturb_pose(pose, 400.0, rng), pose)


def test_exposure_and_white_balance_stay_in_their_ranges():
    grey = np.full((2, 2, 3), 0.2, np.float32)
    rng = np.random.default_rng(2)
    factors = np.array([Rehearsal().expose(grey, rng)[0, 0] / 0.2 for _ in range(500)])
    assert factors.min() > 0.75 * 0.88 - 1e-6 and factors.max() < 1.33 * 1.12 + 1e-6
    tint = factors / factors.mean(axis=1, keepdims=True)
    assert tint.max() > 1.08 and tint.min() < 0.92


@pytest.mark.parametrize(("side", "sigma"), [(224, 1.0), (448, 2.0)])
def test_blur_is_of_the_networks_pixels(side, sigma):
    """A bright point spreads by the Gaussian that was asked for, twice as far in a picture twice as large."""
    phone = Rehearsal(
        blur=CameraBlur(defocus_px=(1.0, 1.0), motion_px=(0.0, 0.0), probability=1.0),
        exposure=Exposure(factor=(1, 1), tint=0),
    )
    point = np.zeros((side, side, 3), np.float32)
    point[side // 2 - 8 : side // 2 + 8, side // 2 - 8 : side // 2 + 8] = 1
    seen = phone.expose(point, np.random.default_rng(0)).mean(axis=2)
    weights = seen.sum(axis=0) / seen.sum()
    places = np.arange(side)
    spread = (weights * (places - (weights * places).sum()) ** 2).sum()
    assert spread == pytest.approx((16**2 - 1) / 12 + sigma**2, rel=0.03)


def test_a_rehearsed_photograph_is_sharp_enough_for_the_gate():
    """The most that is drawn, with what shrinking adds, at the gate's size."""
    blur = Rehearsal().blur
    drawn_px = np.hypot(blur.defocus_px[1], blur.motion_px[1] / np.sqrt(12)) * NETWORK_SIDE_PX / 224
    assert np.hypot(drawn_px, 0.4) < BLUR.threshold


@pytest.mark.parametrize("light", [0.03, 0.18])
def test_the_sensors_noise_is_not_blurred(light):
    """In ink as in grey the photograph's grain is that of real cameras: 0.6 to 1.2 grey levels; 28 were measured."""
    phone, rng = Rehearsal(), np.random.default_rng(1)
    flat = np.full((240, 320, 3), light, np.float32)
    photo = phone.encode(tone_map(phone.expose(flat, rng), (1,), phone.noise, falloff=0))
    grey = np.asarray(Image.open(BytesIO(photo)).convert("L"), float)
    fine = grey - gaussian_filter(grey, 1.5)
    assert 0.5 < fine.std() < 1.5


def test_shots_are_whole_recorded_and_the_same_again(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    plan, item = read_plan(space.plan_file), load_object(space.object_spec("crate"))

    def shoot(source: str, settings: ShootSettings = REHEARSED) -> dict:
        shoot_plan(space, plan, ["crate"], settings=settings, source=source)
        return read_manifest(space.captures_dir / source)

    first, again, plain = shoot("one"), shoot("two"), shoot("plain", PLAIN)
    assert [r.image_sha256 for r in first.values()] == [r.image_sha256 for r in again.values()]
    assert first.keys() == plain.keys() and len(first) == 4
    patch = sha256_file(space.patch("crate"))
    places = set()
    for path, record in first.items():
        assert record.made["rehearsed"] is True and "rehearsed" not in plain[path].made
        assert record.booster_sha256 == (patch if record.variant == "patched" else None), "the file's, not the print's"
        pose = next(p for p in plan.objects["crate"] if p.id == record.pose_id)
        moved = np.array(record.T_world_camera) - pose.matrix()
        distance = np.linalg.norm(moved[:3, 3])
        assert 0 < distance < 0.2 * pose.distance_mm
        places.add(distance)
        picture = Image.open(space.captures_dir / "one" / path)
        assert picture.size == (plan.camera.width, plan.camera.height)
        assert picture.layer[0][1:3] == (2, 2), "colours at half the size"
        assert max(picture.quantization[0]) > max(Image.open(space.captures_dir / "plain" / path).quantization[0])
    assert len(places) == 4, "each photograph is taken anew"
    assert "rehearsal" not in json.dumps(describe_look(space, item, "patched", PLAIN))
    other = ShootSettings(backdrop="white", rehearsal=Rehearsal(jpeg_quality=60))
    assert describe_look(space, item, "patched", other) != describe_look(space, item, "patched", REHEARSED)


def test_each_photograph_has_its_own_grain(make_crate_space, tmp_path):
    """Other noise for each variant, object and pose, as of real photographs: what is left of flat grey is no copy."""
    space = make_crate_space(tmp_path)
    item = load_object(space.object_spec("crate"))
    still = Rehearsal(
        blur=CameraBlur(probability=0.0), exposure=Exposure(factor=(1, 1), tint=0), noise=0.2, jpeg_quality=100,
        stray_share=0, stray_deg=0,
    )  # fmt: skip
    settings = ShootSettings(backdrop="white", rehearsal=still)
    pose = read_plan(space.plan_file).objects["crate"][0].matrix()
    other = replace(item, spec=item.spec.model_copy(update={"name": "box"}))
    shots = [(item, "unpatched", 1), (item, "grey", 1), (item, "unpatched", 2), (item, "unpatched", 1)]
    pictures = []
    for one, variant, number in [*shots, (other, "unpatched", 1)]:
        places = [(Camera.from_fov(96, 72), pose, number)]
        (content,) = shoot_unit(one, variant, None, settings, places)
        pixels = np.asarray(Image.open(BytesIO(content)).convert("L"), float)
        pictures.append((pixels - gaussian_filter(pixels, 1.5))[:12].ravel())
    first, *others = pictures
    grey, turned, same, box = (np.corrcoef(first, one)[0, 1] for one in others)
    assert same == pytest.approx(1) and max(map(abs, (grey, turned, box))) < 0.2
    assert describe_look(space, item, "patched", REHEARSED)["rehearsal"]["version"] == 5


@pytest.mark.parametrize("variant", ["patched", "camouflage"])
def test_the_margin_is_the_printers_paper_and_every_sheet_is_printed(tmp_path, make_crate_space, variant):
    """Paper around the print is the paper below it; a sheet that shows what it hides comes out of the same printer."""
    space = make_crate_space(tmp_path)
    item = load_object(space.object_spec("crate"))
    yellow = PrintProcess(white=(0.8, 0.8), tint=0, density=(0.5, 0.5), bleed_mm=(0.01, 0.01), probability=1)
    booster = find_booster(space, item, variant)
    texture, printed = (
        next(m.texture for m in apply_booster(item, one).materials if m.sheet)
        for one in (booster, print_booster(booster, yellow, 0, "crate"))
    )
    np.testing.assert_allclose(printed[0, 0] / 255, 0.8 * SOLIDS[1, 1, 1], atol=1 / 255)
    middle = len(printed) // 2
    assert np.abs(printed[middle, middle].astype(int) - texture[middle, middle]).max() > 10
    assert print_booster(replace(booster, margin="bleed"), yellow, 0, "crate").margin == "bleed"


def test_a_sheet_has_the_colours_that_were_photographed():
    """Against blank paper in the same light: what the paper mirrors is not counted twice."""
    printer = use_profile(copier_profile(), SHEEN).with_overrides(bleed_mm=(0.001, 0.001))
    chart = np.random.default_rng(2).integers(0, 256, (3, 3, 3), np.uint8)
    booster = print_booster(PatchBooster(chart, "", "chart", (90.0,)), printer, 0, "chart")
    camera, pose, light = Camera.from_fov(64, 64, 40), orbit_pose(np.zeros(3), 20, 60, 250), []
    middle = (np.arange(3) - 1) * 30.0
    x, y = np.meshgrid(middle, -middle)
    column, row = project(camera, pose, np.stack([x, y, 0 * x], -1).reshape(-1, 3))[0].astype(int).T
    for pixels in (booster.pixels, np.full_like(chart, PAPER)):
        shown = RaycastRenderer(make_flat_sheet(pixels, 90), make_studio(0, 100), THUMBNAIL_DETAIL)
        light.append(shown.render(camera, pose)[row, column])
    seen = light[0] / light[1] * srgb_to_linear(PAPER / np.float32(255))
    wanted = srgb_to_linear(print_colours(copier_profile(), chart.reshape(-1, 3) / 255))
    assert delta_e2000(lab_of_linear(seen), lab_of_linear(wanted)).max() < 1


def test_tape_lies_over_the_printed_paper_alone(tmp_path, make_crate_space):
    """An object's own label may be called paper as well."""
    space = make_crate_space(tmp_path)
    item = load_object(space.object_spec("crate"))
    label = replace(item.mesh, materials=tuple(replace(one, name=PAPER_MATERIAL) for one in item.mesh.materials))
    booster = find_booster(space, item, "patched")
    mesh = apply_booster(replace(item, mesh=label), booster)
    taped = Rehearsal(tape_roughness=0.15).tape(mesh)
    changed = []
    for before, after in zip(mesh.materials, taped.materials, strict=True):
        assert after == replace(before, roughness=after.roughness) and after.roughness in (0.15, before.roughness)
        changed += [after.name] if after.roughness == 0.15 else []
    assert changed == [PAPER_MATERIAL] and Rehearsal().tape(label) == label


def test_what_cannot_be_meant_is_refused(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    png = ShootSettings(rehearsal=Rehearsal(), image_format="png")
    with pytest.raises(ToolkitError, match="a phone's JPEGs"):
        shoot_plan(space, read_plan(space.plan_file), ["crate"], settings=png)
    with pytest.raises(ToolkitError, match="profile"):
        (tmp_path / "profile.json").write_text("{}")
        make_rehearsal(tmp_path / "profile.json")
