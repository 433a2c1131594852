"""`toolkit corrupt`: layout, resuming, what it leaves alone, bad input."""

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from toolkit.cli import app
from toolkit.core.draws import image_seed
from toolkit.core.errors import ToolkitError
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import CORRUPTIONS, choose_names
from toolkit.corruptions.digital import from_bytes, to_bytes
from toolkit.corruptions.folder import LOG_FILE, corrupt_images


def run(*arguments) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["corrupt", *map(str, arguments)])
    if isinstance(result.exception, ToolkitError):
        return 2, "", str(result.exception)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def photos(tmp_path):
    rng = np.random.default_rng(0)
    folder = tmp_path / "photos"
    sizes = {
        "a/1.png": (40, 30),
        "a/2.jpg": (40, 30),
        "b/c/3.png": (90, 70),
        "b/c/3.jpg": (90, 70),
        ".hidden/4.png": (9, 9),
    }
    for path, size in sizes.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(rng.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)).save(folder / path)
    (folder / "notes.txt").write_text("no image")
    return folder


def list_files(folder):
    return sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())


def read_all(folder):
    return {path: (folder / path).read_bytes() for path in list_files(folder)}


def make_foggy(file, seed: int) -> np.ndarray:
    return to_bytes(corrupt(from_bytes(np.array(Image.open(file))[None]), "fog", 3, [seed]))[0]


def test_mirrors_the_tree_and_is_the_python_call(photos, tmp_path):
    out = tmp_path / "out"
    code, said, notes = run(photos, out, "--corrupt", "fog", "--severity", 3, "--seed", 5)
    assert code == 0 and "made 4 images" in said
    assert list_files(out) == [
        "a/1.png", "a/2.png", "b/c/3.jpg.png", "b/c/3.png.png", LOG_FILE, "corruption.json",
    ]  # fmt: skip
    expected = make_foggy(photos / "a/1.png", image_seed(5, "a/1.png"))
    assert np.array_equal(np.asarray(Image.open(out / "a/1.png")), expected)
    assert "2 images with the parameters for 32² (cifar)" in notes
    assert "2 images with the parameters for 224² (imagenet); 2 have another size" in notes


def test_several_go_into_folders_and_add_up(photos, tmp_path):
    out = tmp_path / "out"
    assert run(photos / "a", out, "--corrupt", "noise", "--severity", 1, "--severity", 5)[0] == 0
    assert len(list_files(out)) == 3 * 2 * 2 + 2
    before = read_all(out)
    code, said, _ = run(photos / "a", out, "--corrupt", "noise", "--corrupt", "pixelate")
    assert code == 0 and "made 28 images, 12 kept" in said
    assert all(
        content == before[path] for path, content in read_all(out).items() if path in before and ".json" not in path
    )
    assert (out / "impulse_noise/4/2.png").is_file()


def test_a_killed_run_goes_on_and_ends_the_same(photos, tmp_path):
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    for out in (whole, stopped):
        assert run(photos, out, "--corrupt", "snow", "--severity", 2)[0] == 0
    lines = (stopped / LOG_FILE).read_text().splitlines(keepends=True)
    # the second file is written but not its line, the third line is torn, the fourth file is gone
    (stopped / LOG_FILE).write_text(lines[0] + lines[2][:20])
    (stopped / json.loads(lines[3])["path"]).unlink()
    code, said, _ = run(photos, stopped, "--corrupt", "snow", "--severity", 2)
    assert code == 0 and "1 kept" in said
    assert {path: content for path, content in read_all(stopped).items() if path.endswith("png")} == {
        path: content for path, content in read_all(whole).items() if path.endswith("png")
    }
    code, said, _ = run(photos, stopped, "--corrupt", "snow", "--severity", 2)
    assert "made 0 images, 4 kept" in said


