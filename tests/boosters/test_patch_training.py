"""Algorithm 1: its gradient, that none is carried over, and that a step depends on nothing but θ, seed and number."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from tiny_network import IMAGE_PX, LABELS, tiny_classifier, tiny_config, wrap
from watched_patch import WatchedPatch, patch_gradient, train_watched

from toolkit.boosters.patch_config import PatchConfig
from toolkit.boosters.pixels import Target, draw_first_pixels, smooth_gradient
from toolkit.boosters.transforms import Transform
from toolkit.boosters.transforms.placement import AffineRanges
from toolkit.boosters.transforms.printing import LightRanges
from toolkit.boosters.transforms.show import Appearance, show_patch
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import fit

PLAIN = Appearance(AffineRanges(share=(0.4, 0.6)))


@dataclass(frozen=True)
class Cover:
    """The patch fills the frame, texel on pixel."""

    def place(self, rng, count, patch_px, image_px):
        return np.tile(np.eye(3) * [image_px / patch_px, image_px / patch_px, 1], (count, 1, 1))


@dataclass(frozen=True)
class MeanNear:
    """A stand-in classifier: the target's loss is least when the image's mean is `best`."""

    best: float
    device = "cpu"
    preprocessing = tiny_classifier().preprocessing
    labels = ("near", "far")
    name = "mean"

    def logits(self, photos):
        distance = photos.mean(dim=(1, 2, 3)) - self.best
        return torch.stack([-50 * distance**2, torch.zeros_like(distance)], dim=1)


def photos(count: int = 6, side: int = 36) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(1).integers(50, 200, (count, 3, side, side)).astype(np.uint8))


def test_gradient_matches_finite_differences_in_double_precision():
    classifier = tiny_classifier()
    classifier.module.double()
    targets, draws = [Target(classifier, 3), Target(classifier, 1)], Draws(0, 4)
    appearance = Appearance(PLAIN.placement, on_paper=(LightRanges(),))
    rng = np.random.default_rng(2)
    patch = torch.from_numpy(rng.uniform(0.3, 0.7, (3, 8, 8)))
    images = torch.from_numpy(rng.uniform(0.2, 0.8, (3, 3, IMAGE_PX, IMAGE_PX)))
    gradient, _, _ = patch_gradient(patch, images, targets, appearance, draws)
    assert gradient.abs().max() > 1e-5
    for _ in range(12):
        at = tuple(rng.integers(0, (3, 8, 8)))
        step = torch.zeros_like(patch)
        step[at] = 1e-5
        above, below = (patch_gradient(patch + s, images, targets, appearance, draws)[1] for s in (step, -step))
        assert float(gradient[at]) == pytest.approx((above - below) / 2e-5, rel=1e-5, abs=1e-9)


def test_half_precision_keeps_the_direction_of_the_gradient(monkeypatch):
    """Autocast works on any processor, if slowly, so the test need not wait for one with the instructions."""
    from toolkit.models import precision

    images, patch = photos()[:, :, :IMAGE_PX, :IMAGE_PX].float() / 255, draw_first_pixels(16, 0)
    arguments = (patch, images, [Target(tiny_classifier(), 3)], PLAIN, Draws(0, 0))
    found = {}
    for native in (True, False):
        monkeypatch.setattr(precision, "has_native_bfloat16", lambda native=native: native)
        found[native] = patch_gradient(*arguments)[0].flatten()
    assert not torch.equal(found[True], found[False]), "half precision did not act"
    assert torch.cosine_similarity(found[True], found[False], dim=0) > 0.98


def test_a_penalty_of_the_patch_itself_adds_its_own_gradient():
    images, patch = photos()[:, :, :IMAGE_PX, :IMAGE_PX].float() / 255, draw_first_pixels(16, 0)
    arguments = (patch, images, [Target(tiny_classifier(), 3)], PLAIN, Draws(0, 0))
    plain, plain_loss, _ = patch_gradient(*arguments)
    with_it, loss, _ = patch_gradient(*arguments, penalty=lambda theta: 3 * (theta**2).sum())
    assert torch.allclose(with_it - plain, 6 * patch, atol=1e-5)
    assert loss - plain_loss == pytest.approx(3 * float((patch**2).sum()), rel=1e-5)


class Accumulating(WatchedPatch):
    """The mistake of the paper's release: gradients are never zeroed."""

    total = None

    def adjust_gradients(self, step):
        self.total = self.pixels.grad if self.total is None else self.total + self.pixels.grad
        self.pixels.grad = self.total
        super().adjust_gradients(step)


