"""The variant `wrapped`: what it looks like, what the manifest says of it, and what makes it be shot again."""

import itertools
import shutil
from dataclasses import replace

import numpy as np
import pdfplumber
import pytest
from PIL import Image

from toolkit.boosters.linear_view import batch_views, show_texture
from toolkit.boosters.pixels import from_picture, quantise
from toolkit.captures.manifest import read_manifest
from toolkit.captures.read import read_captures
from toolkit.captures.shoot import Rehearsal, ShootSettings, print_booster, shoot_plan, studio_for
from toolkit.core.console import quietly
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.evaluation.results import find_training
from toolkit.objects.load import load_object
from toolkit.objects.records import NetworkRecord
from toolkit.rig import ShotListConfig
from toolkit.rig.camera import Camera
from toolkit.rig.kernel.frame import NOTHING
from toolkit.rig.plan import read_plan
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.renderer import view_from
from toolkit.rig.shading import tone_map
from toolkit.rig.variants import apply_booster, find_booster, note_booster
from toolkit.rooms.photos.shot_list.job import write_shot_list
from toolkit.rooms.wraps.config import Misfit, WrapConfig
from toolkit.rooms.wraps.wrap import Wrap, WrapTraining, read_wrap, write_wrap
from toolkit.rooms.wraps.wrap_booster import WrapBooster
from toolkit.rooms.wraps.wrap_plan import plan_wrap, take_best
from toolkit.rooms.wraps.wrap_task import wear_grey

TRAINING = WrapTraining(
    class_index=1, networks=[], data={}, seed=0, settings={}, final={}, misfit={}, toolkit_version="0"
)


@pytest.fixture(scope="module")
def green(tmp_path_factory, make_crate_space):
    """A crate, and a green wrap on what is seen of it; not to be changed."""
    space = make_crate_space(tmp_path_factory.mktemp("green") / "w")
    item = load_object(space.object_spec("crate"))
    with quietly(True):
        plan = plan_wrap(item)
    pixels = np.full_like(plan.pixels, (20, 200, 30))
    trained = plan.record.model_copy(update={"class_name": "crate", "booster": TRAINING})
    write_wrap(space.wraps_dir / "crate", Wrap(trained, plan.pieces, pixels))
    return space


@pytest.fixture
def space(green, tmp_path):
    """A copy of it."""
    return Workspace(shutil.copytree(green.root, tmp_path / "w"))


@pytest.fixture
def crate(space):
    return load_object(space.object_spec("crate"))


def shoot(space, **settings):
    look = ShootSettings(backdrop="white", image_format="png", **settings)
    return shoot_plan(space, read_plan(space.plan_file), ["crate"], ["unpatched", "wrapped"], look)


def show(shot, variant):
    return np.asarray(Image.open(shot.source_dir / "crate" / variant / "pose_01.png")).astype(int)


def test_it_is_seen_and_the_manifest_says_how_it_misfits(space):
    shot = shoot(space)
    bare, wrapped = show(shot, "unpatched"), show(shot, "wrapped")
    is_green = (wrapped[..., 1] > wrapped[..., 0] + 40) & (wrapped[..., 1] > wrapped[..., 2] + 40)
    on_crate = np.abs(wrapped - bare).max(axis=2) > 12
    assert is_green.sum() > 0.8 * on_crate.sum() > 200
    made = {path: record.made for path, record in read_manifest(shot.source_dir).items()}["crate/wrapped/pose_01.png"]
    assert made["booster"] == "crate" and made["misfit"] == Misfit().record() and made["misfit_seed"] == 0


def test_an_evaluation_says_whether_its_network_was_seen(space):
    wrap = read_wrap(space.wrap("crate"))
    network = NetworkRecord(arch="resnet18", weights="resnet18.pth", sha256="ab" * 32)
    trained = wrap.record.model_copy(update={"booster": TRAINING.model_copy(update={"networks": [network]})})
    write_wrap(space.wraps_dir / "crate", Wrap(trained, wrap.pieces, wrap.pixels))
    captures = read_captures(shoot(space).source_dir.parent).captures
    for judge, seen in ((network.sha256, True), ("cd" * 32, False)):
        (found,) = find_training(captures, space, judge)
        assert (found.variant, found.booster, found.networks, found.seen) == ("wrapped", "crate", (network,), seen)


def test_what_is_stuck_on_otherwise_is_shot_again_and_nothing_else(space):
    assert shoot(space).shot == 4
    assert shoot(space).shot == 0
    perfect = shoot(space, perfect=True)
    assert (perfect.shot, perfect.kept) == (2, 2)
    assert read_manifest(perfect.source_dir)["crate/wrapped/pose_01.png"].made["misfit"] is None


def test_its_place_is_the_seeds_and_its_ink_the_printers(space, crate):
    booster = find_booster(space, crate, "wrapped", seed=3)
    assert isinstance(booster, WrapBooster) and note_booster(booster)["misfit_seed"] == 3
    mesh, again = apply_booster(crate, booster), apply_booster(crate, booster)
    np.testing.assert_array_equal(mesh.vertices, again.vertices)
    other = apply_booster(crate, find_booster(space, crate, "wrapped", seed=4))
    assert mesh.vertices.shape != other.vertices.shape or (mesh.vertices != other.vertices).any()
    looks = [find_booster(space, crate, "wrapped", seed=seed).describe(crate) for seed in (3, 3, 4)]
    assert looks[0] == looks[1] != looks[2]
    printed = print_booster(booster, Rehearsal().printer, 0, "crate").pixels
    assert printed.shape == booster.pixels.shape and np.abs(printed.astype(int) - booster.pixels).max() > 10