def test_foreign_and_changed_files_stay(photos, tmp_path):
    out = tmp_path / "out"
    (out / "a").mkdir(parents=True)
    (out / "a/1.png").write_bytes(b"mine")
    code, said, said_wrong = run(photos, out, "--corrupt", "contrast", "--severity", 1)
    assert code == 1 and "made 3 images" in said
    assert "a/1.png: exists and was not made by this command" in said_wrong
    assert (out / "a/1.png").read_bytes() == b"mine"
    # a source that changes is made again, unless what was made of it was changed too
    Image.new("RGB", (40, 30), "red").save(photos / "a/2.jpg")
    Image.new("RGB", (90, 70), "red").save(photos / "b/c/3.png")
    (out / "b/c/3.png.png").write_bytes(b"mine too")
    code, said, said_wrong = run(photos, out, "--corrupt", "contrast", "--severity", 1)
    assert code == 1 and "made 1 image, 1 kept" in said
    assert "b/c/3.png.png: was changed since it was made" in said_wrong
    assert np.asarray(Image.open(out / "a/2.png"))[0, 0, 0] > 200


def test_bad_files_are_listed_and_the_others_made(photos, tmp_path):
    (photos / "a/broken.jpg").write_bytes((photos / "a/2.jpg").read_bytes()[:300])
    (photos / "a/empty.png").write_bytes(b"")
    Image.new("RGB", (15, 40)).save(photos / "a/narrow.png")
    code, said, said_wrong = run(photos, tmp_path / "out", "--corrupt", "jpeg_compression", "--severity", 1)
    assert code == 1 and "made 4 images" in said
    for words in ("a/broken.jpg: ", "a/empty.png: the file is empty", "a/narrow.png: 15×40 px: too small"):
        assert words in said_wrong
    code, said, _ = run(photos, tmp_path / "o2", "--corrupt", "contrast", "--severity", 1, "--json")
    answer = json.loads(said)
    assert code == 1 and answer["made"] == 4 and {"a/broken.jpg", "a/empty.png", "a/narrow.png"} == {
        one["path"] for one in answer["failed"]
    }  # fmt: skip


def test_size_and_format_as_published(photos, tmp_path):
    code, _, notes = run(
        photos, tmp_path / "out", "--corrupt", "frost", "--severity", 1, "--image-px", 96, "--format", "jpg"
    )
    assert code == 0 and "own texture" in notes
    images = [Image.open(file) for file in (tmp_path / "out").rglob("*.jpg")]
    assert len(images) == 4 and {image.size for image in images} == {(96, 96)}
    reference = Image.new("RGB", (64, 64), "grey")
    reference.save(tmp_path / "reference.jpg", quality=85)
    assert images[0].quantization == Image.open(tmp_path / "reference.jpg").quantization


def test_one_image_into_one_file(photos, tmp_path):
    out = tmp_path / "foggy.png"
    assert run(photos / "a/1.png", out, "--corrupt", "fog", "--severity", 3)[1].startswith("made 1 image")
    expected = make_foggy(photos / "a/1.png", image_seed(0, "1.png"))
    assert np.array_equal(np.asarray(Image.open(out)), expected)
    assert "made 0 images, 1 kept" in run(photos / "a/1.png", out, "--corrupt", "fog", "--severity", 3)[1]
    code, _, said = run(photos / "a/1.png", out, "--corrupt", "fog", "--severity", 4)
    assert code == 2 and "holds something else" in said
    code, _, said = run(photos / "a/1.png", tmp_path / "x.png", "--corrupt", "fog")
    assert code == 2 and "5 corruptions" in said
    assert run(photos / "a/1.png", tmp_path / "folder", "--corrupt", "fog", "--severity", 3)[0] == 0
    assert (tmp_path / "folder/1.png").read_bytes() == out.read_bytes()


