"""Several networks at once: no gradient drowns another, turns are taken, and what acts is in the hash."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hue_network import make_hue_classifier
from part_checks import count_changed, grey_noise
from tiny_network import IMAGE_PX, tiny_classifier, tiny_config, train_tiny, write_photos
from watched_patch import train_watched

from toolkit.boosters.patch_config import PATCHES, list_patch_inputs
from toolkit.boosters.pixels import Target, choose_turn, judge_ensemble, judge_photos, list_networks
from toolkit.boosters.transforms.camera import Jitter
from toolkit.core.draws import Draws
from toolkit.models.predict import CPU_PART
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import fit

DRAWS = Draws(0, 5)


class Louder:
    """A network whose gradient is `factor` times as long."""

    def __init__(self, network, factor: float) -> None:
        self.preprocessing, self.device, self.name = network.preprocessing, network.device, network.name
        self._network, self._factor = network, factor

    def logits(self, photos):
        return self._network.logits(photos) * self._factor


def doubled(seed: int = 0, factor: float = 1.0) -> Target:
    network = tiny_classifier(seed)
    network.module.double()
    return Target(Louder(network, factor), 3)


def differentiate(targets: list[Target], **choices) -> tuple[torch.Tensor, float, float]:
    photos = grey_noise(2, 3, IMAGE_PX, IMAGE_PX).requires_grad_(True)
    loss, recognised = judge_ensemble(photos, targets, tiny_config(**choices), DRAWS)
    (gradient,) = torch.autograd.grad(loss, photos)
    return gradient, loss.item(), recognised


def test_normalised_gradients_have_one_length_and_each_is_that_of_differences():
    targets = [doubled(0), doubled(1, 40.0)]
    photos = grey_noise(2, 3, IMAGE_PX, IMAGE_PX)
    own = [differentiate([one], objective="logit")[0] for one in targets]
    assert own[1].norm() > 10 * own[0].norm(), "one would drown the other"
    direction = torch.from_numpy(np.random.default_rng(1).normal(size=photos.shape)) * 1e-5
    slopes = []
    for target in targets:
        ahead, behind = (judge_photos(photos + sign * direction, [target], "logit")[0] for sign in (1, -1))
        slopes.append(float(ahead - behind) / 2)
    mean = (own[0].norm() + own[1].norm()) / 2
    expected = sum(slope * mean / one.norm() for slope, one in zip(slopes, own, strict=True))
    found, loss, _ = differentiate(targets, ensemble="normalised", objective="logit")
    assert float((found * direction).sum()) == pytest.approx(float(expected), rel=1e-6)
    assert loss == pytest.approx(float(judge_photos(photos, targets, "logit")[0]), rel=1e-12)
    shares = [float((found * one).sum() / found.norm() / one.norm()) for one in own]
    summed = differentiate(targets, ensemble="sum", objective="logit")[0]
    assert shares[0] == pytest.approx(shares[1], rel=1e-9), "both have as much of it"
    assert float((summed * own[0]).sum() / summed.norm() / own[0].norm()) < shares[0]


@pytest.mark.parametrize("ensemble", ["sum", "normalised", "turns"])
def test_one_network_alone_is_as_before(ensemble):
    """The config itself has no ensemble then; by hand it may, and makes no difference."""
    target = Target(tiny_classifier(), 3)
    photos = grey_noise(4, 3, IMAGE_PX, IMAGE_PX).float().requires_grad_(True)
    before = torch.autograd.grad(judge_photos(photos, [target])[0], photos)[0]
    loss, _ = judge_ensemble(photos, [target], tiny_config(ensemble=ensemble), DRAWS)
    (found,) = torch.autograd.grad(loss, photos)
    assert torch.allclose(found, before, rtol=1e-5, atol=1e-9)
    config = tiny_config(ensemble=ensemble)
    assert config.for_networks(1).ensemble is None and config.for_networks(2).ensemble == ensemble
    assert tiny_config().for_networks(3).ensemble in ("sum", "normalised", "turns")


def test_a_network_is_asked_about_few_photographs_at_a_time_and_answers_as_about_all(monkeypatch):
    """What it keeps for the way back is the largest part of a training's memory."""
    part = CPU_PART * torch.get_num_threads()
    target, photos = doubled(), grey_noise(2 * part + 1, 3, IMAGE_PX, IMAGE_PX).requires_grad_(True)
    asked: list[int] = []
    whole, hits = judge_photos(photos, [target])
    logits = Target.logits
    monkeypatch.setattr(Target, "logits", lambda self, seen: asked.append(len(seen)) or logits(self, seen))
    loss, recognised = judge_ensemble(photos, [target], tiny_config(), DRAWS)
    assert asked == [part, part, 1]
    assert loss.item() == pytest.approx(whole.item(), rel=1e-12) and recognised == pytest.approx(hits)
    found, expected = (torch.autograd.grad(one, photos)[0] for one in (loss, whole))
    torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-15)


