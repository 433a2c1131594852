"""From request to files, through kills."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from killed_runs import files_below, stopped_at, train_killed
from texture_parts import TEXELS, crate_config, make_crate
from tiny_network import tiny_classifier, write_photos

from toolkit.boosters.pixels import PixelTask, Target
from toolkit.boosters.texture import TextureTask, train_texture
from toolkit.boosters.texture_objects import TexturedObject, hash_objects, load_objects
from toolkit.core.console import quietly
from toolkit.core.errors import ToolkitError
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.objects.atlas import make_atlas, take_paint
from toolkit.objects.load import TableObject, load_object, read_mesh
from toolkit.objects.mesh import Material
from toolkit.objects.records import read_texture
from toolkit.objects.spec import ObjectSpec
from toolkit.rig.renderers import RENDERERS, make_renderer
from toolkit.rig.views import ViewStream
from toolkit.training.loop import fit

KILLED = """
import sys
from pathlib import Path
from dying import die, die_at_checkpoint
import toolkit.objects.records as records
from texture_parts import crate_config
from tiny_network import tiny_classifier
from toolkit.boosters.texture import train_texture
from toolkit.core.workspace import Workspace

if sys.argv[1] == "checkpoint":
    die_at_checkpoint(4)
else:
    records.write_json = die  # between the texture's picture and its record
train_texture(crate_config(), [tiny_classifier()], Workspace(Path(sys.argv[2])), class_name="jet",
              workers=0, checkpoint_every_s=0)
"""


@pytest.fixture
def space(tmp_path, make_crate_space):
    return make_crate_space(tmp_path / "w")


@pytest.fixture(scope="module")
def trained(tmp_path_factory, make_crate_space):
    """A workspace with a texture, which stays as it is, and what was made; on one thread, as in a killed process."""
    space = make_crate_space(tmp_path_factory.mktemp("trained") / "w")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    made = run(space)
    torch.set_num_threads(threads)
    return space, made


@pytest.fixture
def finished(trained, tmp_path):
    """A copy of that workspace, to work in."""
    return Workspace(shutil.copytree(trained[0].root, tmp_path / "finished"))


def run(space, config=None, class_name="jet", quiet=True, **options):
    with quietly(quiet):
        config = config or crate_config()
        return train_texture(config, [tiny_classifier()], space, class_name=class_name, workers=0, **options)


@pytest.mark.slow
def test_texture_record_glb_and_turntable_are_written_and_nothing_else_is_left(trained):
    space, made = trained
    assert files_below(space.textures_dir) == [
        "crate-crate.uv.npz", "crate.glb", "crate.json", "crate.png", "previews/crate.png",
    ]  # fmt: skip
    record = read_texture(made.files.png).record
    assert (record.name, record.class_name, record.class_index, record.n_px) == ("crate", "jet", 3, TEXELS)
    assert record.settings["gradient"] == "shaded"
    assert record.objects[0].unwrapped
    assert record.final["tiny_held_out_patched_n"] == 4
    mesh = read_mesh(made.glbs["crate"])
    assert len(mesh.faces) == len(load_object(space.object_spec("crate")).mesh.faces)
    assert made.validations[0].clear.patched.n == 4


@pytest.mark.slow
def test_the_class_is_seen_more_surely_in_views_that_were_not_trained_on(space):
    """A network of random weights: the class's mean probability in held-out views, before the first step and after."""
    config = crate_config(40, batch=4)
    task_views, sure = None, []
    for steps, lr in ((1, 1e-6), (40, 0.1)):
        made = run(space, config.with_overrides(steps=steps, lr=lr), restart=True)
        pixels = made.texture.pixels
        if task_views is None:
            subject = _subject(space)
            with ViewStream([subject], config.views(32), config.seed, config.groups, 0) as stream:
                task_views = stream.held_out(2)
        sure.append(_probability(pixels, task_views))
    assert sure[1] > sure[0] + 0.001