def test_a_name_may_hold_its_severity_and_earlier_spellings_go_on_working(photos, tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    assert run(photos, old, "--name", "fog", "--severity", 3, "--size=32")[0] == 0
    assert run(photos, new, "--corrupt", "fog:3", "--image-px", 32)[0] == 0
    assert read_all(old) == read_all(new)
    assert run(photos / "a", tmp_path / "both", "--corrupt", "fog:3", "--corrupt", "snow", "--severity", 1)[0] == 0
    made = {path.rpartition("/")[0] for path in list_files(tmp_path / "both") if path.endswith("png")}
    assert made == {"fog/3", "snow/1"}


def test_out_within_in_is_no_source(photos):
    out = photos / "out"
    for _ in range(2):
        assert run(photos, out, "--corrupt", "contrast", "--severity", 1)[0] == 0
    assert len([path for path in list_files(out) if path.endswith("png")]) == 4


def test_result_does_not_depend_on_what_else_is_there(photos, tmp_path):
    corrupt_images(photos, tmp_path / "all", [("glass_blur", 2)])
    (photos / "a/1.png").unlink()
    corrupt_images(photos, tmp_path / "fewer", [("glass_blur", 2)])
    fewer = {path: content for path, content in read_all(tmp_path / "fewer").items() if path.endswith("png")}
    assert len(fewer) == 3 and fewer.items() <= read_all(tmp_path / "all").items()


def test_names_stand_for_families():
    assert choose_names(["all"]) == list(CORRUPTIONS)
    assert len(choose_names(["common"])) == 15 and len(choose_names(["extra", "common"])) == 19
    assert choose_names(["fog", "weather", "fog"]) == ["fog", "snow", "frost", "brightness"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["IN", "OUT", "--corrupt", "fogg"], "did you mean fog"),
        (["nowhere", "OUT", "--corrupt", "fog"], "does not exist"),
        (["IN", "IN", "--corrupt", "fog"], "another folder"),
        (["IN", "IN/notes.txt", "--corrupt", "fog"], "another folder"),
        (["IN", "OUT", "--corrupt", "fog", "--image-px", "8"], "16 to 4096 px"),
        (["IN", "OUT", "--corrupt", "fog", "--format", "gif"], "png or jpg"),
        (["EMPTY", "OUT", "--corrupt", "fog"], "holds no images"),
        (["IN/notes.txt", "OUT.png", "--corrupt", "fog", "--severity", "1"], "not an image"),
    ],
)
def test_bad_arguments_are_one_line(arguments, words, photos, tmp_path):
    (tmp_path / "empty").mkdir()
    places = {"IN": str(photos), "OUT": str(tmp_path / "out"), "EMPTY": str(tmp_path / "empty")}
    for name, place in places.items():
        arguments = [part.replace(name, place) if part.startswith(name) else part for part in arguments]
    code, _, said = run(*arguments)
    assert code == 2 and words in said and "\n" not in said
    assert not (tmp_path / "out").exists()


def test_other_settings_need_another_folder(photos, tmp_path):
    out = tmp_path / "out"
    run(photos, out, "--corrupt", "fog", "--severity", 3)
    for other in (
        ["--corrupt", "fog", "--severity", 2],
        ["--corrupt", "fog", "--severity", 3, "--seed", 1],
        ["--corrupt", "all"],
    ):
        code, _, said = run(photos, out, *other)
        assert code == 2 and "name another folder" in said


@pytest.mark.parametrize("size_px", [-5, 0, 15, 4097, 1_000_000])
def test_a_size_that_no_network_takes_is_one_line_before_anything_is_read(tmp_path, size_px):
    with pytest.raises(ToolkitError, match=rf"size {size_px} px is too (small|large): choose"):
        corrupt_images(tmp_path, tmp_path / "out", [("fog", 1)], size_px=size_px)


def test_another_method_needs_another_folder(photos, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(photos, out, "--corrupt", "fog", "--severity", 3)
    monkeypatch.setattr("toolkit.corruptions.folder.METHOD", 2)
    code, _, said = run(photos, out, "--corrupt", "fog", "--severity", 3)
    assert code == 2 and "method 1, not 2: name another folder" in said


def test_images_of_earlier_runs_that_no_image_makes_now_are_named(photos, tmp_path):
    out, chosen = tmp_path / "out", ["--corrupt", "fog:3", "--corrupt", "snow:1"]
    run(photos, out, *chosen)
    (photos / "a/1.png").unlink()
    code, _, said = run(photos, out, "--corrupt", "snow:1", "--corrupt", "snow:2")
    assert code == 0 and said.endswith(f"that no image of {photos} makes now: snow/1/a/1.png\n")
    code, said, _ = run(photos, out, *chosen, "--json")
    assert json.loads(said)["left"] == ["fog/3/a/1.png", "snow/1/a/1.png"]