def overshoot(kind=WatchedPatch, best: float = 0.56, lr: float = 0.01) -> float:
    """How far, in steps, θ runs past the optimum of a one-dimensional problem that it reaches after six steps."""
    config = tiny_config(30, batch=2, lr=lr, schedule="constant", size_px=IMAGE_PX, start_contrast=0)
    task = kind(photos(), [Target(MeanNear(best), 0)], Appearance(Cover()), config)
    fit(task, config.fit_config())
    return max(float(patch.mean()) - best for patch in task.seen) / lr


def test_gradients_do_not_accumulate_over_steps():
    assert overshoot() < 1.5


def test_the_test_above_sees_an_accumulating_gradient():
    assert overshoot(Accumulating) > 4


def test_loss_is_cross_entropy_towards_the_target_summed_over_networks():
    classifier, draws = tiny_classifier(), Draws(0, 0)
    images, patch = photos()[:, :, :IMAGE_PX, :IMAGE_PX].float() / 255, draw_first_pixels(16, 0)
    logits = classifier.logits(show_patch(patch, images, PLAIN, draws)).double().numpy()
    odds = np.exp(logits - logits.max(1, keepdims=True))
    odds /= odds.sum(1, keepdims=True)
    _, loss, accuracy = patch_gradient(patch, images, [Target(classifier, 2), Target(classifier, 0)], PLAIN, draws)
    assert loss == pytest.approx(-np.log(odds[:, 2]).mean() - np.log(odds[:, 0]).mean(), rel=1e-4)
    answers = odds.argmax(1)
    assert accuracy == pytest.approx(((answers == 2).mean() + (answers == 0).mean()) / 2)


def test_training_learns_and_stays_in_range():
    task = train_watched(photos(), [Target(tiny_classifier(), 3)], PLAIN, tiny_config(40, start_contrast=1))
    losses = task.history.figures["loss"]
    assert np.mean(losses[-5:]) < np.mean(losses[:5])
    assert task.seen[-1].min() >= 0
    assert task.seen[-1].max() <= 1
    first_move = (task.seen[0] - draw_first_pixels(16, 0)).abs()
    assert first_move.max() == pytest.approx(0.1, abs=1e-6), "a step is η for every texel that is not at its bound"


def test_step_i_depends_on_patch_seed_and_i_alone(tmp_path):
    """A run that begins at step 5 with the patch that it had there makes the steps that the whole run made."""
    config = tiny_config(8, batch=3, seed=7, start_contrast=1)
    whole = train_watched(photos(), [Target(tiny_classifier(), 3)], PLAIN, config)

    class Stopped(WatchedPatch):
        def loss(self, step):
            if step == 5:
                raise KeyboardInterrupt
            return super().loss(step)

    checkpoint = Checkpoint(tmp_path, "ab" * 32)
    with pytest.raises(KeyboardInterrupt):
        fit(Stopped(photos(), [Target(tiny_classifier(), 3)], PLAIN, config), config.fit_config(), checkpoint)
    tail = train_watched(photos(), [Target(tiny_classifier(), 3)], PLAIN, config, checkpoint=checkpoint)
    assert len(tail.seen) == 3
    assert torch.equal(tail.seen[-1], whole.seen[-1])
    assert tail.history.figures == whole.history.figures


def test_another_seed_draws_another_run():
    runs = [train_watched(photos(), [Target(tiny_classifier(), 3)], PLAIN, tiny_config(2, seed=k)) for k in (0, 1)]
    assert runs[0].history.figures["loss"] != runs[1].history.figures["loss"]