@pytest.mark.slow
def test_a_texture_may_be_kept_near_the_paint(space):
    mesh, atlas = make_crate(space)
    paint = take_paint(atlas, mesh).astype(int)
    changes = {}
    for most, lr in ((1.0, 1e-6), (0.1, 0.1), (1.0, 0.1)):
        made = run(space, crate_config(8, lr=lr, max_change=most), restart=True)
        changes[most, lr] = np.abs(made.texture.pixels - paint)[atlas.covered]
        assert made.texture.record.settings["max_change"] == most
    assert changes[1.0, 1e-6].max() <= 1, "it begins with the paint"
    assert 25 <= changes[0.1, 0.1].max() <= 26 < changes[1.0, 0.1].max()
    with pytest.raises(ToolkitError, match="have not the same paint"):
        crate_config(max_change=0.1, objects=("crate", "box"))
    with pytest.raises(ToolkitError, match=r"max_change.*a number above 0 and at most 1, or auto"):
        crate_config(max_change="most")


@pytest.mark.slow
def test_what_the_networks_know_of_the_bare_object_decides_how_near_it_stays(space, monkeypatch):
    mesh, atlas = make_crate(space)
    paint = take_paint(atlas, mesh).astype(int)
    for share, most in ((0.8, 0.2), (0.7, None)):
        hits = lambda self, photos, share=share: round(len(photos) * share)  # noqa: E731
        monkeypatch.setattr(Target, "count_hits", hits)
        made = run(space, crate_config(8, lr=0.1, max_change="auto", studios=1, per_studio=10), restart=True)
        settings = made.texture.record.settings
        assert (settings["max_change"], settings["known_bare"]) == (most, share)
        change = np.abs(made.texture.pixels - paint)[atlas.covered].max()
        assert (abs(change - 255 * most) <= 1) if most else change > 110
    assert run(space, crate_config(8, lr=0.1, max_change="auto", studios=1, per_studio=10)).was_finished


def _subject(space):
    from texture_parts import make_subject

    return make_subject(space)


def _probability(pixels: np.ndarray, views) -> float:
    """Mean probability of the class in photographs of a texture, as the networks see them."""
    from toolkit.boosters.linear_view import batch_views, show_texture

    texture = torch.from_numpy(pixels.transpose(2, 0, 1).copy()).float() / 255
    photos = show_texture(texture, batch_views([one.view for one in views], "cpu"))
    return float(tiny_classifier().logits(photos).softmax(1)[:, 3].mean())


@pytest.mark.slow
def test_a_killed_and_resumed_run_ends_where_an_uninterrupted_one_does(
    tmp_path, trained, make_crate_space, capsys, one_thread
):
    space, whole = trained
    other = make_crate_space(tmp_path / "killed")
    for when in ("checkpoint", "record"):
        train_killed(KILLED, when, other.root)
    resumed = run(other, quiet=False)
    assert "going on after step" in capsys.readouterr().err
    assert resumed.resumed_from > 0
    assert np.array_equal(resumed.texture.pixels, whole.texture.pixels)
    assert resumed.texture.record.final == whole.texture.record.final
    assert files_below(other.textures_dir) == files_below(space.textures_dir)


@pytest.mark.slow
@pytest.mark.parametrize("optimiser", ["sgd", "adam"])
def test_ctrl_c_keeps_what_is_done(space, optimiser):
    config = crate_config(optimiser=optimiser)
    whole = run(space, config, name="whole")
    with stopped_at(TextureTask, 4):
        run(space, config)
    assert (made := run(space, config)).resumed_from == 4
    assert np.array_equal(made.texture.pixels, whole.texture.pixels)
    assert made.texture.record.final == whole.texture.record.final


