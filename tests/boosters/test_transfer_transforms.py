"""Cutout, block shuffle and feature mix-up by their published formulas; off unless they are asked for."""

import numpy as np
import pytest
import torch
from killed_runs import stopped_at
from red_seeker import red_seeker
from texture_parts import crate_config
from tiny_network import IMAGE_PX, tiny_classifier, tiny_config, train_tiny, write_photos
from torchvision.transforms.functional import InterpolationMode, rotate

from toolkit.boosters.detectors import DetectorNetwork, meet_networks
from toolkit.boosters.patch import PatchTask
from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixels import Target, judge_ensemble
from toolkit.boosters.texture import train_texture
from toolkit.boosters.texture_config import TextureConfig
from toolkit.boosters.transforms.transfer import BlockShuffle, Cutout, FeatureMixup, divide
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.rooms.benchmarks.transfer import TransferConfig
from toolkit.rooms.benchmarks.transfer.leave_one_out import leave_one_out
from toolkit.training.processes import Processes

DRAWS = Draws(5, 7)


def pictures(count=2, px=20):
    return torch.rand(count, 3, px, px, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def test_cutout_hides_a_square_of_the_share_about_its_middle():
    """T-SEA: a side of 0.4, filled with 0.5, elsewhere the patch as it is."""
    patch = pictures(1)
    found = Cutout().apply(patch, (np.array([[0.5, 0.3]]),))[0]
    hidden = (found == 0.5).all(0)
    assert torch.equal(hidden, (found != patch[0]).any(0))
    rows, columns = (np.flatnonzero(hidden.any(axis).numpy()) for axis in (1, 0))
    assert rows.tolist() == list(range(2, 10)) and columns.tolist() == list(range(6, 14))
    assert hidden.sum() == 64, "0.16 of 400"


def test_cutout_acts_in_nine_of_ten_steps_with_its_middle_anywhere_in_the_patch():
    rng = np.random.default_rng(0)
    patch = pictures(1)[0]
    changed = [not torch.equal(Cutout().change(patch, rng), patch) for _ in range(400)]
    assert np.mean(changed) == pytest.approx(0.9, abs=0.05)
    (middle,) = Cutout().draw(rng, 4000)
    assert middle.min() >= -0.05 and middle.max() <= 1.05
    assert middle.mean(0) == pytest.approx([0.5, 0.5], abs=0.02)
    assert middle.var(0) == pytest.approx([1.1**2 / 12] * 2, rel=0.05), "even from -0.05 to 1.05, as in its release"


def test_the_gradient_reaches_what_is_not_hidden_alone():
    patch = pictures(1).requires_grad_(True)
    Cutout().apply(patch, (np.array([[0.5, 0.5]]),)).sum().backward()
    assert patch.grad.sum() == 3 * (400 - 64) and set(patch.grad.unique().tolist()) == {0.0, 1.0}


def test_blocks_lie_where_their_order_says():
    """Two by two with no angle: strips of 5 and 15 rows change places, and so do the blocks of the second."""
    photo = pictures(1)
    sizes = np.array([[[1.0, 3.0], [1.0, 1.0], [1.0, 4.0]]])
    orders, angles = np.array([[[1, 0], [0, 1], [1, 0]]]), np.zeros((1, 2, 2))
    down = BlockShuffle().apply(photo, (np.array([0]), sizes, orders, angles))[0]
    first = torch.cat([photo[0, :, 5:, 4:], photo[0, :, 5:, :4]], 2)
    assert torch.allclose(down, torch.cat([first, photo[0, :, :5]], 1))
    right = BlockShuffle().apply(photo.mT, (np.array([1]), sizes, orders, angles))[0]
    assert torch.allclose(right, down.mT), "along the other axis the same of the picture on its side"


def test_without_an_angle_pixels_change_places_alone_and_one_block_is_turned_whole():
    photos, rng = pictures(3), np.random.default_rng(1)
    moved = BlockShuffle(blocks=4, max_angle_deg=0, probability=1).change(photos, rng)
    assert not torch.allclose(moved, photos)
    assert torch.allclose(moved.flatten(2).sort(2)[0], photos.flatten(2).sort(2)[0])
    whole = BlockShuffle(blocks=1)
    drawn = whole.draw(rng, 3)
    turned = [
        rotate(one, float(a), InterpolationMode.BILINEAR) for one, a in zip(photos, drawn[3].ravel(), strict=True)
    ]
    assert torch.allclose(whole.apply(photos, drawn), torch.stack(turned))


def test_angles_and_sizes_are_as_published():
    _, sizes, orders, angles = BlockShuffle().draw(np.random.default_rng(0), 2000)
    assert np.abs(angles).max() <= 24 and angles.std() == pytest.approx(24 / 3**0.5, rel=0.03)
    assert (orders[..., 0] == 0).mean() == pytest.approx(0.5, abs=0.03)
    for one in sizes[:50, 0]:
        parts = divide(224, one)
        assert sum(parts) == 224 and np.abs(np.array(parts) - 224 * one / one.sum()).max() <= 1


def test_the_gradient_agrees_with_a_difference():
    photos = pictures(1, px=8).requires_grad_(True)
    drawn = BlockShuffle().draw(np.random.default_rng(4), 1)
    assert torch.autograd.gradcheck(lambda x: BlockShuffle().apply(x, drawn), photos)


def test_they_are_off_and_leave_no_trace_unless_asked_for():
    names = {"cutout", "block_shuffle", "feature_mixup"}
    assert all(getattr(PatchConfig(), name) is None for name in names)
    assert not names & {*PatchConfig().record(), *TextureConfig().record()}
    asked = PatchConfig().with_overrides({"cutout": True, "block_shuffle": True})
    assert [type(one) for one in asked.transforms("network")] == [BlockShuffle]
    assert Cutout in [type(one) for one in asked.transforms("print")]
    assert asked.record()["cutout"] == {"share": 0.4, "probability": 0.9}


class TestFeatureMixup:
    """Clean feature mix-up (CFM)."""

    photos, clean = pictures(4, IMAGE_PX), pictures(4, IMAGE_PX).flip(3)

    @staticmethod
    def mix(f, g, rng):
        """(1 - a) f + a g: g in a random order, a even in 0 to 0.75 for each photograph and channel."""
        order, a = rng.permutation(len(g)), torch.zeros(g.shape[:2], dtype=g.dtype)
        a += torch.from_numpy(rng.uniform(0, 0.75, g.shape[:2]))
        return torch.stack([
            torch.stack([(1 - a[i, c]) * f[i, c] + a[i, c] * g[order[i], c] for c in range(f.shape[1])])
            for i in range(len(f))
        ])  # fmt: skip

    def test_features_are_mixed_as_published(self):
        module, part = tiny_classifier().module.double(), FeatureMixup(probability=1)
        seen, other = self.photos, self.clean
        for k, layer in enumerate(module):
            seen, other = layer(seen), layer(other)
            if k in (2, 6):  # the first layer's map, 14 of 32 pixels, is larger than a quarter of the side
                seen = self.mix(seen, other, part.rng(DRAWS, f" {k // 2 - k // 6} 0"))
        with part.inside(module, IMAGE_PX, lambda: module(self.clean), DRAWS):
            found = module(self.photos)
        assert torch.allclose(found, seen, rtol=0, atol=1e-12)
        assert not torch.allclose(found, module(self.photos), atol=1e-3), "it acts, and is gone afterwards"

    def test_a_tenth_of_the_layers_act(self):
        module, acted = tiny_classifier().module.double(), 0
        for step in range(600):
            asked = []
            with FeatureMixup().inside(module, IMAGE_PX, lambda asked=asked: asked.append(1), Draws(0, step)):
                acted += sum(len(one._forward_hooks) for one in module.modules())
            assert len(asked) <= 1
        assert acted / 1800 == pytest.approx(0.1, abs=0.02)
        assert FeatureMixup().max_share == 0.75

    def test_the_gradient_agrees_with_a_difference(self):
        network = tiny_classifier()
        network.module.double()
        config = tiny_config(feature_mixup=FeatureMixup(probability=1))

        def judge(photos):
            return judge_ensemble(photos, [Target(network, 3)], config, DRAWS, self.clean)[0]

        photos = self.photos.clone().requires_grad_(True)
        (gradient,) = torch.autograd.grad(judge(photos), photos)
        direction = pictures(4, IMAGE_PX) - 0.5
        ahead, behind = (judge(self.photos + sign * 1e-5 * direction) for sign in (1, -1))
        assert float((gradient * direction).sum()) == pytest.approx(float(ahead - behind) / 2e-5, rel=1e-5)

    def test_processes_mix_their_part_as_one_does(self, monkeypatch):
        part, features = FeatureMixup(), (pictures(4, 6), pictures(4, 6).flip(2))
        whole = part.apply(*features, np.random.default_rng(3))
        for rank in range(2):
            monkeypatch.setattr("toolkit.boosters.transforms.transfer.current", lambda rank=rank: Processes(rank, 2))
            own = slice(2 * rank, 2 * rank + 2)
            assert torch.equal(part.apply(features[0][own], features[1], np.random.default_rng(3)), whole[own])

    def test_the_network_is_left_as_it_was_and_a_stopped_run_ends_in_the_same_bytes(self, tmp_path):
        photos, network = write_photos(tmp_path / "photos", 6), tiny_classifier()

        def state():
            hooks = [len(one._forward_hooks) + len(one._forward_pre_hooks) for one in network.module.modules()]
            weights = [value.numpy().tobytes() for value in network.module.state_dict().values()]
            with torch.no_grad():
                return hooks, weights, network.logits(self.photos.float()).numpy().tobytes(), network.module.training

        def train(name, **options):
            config = tiny_config(6, feature_mixup=FeatureMixup(probability=0.5))
            return train_tiny(tmp_path / name, photos, config, networks=[network], checkpoint_every_s=0)

        before = state()
        whole = train("whole")
        assert state() == before

        with stopped_at(PatchTask, 3):
            train("stopped")
        stopped = train("stopped")
        assert stopped.resumed_from == 3 and state() == before
        assert stopped.files.png.read_bytes() == whole.files.png.read_bytes()
        assert whole.patch.record.settings["feature_mixup"] == {"max_share": 0.75, "probability": 0.5}
        plain = train_tiny(tmp_path / "plain", photos, tiny_config(6), networks=[network])
        assert not np.array_equal(plain.patch.pixels, whole.patch.pixels)
        assert "feature_mixup" not in plain.patch.record.settings

    def test_a_texture_meets_it(self, tmp_path, make_crate_space):
        space, network = make_crate_space(tmp_path), tiny_classifier()
        before = [value.numpy().tobytes() for value in network.module.state_dict().values()]
        made = [
            train_texture(crate_config(feature_mixup=one), [network], space, class_name="jet", name=name, workers=0)
            for name, one in (("plain", None), ("mixed", FeatureMixup(probability=1)))
        ]
        assert not np.array_equal(*(one.texture.pixels for one in made))
        assert made[1].texture.record.settings["feature_mixup"]["probability"] == 1
        assert [value.numpy().tobytes() for value in network.module.state_dict().values()] == before
        assert not any(one._forward_hooks or one.training for one in network.module.modules())


@pytest.mark.parametrize("name", ["jitter", "block_shuffle", "feature_mixup"])
def test_detectors_refuse_what_acts_on_classifiers_alone(name, tmp_path, make_crate_space):
    config, detector = PatchConfig().with_overrides({name: True}), DetectorNetwork(red_seeker())
    with pytest.raises(ToolkitError, match=f"^{name} acts on classifiers alone: leave it out"):
        meet_networks(config, [detector], "car")
    assert meet_networks(PatchConfig(), [detector], "car")[1][0].label == "car"
    if name != "block_shuffle":
        space = make_crate_space(tmp_path)
        asked = TransferConfig().with_overrides({name: True})
        with pytest.raises(ToolkitError, match="acts on classifiers alone"):
            leave_one_out(space, asked, [tiny_classifier(), detector])


def test_a_network_whose_features_cannot_be_reached_is_a_line():
    network = tiny_classifier()
    object.__setattr__(network, "module", torch.nn.Softplus())
    with pytest.raises(ToolkitError, match=r"model tiny: its features cannot be reached, so feature_mixup cannot"):
        meet_networks(PatchConfig(feature_mixup=FeatureMixup()), [network], "jet")
