"""The commands in their groups, each loaded when it is called."""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from functools import cache, wraps
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from toolkit.core.errors import FieldError, ToolkitError, one_of, show_value
from toolkit.core.rooms import Entry, explain_missing, find_rooms, load
from toolkit.core.text import shorten

SHARED = "Every command"
DEBUG = "--debug"
"""Removed from the words before they are parsed, so that it may stand anywhere."""
UsageError: type[Exception] = typer.BadParameter.__bases__[0]
"""Error in the typed words: Click's own class, or the class of the copy of Click in newer typers."""

ABOUT = "Boost physical objects for a neural network, and prove it: train, print, plan, shoot, evaluate."
PLAIN: dict[str, Any] = {
    "rich_markup_mode": None,
    "context_settings": {"help_option_names": ["-h", "--help"], "max_content_width": 110},
}


TYPE = re.compile(r"<[\w\[\], ]+>")
METAVARS = {"str": "TEXT", "int": "N", "float": "X", "path": "PATH", "Path": "PATH"}
"""Metavar of an option's type in the help, if the option has none of its own."""
ROAD = ("train-patch", "print", "plan", "capture-sim", "eval")
"""Commands of the shortest way to a result, which `toolkit` alone lists."""
SWITCHED = {
    "--pose": "--vary-pose", "--no-pose": "--no-vary-pose", "--light": "--vary-light", "--no-light": "--no-vary-light",
}  # fmt: skip
"""Earlier switches: other commands use their names for a pose of the plan and the light of the rig."""

GROUPS: dict[str, dict[str, Entry]] = {
    "The road": {
        "train-patch": Entry("trainings:train_patch", "train a patch for an object or a class", SWITCHED),
        "train-texture": Entry(
            "trainings:train_texture",
            "train a texture for an object",
            {
                "--backgrounds": "--background-folder",
                "--keep": "--keep-material",
                "--fog": "--clouds",
                "--no-fog": "--no-clouds",
            },
        ),
        "print": Entry("print_:print_patches", "print patches or a wrap at true size, or the board"),
        "place": Entry("rig:place", "find the best place for a patch on an object"),
        "plan": Entry("rig:plan", "plan the camera poses", {"--size": "--resolution"}),
        "capture-sim": Entry("rig:capture_sim", "shoot every object at every pose"),
        "eval": Entry("evaluate:evaluate", "classify a capture folder: table, statistics, report"),
        "view": Entry("rig:view", "show plan, captures and wraps in a 3D viewer"),
        "coco": Entry("rig:write_boxes", "write the objects' boxes and masks as COCO"),
    },
    "Your photographs": {},
    "Benchmarks": {
        "corrupt": Entry(
            "evaluate:corrupt", "corrupt images as ImageNet-C does", {"--name": "--corrupt", "--size": "--image-px"}
        ),
        "train-classifier": Entry("trainings:train_classifier", "train a classifier of your own classes"),
        "head": Entry("encoders:head", "make a classifier of an encoder and a folder of images"),
        "zero-shot": Entry("encoders:zero_shot", "make a classifier of prompts, with CLIP or SigLIP"),
        "refine-network": Entry("trainings:refine_network", "refine a network so that boosters transfer"),
    },
    "Worlds": {},
    "Landing": {},
    "Challenge": {},
    "Results": {
        "runs": Entry("runs:list_runs", "list the results of every run as a table"),
        "verify": Entry("runs:verify", "compute a result again, and compare it"),
        "compare": Entry("runs:compare", "compare two runs image by image"),
        "report": Entry("runs:report", "write a page of many runs"),
        "export": Entry("runs:export", "write predictions as Parquet, objects as 3MF"),
    },
    "Set-up": {
        "init": Entry("setup:init", "make a workspace"),
        "add": Entry("setup:add", "add your own object from its mesh"),
        "demo": Entry("setup:demo", "run every step in a new workspace"),
        "objects": Entry("setup:list_objects", "list the objects, built in and your own"),
        "models": Entry("setup:list_models", "list the networks with weights on this machine"),
        "doctor": Entry("setup:doctor", "check this machine for everything that is needed"),
    },
}
"""Heading in the help -> commands of the core; `list_groups` adds the commands of the rooms."""


