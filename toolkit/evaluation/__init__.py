"""From predictions to metrics, table and report. The settings for all of it are declared here."""

from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, BeforeValidator, Field

from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError
from toolkit.core.text import is_folder_name

if TYPE_CHECKING:
    from toolkit.captures.read import Selection


def check_run_name(name: str) -> str:
    """Return the name of a run; a `FieldError` if no folder can have it."""
    if not is_folder_name(name):
        raise FieldError("expected letters, digits, '.', '_' and '-', such as 'resnet18-tuesday'", {"run": name})
    return name


def read_corruptions(given: object) -> object:
    """Return the (name, severity) pairs of words such as `fog:3`, `noise:1-3`, `common`; pairs stay as they are."""
    # brings torch, which the settings can do without
    from toolkit.corruptions.catalogue import parse_corruptions

    each = [given] if isinstance(given, str) else given
    if not isinstance(each, list | tuple):
        return given
    read = [parse_corruptions([item]) if isinstance(item, str) else (item,) for item in each]
    return tuple(dict.fromkeys(tuple(pair) for pairs in read for pair in pairs))


Corruptions = Annotated[tuple[tuple[str, int], ...], BeforeValidator(read_corruptions)]
"""(name, severity) pairs."""
RunName = Annotated[str, AfterValidator(check_run_name)]


class EvalConfig(Config):
    """Settings of `evaluate_captures`: the part of a capture folder to evaluate, and how."""

    run: Annotated[RunName | None, Flag(metavar="NAME")] = Field(
        None, description="Folder name under eval/. Default: network, weights and sources."
    )
    replace: Annotated[bool, Flag("--replace")] = Field(
        False, exclude=True, description="Overwrite another result with that name, instead of writing beside it."
    )
    trust_files: Annotated[bool, Flag("--trust-files")] = Field(
        False,
        description="Count images that contradict their manifest.jsonl, by folder and name. The report states it.",
    )
    sources: Annotated[tuple[str, ...], Flag("--source", metavar="NAME")] = Field(
        (), description="Only this source; may be repeated."
    )
    objects: Annotated[tuple[str, ...], Flag("--object", metavar="NAME")] = Field(
        (), description="Only this object; may be repeated."
    )
    variants: Annotated[tuple[str, ...], Flag("--variant", metavar="NAME")] = Field(
        (), description="Only this variant; may be repeated."
    )
    corruptions: Annotated[Corruptions, Flag("--corrupt", metavar="NAME[:SEVERITY]", typed=tuple[str, ...])] = Field(
        (),
        description="Also classify under ImageNet-C's corruption: fog:3, noise:1-3, weather, common (15), all; may be "
        "repeated. Default: all five severities.",
    )
    batch_size: Annotated[int | None, Field(ge=1), Flag()] = Field(
        None, description="Images in a batch. Default: 128 on a GPU, 4 per thread on a CPU."
    )
    saliency: Annotated[bool | None, Flag()] = Field(
        None, description="Draw Grad-CAM maps of the changed images in the report. Default: up to 200 images."
    )

    @property
    def selection(self) -> "Selection":
        """Sources, objects and variants to evaluate."""
        from toolkit.captures.read import Selection

        return Selection(self.sources, self.objects, self.variants)
