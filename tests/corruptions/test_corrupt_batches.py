"""What every corruption keeps to: range, purity, independence of batch and order, growth with severity, no drift."""

import numpy as np
import pytest
import torch

from toolkit.core.draws import image_seed
from toolkit.core.errors import ToolkitError
from toolkit.corruptions.batch import corrupt
from toolkit.corruptions.catalogue import COMMON, CORRUPTIONS, FAMILIES, SEVERITIES, choose_parameters
from toolkit.corruptions.digital import from_bytes, to_bytes

CLOSED = {
    "defocus_blur", "zoom_blur", "gaussian_blur", "brightness", "contrast", "pixelate", "jpeg_compression", "saturate",
}  # fmt: skip
"""Corruptions without anything random."""
VEILS = ("fog", "frost")
"""What is laid over the image, of random brightness: their distance is the share of the image that is lost."""
RISES_AND_FALLS = {
    ("imagenet", "elastic_transform"): {2: "from large bends to small ripples", 3: "as many, smaller moves"},
    ("cifar", "elastic_transform"): dict.fromkeys((1, 2, 3, 4), "the affine part shrinks from 8 % to 3 %"),
    ("imagenet", "saturate"): {2: "2 drains the colour, 3 adds to it"},
    ("cifar", "saturate"): {2: "2 drains the colour, 3 adds to it"},
    ("imagenet", "glass_blur"): {1: "rounds fall from 2 to 1", 3: "rounds fall from 3 to 2"},
    ("cifar", "glass_blur"): {1: "the same moves", 2: "the same moves", 4: "the same moves"},
    ("cifar", "motion_blur"): {3: "a longer line of the same sigma"},
    ("imagenet", "frost"): {3: "from 0.7 : 0.7 to 0.65 : 0.7"},
    ("cifar", "frost"): {3: "from 0.9 : 0.4 to 0.85 : 0.4"},
    ("cifar", "spatter"): {3: "from water to mud"},
}
"""(parameters, name): the severities whose published parameters do not make the next one worse, and why."""