def test_a_loss_that_is_not_a_number_stops_with_the_reason():
    classifier = tiny_classifier()
    classifier.module[0].weight[0, 0, 0, 0] = float("nan")
    with pytest.raises(ToolkitError, match=r"step 1 is not a finite number .*check model and weights"):
        train_watched(photos(), [Target(classifier, 3)], PLAIN)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"schedule": "cosin"}, "schedule cosin: expected .*did you mean cosine"),
        ({"steps": 0}, "steps 0: expected at least 1"),
        ({"lr": 0}, "lr 0: expected a number above 0 and at most 1"),
        ({"lr": float("nan")}, "above 0"),
    ],
)
def test_impossible_settings_are_refused(settings, words):
    with pytest.raises(ToolkitError, match=words):
        PatchConfig(**settings)


def test_a_black_patch_hides_the_image_and_a_clear_region_does_not():
    images = torch.full((1, 3, IMAGE_PX, IMAGE_PX), 0.8)
    shown = show_patch(torch.zeros(3, 16, 16), images, PLAIN, Draws(0, 0))
    assert shown.min() < 1e-5
    assert shown.max() == pytest.approx(0.8)


def test_parts_act_in_order_each_with_its_own_draws():
    seen = []

    class Note(Transform):
        name: str

        def change(self, pixels, rng):
            seen.append((self.name, tuple(pixels.shape), rng.integers(1 << 30)))
            return pixels

    appearance = Appearance(PLAIN.placement, on_print=(Note(name="print"),), on_photo=(Note(name="photo"),))
    images = torch.rand(2, 3, IMAGE_PX, IMAGE_PX)
    shown = show_patch(draw_first_pixels(16, 0), images, appearance, Draws(0, 0))
    assert [entry[:2] for entry in seen] == [("print", (3, 16, 16)), ("photo", (2, 3, IMAGE_PX, IMAGE_PX))]
    assert torch.equal(shown, show_patch(draw_first_pixels(16, 0), images, PLAIN, Draws(0, 0)))


def test_the_last_label_can_be_a_target():
    """Index of the last output: `full` of class indices must not run past it."""
    classifier = wrap(torch.nn.Sequential(torch.nn.Flatten(), torch.nn.Linear(3 * IMAGE_PX**2, len(LABELS))))
    images = torch.rand(2, 3, IMAGE_PX, IMAGE_PX)
    gradient, loss, _ = patch_gradient(draw_first_pixels(16, 0), images, [Target(classifier, 3)], PLAIN, Draws(0, 0))
    assert np.isfinite(loss)
    assert gradient.shape == (3, 16, 16)


def test_smoothing_is_a_gaussian_that_fades_over_the_steps():
    from scipy.ndimage import gaussian_filter

    gradient = torch.from_numpy(np.random.default_rng(0).standard_normal((3, 40, 40))).float()
    wanted = np.stack([gaussian_filter(channel, 2.0, mode="mirror", radius=7) for channel in gradient.numpy()])
    np.testing.assert_allclose(smooth_gradient(gradient, 2.0).numpy(), wanted, atol=1e-5)
    assert smooth_gradient(gradient, 0.2) is gradient
    task = WatchedPatch(photos(), [Target(tiny_classifier(), 3)], PLAIN, tiny_config(10, smoothing_px=2.0))
    noise = torch.from_numpy(np.random.default_rng(1).standard_normal((3, 16, 16))).float()
    for step, sigma_px in ((0, 2.0), (5, 1.0), (9, 0.2)):
        task.pixels.grad = noise.clone()
        task.adjust_gradients(step)
        assert torch.equal(task.pixels.grad, smooth_gradient(noise, sigma_px))


def test_the_first_patch_has_the_contrast_asked_for():
    full, faint = draw_first_pixels(64, 3), draw_first_pixels(64, 3, 0.2)
    assert (full.min(), full.max()) == (pytest.approx(0, abs=1e-3), pytest.approx(1, abs=1e-3))
    assert (faint.min(), faint.max()) == (pytest.approx(0.4, abs=1e-3), pytest.approx(0.6, abs=1e-3))