@cache
def list_groups() -> dict[str, dict[str, Entry]]:
    """Return all commands under their headings, each with its full place."""
    groups = {heading: _find_places("toolkit.cli", entries) for heading, entries in GROUPS.items()}
    for name, room in find_rooms().items():
        for heading, entries in room.commands.items():
            listed = [*groups.setdefault(heading, {}).items()]
            for command, entry in _find_places(f"toolkit.rooms.{name}", entries).items():
                above = next((row for row, (known, _) in enumerate(listed, 1) if known == entry.after), len(listed))
                listed.insert(above, (command, entry))
            groups[heading] = dict(listed)
    return {heading: entries for heading, entries in groups.items() if entries}


def _find_places(package: str, entries: Mapping[str, Entry]) -> dict[str, Entry]:
    return {name: entry._replace(place=f"{package}.{entry.place}") for name, entry in entries.items()}


def list_places() -> Sequence[tuple[str, Entry]]:
    """Return every command's name and entry."""
    return [(name, entry) for entries in list_groups().values() for name, entry in entries.items()]


class GroupedCommand(TyperCommand):
    """A command whose help lists its options under their headings."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return `[OPTIONS] PHOTOS...`."""
        arguments = [parameter for parameter in self.get_params(ctx) if parameter.param_type_name == "argument"]
        names = [(_name_parameter(argument), argument.required) for argument in arguments]
        return ["[OPTIONS]", *(name if is_required else f"[{name}]" for name, is_required in names)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write every parameter under its heading; the options of every command come last."""
        # headings in the order in which they are shown
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            row = parameter.get_help_record(ctx)
            if row is None:
                continue
            heading, name = getattr(parameter, "rich_help_panel", None) or "Options", TYPE.sub(_name_type, row[0])
            if parameter.param_type_name == "argument":
                heading, name = "Arguments", _name_parameter(parameter)
            elif parameter.name in ("help", "seed"):
                heading = SHARED
            sections.setdefault(heading, []).append((name, write_bounds(row[1])))
        sections[SHARED] = sections.pop(SHARED)  # comes last
        for heading, rows in sections.items():
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; the message of a `FieldError` then names flags."""
        try:
            return super().invoke(ctx)
        except FieldError as error:
            names = {
                parameter.name.replace("__", "."): _name_parameter(parameter) for parameter in self.get_params(ctx)
            }
            raise ToolkitError(error.spell(lambda path: spell_flag(path, names), show_typed)) from None


def _name_parameter(parameter: Any) -> str:
    """Return `--size-mm`, or an argument's metavar."""
    if parameter.param_type_name == "option":
        return str(parameter.opts[0])
    return str(parameter.metavar or parameter.name.upper())


def spell_flag(path: str, names: Mapping[str, str]) -> str:
    """Return the flag of a field, found by its path or its last name; its path if it has no flag."""
    if path in names:
        return names[path]
    last = path.rpartition(".")[2]
    found = {flag for known, flag in names.items() if known.rpartition(".")[2] == last}
    return found.pop() if len(found) == 1 else path


def show_typed(flag: str, value: object) -> str:
    """Return a flag with its value as it was typed: `--no-pose`, `--share 0.2 0.4`."""
    if isinstance(value, bool) and flag.startswith("--"):
        return flag if value else f"--no-{flag.removeprefix('--')}"
    return f"{flag} {show_value(value)}"


def write_bounds(text: str) -> str:
    """Return help with ranges in words: `1<=x<=5` as `1 to 5`."""
    text = re.sub(r"; x>=[01](?=\])| *\[x>=[01]\]", "", text)  # obvious bounds
    return re.sub(r"x>=(\d+)", r"at least \1", re.sub(r"(\d+)<=x<=(\d+)", r"\1 to \2", text))


def _name_type(found: re.Match[str]) -> str:
    words = [word for word in re.findall(r"\w+", found[0]) if word not in ("list", "tuple", "range")]
    return " ".join(METAVARS.get(word, word) for word in words)


class LazyCommand(TyperCommand):
    """A command whose name and summary are known before its module is loaded."""

    def __init__(self, name: str, entry: Entry, group: str) -> None:
        super().__init__(name, help=entry.about, short_help=entry.about, rich_help_panel=group, rich_markup_mode=None)
        self.entry = entry

    def load(self, is_completed: bool = False) -> Any:
        """Return the whole command; if the shell `is_completed`, with values to offer."""
        function = load(self.entry.place)
        if is_completed:
            from toolkit.cli.complete import offer_values

            offer_values(function)
        return typer.main.get_command(make_single(function, str(self.name)))

    def make_context(self, info_name: Any, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Load the command, and parse the words; earlier spellings of options are replaced first."""
        command = self.load(is_completed=bool(extra.get("resilient_parsing")))
        # an earlier spelling counts only if no option has it now
        known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
        old = {earlier: today for earlier, today in self.entry.old.items() if earlier not in known}
        parts = [word.partition("=") for word in args]
        words = [f"{old.get(name, name)}{equals}{value}" for name, equals, value in parts]
        return command.make_context(info_name, words, parent, **extra)


def explain_usage(error: Any, typed: Sequence[str]) -> ToolkitError:
    """Return a `UsageError` as a single line: the option and its value, or the nearest option."""
    line = f"{' '.join(typed)} "
    words = [word for room in find_rooms().values() for word in room.words]
    # the command that was typed, for the hint
    command = next((name for name in (*dict(list_places()), *words) if line.startswith(f"{name} ")), "")
    help_call = " ".join(filter(None, ["toolkit", command, "--help"]))
    if hasattr(error, "possibilities"):  # no such option
        known = [name for parameter in error.ctx.command.get_params(error.ctx) for name in parameter.opts]
        near = get_close_matches(error.option_name, known, n=3)
        hint = f"did you mean {' or '.join(near)}?" if near else f"see '{help_call}'"
        return ToolkitError(f"no option called '{error.option_name}': {hint}")
    # errors that name no parameter keep Click's own text
    parameter = getattr(error, "param", None)
    if parameter is None:
        message = error.format_message().rstrip(".")
        return ToolkitError(f"{message[0].lower()}{message[1:]}: see '{help_call}'")
    name = _name_parameter(parameter)
    if hasattr(error, "param_type"):
        return ToolkitError(f"{name} is missing: see '{help_call}'")
    # quote the words after the option
    at = next((typed.index(flag) + 1 for flag in parameter.opts if flag in typed), len(typed))
    given = typed[at : at + parameter.nargs]
    if any(word.lower().lstrip("+-") == "nan" for word in given):
        return ToolkitError(f"{' '.join([name, *given])}: expected a number")
    # pydantic's words, shortened
    expected = error.message.rstrip(".").partition(", unable")[0].replace("Input should be", "expected")
    for long, short in (
        ("greater than or equal to", "at least"), ("less than or equal to", "at most"),
        ("a valid integer", "a whole number"), ("a valid number", "a number"),
    ):  # fmt: skip
        expected = expected.replace(long, short)
    return ToolkitError(f"{' '.join([name, *(shorten(word, 80) for word in given)])}: {expected}")


class WordGroup(TyperGroup):
    """Commands that begin with the same word, such as `world`; the error for another word lists them."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the typed command; a `ToolkitError` if there is none."""
        if args[0] not in self.commands and not args[0].startswith("-") and not ctx.resilient_parsing:
            raise one_of("command", f"{self.name} {args[0]}", [f"{self.name} {known}" for known in self.commands])
        return super().resolve_command(ctx, args)


class RoadGroup(TyperGroup):
    """All commands, listed by group; the error for a mistyped command names the nearest.

    `commands` has every command by all its words, `words` commands of several words by the first.
    """

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.words: dict[str, WordGroup] = {}
        about = {word: words for room in find_rooms().values() for word, words in room.words.items()}
        for group, entries in list_groups().items():
            for name, entry in entries.items():
                command = LazyCommand(name, entry, group)
                self.add_command(command)
                word, _, rest = name.partition(" ")
                if rest:
                    if word not in self.words:
                        self.words[word] = WordGroup(name=word, help=about[word], no_args_is_help=True, **PLAIN)
                    self.words[word].add_command(command, rest)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """`help COMMAND` is `COMMAND --help`; without a word, print the commands of the road."""
        if not args and not ctx.resilient_parsing:
            typer.echo(describe_road(), err=True)
            ctx.exit(2)
        return super().parse_args(ctx, [*args[1:], "--help"] if args[:1] == ["help"] else args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return every first word, in the order of the groups."""
        return list(dict.fromkeys(name.partition(" ")[0] for name in self.commands))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, or the group of commands that begin with a word."""
        return self.words.get(cmd_name) or super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the typed command; a `ToolkitError` if there is none."""
        word = args[0]
        if not word.startswith("-") and self.get_command(ctx, word) is None and not ctx.resilient_parsing:
            if missing := explain_missing(word):
                raise missing
            # a part of a name, such as `train`
            if parts := [name for name in self.commands if name.startswith(word) or word in name.split("-")]:
                raise ToolkitError(f"no command called '{word}': did you mean {' or '.join(parts)}?")
            raise one_of("command", word, list(self.commands))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each group, the summaries below each other."""
        width = max(map(len, self.commands))
        for group, entries in list_groups().items():
            with formatter.section(group):
                formatter.write_dl([(f"{name:<{width}}", entry.about) for name, entry in entries.items()])


def describe_road() -> str:
    """Return what `toolkit` alone prints: the commands of the road, and where the others are."""
    known = dict(list_places())
    rows = [f"  toolkit {name:<12} {known[name].about}" for name in ROAD]
    return "\n".join([
        ABOUT, "", *rows, "",
        "Start with 'toolkit demo', which runs these steps. 'toolkit --help' lists all commands,",
        "'toolkit help COMMAND' explains a command.",
    ])  # fmt: skip


def be_quiet(context: typer.Context, wanted: bool) -> bool:
    """Suppress progress and notices until the command has ended, if wanted."""
    if wanted:
        from toolkit.core.console import quietly

        context.with_resource(quietly())
    return wanted


def be_verbose(context: typer.Context, wanted: bool) -> bool:
    """Print every setting and whole tables until the command has ended, if wanted."""
    if wanted:
        from toolkit.core.console import verbosely

        context.with_resource(verbosely())
    return wanted


Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", callback=be_quiet, rich_help_panel=SHARED, help="No progress bar.")
]


def add_quiet(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command `--quiet` if it has no such parameter of its own."""
    signature = inspect.signature(command, eval_str=True)
    if "quiet" in signature.parameters:
        return command
    quiet = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet)
    parameters = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in signature.parameters.values()]
    # before `--json`, so that the shared options stand together
    at = next((k for k, parameter in enumerate(parameters) if parameter.name == "as_json"), len(parameters))

    @wraps(command)
    def run(quiet: bool, **typed: Any) -> None:
        command(**typed)

    run.__signature__ = signature.replace(parameters=[*parameters[:at], quiet, *parameters[at:]])  # type: ignore[attr-defined]
    run.__annotations__ = {}
    return run


def make_single(function: Callable[..., None], name: str | None = None) -> typer.Typer:
    """Return the command line of a function, with the help of every command."""
    single = typer.Typer(add_completion=False, **PLAIN)  # type: ignore[arg-type]
    single.command(name, cls=GroupedCommand)(add_quiet(function))
    return single


def make_app() -> typer.Typer:
    """Return the whole command line."""
    app = typer.Typer(
        cls=RoadGroup, pretty_exceptions_enable=False, **PLAIN,  # type: ignore[arg-type]
        help=f"{ABOUT} 'toolkit help COMMAND' explains a command.",
    )  # fmt: skip

    def show_version(wanted: bool) -> None:
        if wanted:
            from toolkit import __version__

            typer.echo(f"toolkit {__version__}")
            raise typer.Exit

    @app.callback()
    def all_commands(
        version: bool = typer.Option(
            False, "--version", help="Print the version.", callback=show_version, is_eager=True
        ),
        debug: bool = typer.Option(False, DEBUG, help="Show the traceback of an error, as TOOLKIT_DEBUG=1 does."),
    ) -> None:
        pass

    return app