def test_without_a_choice_the_losses_are_added():
    targets = [doubled(0), doubled(1)]
    photos = grey_noise(2, 3, IMAGE_PX, IMAGE_PX)
    found, _ = judge_ensemble(photos, targets, tiny_config(), DRAWS)
    assert float(found) == pytest.approx(float(judge_photos(photos, targets)[0]), rel=1e-12)


def test_turns_ask_every_network_once_a_round_in_another_order():
    rounds = [[choose_turn(7, 3 * k + inside, [1] * 3) for inside in range(3)] for k in range(20)]
    assert all(sorted(one) == [0, 1, 2] for one in rounds) and len({tuple(one) for one in rounds}) > 3
    targets = [doubled(seed) for seed in range(3)]
    own = [differentiate([one])[0] for one in targets]
    found = differentiate(targets, ensemble="turns")[0]
    assert torch.equal(found, own[choose_turn(0, DRAWS.step, [1] * 3)])


def test_a_network_may_have_more_turns_than_others():
    rounds = [[choose_turn(7, 4 * k + inside, [1, 2, 1]) for inside in range(4)] for k in range(20)]
    assert all(sorted(one) == [0, 1, 1, 2] for one in rounds) and len({tuple(one) for one in rounds}) > 5
    plain, often = (Target(replace(tiny_classifier(), turns=turns), 3) for turns in (1, 3))
    assert often.turns == 3 and list_networks([plain]) != list_networks([often])
    assert list_networks([plain]) == list_networks([Target(tiny_classifier(), 3)]), "older hashes stay"


@pytest.mark.parametrize("ensemble", ["sum", "normalised", "turns"])
def test_views_that_the_booster_loses_count_more(ensemble):
    """The loss without weights plus (X - 1) times that of the views which are known bare and missed."""
    # a network that tells colours, asked for red and for green, and photographs of one colour each
    targets = [Target(make_hue_classifier(), index) for index in (0, 1)]
    colours = np.random.default_rng(0).uniform(size=(2, 24, 3, 1, 1))
    unmodified, photos = (torch.from_numpy(each).expand(24, 3, IMAGE_PX, IMAGE_PX) for each in colours)
    choices = {"ensemble": ensemble, "lost_weight": 3.0, "jitter": Jitter(probability=1, scale=(1, 1), shift=0)}
    number = choose_turn(0, DRAWS.step, [1, 1])
    expected = 0.0
    for target in targets[number : number + 1] if ensemble == "turns" else targets:
        known = target.find_hits(unmodified)
        lost = known & ~target.find_hits(photos)
        assert 0 < lost.sum() < known.sum() < 24
        each = torch.tensor([float(judge_photos(photo[None], [target])[0]) for photo in photos])
        expected += float((each * (1 + 2 * lost)).mean())
    seen = photos.clone().requires_grad_(True)
    loss, _ = judge_ensemble(seen, targets, tiny_config(**choices), DRAWS, unmodified=unmodified)
    assert loss.item() == pytest.approx(expected, rel=1e-5)
    plain, _ = judge_ensemble(seen, targets, tiny_config(**choices | {"lost_weight": 1.0}), DRAWS)
    assert plain.item() < expected


