"""A classifier of prompts answers as the definition says, trains boosters, and says in one line what it cannot use."""

import json
import sys

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from one_line import error_of
from slow_cases import mark_slow
from two_towers import COLOURS, answer_in_numpy, draw_colours, train_towers, write_towers

from toolkit.core.workspace import make_workspace
from toolkit.models.encoders import load_encoder
from toolkit.models.heads import AsEncoder
from toolkit.models.identity import describe_network
from toolkit.models.load import load_classifier
from toolkit.models.prompts import make_prompts, read_class_names
from toolkit.models.text_towers import TextTower, load_text_tower
from toolkit.training.zero_shot import make_zero_shot

pytestmark = pytest.mark.usefixtures("forked_trials")
TEMPLATES = ["a photo of a {}.", "the {c} thing", "a {label}"]
NAMES = list(COLOURS)


@pytest.fixture(scope="module")
def towers():
    pytest.importorskip("tokenizers", reason="needs tokenizers: pip install '.[clip]'")
    return train_towers()


def make(folder, files, prompts, name="hues", **settings):
    image = load_encoder(str(files[0]), device="cpu", how=AsEncoder(whole=True))
    return make_zero_shot(name, image, load_text_tower(str(files[1])), prompts, folder, **settings)


@pytest.mark.parametrize("kind", ["pt2", "onnx"])
def test_the_answers_and_gradients_are_those_of_the_definition(tmp_path, towers, kind):
    if kind == "onnx":
        for name in ("onnx", "onnxruntime", "onnx2torch"):
            pytest.importorskip(name, reason="needs onnx: pip install '.[onnx]'")
    templates = tmp_path / "templates.txt"
    templates.write_text("\n".join(TEMPLATES))
    prompts = make_prompts(NAMES, templates)
    assert prompts["red"] == ["a photo of a red.", "the red thing", "a red"]
    files = write_towers(tmp_path / "towers", kind, towers)
    made = make(tmp_path / "networks", files, prompts, scale=25.0)
    classifier = load_classifier("hues", device="cpu", folder=tmp_path / "networks")
    images, truth = draw_colours(70, 1000)
    expected = answer_in_numpy(towers, images.double().numpy(), prompts, 25.0)
    asked = images.clone().requires_grad_()
    found = classifier.logits(asked)
    assert np.abs(found.detach().numpy() - expected).max() < 1e-5 * 25
    with torch.no_grad():
        assert np.abs(classifier.logits(images).numpy() - expected).max() < 1e-5 * 25
    assert (expected.argmax(1) == truth.numpy()).mean() > 0.95
    assert made.record.labels == classifier.labels == NAMES and not made.record.held_out.n
    # the gradient is the slope of the oracle, along it
    gradient = torch.autograd.grad(found[0, 1], asked)[0][0].double().numpy()
    step = 1e-4 * gradient / np.linalg.norm(gradient)
    one = images[:1].double().numpy()
    ends = [answer_in_numpy(towers, one + sign * step, prompts, 25.0)[0, 1] for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 2e-4 == pytest.approx(np.linalg.norm(gradient), rel=1e-4)


def test_another_template_scale_or_order_is_another_network(tmp_path, towers):
    files = write_towers(tmp_path / "towers", "pt2", towers)
    folder, seen = tmp_path / "networks", []
    prompts = make_prompts(NAMES, None)
    for asked, scale in (
        (prompts, 10.0), ({name: [f"the {name}"] for name in NAMES}, 10.0), (prompts, 11.0),
        (dict(reversed(prompts.items())), 11.0),
    ):  # fmt: skip
        made = make(folder, files, asked, scale=scale)
        assert not made.was_finished and made.record.settings["prompts"] == asked
        seen.append(describe_network(load_classifier("hues", device="cpu", folder=folder))["network_id"])
    assert len(set(seen)) == 4
    assert make(folder, files, dict(reversed(prompts.items())), scale=11.0).was_finished


def test_embeddings_are_kept_by_tower_and_prompts(tmp_path, towers):
    files, asked = write_towers(tmp_path / "towers", "pt2", towers), []
    image = load_encoder(str(files[0]), device="cpu", how=AsEncoder(whole=True))
    tower = load_text_tower(str(files[1]))

    def embed(texts):
        asked.extend(texts)
        return tower.embed(texts)

    watched = TextTower(tower.name, tower.sha256, embed)
    prompts = make_prompts(NAMES, None)
    make_zero_shot("hues", image, watched, prompts, tmp_path)
    make_zero_shot("more", image, watched, {**prompts, "thing": ["a thing"]}, tmp_path)
    assert asked == [texts[0] for texts in prompts.values()] + ["a thing"]
    other = TextTower(tower.name, "0" * 64, embed)
    make_zero_shot("other", image, other, prompts, tmp_path)
    assert len(asked) == 7


@pytest.mark.parametrize(
    ("name", "content", "dataset", "expected"),
    [
        ("a.txt", "red\ngreen\n\nblue\n", None, NAMES),
        ("a.txt", "0: red\n1: green\n2: blue\n", None, NAMES),
        ("a.json", NAMES, None, NAMES),
        ("a.json", {"0": "red", "1": "green"}, None, ["red", "green"]),
        ("a.json", {"hues": NAMES}, None, NAMES),
        ("a.json", {"hues": NAMES, "cars": ["racer", "limousine"]}, "cars", ["racer", "limousine"]),
        ("a.json", {"hues": NAMES, "cars": ["racer"]}, None, "holds 2 data sets (hues, cars): choose with dataset"),
        ("a.json", {"hues": NAMES, "cars": ["racer"]}, "pets", "expected one of hues, cars"),
        ("a.json", {"hues": {"red": 1.5}}, None, "at least two classes, found 0"),
        ("a.txt", "red\n", None, "at least two classes, found 1"),
        ("a.txt", "red\ngreen\nred\n", None, "'red' stands twice"),
        ("a.txt", "", None, "is empty"),
        ("a.json", ["red", " "], None, "found an empty name"),
        ("a.txt", "red\n" + "x" * 5000, None, "at most"),
    ],
)
def test_class_names_in_the_forms_that_people_have(tmp_path, name, content, dataset, expected):
    file = tmp_path / name
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    if isinstance(expected, str):
        assert expected in error_of(lambda: read_class_names(file, dataset))
    else:
        assert read_class_names(file, dataset) == expected


CUPL = {name: [f"{name} is a colour", f"a {name} sky"] for name in NAMES}


@pytest.mark.parametrize(
    ("name", "content", "dataset", "expected"),
    [
        ("t.txt", "a {}\n{} in the wild", None, ["a red", "red in the wild"]),
        ("t.json", ["a photo of a {c}."], None, ["a photo of a red."]),
        ("t.json", {"imagenet1k": ["a {c}"]}, None, ["a red"]),
        ("t.json", {"imagenet1k": ["a {c}"], "vtab/pets": ["a {c}, a pet"]}, "vtab/pets", ["a red, a pet"]),
        ("t.json", CUPL, None, CUPL["red"]),
        ("t.json", {"hues": CUPL, "cars": {}}, "hues", CUPL["red"]),
        ("t.txt", "\n", None, "expected at least one template"),
        ("t.json", [], None, "expected at least one template"),
        ("t.json", {"imagenet1k": []}, None, "expected at least one template"),
        ("t.json", [1], None, "texts alone"),
        ("t.json", "a {c}", None, "expected at least one template"),
        ("t.txt", "a photo", None, "'a photo' has no {} where the class goes"),
        ("t.json", {"hues": {"red": ["a"], "green": ["b"]}}, None, "no prompts for blue"),
        ("t.json", {**CUPL, "green": []}, None, "no prompts for green"),
        ("t.json", {"one": ["a {}"], "two": ["a {}"]}, None, "holds 2 data sets (one, two)"),
        ("missing.txt", None, None, "missing.txt"),
    ],
)
def test_templates_in_the_forms_that_people_have(tmp_path, name, content, dataset, expected):
    file = tmp_path / name
    if content is not None:
        file.write_text(content if isinstance(content, str) and name.endswith("txt") else json.dumps(content))
    if isinstance(expected, str):
        assert expected in error_of(lambda: make_prompts(NAMES, file, dataset))
    else:
        assert make_prompts(NAMES, file, dataset)["red"] == expected


def test_towers_that_do_not_fit_are_one_line(tmp_path, towers):
    files = write_towers(tmp_path / "towers", "pt2", towers)
    image, text = load_encoder(str(files[0]), device="cpu", how=AsEncoder()), load_text_tower(str(files[1]))
    prompts = make_prompts(NAMES, None)
    wide = TextTower("wide", "1" * 64, lambda texts: np.ones((len(texts), 5), np.float32))
    message = error_of(lambda: make_zero_shot("hues", image, wide, prompts, tmp_path))
    assert "gives 8 numbers for an image, and wide 5 for a text" in message
    empty = TextTower("empty", "2" * 64, lambda texts: np.zeros((len(texts), 8), np.float32))
    assert "prompts of 'red'" in error_of(lambda: make_zero_shot("hues", image, empty, prompts, tmp_path))
    assert not (tmp_path / "hues.pt2").exists()
    assert "expected token ids" in error_of(lambda: load_text_tower(str(files[0])))
    assert "expected a batch of colour images" in error_of(
        lambda: load_encoder(str(files[1]), device="cpu", how=AsEncoder())
    )
    assert "no such file" in error_of(lambda: load_text_tower("nothing.onnx"))
    assert "open_clip:NAME:WEIGHTS" in error_of(lambda: load_text_tower("resnet18"))
    (files[1].parent / "tokenizer.json").write_text("{}")
    assert "tokenizer.json" in error_of(lambda: load_text_tower(str(files[1])))
    (files[1].parent / "tokenizer.json").unlink()
    assert "no tokenizer.json beside it" in error_of(lambda: load_text_tower(str(files[1])))
    assert text.scale is None


def test_without_the_extra_one_line_names_the_command(tmp_path, towers, monkeypatch):
    files = write_towers(tmp_path / "towers", "pt2", towers)
    monkeypatch.setitem(sys.modules, "tokenizers", None)
    monkeypatch.setitem(sys.modules, "open_clip", None)
    assert "pip install '.[clip]'" in error_of(lambda: load_text_tower(str(files[1])))
    message = error_of(lambda: load_encoder("open_clip:ViT-B-32:openai", device="cpu", how=AsEncoder()))
    assert "pip install '.[clip]'" in message


def write_open_clip(folder, squash: bool):
    """A network of open_clip with random weights, in the folder that its `local-dir:` reads."""
    library = pytest.importorskip("open_clip", reason="needs open_clip: pip install '.[clip]'")
    from safetensors.torch import save_file

    vision = {"image_size": 32, "layers": 1, "width": 64, "patch_size": 16, "head_width": 32}
    words = {"context_length": 16, "vocab_size": 49408, "width": 32, "heads": 2, "layers": 1}
    config = {"embed_dim": 24, "vision_cfg": vision, "text_cfg": words}
    how = {"mean": [0.5, 0.4, 0.3], "std": [0.2, 0.3, 0.4], "interpolation": "bicubic"}
    how["resize_mode"] = "squash" if squash else "shortest"
    if squash:  # as SigLIP
        config["init_logit_bias"] = -10
    folder.mkdir()
    (folder / "open_clip_config.json").write_text(json.dumps({"model_cfg": config, "preprocess_cfg": how}))
    torch.manual_seed(0)
    network = library.CLIP(24, vision, words, **({"init_logit_bias": -10} if squash else {}))
    save_file(network.state_dict(), folder / "open_clip_model.safetensors")
    return library


@pytest.mark.parametrize("squash", mark_slow([False, True], False))
def test_the_answers_are_those_of_open_clips_own_code(tmp_path, squash):
    from PIL import Image

    library = write_open_clip(tmp_path / "clip", squash)
    name = f"local-dir:{tmp_path / 'clip'}"
    network, transform = library.create_model_from_pretrained(name)
    network.eval()
    pixels = np.random.default_rng(0).integers(0, 256, (2, 48, 60, 3), np.uint8)
    from toolkit.models.open_clip import open_towers

    model = f"open_clip:{name}"
    templates = ["a photo of a {}.", "a drawing of a {}."]
    prompts = {one: [text.format(one) for text in templates] for one in ("racing car", "teapot", "warplane")}
    image = load_encoder(model, device="cpu", how=AsEncoder(whole=True))
    make_zero_shot("clip", image, open_towers(model).text, prompts, tmp_path)
    classifier = load_classifier("clip", device="cpu", folder=tmp_path)
    found = classifier.logits(torch.stack([classifier.preprocess(one) for one in pixels]))
    with torch.no_grad():
        photos = torch.stack([transform(Image.fromarray(one)) for one in pixels])
        classes = library.build_zero_shot_classifier(network, library.get_tokenizer(name), list(prompts), templates)
        expected = network.logit_scale.exp() * network.encode_image(photos, normalize=True) @ classes
        if squash:
            expected = expected + network.logit_bias
    assert torch.allclose(found, expected, atol=1e-4) and (expected.std(1) > 0.01).all()
    assert classifier.preprocessing.squash == squash


def test_the_command_writes_a_classifier_that_other_commands_take(tmp_path, towers, monkeypatch, capsys):
    from toolkit.cli import main

    space = make_workspace(tmp_path / "lab")
    write_towers(space.root, "pt2", towers)
    (space.root / "classes.txt").write_text("\n".join(NAMES))
    data = write_colours(tmp_path / "photos", 6, px=40)
    monkeypatch.chdir(space.root)
    begin = ["zero-shot", "hues", "--image", "image.pt2"]
    for words, code, said in (
        ([*begin, "--prompts", "classes.txt"], 2, "--text"),
        ([*begin, "--text", "text.pt2", "--prompts", "classes.txt"], 0, "does not say its scale: 100 is used"),
        (["models", "--model", "hues", "--data", str(data), "--json"], 0, ""),
    ):
        monkeypatch.setattr(sys, "argv", ["toolkit", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out = capsys.readouterr()
        assert (ended.value.code or 0) == code, out.err
        assert said in out.err
    row = json.loads(out.out)[0]
    assert row["can_train"] and row["correct"] >= 16