@pytest.mark.slow
def test_a_finished_texture_is_not_trained_again_unless_asked(finished):
    made = run(finished)
    assert made.was_finished
    assert not run(finished, restart=True).was_finished
    made.glbs["crate"].unlink()
    assert not run(finished).was_finished
    assert not run(finished, crate_config(gradient="linear")).was_finished


@pytest.mark.slow
def test_other_settings_give_other_textures(trained, space):
    first = trained[1].texture.pixels
    for change in ({"gradient": "linear"}, {"optimiser": "adam"}, {"exposure": None}):
        assert not np.array_equal(first, run(space, crate_config(**change), name="other").texture.pixels)


@pytest.mark.slow
def test_several_objects_share_one_texture(space):
    spec = (space.objects_dir / "crate.toml").read_text()
    (space.objects_dir / "box.toml").write_text(spec.replace('name = "crate"', 'name = "box"').replace("100", "80"))
    made = run(space, crate_config(objects=("crate", "box"), studios=2))
    assert made.texture.record.name == "jet"
    assert [one.name for one in made.texture.record.objects] == ["crate", "box"]
    assert made.glbs["box"].name == "jet-box.glb" and made.glbs["box"].is_file()


@pytest.mark.slow
def test_photographs_stand_behind_the_object(trained, space, tmp_path):
    photos = write_photos(tmp_path / "photos", 3)
    made = run(space, crate_config(backgrounds=photos, background_share=1.0))
    assert made.texture.record.data["backgrounds"]["used"] == 3
    assert not np.array_equal(made.texture.pixels, trained[1].texture.pixels)


@pytest.mark.parametrize("name", ["sign", "sgd", "adam"])
def test_optimisers_go_down_a_bowl(name):
    """The least of |θ - 0.7|² is at 0.7, wherever one begins."""

    class Bowl(PixelTask):
        work = Work("bowl")

        def loss(self, step):
            return (self.pixels - 0.7).square().sum() / 2, {}

        def finish(self, history):
            return self.pixels.detach()

    config = crate_config(300, lr=0.03, schedule="linear", smoothing_px=0, start_contrast=1)
    task = Bowl(config, 8, [Target(tiny_classifier(), 0)], name)
    assert (fit(task, config.fit_config(name)).made - 0.7).abs().max() < 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objects": ()}, "at least one object"),
        ({"objects": ("crate", "crate")}, "each object once"),
        ({"size_px": 4}, "size_px 4: expected 8 to 1024"),
        ({"optimiser": "lion"}, "optimiser"),
        ({"gradient": "exact"}, "gradient"),
        ({"reuse": 0}, "reuse 0: expected at least 1"),
        ({"renderer": "raycat"}, "did you mean raycast"),
        ({"renderer": "filament", "weather": ["fog:1"]}, "renderer filament: draws no weather: leave weather out"),
        ({"renderer": "filament", "world": "city"}, "filament draws studios alone: use raycast or mitsuba"),
    ],
)
def test_a_request_that_cannot_be_is_refused(change, message):
    with pytest.raises(ToolkitError, match=message):
        crate_config(**change)


def test_a_renderer_that_cannot_start_is_refused(space, monkeypatch):
    absent = replace(RENDERERS["raycast"], find_trouble=lambda: "it is away", fix="fetch it")
    monkeypatch.setitem(RENDERERS, "away", absent)
    with pytest.raises(ToolkitError, match="the renderer away cannot start: it is away: run 'fetch it'"):
        run(space, crate_config(renderer="away"))


def test_another_renderer_makes_another_texture_and_is_recorded(space, monkeypatch):
    """A quarter as bright: the network answers its images. Another version of the renderer is another run."""
    dim = replace(RENDERERS["raycast"], version=3, make=make_dim, describe=lambda: ("dim 1.0", ""))
    monkeypatch.setitem(RENDERERS, "dim", dim)
    config = crate_config(2, renderer="dim")
    made = run(space, config)
    record = made.texture.record
    assert record.settings["renderer"] == {"name": "dim", "version": 3, "library": "dim 1.0"}
    assert run(space, config).was_finished
    monkeypatch.setitem(RENDERERS, "dim", replace(dim, version=4))
    assert not run(space, config).was_finished
    usual = run(space, crate_config(2), out=space.root / "usual").texture.record
    assert "renderer" not in usual.settings
    # signs of a tiny network's gradient may agree, its answers do not
    assert usual.final["loss"] != record.final["loss"]


