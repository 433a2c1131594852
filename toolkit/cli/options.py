"""Options that several commands share, and options that are made from a config.

A command names its config, and receives it ready or as overrides of a recipe:

    @from_config(data=DataConfig, overrides=RECIPES)
    def train_patch(data: DataConfig, recipe: str, overrides: Overrides, networks: NamedNetworks) -> None: ...

A parameter of a named tuple, such as `NamedNetworks`, has an option for each of its fields.
"""

import inspect
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, Optional, TypeVar, get_args, get_origin

import typer
from pydantic.fields import FieldInfo
from typer.models import OptionInfo

from toolkit.cli.app import SHARED, be_quiet, be_verbose, spell_flag
from toolkit.core.config import Config, Flag, Range, bounds_of, flag_of, is_config, part_maker, typed_as
from toolkit.core.errors import FIELD_PATH, show_value

Overrides = dict[str, Any]
"""Path of a field -> the value that was typed; what was not typed is left out."""
Source = type[Config] | Mapping[str, Config]
Result = TypeVar("Result")
OBVIOUS = ("", "at least 0", "at least 1", "above 0")
"""Bounds that the help leaves to the errors."""

WORKSPACE = "Work in this folder; default: the nearest upwards with toolkit.toml."
Workspace = Annotated[
    Path | None, typer.Option("--workspace", metavar="FOLDER", rich_help_panel=SHARED, help=WORKSPACE)
]
JSON = "Print the result as JSON on stdout; no progress bar."
Json = Annotated[bool, typer.Option("--json", callback=be_quiet, rich_help_panel=SHARED, help=JSON)]
VERBOSE = "Also print every setting, or every table."
Verbose = Annotated[bool, typer.Option("--verbose", callback=be_verbose, rich_help_panel=SHARED, help=VERBOSE)]
SEED = "Same seed, same bytes on the same machine."
Seed = Annotated[int, typer.Option("--seed", metavar="N", rich_help_panel=SHARED, help=SEED, min=0)]
Device = Annotated[
    str, typer.Option("--device", metavar="auto|cpu|cuda", rich_help_panel=SHARED, help="Where the networks run.")
]
Patches = Annotated[
    str | None, typer.Option("--patches", metavar="NAME", help="Subfolder of print/patches; default: print/patches.")
]
BOARD = "The board in the photographs: a name in rig/boards, or a TOML file. Default: the last printed board."
Board = Annotated[str | None, typer.Option("--board", metavar="NAME", help=BOARD)]
Objects = Annotated[
    list[str] | None,
    typer.Option("--object", metavar="NAME", help="Only this object; repeat for more. Default: all."),
]
Variants = Annotated[
    list[str] | None,
    typer.Option(
        "--variant",
        metavar="NAME",
        help="unpatched, patched, wrapped, textured; controls of the patch: wrong-patch, random-patch, grey-patch, "
        "camouflage (what the sheet hides), patch-alone; of the texture: random-texture, grey-texture. Repeat for "
        "more. Default: unpatched and patched.",
    ),
]
RealSource = Annotated[str, typer.Option("--source", metavar="NAME", help="Folder below captures/.")]
TrueClass = Annotated[
    str | None,
    typer.Option("--class", metavar="NAME", help="Class that networks should predict. Default: the object's own."),
]
NETWORK = "Torchvision classifier, timm:NAME, onnx:FILE, a .pt2, hf:ORG/NAME, python:MODULE:FUNCTION, rig18, your own"
STATE_DICT = "State dict (.pth, .ckpt, .safetensors)"
Model = Annotated[str | None, typer.Option("--model", metavar="NAME", help=f"{NETWORK}. Default: resnet18.")]
WeightsFile = Annotated[
    Path | None,
    typer.Option("--weights", metavar="FILE", help=f"{STATE_DICT} of --model; FILE.json may hold its labels."),
]


class NamedNetwork(NamedTuple):
    """Arguments of `load_classifier` but for the folder, each an option."""

    model: Model = None
    weights: WeightsFile = None
    device: Device = "auto"


