"""What is known of a classifier that the kit trained: `NAME.json` beside `NAME.safetensors`."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class ClassShare(BaseModel):
    """Of one class's held-out images, how many the network gets right."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    n: int
    correct: int


class HeldOut(BaseModel):
    """What the written weights say of images that they were not trained on.

    Attributes:
        n, correct: of all classes together.
        accuracy: their ratio; None where nothing was held out.
        ci95: Wilson's 95 % interval of it.
        per_class: by label.
        confusions: the commonest mistakes, (true label, answer, how often).
        what: how these images differ from those trained on.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    n: int
    correct: int
    accuracy: float | None
    ci95: tuple[float, float]
    per_class: dict[str, ClassShare]
    confusions: list[tuple[str, str, int]]
    what: str


class ClassifierRecord(BaseModel):
    """How a classifier came to be, and how to feed and read it; a `LabelsFile` with more in it.

    Attributes:
        name: file name without suffix.
        arch: name of the network, see `list_architectures`.
        trained_on: in a few words, to be said wherever the network speaks.
        labels: one per output, in order.
        resize_px, crop_px, mean, std, filter_name: preprocessing of an image, sRGB-encoded.
        data: sources with counts, and the hashes of the pixels that were trained on and held out.
        seed: of every random draw.
        settings: every hyper-parameter.
        final: mean loss and accuracy of the last steps, on augmented training images.
        held_out: accuracy of the weights as written.
        sha256: of the weights' file.
        toolkit_version: of the program that trained it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: int = 1
    name: str
    arch: str
    trained_on: str
    labels: list[str] = Field(min_length=2)
    resize_px: int = Field(gt=0)
    crop_px: int = Field(gt=0)
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    filter_name: str
    data: dict[str, Any]
    seed: int
    settings: dict[str, Any]
    final: dict[str, float]
    held_out: HeldOut
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    toolkit_version: str
