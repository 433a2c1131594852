"""A patch is trained against a detector: boxes lie round the object, and the loss brings its score up."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hue_network import make_hue_classifier
from red_seeker import PX, red_seeker
from texture_parts import crate_config
from tiny_network import tiny_classifier

from toolkit.boosters import pixels
from toolkit.boosters.detectors import (
    DetectorNetwork,
    box_of_coverage,
    describe_targets,
    judge_detectors,
    meet_networks,
)
from toolkit.boosters.patch import train_patch
from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixel_config import DataConfig
from toolkit.boosters.pixels import Target, choose_targets
from toolkit.boosters.texture import train_texture
from toolkit.core.errors import ToolkitError
from toolkit.models.load_detector import DenseDetector


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


class TestBesideClassifiers:
    def test_classifiers_lead_and_a_detector_may_lack_the_class(self):
        networks = [DetectorNetwork(red_seeker()), tiny_classifier()]
        config, (first, second) = meet_networks(PatchConfig(), networks, "sports car")
        assert config.ensemble == "turns" and first.label == "sports car" and second.label == "car"
        _, (jet, lacking) = meet_networks(PatchConfig(), networks, "jet")
        assert lacking.classifier.any_class and lacking.label == "object"
        assert describe_targets([jet, lacking]) == ["tiny", "red (knows no jet: keeps the unmodified object's score)"]
        with pytest.raises(ToolkitError, match=r"ensemble\}? sum: expected turns"):
            meet_networks(PatchConfig(ensemble="sum"), networks, "jet")
        with pytest.raises(ToolkitError, match="jet"):
            meet_networks(PatchConfig(), networks[:1], "jet")

    def test_a_detector_that_lacks_the_class_only_forbids_to_hide_the_object(self):
        target = Target(DetectorNetwork(red_seeker(), any_class=True), 1)
        blue, boxes = torch.zeros(1, 3, PX, PX), np.array([[8.0, 8.0, 48.0, 48.0]], np.float32)
        blue[:, 2] = 1
        red = blue.clone()
        red[:, 0, 8:48, 8:48], red[:, 1:, 8:48, 8:48] = 1, 0
        assert target.find_hits(torch.cat([red, blue])).tolist() == [True, False]
        hidden, seen = judge_detectors(blue, [target], boxes, unmodified=red)
        kept, still_seen = judge_detectors(red, [target], boxes, unmodified=blue)
        assert float(hidden) > 0.5 and float(kept) == 0 and (seen, still_seen) == (0, 1)
        doubled, _ = judge_detectors(blue, [target], boxes, unmodified=red, lost_weight=2)
        assert float(doubled) == pytest.approx(2 * float(hidden))
        # its gradient is that of finite differences
        at = (0.6 * blue + 0.4 * red).double().requires_grad_()
        gradient = torch.autograd.grad(judge_detectors(at, [target], boxes, unmodified=red.double())[0], at)[0]
        along = 1e-5 * gradient / gradient.norm()
        with torch.no_grad():
            ends = [float(judge_detectors(at + k * along, [target], boxes, red.double())[0]) for k in (1, -1)]
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(float(gradient.norm()), rel=1e-4)

    def test_photographs_are_judged_in_parts_and_count_alike(self, monkeypatch):
        target, asked = Target(DetectorNetwork(red_seeker(), any_class=True), 1), []
        monkeypatch.setattr(pixels, "CPU_PART", 2)
        monkeypatch.setattr(torch, "get_num_threads", lambda: 1)
        losses = DenseDetector.losses
        monkeypatch.setattr(DenseDetector, "losses", lambda *given: asked.append(len(given[1])) or losses(*given))
        rng = torch.Generator().manual_seed(0)
        red, photos = (torch.rand(5, 3, PX, PX, generator=rng, dtype=torch.float64) for _ in range(2))
        red[:, 0, 8:48, 8:48], red[:, 1:, 8:48, 8:48] = 1, 0
        boxes = np.stack([np.array([8.0 + k, 8.0, 48.0, 48.0], np.float32) for k in range(5)])
        photos.requires_grad_()

        def judge(where: slice):
            loss, _ = judge_detectors(photos[where], [target], boxes[where], unmodified=red[where], lost_weight=2)
            return float(loss.detach()), torch.autograd.grad(loss, photos)[0]

        whole, gradient = judge(slice(0, 5))
        assert max(asked) == 2 and gradient.abs().amax((1, 2, 3)).min() > 0
        alone = [judge(slice(k, k + 1)) for k in range(5)]
        assert whole == pytest.approx(np.mean([loss for loss, _ in alone]))
        torch.testing.assert_close(gradient, sum(part for _, part in alone) / 5)

    @pytest.mark.parametrize("class_name", ["jet", "sports car"])
    def test_a_patch_is_trained_on_both_by_turns(self, make_crate_space, tmp_path, class_name):
        space, config = make_crate_space(tmp_path / "w"), PatchConfig(
            size_px=16, steps=4, batch=4, lr=0.1, mounted_share=0.5, mounted_views=5, lost_weight=2
        )  # fmt: skip
        networks, data = (
            [DetectorNetwork(red_seeker()), tiny_classifier()],
            DataConfig(sources=("rig:crate",), images=4),
        )
        made = train_patch(config, class_name, networks, data, space, name="crate")
        record = made.patch.record
        assert [network.arch for network in record.networks] == ["tiny", "onnx:red.onnx"]
        assert record.class_name == class_name and record.settings["lost_weight"] == 2
        assert {answer.network for answer in made.on_object} == {"tiny", "red"}
        again = train_patch(config, class_name, networks, data, space, name="crate")
        assert again.was_finished

    def test_without_the_object_there_is_no_place_for_detectors(self, make_crate_space, tmp_path):
        networks, data = (
            [DetectorNetwork(red_seeker()), tiny_classifier()],
            DataConfig(sources=("rig:crate",), images=4),
        )
        config = PatchConfig(size_px=16, steps=4, batch=4, mounted_share=0)
        with pytest.raises(ToolkitError, match="detectors need views of the object"):
            train_patch(config, "jet", networks, data, make_crate_space(tmp_path / "w"), name="crate")

    def test_a_texture_is_trained_on_both_by_turns(self, make_crate_space, tmp_path):
        networks = [tiny_classifier(), DetectorNetwork(red_seeker())]
        space, seen = make_crate_space(tmp_path / "w"), []

        class Watched(type(networks[1].detector)):
            def losses(self, batch, boxes, class_index):
                seen.append(class_index)
                return super().losses(batch, boxes, class_index)

        networks[1] = replace(networks[1], detector=Watched(**vars(red_seeker())))
        config = crate_config(lost_weight=2)
        made = train_texture(config, networks, space, class_name="jet", workers=0)
        assert [network.arch for network in made.texture.record.networks] == ["tiny", "onnx:red.onnx"]
        # half of six steps, with and without the texture
        assert seen == [None] * 6
        _, targets = meet_networks(config, networks, "jet")
        by_turns = config.for_networks(2)
        asked = [choose_targets(targets, by_turns, step)[0].label for step in range(6)]
        assert sorted(asked) == ["jet"] * 3 + ["object"] * 3


def test_a_patch_makes_its_object_found(tmp_path):
    """The whole way, on a small object: the patch turns red, since that is what the detector finds."""
    import trimesh

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


@pytest.mark.slow
def test_a_texture_makes_its_object_found(tmp_path):
    import trimesh

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


def test_the_command_takes_detectors_and_classifiers(tmp_path, monkeypatch):
    from toolkit.boosters import detectors
    from toolkit.models import load, load_detector

    monkeypatch.setattr(load_detector, "is_detector", lambda name: name == "ssd300_vgg16")
    monkeypatch.setattr(load_detector, "load_detector", lambda *_: red_seeker())
    monkeypatch.setattr(load, "load_classifiers", lambda models, *_: list(map(make_hue_classifier, models)))
    monkeypatch.setattr(load, "load_classifier", lambda model, *_: make_hue_classifier(model))
    (network,) = detectors.load_networks(["ssd300_vgg16"], None)
    assert isinstance(network, DetectorNetwork) and network.labels[network.class_index("sports car")] == "car"
    assert [one.name for one in detectors.load_networks(["resnet18"], None)] == ["resnet18"]
    both = detectors.load_networks(["ssd300_vgg16", "resnet18"], None)
    assert [one.name for one in both] == ["red", "resnet18"]
    with pytest.raises(ToolkitError, match="model net other net: several are called 'net': name each once"):
        detectors.load_networks(["net", "other", "net"], None)