class NamedNetworks(NamedTuple):
    """Arguments of `load_classifiers` and `load_networks` but for the folder, each an option."""

    model: Annotated[
        list[str] | None,
        typer.Option("--model", metavar="NAME", help=f"{NETWORK}; repeat for several. Default: resnet18."),
    ] = None
    weights: Annotated[
        list[Path] | None, typer.Option("--weights", metavar="FILE", help=f"{STATE_DICT}, for each --model.")
    ] = None
    device: Device = "auto"


ClassifierFolder = Annotated[
    Path | None, typer.Option("--out", metavar="FOLDER", help="Folder for the classifier. Default: rig/classifiers.")
]
Restart = Annotated[bool, typer.Option("--restart", help="Begin again; discard an unfinished run.")]
RENDER_THREADS = "Threads that render ahead; 0: none. Default: as many as cores."
RenderThreads = Annotated[int | None, typer.Option("--workers", metavar="N", min=0, help=RENDER_THREADS)]
RENDER_PROCESSES = "Processes that render. Default: as many as cores."
RenderProcesses = Annotated[
    int | None, typer.Option("--workers", metavar="N", help=RENDER_PROCESSES, min=1, show_default=False)
]
DATA = "Folder with a folder for each class (in its train/, val/ or test/, if it has them), or cifar10:FOLDER."
Data = Annotated[str, typer.Option("--data", metavar="FOLDER", help=DATA)]
PrintProfile = Annotated[
    Path | None,
    typer.Option(
        "--print-profile",
        metavar="FILE",
        rich_help_panel="Augmentation",
        help="Your own printer, as 'toolkit print-profile' measured it, in place of --print-process.",
    ),
]
Download = Annotated[bool, typer.Option("--download", help="Fetch CIFAR-10 into the folder of cifar10:FOLDER.")]
Corrupt = Annotated[
    list[str] | None,
    typer.Option(
        "--corrupt",
        metavar="NAME[:SEVERITY]",
        help="Corruption of ImageNet-C: fog:3, noise:1-3, weather, common (15), all; without a severity all five; "
        "may be repeated.",
    ),
]


@dataclass(frozen=True)
class ConfigFlag:
    """Flag of a field of a config, or of a part of it.

    Attributes:
        path: path of the field, such as `affine.share`.
        info: declaration of the field.
        flag: mark of the field.
        is_switch: whether the flag puts a part in or takes it out.
        values: the field's value in each recipe; without recipes its default, under ``.
    """

    path: str
    info: FieldInfo
    flag: Flag
    is_switch: bool
    values: Mapping[str, object]

    @property
    def spelling(self) -> str:
        """Such as `--size-px`; the spelling that turns a switch on; a positional argument's metavar."""
        if self.flag.positional:
            return self.flag.metavar or self.path.upper()
        return (self.flag.name or f"--{self.path.rpartition('.')[2].replace('_', '-')}").partition("/")[0]

    @property
    def parameter(self) -> str:
        """Name of the parameter in the command function."""
        return self.path.replace(".", "__")

    def option(self, names: Mapping[str, str]) -> inspect.Parameter:
        """Return the parameter that typer makes an option of; an option that was not typed is None.

        Args:
            names: path of a field -> its flag, for fields that the help names as `{path}`.
        """
        kind = bool if self.is_switch else typed_as(self.info)
        spellings = self.spelling
        # a switch has two spellings, unless its flag names its own
        if kind is bool:
            spellings = self.flag.name or f"{spellings}/--no-{spellings.removeprefix('--')}"
        given: dict[str, Any] = {"help": self._help(names), "metavar": self.flag.metavar or _metavar(kind)}
        # a field without a default is optional if a recipe gives it a value
        required = self.info.is_required() and not any(value is not None for value in self.values.values())
        made = (
            typer.Argument(**given)
            if self.flag.positional
            else typer.Option(spellings, rich_help_panel=self.flag.group, show_default=False, **given)
        )
        annotation = _as_typer_takes(kind)
        # an option that was not typed must be told from one that was typed with its default
        return inspect.Parameter(
            self.parameter,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if required else None,
            annotation=Annotated[annotation if required else Optional[annotation], made],  # noqa: UP045, a value
        )

    def _help(self, names: Mapping[str, str]) -> str:
        # bounds first, then the defaults of recipes
        bounds = bounds_of(self.info)
        notes = [] if bounds in OBVIOUS else [bounds]
        # a lone switch is off by default, which goes without saying
        first, is_lone = None, typed_as(self.info) is bool and "/" not in (self.flag.name or "/")
        for number, (recipe, value) in enumerate(self.values.items()):
            shown = (
                None if value is None and not self.is_switch else show_value(bool(value) if self.is_switch else value)
            )
            if not shown or (number and shown == first) or (is_lone and not value):
                continue
            notes.append(f"{recipe or 'default'}: {shown}")
            first = shown if not number else first
        # other fields are named by their flags
        about = FIELD_PATH.sub(lambda path: spell_flag(path[1], names), self.info.description or "").rstrip()
        return f"{about}  [{'; '.join(notes)}]" if notes else about