def make_dim(mesh, scene, detail, stand):
    return make_renderer("raycast", mesh, replace(scene, exposure=scene.exposure / 4), detail, stand)


def test_photographs_that_are_not_named_are_refused(space):
    with pytest.raises(ToolkitError, match=r"background_share 0\.5: needs photographs"):
        run(space, crate_config(background_share=0.5))


def test_objects_of_several_classes_need_a_class(space):
    spec = (space.objects_dir / "crate.toml").read_text()
    (space.objects_dir / "box.toml").write_text(spec.replace('"crate"', '"box"').replace("box.obj", "crate.obj"))
    with pytest.raises(ToolkitError, match=r"several classes.*say which is trained with class_name"):
        run(space, crate_config(objects=("crate", "box")), class_name=None)


def test_the_atlas_of_the_parts_is_the_one_that_the_variant_wears(trained):
    from toolkit.objects.painted import paint_object

    space, made = trained
    item = load_object(space.object_spec("crate"))
    worn = paint_object(item, made.texture, made.texture.pixels)
    assert np.array_equal(worn.uv[worn.faces], make_crate(space)[1].corner_uv)


@pytest.mark.slow
def test_a_run_goes_on_from_another_texture(space):
    """A step that moves next to nothing leaves its colours; other sizes and objects are refused."""
    first = run(space, crate_config(2), name="first")
    still = run(space, crate_config(1, lr=1e-6, start=first.files.png), name="second")
    seen = load_objects(space, crate_config(), None)[0].atlas.covered
    assert np.array_equal(still.texture.pixels[seen], first.texture.pixels[seen])
    noise = run(space, crate_config(1, lr=1e-6), name="noise")
    assert not np.array_equal(noise.texture.pixels[seen], first.texture.pixels[seen])
    with pytest.raises(ToolkitError, match="is 32 px a side: expected 16, as"):
        run(space, crate_config(1, start=first.files.png, size_px=16), name="small")
    with pytest.raises(ToolkitError, match=r"nowhere-first\.png"):
        run(space, crate_config(1, start=first.files.png.with_name("nowhere-first.png")), name="none")
    spec = (space.objects_dir / "crate.toml").read_text()
    (space.objects_dir / "box.toml").write_text(spec.replace('name = "crate"', 'name = "box"'))
    with pytest.raises(ToolkitError, match="was not trained on object 'box'"):
        run(space, crate_config(1, start=first.files.png, objects=("box",)), name="other")


def test_kept_paint_is_part_of_what_a_texture_rests_on(make_box):
    """Paint that is kept is seen beside the texture; paint that the texture covers is not."""
    box = make_box()
    spec = ObjectSpec(name="box", class_name="crate", mesh="builtin:racer", length_mm=100)

    def hash_with(lid: int, wall: int, keep: tuple[str, ...]) -> str:
        paints = [Material(name, np.full((2, 2, 3), level, np.uint8)) for name, level in (("lid", lid), ("wall", wall))]
        face_material = np.int32(np.arange(len(box.faces)) >= 2)
        mesh = replace(box, materials=tuple(paints), face_material=face_material)
        return hash_objects([TexturedObject(TableObject(spec, mesh), make_atlas(mesh, TEXELS, keep))])

    assert hash_with(20, 50, ("lid",)) == hash_with(20, 90, ("lid",))
    assert hash_with(20, 50, ("lid",)) != hash_with(70, 50, ("lid",))
    assert hash_with(20, 50, ()) == hash_with(70, 90, ())
