"""The settings of a classifier's training."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from pydantic import AfterValidator, BeforeValidator, Field, computed_field, model_validator

from toolkit.core.config import Config, Expect, Flag, Later
from toolkit.core.errors import FieldError, one_of
from toolkit.core.lazy import np, torch
from toolkit.core.text import is_folder_name
from toolkit.imaging.preprocessing import Preprocessing, published_preprocessing
from toolkit.models.architectures import build_network, list_architectures, published_weights

if TYPE_CHECKING:
    from toolkit.training.loop import FitConfig


@dataclass(frozen=True)
class Augmentation:
    """Ranges, lowest and highest, and shares; each image draws its own.

    Attributes:
        crop: side of the square that is cut out, as a share of the stored image's.
        stretch: of the crop's width against its height, 1 ± this.
        shift: how far the crop may leave the image, as a share of its side; what is missing is mirrored in.
        brightness, contrast, saturation: factors.
        tint: factor of each colour channel, 1 ± this.
        blur_share, blur_sigma: how many are blurred, and by how much, as a share of the image's side.
        noise_sigma: of Gaussian noise, on values in [0, 1].
    """

    crop: tuple[float, float] = (0.55, 1.0)
    stretch: float = 0.12
    shift: float = 0.04
    brightness: tuple[float, float] = (0.6, 1.4)
    contrast: tuple[float, float] = (0.7, 1.3)
    saturation: tuple[float, float] = (0.6, 1.4)
    tint: float = 0.12
    blur_share: float = 0.25
    blur_sigma: tuple[float, float] = (0.002, 0.014)
    noise_sigma: tuple[float, float] = (0.0, 0.04)


PHOTOGRAPHS = Augmentation()
SMALL_IMAGES = Augmentation(
    crop=(0.8, 1.0), stretch=0.0, shift=0.1, brightness=(0.8, 1.2), contrast=(0.8, 1.2), saturation=(0.8, 1.2),
    tint=0.05, blur_share=0.0, noise_sigma=(0.0, 0.02),
)  # fmt: skip
"""For images of a few dozen pixels, in which every pixel counts."""


class Corrupting(Config):
    """What is done to which share; each image draws a corruption from the list, which are (name, severity)."""

    corruptions: Annotated[tuple[tuple[str, int], ...], Field(min_length=1)]
    share: Annotated[
        float, Field(gt=0, le=1), Expect("a share above 0 and at most 1, such as 0.5"), Flag("--corrupt-share")
    ] = Field(0.5, description="Share of the training images that are corrupted.")


LARGEST = {"l2": 1000.0, "linf": 1.0}
"""Radius of the ball by its norm: black and white of 577 px are so far apart, and the ends of a value."""
ATTACK_STEPS = 3
REACH = 2.0
"""All steps together, in radii: they get from the middle to any place of the ball, and along its border."""
TINY = 1e-10


class Attack(Config):
    """How far an image may be moved, in values from 0 to 1, and in how many steps the worst place is looked for.

    Step sizes are those of robust-models-transfer (Salman et al. 2020, "Do adversarially robust ImageNet models
    transfer better?"), whose networks met 3 steps of 2/3 of the radius. As in MadryLab's robustness library a step goes
    along the gradient scaled to length 1 (l2) or its sign (linf).
    """

    norm: Literal["l2", "linf"]
    eps: Annotated[float, Field(gt=0)]
    steps: Annotated[int, Field(ge=1), Flag("--attack-steps", group="Steps")] = Field(
        ATTACK_STEPS, description="Steps of gradient ascent on each image, for {robust}; each is 2/N of the radius."
    )

    @model_validator(mode="after")
    def _check_eps(self) -> "Attack":
        if self.eps > (most := LARGEST[self.norm]):
            raise FieldError(f"expected at most {most:g}, in values of 0 to 1", {"eps": self.eps})
        return self

    @computed_field  # type: ignore[prop-decorator]
    @property
    def step_size(self) -> float:
        """Length of a step, in the norm."""
        return REACH * self.eps / self.steps

    def describe(self) -> str:
        """Such as `l2 0.5, 3 steps`."""
        return f"{self.norm} {self.eps:.4g}, {self.steps} step{'s' if self.steps > 1 else ''}"

    def climb(self, images: "torch.Tensor", gradient: "torch.Tensor") -> "torch.Tensor":
        """Images (b, 3, h, w), each moved a step up its gradient."""
        if self.norm == "linf":
            return images + self.step_size * gradient.sign()
        # TINY: where the gradient is 0 the image stays
        return images + self.step_size * gradient / (_length(gradient) + TINY)

    def project(self, moved: "torch.Tensor", images: "torch.Tensor") -> "torch.Tensor":
        """The place nearest to each of `moved` in the ball around its image; then values are clipped to 0 to 1."""
        away = moved - images
        if self.norm == "linf":
            away = away.clamp(-self.eps, self.eps)
        else:
            # inside the ball the clamp makes the factor 1
            away = away * (self.eps / _length(away).clamp(min=self.eps))
        return (images + away).clamp(0, 1)


def read_attack(given: object) -> object:
    """An `Attack` from words such as `l2:0.5` or `linf:8/255`; anything else as it is.

    Raises:
        ValueError: the words are none.
    """
    if not isinstance(given, str):
        return given
    # words such as l2:0.5, with a fraction for steps of 255
    norm, _, eps = given.partition(":")
    above, _, below = eps.partition("/")
    try:
        radius = float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        radius = -1.0
    if norm not in LARGEST or not 0 < radius <= LARGEST[norm]:
        raise ValueError("expected l2:EPS or linf:EPS in values of 0 to 1, such as l2:0.5 or linf:8/255")
    return Attack(norm=norm, eps=radius)


def _length(batch: "torch.Tensor") -> "torch.Tensor":
    """(b, 3, h, w) to the l2 norm of each, (b, 1, 1, 1)."""
    return batch.flatten(1).norm(dim=1).view(-1, 1, 1, 1)


Overlay = Callable[["torch.Tensor", "np.ndarray", Sequence[int]], "torch.Tensor"]
"""(images (b, 3, m, m) float32 sRGB-encoded in [0, 1], classes (b,), a seed for each) -> images with their pictures."""


class ClassPictures(Protocol):
    """Pictures of classes, before it is known which classes there are."""

    @property
    def record(self) -> dict[str, Any]:
        """All that decides what is laid on, for the classifier's record and the hash of its inputs."""

    @property
    def words(self) -> str:
        """What an image carries, in a few words, after `each with`."""

    def fit(self, labels: Sequence[str], used: Sequence[int], image_px: int) -> Overlay:
        """For a network of these labels whose data has the classes `used`.

        Raises:
            ToolkitError: a class has no picture, or they do not fit into the image.
        """


METHOD = "cross-entropy, SGD with Nesterov momentum, one cycle of the learning rate"
SMALL_PX = 96
"""Networks that see less are shown whole images; larger networks the middle 7/8 of the shorter side, as usual."""
LEAST_PX, MOST_PX = 16, 1024
STORED_SHARE = 1.375
"""Side of the stored images against what the network sees: crops of them are enlarged little."""
DATA, STEPS = "Images", "Steps"


def check_name(name: str) -> str:
    """A file's name, and no network's."""
    if not is_folder_name(name) or name.endswith(".safetensors"):
        expected = "expected letters, digits, '.', '-' and '_', no folder and no suffix"
        raise FieldError(f"{{name}} '{name}': {expected}", {})
    if name in list_architectures():
        raise FieldError("there is a network of that name ({arch}): choose another", {"name": name})
    return name


def check_arch(arch: str) -> str:
    """A network that there is."""
    if arch not in (known := list_architectures()):
        raise one_of("network (arch)", arch, known)
    return arch


def read_words(given: object) -> object:
    """Corruptions from words such as `fog:3`; anything else as it is."""
    if isinstance(given, list | tuple) and all(isinstance(word, str) for word in given):
        from toolkit.corruptions.catalogue import parse_corruptions

        return Corrupting(corruptions=parse_corruptions(given))
    return given


class ClassifierConfig(Config):
    """Every setting of a classifier's training."""

    name: Annotated[str, AfterValidator(check_name), Flag(metavar="NAME")] = Field(
        exclude=True, description="File name of the classifier, for --model NAME afterwards."
    )
    data: Annotated[tuple[str, ...], Flag(metavar="FOLDER|everyday|rig", group=DATA)] = Field(
        (), exclude=True,
        description="everyday: renders of procedural objects; rig: renders of the workspace's objects; cifar10:FOLDER; "
        "or a folder with one folder per class, in train/ and val/ or test/ where there are such. May be repeated.",
    )  # fmt: skip
    arch: Annotated[str, AfterValidator(check_arch), Flag(metavar="NAME")] = Field(
        "resnet18", exclude=True,
        description="Any torchvision classification network; cifar_resnet18, cifar_resnet50 or cifar_resnet8 for small "
        "images.",
    )  # fmt: skip
    init: Annotated[Path | None, Flag(metavar="FILE")] = Field(
        None, exclude=True, description="Weights to start from: .pth, .ckpt or .safetensors of --arch."
    )
    image_px: Annotated[int, Field(ge=LEAST_PX, le=MOST_PX), Flag()] = Field(
        128, description="Side of what the network sees; 32 for CIFAR."
    )
    per_class: Annotated[int, Field(ge=1), Flag(group=DATA)] = Field(
        480, description="Renders of each class, or of each object of the rig."
    )
    views: Annotated[int, Field(ge=1), Flag(group=DATA)] = Field(
        12, description="Renders of each object in its studio."
    )
    held_out: Annotated[
        float, Field(ge=0, lt=1), Expect("a share from 0 to below 1, such as 0.1"), Flag(group=DATA)
    ] = Field(0.1, description="Share of the images to test with; a val/ or test/ wins.")
    epochs: Annotated[int, Field(ge=1), Flag(group=STEPS)] = Field(24, description="Passes over the images.")
    batch: Annotated[int, Field(ge=2), Expect("at least 2, batch normalisation needs company"), Flag(group=STEPS)] = (
        Field(64, description="Images per step.")
    )
    lr: Annotated[
        float, Field(gt=0, le=10), Expect("a number above 0 and at most 10, such as 0.1"), Flag(group=STEPS)
    ] = Field(0.1, description="Highest learning rate; 0.001 suits --init.")
    warm_up: Annotated[float, Field(ge=0, le=1)] = Field(0.2, description="Share of the steps in which it rises.")
    momentum: Annotated[float, Field(ge=0, lt=1)] = Field(0.9, description="Nesterov's.")
    weight_decay: Annotated[float, Field(ge=0, lt=1), Expect("0 to below 1, such as 0.0005"), Flag(group=STEPS)] = (
        Field(5e-4, description="Weight decay; biases and normalisation have none.")
    )
    label_smoothing: Annotated[float, Field(ge=0, lt=1), Expect("0 to below 1"), Flag(group=STEPS)] = Field(
        0.1, description="Share of each target spread over all classes."
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Seed of every random draw.")
    augmentation: Augmentation = Field(PHOTOGRAPHS, description="Of the images; by default as their size asks for.")
    corrupting: Annotated[
        Corrupting | None,
        BeforeValidator(read_words),
        Later,
        Flag("--corrupt", metavar="NAME[:SEVERITY]", group=DATA, typed=tuple[str, ...]),
    ] = Field(
        None,
        description="Corrupt some training images: NAME, a family, common or all, with :SEVERITY or :FIRST-LAST. "
        "Several may be given.",
    )
    robust: Annotated[
        Attack | None, BeforeValidator(read_attack), Later, Flag(metavar="l2:EPS|linf:EPS", group=STEPS, typed=str)
    ] = Field(
        None,
        description="Train on the worst images in a ball around each, as far as EPS in values of 0 to 1: l2:0.5, "
        "linf:8/255. Training takes three to four times as long.",
    )
    keep_labels: Annotated[bool, Later, Flag("--keep-labels")] = Field(
        False, description="Keep all classes of --init; the folders are called by WordNet id or label."
    )

    @model_validator(mode="before")
    @classmethod
    def _choose_augmentation(cls, values: Any) -> Any:
        if isinstance(values, dict) and "augmentation" not in values:
            side = values.get("image_px", 128)
            small = isinstance(side, int) and side < SMALL_PX
            return {**values, "augmentation": SMALL_IMAGES if small else PHOTOGRAPHS}
        return values

    @model_validator(mode="after")
    def _check_labels(self) -> "ClassifierConfig":
        if self.keep_labels and self.init is None:
            raise FieldError("{keep_labels} keeps those of {init}: name its weights, or leave it out", {})
        return self

    @property
    def is_small(self) -> bool:
        """Whether the network sees small images, which are shown whole."""
        return self.image_px < SMALL_PX

    @property
    def stored_px(self) -> int:
        """Side of the images that are kept for training."""
        return self.image_px if self.is_small else round(self.image_px * STORED_SHARE)

    def preprocessing(self) -> Preprocessing:
        """How the trained network wants its images: the published normalisation of its architecture."""
        published = published_preprocessing(published_weights(self.arch).transforms())
        resize_px = self.image_px if self.is_small else round(self.image_px * 8 / 7)
        return Preprocessing(resize_px, self.image_px, published.mean, published.std)

    def fit_config(self, images: int) -> "FitConfig":
        """For the training loop; what does not fill a batch is left to the next epoch's order."""
        from toolkit.training.loop import FitConfig

        return FitConfig(
            steps=self.epochs * max(images // self.batch, 1), lr=self.lr, schedule="one-cycle", optimiser="sgd",
            seed=self.seed, warm_up=self.warm_up, momentum=self.momentum, nesterov=True,
            weight_decay=self.weight_decay,
        )  # fmt: skip

    def settings(self, pictures: ClassPictures | None = None) -> dict[str, Any]:
        """Every hyper-parameter, as recorded; `pictures` are on the images."""
        patches = {} if pictures is None else {"patches": json.loads(json.dumps(pictures.record))}
        return {"method": METHOD, **self.record(), **patches}


def check_fit(arch: str, classes: int, image_px: int) -> None:
    """Pass shapes, without numbers, through the network as it is trained.

    Raises:
        ToolkitError: images of this size are too small, or not of the size that the network takes.
    """
    try:
        # on the device "meta" a network has shapes and no numbers
        with torch.device("meta"):
            build_network(arch, classes).train()(torch.zeros(2, 3, image_px, image_px))
    except (RuntimeError, ValueError, AssertionError) as error:
        usual = published_weights(arch).transforms().crop_size[0]
        reason = " ".join(str(error).split())[:160]
        raise FieldError(
            f"{{arch}} {arch} cannot be trained with {{image_px}} {image_px} ({reason}): try {{image_px}} {usual}, "
            "its usual size, or another network",
            {},
        ) from None