def test_the_logits_gradient_does_not_vanish_where_the_network_is_sure():
    """That of cross-entropy is 1 - p times as long before a network whose other logits are still."""
    logits = torch.tensor([[0.0, 0.0, 0.0, 9.0]], dtype=torch.double, requires_grad=True)

    class Sure:
        preprocessing = tiny_classifier().preprocessing

        def logits(self, photos):
            return logits

    lengths = []
    for objective in ("logit", "cross-entropy"):
        loss, recognised = judge_photos(torch.zeros(1, 3, IMAGE_PX, IMAGE_PX).double(), [Target(Sure(), 3)], objective)
        lengths.append(float(torch.autograd.grad(loss, logits)[0][0, 3]))
        assert recognised == 1
    assert lengths[0] == -1 and lengths[1] == pytest.approx(-(1 - float(logits.softmax(1)[0, 3])), rel=1e-9)


def test_a_network_of_another_size_is_shown_its_own():
    small = tiny_classifier()
    large = replace(tiny_classifier(), preprocessing=replace(small.preprocessing, resize_px=60, crop_px=48))
    seen = []
    large.module.register_forward_hook(lambda module, given, found: seen.append(tuple(given[0].shape)))
    photos = grey_noise(2, 3, IMAGE_PX, IMAGE_PX).float().requires_grad_(True)
    loss, _ = judge_photos(photos, [Target(small, 3), Target(large, 3)])
    loss.backward()
    assert seen == [(2, 3, 48, 48)] and photos.grad.abs().max() > 0
    assert Target(large, 3).count_hits(photos) <= 2


class TestJitter:
    def test_its_gradient_is_that_of_differences(self):
        photos = grey_noise(3, 3, 24, 24)
        weights = torch.from_numpy(np.random.default_rng(1).normal(size=photos.shape))
        part = Jitter(probability=1)

        def weigh(at: torch.Tensor) -> torch.Tensor:
            return (part.change(at, np.random.default_rng(3)) * weights).sum()

        at = photos.clone().requires_grad_(True)
        (gradient,) = torch.autograd.grad(weigh(at), at)
        direction = torch.from_numpy(np.random.default_rng(2).normal(size=photos.shape)) * 1e-4
        difference = float(weigh(photos + direction) - weigh(photos - direction)) / 2
        assert float((gradient * direction).sum()) == pytest.approx(difference, rel=1e-6)

    def test_it_moves_right_and_down_and_enlarges(self):
        photo = torch.zeros(1, 3, 40, 40, dtype=torch.double)
        photo[:, :, 18:22, 18:22] = 1
        moved = Jitter(scale=(1, 1), shift=0.25, probability=1).change(photo, Fixed([1.0], [[0.25, 0.1]]))
        assert torch.allclose(moved, photo.roll((4, 10), (2, 3)), atol=1e-9)
        larger = Jitter(scale=(2, 2), shift=0, probability=1).change(photo, Fixed([2.0], [[0.0, 0.0]]))
        assert float(larger.sum()) == pytest.approx(4 * float(photo.sum()), rel=1e-9)

    def test_each_photograph_draws_its_own_and_each_network_too(self):
        images = grey_noise(100, 3, 16, 16)
        assert count_changed(Jitter(probability=0).change, images) == 0
        assert 50 < count_changed(Jitter().change, images) < 90
        shown = []

        class Watched(Louder):
            def logits(self, photos):
                shown.append(photos)
                return super().logits(photos)

        targets = [Target(Watched(doubled().classifier, 1.0), 3)] * 2
        photos = grey_noise(2, 3, IMAGE_PX, IMAGE_PX)
        judge_ensemble(photos, targets, tiny_config(jitter=Jitter(probability=1)), DRAWS)
        assert not torch.equal(shown[0], shown[1])


