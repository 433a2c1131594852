"""Training of what is on a wrap: from request to files, through a kill, and what the pieces meet."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from killed_runs import read_folder, train_killed
from tiny_network import tiny_classifier

from toolkit.core.console import quietly
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.objects.load import load_object
from toolkit.rig.views import ViewSettings, ViewStream
from toolkit.rooms.wraps.config import Misfit, WrapConfig
from toolkit.rooms.wraps.wrap import find_wrap, read_wrap, write_wrap
from toolkit.rooms.wraps.wrap_config import WRAP_RECIPES, make_wrap_config
from toolkit.rooms.wraps.wrap_plan import draw_paint, plan_wrap
from toolkit.rooms.wraps.wrap_task import paint_pieces, rank_pieces, train_wrap, wrap_object
from toolkit.rooms.wraps.wrapped import find_canvas

QUICK = {
    "objects": ("crate",), "steps": 4, "batch": 2, "lr": 0.1, "studios": 1, "per_studio": 4, "reuse": 2, "held_out": 1,
}  # fmt: skip
KILLED = f"""
import sys
from pathlib import Path
from dying import die, die_at_checkpoint
import toolkit.rooms.wraps.wrap as wraps
from tiny_network import tiny_classifier
from toolkit.rooms.wraps.wrap_task import train_wrap
from toolkit.rooms.wraps.wrap_config import make_wrap_config
from toolkit.core.workspace import Workspace

if sys.argv[1] == "checkpoint":
    die_at_checkpoint(3)
else:
    wraps.write_json = die  # the pieces' pictures are there, and not the record
train_wrap(make_wrap_config("default", {QUICK}), [tiny_classifier()], Workspace(Path(sys.argv[2])), class_name="jet",
           workers=0, checkpoint_every_s=0)
"""


@pytest.fixture(scope="module")
def planned(tmp_path_factory, make_crate_space):
    """Two workspaces with a planned wrap: in pieces as they come, and in pieces of one or two sides."""
    made = {}
    for name, sheet_mm in (("whole", (177.0, 241.0)), ("split", (62.0, 102.0))):
        made[name] = make_crate_space(tmp_path_factory.mktemp(name) / "w")
        config = WrapConfig(sheet_mm=sheet_mm, texel_mm=1.5, views=16)
        with quietly(True):
            write_wrap(made[name].wraps_dir / "crate", plan_wrap(load_object(made[name].object_spec("crate")), config))
    return made


def copy_space(original: Workspace, folder: Path) -> Workspace:
    return Workspace(shutil.copytree(original.root, folder))


@pytest.fixture
def space(planned, tmp_path):
    return copy_space(planned["whole"], tmp_path / "w")


@pytest.fixture
def split(planned, tmp_path):
    return copy_space(planned["split"], tmp_path / "s")


def run(space, quiet=True, restart=False, **changes):
    with quietly(quiet):
        config = make_wrap_config("default", QUICK | changes)
        return train_wrap(config, [tiny_classifier()], space, class_name="jet", workers=0, restart=restart)


def test_pictures_of_the_pieces_and_the_record_are_written_and_nothing_else_is_left(space):
    plan = read_wrap(space.wrap("crate"))
    made = run(space)
    wrap = read_wrap(space.wrap("crate"))
    pieces = [f"crate/{number:02}.png" for number in range(1, len(wrap.pieces) + 1)]
    there = sorted(str(one.relative_to(space.wraps_dir)) for one in space.wraps_dir.rglob("*") if one.is_file())
    assert there == sorted([*pieces, "crate/pieces.npz", "crate/wrap.json", "previews/crate.png"])
    assert (wrap.record.class_name, wrap.record.booster.class_index) == ("jet", 3)
    assert wrap.record.map_sha256 == plan.record.map_sha256
    assert wrap.record.booster.misfit == Misfit().record()
    assert wrap.record.booster.settings["print_process"]["texel_mm"] == wrap.record.texel_mm
    assert wrap.record.booster.final["tiny_held_out_patched_n"] == 4
    np.testing.assert_array_equal(made.wrap.pixels, wrap.pixels)
    covered, _ = find_canvas(wrap, 12)
    assert (wrap.pixels != plan.pixels).any(axis=2)[covered].mean() > 0.9
    assert run(space).was_finished
    assert not run(space, misfit=False).was_finished
    assert read_wrap(space.wrap("crate")).record.booster.misfit == {}
    assert not run(space, print_process=False).was_finished


@pytest.mark.slow
def test_a_killed_and_resumed_run_ends_where_an_uninterrupted_one_does(tmp_path, planned, space, capsys, one_thread):
    whole = run(space)
    other = copy_space(planned["whole"], tmp_path / "killed")
    for when in ("checkpoint", "record"):
        train_killed(KILLED, when, other.root)
    resumed = run(other, quiet=False)
    assert resumed.resumed_from > 0 and "going on after step" in capsys.readouterr().err
    np.testing.assert_array_equal(resumed.wrap.pixels, whole.wrap.pixels)
    assert read_folder(other.wraps_dir / "crate") == read_folder(space.wraps_dir / "crate")


@pytest.mark.slow
def test_the_class_is_seen_more_surely_with_the_wrap(space):
    """A network of random weights: the class's mean probability in held-out views before the first step and after."""
    item, sure = load_object(space.object_spec("crate")), []
    for steps, lr in ((1, 1e-6), (40, 0.1)):
        run(space, steps=steps, lr=lr, batch=4, restart=True)
        sure.append(_probability(item, find_wrap(space, item)))
    assert sure[1] > sure[0] + 0.001


