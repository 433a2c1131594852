"""A patch is trained against a detector: boxes lie round the object, and the loss brings its score up."""

import numpy as np
import pytest
import torch
from hue_network import make_hue_classifier
from red_seeker import PX, red_seeker

from toolkit.boosters.detectors import DetectorNetwork, box_of_coverage, find_detectors
from toolkit.core.errors import ToolkitError


def test_the_loss_falls_where_score_and_box_fit():
    detector, box = red_seeker(), torch.tensor([[12.0, 12.0, 44.0, 44.0]])
    grey = torch.full((1, 3, PX, PX), 0.5)
    red, aside = grey.clone(), grey.clone()
    red[:, 0, 8:48, 8:48], red[:, 1:, 8:48, 8:48] = 1, 0
    aside[:, 0, 56:, 56:], aside[:, 1:, 56:, 56:] = 1, 0
    losses = [float(detector.losses(one, box, 1)) for one in (grey, aside, red)]
    assert losses[2] < losses[1] - 0.5 and losses[2] < losses[0] - 0.5
    assert float(detector.losses(red, box, 0)) > losses[2] + 0.5
    thin = torch.tensor([[26.0, 12.0, 30.0, 44.0]])  # no box of this detector fits it
    assert float(detector.losses(red, thin, 1)) > losses[2] + 0.1


def test_its_gradient_is_that_of_finite_differences():
    detector, box = red_seeker(), torch.tensor([[12.0, 12.0, 44.0, 44.0]])
    image = torch.rand(1, 3, PX, PX, generator=torch.Generator().manual_seed(0)).double().requires_grad_()
    gradient = torch.autograd.grad(detector.losses(image, box.double(), 1).sum(), image)[0]
    along = gradient / gradient.norm()
    with torch.no_grad():
        ends = [detector.losses(image + sign * 1e-4 * along, box.double(), 1) for sign in (1, -1)]
    assert float((ends[0] - ends[1]) / 2e-4) == pytest.approx(float(gradient.norm()), rel=1e-4)


def test_the_box_of_a_coverage():
    coverage = np.zeros((10, 12))
    coverage[2:5, 3:9] = 1
    coverage[5, 3:9] = 0.3
    assert box_of_coverage(coverage) == (3, 2, 9, 5)
    assert box_of_coverage(np.zeros((4, 4))) == (0, 0, 0, 0)


def test_classifiers_and_detectors_are_not_mixed():
    from tiny_network import tiny_classifier

    network = DetectorNetwork(red_seeker())
    assert find_detectors([network]) == [network] and find_detectors([tiny_classifier()]) is None
    with pytest.raises(ToolkitError, match="not both"):
        find_detectors([network, tiny_classifier()])


def test_a_patch_makes_its_object_found(tmp_path):
    """The whole way, on a small object: the patch turns red, since that is what the detector finds."""
    import trimesh

    from toolkit.boosters.patch import train_patch
    from toolkit.boosters.patch_config import PatchConfig
    from toolkit.boosters.pixel_config import DataConfig
    from toolkit.core.workspace import make_workspace, open_workspace

    make_workspace(tmp_path)
    trimesh.creation.box((200, 160, 60)).export(tmp_path / "rig/objects/crate.obj")
    spec = 'class = "racer"\nmesh = "crate.obj"\nlength_mm = 200\n[patch]\nsize_mm = 90\n'
    (tmp_path / "rig/objects/crate.toml").write_text(spec)
    config = PatchConfig(size_px=16, steps=25, batch=4, lr=0.1, mounted_share=0.5, mounted_views=6)
    data = DataConfig(sources=("rig:crate",), images=4)
    trained = train_patch(
        config, "racer", [DetectorNetwork(red_seeker())], data, open_workspace(tmp_path), name="crate"
    )
    red, _, blue = trained.patch.pixels.reshape(-1, 3).mean(0)
    assert red > blue + 60 and trained.patch.record.class_name == "car"
    assert trained.patch.record.networks[0].arch == "onnx:red.onnx"
    (on_object,) = trained.on_object
    assert on_object.patched.hits >= on_object.bare.hits


def test_a_texture_makes_its_object_found(tmp_path):
    import trimesh

    from toolkit.boosters.texture import train_texture
    from toolkit.boosters.texture_config import TextureConfig
    from toolkit.core.workspace import make_workspace, open_workspace

    make_workspace(tmp_path)
    trimesh.creation.box((200, 160, 60)).export(tmp_path / "rig/objects/crate.obj")
    (tmp_path / "rig/objects/crate.toml").write_text('class = "racer"\nmesh = "crate.obj"\nlength_mm = 200\n')
    few = {"studios": 1, "per_studio": 4, "reuse": 2, "held_out": 1}
    config = TextureConfig(objects=("crate",), size_px=16, steps=16, batch=4, lr=0.1, **few)
    trained = train_texture(config, [DetectorNetwork(red_seeker())], open_workspace(tmp_path), workers=0)
    red, _, blue = trained.texture.pixels.reshape(-1, 3).mean(0)
    assert red > blue + 40 and trained.texture.record.class_name == "car"


def test_the_command_takes_detectors_or_classifiers(tmp_path, monkeypatch):
    from toolkit.boosters import detectors
    from toolkit.models import load, load_detector

    monkeypatch.setattr(load_detector, "is_detector", lambda name: name == "ssd300_vgg16")
    monkeypatch.setattr(load_detector, "load_detector", lambda *_: red_seeker())
    monkeypatch.setattr(load, "load_classifiers", lambda models, *_: list(map(make_hue_classifier, models)))
    (network,) = detectors.load_networks(["ssd300_vgg16"], None)
    assert isinstance(network, DetectorNetwork) and network.labels[network.class_index("sports car")] == "car"
    assert [one.name for one in detectors.load_networks(["resnet18"], None)] == ["resnet18"]
    with pytest.raises(ToolkitError, match="not both"):
        detectors.load_networks(["ssd300_vgg16", "resnet18"], None)
    with pytest.raises(ToolkitError, match="model net other net: several are called 'net': name each once"):
        detectors.load_networks(["net", "other", "net"], None)