class Fixed:
    """A generator that gives what it was given."""

    def __init__(self, scale, shift) -> None:
        self._drawn = [np.array(scale), np.array(shift)]

    def random(self, count: int):
        return np.zeros(count)

    def uniform(self, *_):
        return self._drawn.pop(0)


def test_momentum_adds_what_was_before_and_survives_a_stop(tmp_path):
    images = (grey_noise(8, 3, 36, 36) * 255).byte()
    target = Target(tiny_classifier(), 3)
    config = tiny_config(steps=6, momentum=0.8, last_smoothing_px=1.0)
    whole = train_watched(images, [target], config=config)
    plain = train_watched(images, [target], config=tiny_config(steps=6, last_smoothing_px=1.0))
    assert torch.equal(whole.seen[0], plain.seen[0]) and not torch.equal(whole.seen[-1], plain.seen[-1])

    class Stopped(type(whole)):
        def loss(self, step: int):
            if step == 3:
                raise KeyboardInterrupt
            return super().loss(step)

    def keep() -> Checkpoint:
        return Checkpoint(tmp_path / "c" / "one", "a" * 64, False, 1e9, ())

    with pytest.raises(KeyboardInterrupt):
        fit(Stopped(images, [target], config=config), config.fit_config(), keep())
    resumed = train_watched(images, [target], config=config, checkpoint=keep())
    assert torch.equal(resumed.seen[-1], whole.seen[-1])


def test_the_velocity_is_that_of_the_paper():
    """Dong et al. 2018, equation 6: μ g + gradient / its L1 norm, here its mean."""
    images = (grey_noise(4, 3, 36, 36) * 255).byte()
    config = tiny_config(steps=4, momentum=0.5, smoothing_px=0)
    task = train_watched(images, [Target(tiny_classifier(), 3)], config=config)
    gradients = [torch.randn(3, 16, 16) * 10**k for k in range(3)]
    task._velocity.zero_()
    for step, gradient in enumerate(gradients):
        task.pixels.grad = gradient.clone()
        task.adjust_gradients(step)
    unit = [one / one.abs().mean() for one in gradients]
    assert torch.allclose(task.pixels.grad, unit[2] + 0.5 * unit[1] + 0.25 * unit[0], atol=1e-5)


def test_hashes_and_records_name_what_acts_and_nothing_else():
    networks = list_networks([Target(tiny_classifier(), 3)])
    plain = PATCHES.key(*list_patch_inputs(tiny_config(), "jet", networks, ""))
    named = ("ensemble", "objective", "jitter", "momentum", "last_smoothing_px")
    assert not set(named) & set(tiny_config().record())
    choices = [
        {"ensemble": "turns"},
        {"objective": "logit"},
        {"jitter": Jitter()},
        {"momentum": 0.9},
        {"last_smoothing_px": 1},
    ]
    assert (
        len({plain, *(PATCHES.key(*list_patch_inputs(tiny_config(**one), "jet", networks, "")) for one in choices)})
        == 6
    )
    assert "jitter" not in dict(tiny_config().rows())
    said = dict(tiny_config(jitter=Jitter(), momentum=0.9, objective="logit").for_networks(2).rows())
    assert "jitter" in said and (said["momentum"], said["objective"], said["ensemble"]) == ("0.9", "logit", "turns")


def test_a_run_on_two_networks_says_how_they_were_joined(tmp_path):
    photos = write_photos(tmp_path / "photos", 6)
    networks = [tiny_classifier(0), tiny_classifier(1)]
    made = train_tiny(tmp_path / "w", photos, tiny_config(steps=2, ensemble="turns"), networks=networks)
    assert made.patch.record.settings["ensemble"] == "turns" and len(made.patch.record.networks) == 2