class Only(dict[str, Config]):
    """Recipes of which a command offers some fields alone."""

    def __init__(self, recipes: Mapping[str, Config], fields: Container[str]) -> None:
        super().__init__(recipes)
        self.fields = fields


def list_flags(source: Source) -> list[ConfigFlag]:
    """Return every flag of a config class, or of its recipes, in the order of its fields."""
    if isinstance(source, Only):
        return [flag for flag in list_flags(dict(source)) if flag.path in source.fields]
    if isinstance(source, Mapping):
        return list(_walk(type(next(iter(source.values()))), dict(source), ""))
    return list(_walk(source, {"": None}, ""))


def from_config(**sources: Source) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Make options of a command from configs.

    Args:
        sources: parameter of the command function -> a config class, of which it receives an instance; or recipes by
            name, of which it receives what was typed as `Overrides`. A parameter `recipe` then becomes `--recipe`.

    Raises:
        ValueError: two fields have the same flag.
    """

    def decorate(command: Callable[..., Result]) -> Callable[..., Result]:
        flags = {parameter: list_flags(source) for parameter, source in sources.items()}
        written = list(inspect.signature(command, eval_str=True).parameters.values())
        # a named tuple stands for the options of its fields
        bundles = {
            item.name: inspect.signature(item.annotation).parameters.values()
            for item in written
            if hasattr(item.annotation, "_fields")
        }
        # a bundle's fields stand in its place, in the order of the help
        own = [item for outer in written for item in bundles.get(outer.name, [outer])]
        names = {flag.path: flag.spelling for some in flags.values() for flag in some}
        names |= _spellings([item for item in own if item.name not in sources])
        parameters = _spread(own, sources, flags, names)
        # a flag names a single field
        seen: dict[str, str] = {}
        for path, flag in names.items():
            if seen.setdefault(flag, path) != path:
                raise ValueError(f"{flag} is the flag of {seen[flag]} and of {path}")

        # what typer hands over goes back into configs and bundles
        @wraps(command)
        def run(**typed: Any) -> Result:
            for parameter, source in sources.items():
                given = {flag.path: typed.pop(flag.parameter, None) for flag in flags[parameter]}
                # what was not typed is left to the default or the recipe
                given = {path: value for path, value in given.items() if value not in (None, [], ())}
                typed[parameter] = given if isinstance(source, Mapping) else _make(source, given)
            for item in written:
                if item.name in bundles:
                    typed[item.name] = item.annotation(*(typed.pop(field.name) for field in bundles[item.name]))
            return command(**typed)

        # typer makes its options of the signature, and not of the function's own parameters
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return decorate


def _walk(config: type[Config], holders: Mapping[str, object], before: str) -> Iterator[ConfigFlag]:
    for name, info in config.model_fields.items():
        default = None if info.is_required() else info.get_default(call_default_factory=True)
        values = {
            recipe: getattr(holder, name) if holder is not None else default for recipe, holder in holders.items()
        }
        flag, is_switch = flag_of(info), part_maker(config, name) is not None
        if flag is not None:
            yield ConfigFlag(before + name, info, flag, is_switch and flag.typed is None, values)
        for part in _parts(info.annotation):
            within = {recipe: value for recipe, value in values.items() if isinstance(value, part)}
            yield from _walk(part, within, f"{before}{name}.")


def _parts(annotation: object) -> Iterator[type[Config]]:
    if is_config(annotation):
        yield annotation
    elif get_origin(annotation) is not tuple:
        for member in get_args(annotation):
            yield from _parts(member)


def _spread(
    own: list[inspect.Parameter], sources: Mapping[str, Source], flags: Mapping[str, list[ConfigFlag]],
    names: Mapping[str, str],
) -> list[inspect.Parameter]:  # fmt: skip
    """Return the parameters of the options, those of a config in its place."""
    parameters: list[inspect.Parameter] = []
    for parameter in own:
        if parameter.name in sources:
            parameters += [flag.option(names) for flag in flags[parameter.name]]
        elif parameter.name == "recipe" and parameter.annotation is str:
            recipes = next(source for source in sources.values() if isinstance(source, Mapping))
            parameters.append(_recipe_option(recipes))
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    return parameters


def _recipe_option(recipes: Mapping[str, Config]) -> inspect.Parameter:
    about = "; ".join(
        f"{name}: {text}" if (text := getattr(recipe, "about", "")) else name for name, recipe in recipes.items()
    )
    first = next(iter(recipes))
    words = f"{about}. The other options change single settings of it.  [default: {first}]"
    option = typer.Option("--recipe", metavar="NAME", help=words, show_default=False)
    return inspect.Parameter("recipe", inspect.Parameter.KEYWORD_ONLY, default=first, annotation=Annotated[str, option])


def _spellings(parameters: list[inspect.Parameter]) -> dict[str, str]:
    """Return the flags of the command's own options, which other fields' errors may name."""
    names = {}
    for parameter in parameters:
        option = next((mark for mark in get_args(parameter.annotation)[1:] if isinstance(mark, OptionInfo)), None)
        if option is not None and "__" not in parameter.name:
            given = [text for text in (option.default, *(option.param_decls or ())) if isinstance(text, str)]
            names[parameter.name] = next(iter(given), f"--{parameter.name.replace('_', '-')}").partition("/")[0]
    return names


def _make(config: type[Config], given: Overrides) -> Config:
    def of_a_part(path: str) -> bool:
        return "." in path or (isinstance(given[path], bool) and part_maker(config, path) is not None)

    parts = {path: value for path, value in given.items() if of_a_part(path)}
    made = config(**{path: value for path, value in given.items() if path not in parts})
    return made.with_overrides(parts) if parts else made


def _metavar(kind: object) -> str | None:
    if get_origin(kind) is Literal:
        return "|".join(str(choice) for choice in get_args(kind))
    items = get_args(kind)
    if get_origin(kind) is tuple and items[-1] is not Ellipsis:
        return "LOW HIGH" if kind == Range else " ".join(str(_metavar(item)) for item in items)
    if get_origin(kind) in (list, tuple):
        return _metavar(items[0])
    return {int: "N", float: "X", Path: "PATH", str: "TEXT"}.get(kind)  # type: ignore[call-overload]


def _as_typer_takes(kind: Any) -> Any:
    if get_origin(kind) is Literal:
        return str  # the config checks it
    items = get_args(kind)
    if get_origin(kind) is tuple and items[-1] is Ellipsis:
        return list[items[0]]  # type: ignore[valid-type]
    if NoneType in items:
        raise TypeError(f"{kind}: give its Flag the type that is typed")
    return kind