@pytest.mark.parametrize("variant", ["patched", "wrapped"])
def test_what_is_printed_has_four_samples_in_every_pixel_and_the_objects_own_paper_has_not(space, crate, variant):
    worn = apply_booster(crate, find_booster(space, crate, variant, perfect=True))
    mesh = replace(worn, materials=tuple(one if one.sheet else replace(one, name="paper") for one in worn.materials))
    renderer = RaycastRenderer(mesh, studio_for(crate, ShootSettings(backdrop="white")))
    camera, pose = Camera.from_fov(96, 72), read_plan(space.plan_file).objects["crate"][0].matrix()
    part = renderer._tracer.trace(view_from(camera, pose), (0, 0, 96, 72))
    seen = part.hits.face != NOTHING
    material = mesh.face_material[np.where(seen, part.hits.face, 0)]
    printed = seen & np.array([bool(one.sheet) for one in mesh.materials])[material]
    own = seen & ~printed
    refined = np.isin(np.arange(len(seen)), part.refine)
    assert printed.sum() > 50 and refined[printed].all()
    # of the crate a wrap leaves edges alone bare
    assert variant == "wrapped" or refined[own].mean() < 0.8


def test_training_shows_a_wrap_as_a_capture_does(space, crate):
    """The same pieces, light and samples: noise alone is the camera's."""
    booster = find_booster(space, crate, "wrapped", seed=3)
    assert isinstance(booster, WrapBooster)
    noise = np.random.default_rng(0).integers(0, 256, booster.pixels.shape, np.uint8)
    scene, camera = studio_for(crate, ShootSettings(backdrop="white")), Camera.from_fov(96, 72)
    pose = read_plan(space.plan_file).objects["crate"][0].matrix()
    taken = RaycastRenderer(apply_booster(crate, replace(booster, pixels=noise)), scene).render(camera, pose)
    grey = wear_grey(crate, booster.wrap, booster.misfit, Draws(3, 0, f"stick {crate.name}"))
    view = RaycastRenderer(grey, scene).render_linear(camera, pose, grey.materials[len(crate.mesh.materials)].texture)
    shown = quantise(show_texture(from_picture(noise, "cpu"), batch_views([view], "cpu"))[0])
    apart = np.abs(shown.astype(int) - tone_map(taken, (0,), noise=0, falloff=0))[view.coverage > 0]
    assert len(apart) > 500 and apart.max() <= 3, "light that the table throws back has another mean colour"


def test_a_plan_with_nothing_trained_on_it_is_refused(space, crate):
    wrap = read_wrap(space.wrap("crate"))
    plan = Wrap(wrap.record.model_copy(update={"booster": None, "class_name": None}), wrap.pieces, wrap.pixels)
    write_wrap(space.wraps_dir / "crate", plan)
    with pytest.raises(ToolkitError, match="train it with 'toolkit train-wrap --object crate'"):
        find_booster(space, crate, "wrapped")


def test_without_a_wrap_it_says_how_to_make_one(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path / "bare")
    with pytest.raises(ToolkitError, match="no wrap is for 'crate'"):
        find_booster(space, load_object(space.object_spec("crate")), "wrapped")


def test_the_best_pieces_cover_the_share_that_is_asked_for(space, crate):
    wrap = read_wrap(space.wrap("crate"))
    whole = wrap.record.covered
    reached = [take_best(wrap, crate, share) for share in (0.3, 0.6, 1.0)]
    shares = [one.record.covered for one in reached]
    # triangles stay whole: the crate has twelve
    assert shares == pytest.approx([0.3, 0.6, whole], abs=0.2) and shares[2] == pytest.approx(whole, abs=1e-3)
    for few, more in itertools.pairwise(reached):
        assert set(np.concatenate([p.faces for p in few.pieces])) < set(np.concatenate([p.faces for p in more.pieces]))
    assert len(take_best(wrap, crate, 0.001).pieces[0].faces) == 1


def test_a_share_of_the_wrap_is_shot_and_said(space, crate):
    part = ShootSettings(backdrop="white", coverage=0.5).find_booster(space, crate, "wrapped")
    full = find_booster(space, crate, "wrapped")
    assert part.describe(crate) != full.describe(crate)
    assert len(apply_booster(crate, part).faces) < len(apply_booster(crate, full).faces)
    green = {name: (show(shoot(space, coverage=share), "wrapped")[..., 1]).mean() for name, share in
             (("half", 0.5), ("all", None))}  # fmt: skip
    assert green["half"] != green["all"]


def test_the_shot_list_shows_where_the_pieces_go(space):
    asked = ShotListConfig(variants=("unpatched", "wrapped"))
    with quietly(True):
        written = write_shot_list(space, read_plan(space.plan_file), ["crate"], asked)
    with pdfplumber.open(written.pdf_file) as pdf:
        words = pdf.pages[0].extract_text()
    assert "Places of the wrap's pieces" in words and "there is no sheet to stick on" not in words
    assert all(side in words for side in ("front", "left", "back", "right", "top", "bottom"))


def test_a_mesh_of_very_many_triangles_is_one_line(crate, monkeypatch):
    monkeypatch.setattr("toolkit.rooms.wraps.wrap_plan.MOST_TRIANGLES", 11)
    with pytest.raises(ToolkitError, match=r"crate: 12 triangles, more than a wrap's 11: simplify it \("):
        plan_wrap(crate)


def test_sides_larger_than_the_sheet_are_pieces_in_tiles(crate, capsys):
    small = plan_wrap(crate, WrapConfig(sheet_mm=(40.0, 50.0), views=8))
    assert small.record.covered > 0.99
    assert "printed in tiles" in " ".join(capsys.readouterr().err.split())
    assert max(max(piece.width_mm, piece.height_mm) for piece in small.pieces) == pytest.approx(100, abs=0.01)
