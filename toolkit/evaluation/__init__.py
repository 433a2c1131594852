"""From predictions to metrics, table and report.

The settings are declared here once, for the command line and for Python; nothing heavy is loaded for them.
"""

from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, BeforeValidator, Field

from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError
from toolkit.core.text import is_folder_name

if TYPE_CHECKING:
    from toolkit.captures.read import Selection


def check_run_name(name: str) -> str:
    """The name of a run, if it can be that of a folder.

    Raises:
        FieldError: it cannot.
    """
    if not is_folder_name(name):
        raise FieldError("expected letters, digits, '.', '_' and '-', such as 'resnet18-tuesday'", {"run": name})
    return name


def read_corruptions(given: object) -> object:
    """(name, severity) of each from words such as `fog:3`, `noise:1-3` and `common`; pairs stay as they are.

    Raises:
        ToolkitError: there is no such corruption or severity.
    """
    from toolkit.corruptions.catalogue import parse_corruptions

    each = [given] if isinstance(given, str) else given
    if not isinstance(each, list | tuple):
        return given
    read = [parse_corruptions([one]) if isinstance(one, str) else (one,) for one in each]
    return tuple(dict.fromkeys(tuple(pair) for pairs in read for pair in pairs))


Corruptions = Annotated[tuple[tuple[str, int], ...], BeforeValidator(read_corruptions)]
"""(name, severity) of each."""
RunName = Annotated[str, AfterValidator(check_run_name)]


class EvalConfig(Config):
    """What of a capture folder is evaluated, and how; see `evaluate_captures`."""

    run: Annotated[RunName | None, Flag(metavar="NAME")] = Field(
        None, description="Name of the folder under eval/; default: network, weights and sources."
    )
    replace: Annotated[bool, Flag("--replace")] = Field(
        False, exclude=True, description="Overwrite another result of that name, instead of writing beside it."
    )
    trust_files: Annotated[bool, Flag("--trust-files")] = Field(
        False,
        description="Count images that are not as their manifest.jsonl says, by folder and name. The result says so.",
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
        description="Also under this corruption of ImageNet-C: fog:3, noise:1-3, weather, common (15), all; "
        "without a severity under all five; may be repeated.",
    )
    batch_size: Annotated[int | None, Field(ge=1), Flag()] = Field(
        None, description="Images read before the network is asked. Default: 128 on a GPU, 4 per thread on a CPU."
    )
    saliency: Annotated[bool | None, Flag()] = Field(
        None, description="Grad-CAM maps of the flips in the report; default: when there are at most 200."
    )

    @property
    def selection(self) -> "Selection":
        """Which part of the capture folder is meant."""
        from toolkit.captures.read import Selection

        return Selection(self.sources, self.objects, self.variants)