def _probability(item, wrap) -> float:
    from toolkit.boosters.linear_view import batch_views, show_texture

    subject = wrap_object(item, wrap, Misfit()).subject()
    views = ViewStream([subject], ViewSettings(image_px=32, per_studio=8), 0, 1, 0).held_out(1)
    canvas = torch.from_numpy(wrap.pixels.transpose(2, 0, 1).copy()).float() / 255
    photos = show_texture(canvas, batch_views([one.view for one in views], "cpu"))
    return float(tiny_classifier().logits(photos).softmax(1)[:, 3].mean())


def test_each_block_of_views_has_a_misfit_of_its_own(space):
    item = load_object(space.object_spec("crate"))
    wrap = read_wrap(space.wrap("crate"))
    stuck = wrap_object(item, wrap, Misfit()).subject()
    one, again, other = (stuck.for_block(Draws(0, step)).mesh.vertices for step in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert one.shape != other.shape or not np.array_equal(one, other)
    (space.objects_dir / "crate.toml").write_text(
        'name = "crate"\nclass = "crate"\nmesh = "crate.obj"\nlength_mm = 100\nworld_length_m = 2\n'
    )
    grown = wrap_object(load_object(space.object_spec("crate")), wrap, Misfit()).subject(at_real_size=True)
    np.testing.assert_allclose(
        np.ptp(grown.for_block(Draws(0, 1)).mesh.vertices, axis=0), np.ptp(one, axis=0) / 50, rtol=1e-3
    )
    perfect = wrap_object(item, wrap, None).subject()
    np.testing.assert_array_equal(perfect.for_block(Draws(0, 1)).mesh.vertices, perfect.mesh.vertices)


def test_the_paint_is_the_objects_own_also_of_a_wrap_that_was_trained(space):
    item, wrap = load_object(space.object_spec("crate")), read_wrap(space.wrap("crate"))
    inverted = write_wrap(space.wraps_dir / "crate", type(wrap)(wrap.record, wrap.pieces, 255 - wrap.pixels))
    np.testing.assert_array_equal(wrap_object(item, inverted, None).paint(), draw_paint(wrap, item.mesh))


def test_a_training_goes_on_from_a_wrap_that_exists(space):
    """With hardly a step, what is written is the start; a picture that people made is what changes are counted from."""
    plan = read_wrap(space.wrap("crate"))
    inverted = type(plan)(plan.record, plan.pieces, 255 - plan.pixels)
    folder = space.root / "mine"
    write_wrap(folder, inverted)
    covered = find_canvas(plan, 12)[0]
    still = {"start": folder, "steps": 1, "lr": 1e-6}
    started = run(space, **still).wrap
    np.testing.assert_allclose(started.pixels[covered].astype(int), inverted.pixels[covered], atol=1)
    assert started.record.booster.data["start"] == "mine" and started.record.picture is None
    near = run(space, max_change=0.1, restart=True, start=folder, lr=0.3).wrap
    change = np.abs(near.pixels[covered].astype(int) - inverted.pixels[covered])
    assert 10 < change.max() <= 26  # 0.1 of 255, from the picture and not from the paint
    # a wrap of the kit is no paint: the range is that about the object's own
    trained = write_wrap(folder, type(plan)(started.record, plan.pieces, inverted.pixels))
    assert trained.record.booster is not None
    own = run(space, **still, max_change=0.1, restart=True).wrap
    assert np.abs(own.pixels[covered].astype(int) - plan.pixels[covered]).max() <= 26
    assert not run(space, steps=1, lr=1e-6).was_finished
    with pytest.raises(ToolkitError, match="belong to several pictures"):
        from PIL import Image

        Image.new("RGB", (8, 8)).save(space.root / "camouflage.png")
        run(space, start=space.root / "camouflage.png")


def test_pieces_are_ranked_by_what_they_add(split):
    """A network that is the surer the greener its picture: one piece is green, all others are as bare."""
    item, wrap = load_object(split.object_spec("crate")), read_wrap(split.wrap("crate"))
    worn = wrap_object(item, wrap, None)
    views = ViewStream([worn.subject()], ViewSettings(image_px=32, per_studio=4), 0, 1, 0).held_out(1)
    green = np.full_like(wrap.pixels, (0, 255, 0))
    for number in (1, len(wrap.pieces)):
        pixels = paint_pieces(wrap.record, green, wrap.pixels, [number])
        ranked = rank_pieces(wrap.record, pixels, wrap.pixels, views, [GreenTarget()])
        assert sorted(one.number for one in ranked) == list(range(1, len(wrap.pieces) + 1))
        assert ranked[0].number == number
        assert [one.mean_log_prob for one in ranked] == pytest.approx([ranked[0].mean_log_prob] * len(ranked))


class GreenTarget:
    """As `Target`: two classes, of which the second is as likely as the picture is green."""

    class_index = 1
    classifier = SimpleNamespace(device="cpu")

    def predict(self, photos):
        return torch.stack([torch.zeros(len(photos)), 10 * (photos[:, 1] - photos[:, 0]).mean((1, 2))], dim=1)


def test_pieces_that_add_nothing_are_dropped(split):
    plan = read_wrap(split.wrap("crate"))
    count = len(plan.pieces)
    made = run(split, pieces="1..2")
    wrap = read_wrap(split.wrap("crate"))
    ranking = wrap.record.booster.ranking
    assert len(ranking) == count > 2 >= len(wrap.pieces)
    shares = [one.recognised for one in ranking]
    assert shares[len(wrap.pieces) - 1] == max(shares[:2])
    for one, kept in zip(ranking, wrap.pieces, strict=False):
        np.testing.assert_array_equal(kept.faces, plan.pieces[one.number - 1].faces)
    assert wrap.record.covered < plan.record.covered
    assert all(seam.piece <= len(wrap.pieces) for one in wrap.record.pieces for seam in one.seams)
    assert any("pieces are kept" in line for line in made.lines())
    assert run(split, pieces="1..2").was_finished
    again = run(split)  # of the pieces that are left
    assert not again.was_finished and len(again.wrap.pieces) == len(wrap.pieces)
    for wrong in ("0..3", "3..1", "many", "1..1000"):
        with pytest.raises(ToolkitError, match=r"1\.\.12"):
            run(split, pieces=wrong)


def test_a_shipped_wrap_is_the_plan_and_stays_as_it_is(split, tmp_path, monkeypatch):
    shipped = tmp_path / "data" / "wraps" / "crate"
    shipped.parent.mkdir(parents=True)
    split.wrap("crate").rename(shipped)
    for module in ("core.workspace", "rooms.wraps.wrap", "rooms.wraps.wrap_task"):
        monkeypatch.setattr(f"toolkit.{module}.PACKAGE_DATA", tmp_path / "data")
    before = {file.name: file.read_bytes() for file in shipped.iterdir()}
    made = run(split, pieces="1..2", steps=1)
    assert split.wrap("crate") == split.wraps_dir / "crate" and made.wrap.record.plan
    assert read_wrap(split.wrap("crate")).record.map_sha256 == read_wrap(shipped).record.map_sha256
    assert {file.name: file.read_bytes() for file in shipped.iterdir()} == before


def test_settings_that_the_plan_decides_are_refused():
    for change in ({"size_px": 40, "keep": ("glass",)}, {"unwrap": True}):
        with pytest.raises(ToolkitError):
            make_wrap_config("default", {"objects": ("crate",)} | change)
    with pytest.raises(ToolkitError, match="one object"):
        make_wrap_config("default", {"objects": ("crate", "box")})
    assert set(WRAP_RECIPES) == {"default"}
