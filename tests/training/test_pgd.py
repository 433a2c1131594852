"""The attack: its optimum in closed form, the ball it stays in, and that it never makes a loss smaller."""

import pytest
import torch
from torch.nn.functional import cross_entropy, softplus

from toolkit.core.errors import ToolkitError
from toolkit.training.classifier_config import Attack, ClassifierConfig
from toolkit.training.classifier_task import find_worst_images

ATTACKS = [("l2", 0.5, 3), ("l2", 0.5, 20), ("linf", 8 / 255, 3), ("linf", 0.1, 10)]


def make_images(count=16, seed=0, low=0.0, high=1.0):
    return torch.rand(count, 3, 8, 8, generator=torch.Generator().manual_seed(seed)) * (high - low) + low


def make_network():
    torch.manual_seed(0)
    return torch.nn.Sequential(torch.nn.Conv2d(3, 8, 3), torch.nn.Tanh(), torch.nn.Flatten(), torch.nn.Linear(288, 5))


@pytest.mark.parametrize(("norm", "eps", "steps"), ATTACKS)
def test_of_a_linear_network_it_finds_the_optimum(norm, eps, steps):
    """A loss that rises along w is largest at eps * w / |w| (l2) or eps * sign(w) (linf), where no value is clipped."""
    images = make_images(low=0.4, high=0.6)
    weight = torch.randn(3, 8, 8, generator=torch.Generator().manual_seed(1))
    attack = Attack(norm=norm, eps=eps, steps=steps)
    found = find_worst_images(images, lambda x: softplus((x * weight).sum((1, 2, 3))), attack)
    direction = weight / weight.norm() if norm == "l2" else weight.sign()
    assert torch.allclose(found - images, (eps * direction).expand_as(images), atol=1e-5)


@pytest.mark.parametrize(("norm", "eps", "steps"), ATTACKS)
def test_it_stays_in_the_ball_and_in_the_image(norm, eps, steps):
    images, network = make_images(), make_network()
    images[0], images[1] = 0, 1
    classes, attack = torch.arange(16) % 5, Attack(norm=norm, eps=eps, steps=steps)
    found = find_worst_images(images, lambda x: 30 * cross_entropy(network(x), classes, reduction="none"), attack)
    away = (found - images).flatten(1)
    assert found.min() >= 0 and found.max() <= 1 and not found.requires_grad
    assert (away.norm(dim=1) if norm == "l2" else away.abs().amax(1)).max() <= eps * (1 + 1e-5)
    assert (away != 0).any(1).all()


def test_projection_is_the_nearest_place():
    """Against the definition: of many places in the ball none is nearer."""
    images, far = make_images(1, low=0.4, high=0.6), make_images(1, seed=2, low=0.3, high=0.7)
    generator = torch.Generator().manual_seed(3)
    for attack in (Attack(norm="l2", eps=0.3), Attack(norm="linf", eps=0.02)):
        near = attack.project(far, images)
        moves = torch.randn(2000, 3, 8, 8, generator=generator) * 0.02
        places = attack.project(near + moves, images.expand_as(moves))
        assert ((places - far).flatten(1).norm(dim=1) >= (near - far).norm() - 1e-6).all()
        assert torch.allclose(attack.project(near, images), near, atol=1e-6)


@pytest.mark.parametrize(("norm", "eps", "steps"), ATTACKS)
def test_no_loss_falls_below_the_clean_one(norm, eps, steps):
    """Even where a step is much longer than the loss is smooth: the image itself is among the places."""
    images, network, classes = make_images(), make_network(), torch.arange(16) % 5

    def measure(x):
        return cross_entropy(network(x), classes, reduction="none") + torch.sin(40 * x).mean((1, 2, 3))

    found = find_worst_images(images, measure, Attack(norm=norm, eps=eps, steps=steps))
    assert (measure(found) >= measure(images)).all() and (measure(found) > measure(images)).any()


def test_more_steps_find_worse_images_and_a_larger_ball_too():
    images, network, classes = make_images(), make_network(), torch.arange(16) % 5

    def mean_loss(**attack):
        found = find_worst_images(
            images, lambda x: cross_entropy(network(x), classes, reduction="none"), Attack(norm="l2", **attack)
        )
        return cross_entropy(network(found), classes).item()

    assert mean_loss(eps=1.0, steps=20) >= mean_loss(eps=1.0, steps=1)
    assert mean_loss(eps=1.0) > mean_loss(eps=0.5) > mean_loss(eps=1e-6)


def test_an_image_is_moved_by_itself():
    images, network = make_images(), make_network()
    attack, whole = Attack(norm="l2", eps=0.5), torch.arange(16) % 5

    def find(part, classes):
        return find_worst_images(part, lambda x: cross_entropy(network(x), classes, reduction="none"), attack)

    assert torch.allclose(find(images, whole)[8:], find(images[8:], whole[8:]), atol=1e-6)


def test_a_flat_loss_moves_nothing():
    images = make_images()
    assert torch.equal(find_worst_images(images, lambda x: 0 * x.sum((1, 2, 3)), Attack(norm="l2", eps=1)), images)


@pytest.mark.parametrize(
    ("words", "norm", "eps"),
    [("l2:0.5", "l2", 0.5), ("linf:8/255", "linf", 8 / 255), ("linf:0.03", "linf", 0.03), ("l2:64/128", "l2", 0.5)],
)
def test_words(words, norm, eps):
    attack = ClassifierConfig(name="net", robust=words).robust
    assert (attack.norm, attack.eps, attack.steps) == (norm, eps, 3)
    assert attack.step_size == pytest.approx(eps * 2 / 3), "as of robust-models-transfer"
    record = ClassifierConfig(name="net", robust=words).record()["robust"]
    assert record == {"norm": norm, "eps": eps, "steps": 3, "step_size": attack.step_size}
    assert "robust" not in ClassifierConfig(name="net").record()


@pytest.mark.parametrize(
    "words", ["l2", "l2:", "l2:x", "l2:-1", "l2:0", "l2:nan", "l2:inf", "l1:1", "linf:8", "linf:1/0"]
)
def test_words_that_are_none(words):
    with pytest.raises(ToolkitError, match=f"robust {words}: expected l2:EPS or linf:EPS .* such as l2:0.5"):
        ClassifierConfig(name="net", robust=words)


def test_settings_that_cannot_be():
    with pytest.raises(ToolkitError, match=r"eps 8.*at most 1"):
        Attack(norm="linf", eps=8)
    with pytest.raises(ToolkitError, match=r"steps 0: expected at least 1"):
        ClassifierConfig(name="net", robust="l2:0.5").with_overrides({"robust.steps": 0})
    with pytest.raises(ToolkitError, match="together with robust"):
        ClassifierConfig(name="net").with_overrides({"robust.steps": 7})