def draw_scene(side: int, seed: int = 0) -> torch.Tensor:
    """(3, side, side): smooth clouds, sharp coloured boxes and fine grain, with values over most of the range."""
    rng = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)) + 1 / side
    clouds = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((3, side, side))) / frequency**1.3, (side, side))
    scene = 0.45 + 0.16 * (clouds - clouds.mean()) / clouds.std()
    for _ in range(12):
        top, left = rng.integers(0, side * 3 // 4, 2)
        size = rng.integers(side // 12, side // 4)
        scene[:, top : top + size, left : left + size] = rng.uniform(0, 1, (3, 1, 1))
    return torch.from_numpy(np.clip(scene + rng.normal(0, 0.02, scene.shape), 0, 1).astype(np.float32))


@pytest.fixture(scope="module")
def scenes() -> torch.Tensor:
    return torch.stack([draw_scene(224, seed) for seed in range(4)])


@pytest.fixture(scope="module")
def small_scenes() -> torch.Tensor:
    return torch.stack([draw_scene(32, seed) for seed in range(24)])


def test_nineteen_corruptions_in_their_families():
    assert len(CORRUPTIONS) == 19 and len(COMMON) == 15
    counts = {family: sum(one.family == family for one in CORRUPTIONS.values()) for family in FAMILIES}
    assert counts == {"noise": 3, "blur": 4, "weather": 4, "digital": 4, "extra": 4}
    assert all(len(given) == 5 for one in CORRUPTIONS.values() for given in one.parameters.values())
    assert [name for name, one in CORRUPTIONS.items() if one.note] == ["frost"]


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_range_shape_and_purity(name, small_scenes):
    before = small_scenes.clone()
    for severity in SEVERITIES:
        result = corrupt(small_scenes, name, severity, range(24))
        assert result.shape == before.shape and result.dtype == torch.float32
        assert result.min() >= 0 and result.max() <= 1 and not result.isnan().any()
        assert not torch.equal(result, before)
    assert torch.equal(small_scenes, before)


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_result_depends_on_the_image_and_its_seed_alone(name, scenes):
    seeds = [11, 12, 13, 14]
    whole = corrupt(scenes, name, 3, seeds)
    backwards = corrupt(scenes.flip(0), name, 3, seeds[::-1]).flip(0)
    alone = torch.cat([corrupt(scenes[i : i + 1], name, 3, seeds[i : i + 1]) for i in range(4)])
    # matrix products and reductions may add up in another order in another batch
    assert torch.allclose(whole, backwards, atol=2e-6) and torch.allclose(whole, alone, atol=2e-6)
    other = corrupt(scenes, name, 3, [11, 12, 13, 15])
    assert torch.allclose(whole[:3], other[:3], atol=2e-6)
    assert torch.equal(whole[3], other[3]) == (name in CLOSED)


def test_threads_do_not_change_the_result(scenes):
    threads = torch.get_num_threads()
    try:
        results = []
        for count in (1, 3):
            torch.set_num_threads(count)
            names = ("gaussian_noise", "spatter", "snow")
            results.append([corrupt(scenes, name, 3, range(4)) for name in names])
            assert torch.get_num_threads() == count  # the workers keep to one thread, the caller does not
    finally:
        torch.set_num_threads(threads)
    assert all(torch.equal(one, other) for one, other in zip(*results, strict=True))


def measure_distance(clean: torch.Tensor, spoilt: torch.Tensor, is_veil: bool) -> float:
    if not is_veil:
        return (spoilt - clean).square().mean().item()
    clean, spoilt = (images - images.mean((2, 3), keepdim=True) for images in (clean, spoilt))
    shared = (clean * spoilt).sum((1, 2, 3)) ** 2
    return (1 - shared / (clean.square().sum((1, 2, 3)) * spoilt.square().sum((1, 2, 3)))).mean().item()


@pytest.mark.parametrize("parameters", ["imagenet", "cifar"])
@pytest.mark.parametrize("name", CORRUPTIONS)
def test_distance_from_the_clean_image_grows_with_severity(name, parameters, scenes, small_scenes):
    images = (scenes if parameters == "imagenet" else small_scenes).repeat(6 if name in VEILS else 1, 1, 1, 1)
    seeds = range(len(images))
    distances = [measure_distance(images, corrupt(images, name, level, seeds), name in VEILS) for level in SEVERITIES]
    assert distances[0] > 1e-5
    excused = RISES_AND_FALLS.get((parameters, name), {})
    shrinking = [level for level in (1, 2, 3, 4) if distances[level] <= distances[level - 1] and level not in excused]
    assert not shrinking, distances


def test_parameters_follow_the_size_unless_named(small_scenes):
    assert [choose_parameters(*size) for size in ((32, 32), (64, 500), (65, 65), (224, 224))] == [
        "cifar", "cifar", "imagenet", "imagenet",
    ]  # fmt: skip
    cifar = corrupt(small_scenes, "contrast", 1, range(24)).std((2, 3))
    imagenet = corrupt(small_scenes, "contrast", 1, range(24), "imagenet").std((2, 3))
    assert torch.allclose(imagenet / cifar, torch.tensor(0.4 / 0.75), atol=1e-5)


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_images_of_any_shape(name):
    wide = torch.rand(2, 3, 70, 131)
    assert corrupt(wide, name, 5, [0, 1]).shape == wide.shape
    tiny = torch.rand(1, 3, 16, 17)
    assert corrupt(tiny, name, 5, [0]).shape == tiny.shape
    for flat in (torch.zeros(1, 3, 32, 32), torch.ones(1, 3, 32, 32)):
        assert not corrupt(flat, name, 4, [0]).isnan().any()


def test_bytes_are_the_nearest_level():
    images = draw_scene(96)[None]
    pixels = to_bytes(images)
    assert pixels.dtype == np.uint8
    assert np.abs(pixels[0] / 255 - images[0].permute(1, 2, 0).numpy()).max() <= 0.5 / 255 + 1e-6
    assert np.array_equal(to_bytes(from_bytes(pixels)), pixels)


def test_seeds_are_by_address():
    seeds = {image_seed(seed, path) for seed in range(20) for path in ("a/1.jpg", "a/2.jpg", "b/1.jpg")}
    assert len(seeds) == 60 and all(0 <= seed < 2**63 for seed in seeds)
    assert image_seed(0, "a/1.jpg") == image_seed(0, "a/1.jpg")


def test_gradients_stop_here():
    images = torch.rand(1, 3, 32, 32, requires_grad=True)
    assert not corrupt(images, "brightness", 1, [0]).requires_grad


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda x: corrupt(x, "fogg", 3, [0]), ["fogg", "did you mean", "fog"]),
        (lambda x: corrupt(x, "fog", 6, [0]), ["severity 6", "1", "5"]),
        (lambda x: corrupt(x, "fog", 3, [0, 1]), ["2 seeds for 1 images"]),
        (lambda x: corrupt(x, "fog", 3, [0], "mnist"), ["mnist", "imagenet"]),
        (lambda x: corrupt(x[0], "fog", 3, [0]), ["(b, 3, h, w)", "(3, 32, 32)"]),
        (lambda x: corrupt(x.to(torch.uint8), "fog", 3, [0]), ["uint8"]),
        (lambda x: corrupt(x[..., :15], "fog", 3, [0]), ["16 px", "15×32"]),
    ],
)
def test_wrong_calls_say_what_is_wrong(call, words):
    with pytest.raises(ToolkitError) as error:
        call(torch.rand(1, 3, 32, 32))
    assert all(word in str(error.value) for word in words)


def test_empty_batch():
    assert corrupt(torch.zeros(0, 3, 32, 32), "fog", 1, []).shape == (0, 3, 32, 32)


@pytest.mark.parametrize("inference", [False, True])
def test_it_works_in_inference_mode_on_several_threads(inference):
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        images = torch.rand(4, 3, 32, 32, generator=torch.Generator().manual_seed(1))
        with torch.inference_mode(inference):
            found = corrupt(images, "fog", 3, [1, 2, 3, 4])
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(found, corrupt(images, "fog", 3, [1, 2, 3, 4]))
