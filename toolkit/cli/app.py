"""The commands in their groups, each loaded when it is called."""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from toolkit.core.errors import one_of

SHARED = "Every command"

PLAIN = {
    "rich_markup_mode": None,
    "context_settings": {"help_option_names": ["-h", "--help"], "max_content_width": 110},
}


class Entry(NamedTuple):
    """A command in the list: `module:function` below `toolkit.cli`, and what it does in a few words."""

    place: str
    about: str


GROUPS: dict[str, dict[str, Entry]] = {
    "The road": {
        "train-patch": Entry("train_patch:train_patch", "train a patch for a class"),
        "train-texture": Entry("train_texture:train_texture", "train a texture for an object"),
        "print": Entry("print_:print_patches", "print patches at true size, or the board"),
        "plan": Entry("plan:plan", "plan the camera poses"),
        "capture-sim": Entry("capture_sim:capture_sim", "shoot every object at every pose"),
        "eval": Entry("eval_:evaluate", "classify a capture folder: table, statistics, report"),
        "sweep": Entry("sweep:sweep", "vary one thing: distance, light, size and more"),
    },
    "Your photographs": {
        "studio": Entry("studio:studio", "shoot by phone, the next shot shown as a ghost"),
        "import": Entry("import_:import_", "import photographs, tell object and pose"),
        "check": Entry("check:check", "judge photographs: sharp, well exposed, whole"),
        "calibrate": Entry("calibrate:calibrate", "measure a camera's lens"),
        "print-profile": Entry("print_profile:print_profile", "measure what a printer does to colours"),
    },
    "Benchmarks": {
        "corrupt": Entry("corrupt:corrupt", "corrupt images as ImageNet-C does"),
        "train-classifier": Entry("train_classifier:train_classifier", "train a classifier of your own classes"),
        "train-patches": Entry("train_patches:train_patches", "train a patch for each of many classes"),
        "baseline": Entry("baseline:baseline", "make codes and other baselines"),
        "corrupt-eval": Entry("corrupt_eval:corrupt_eval", "corrupt a data set with and without patches"),
    },
    "Set-up": {
        "init": Entry("init:init", "make a workspace"),
        "demo": Entry("demo:demo", "walk the whole road in a new workspace"),
        "objects": Entry("objects:list_objects", "list the objects that can be photographed"),
        "doctor": Entry("health:doctor", "check what the kit needs from this machine"),
    },
}


class GroupedCommand(TyperCommand):
    """A command whose help lists its options under the headings that they name."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write every parameter under its heading; what every command has comes last."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            row = parameter.get_help_record(ctx)
            if row is not None:
                heading = (
                    SHARED if parameter.name == "help" else getattr(parameter, "rich_help_panel", None) or "Options"
                )
                sections.setdefault(heading, []).append(row)
        sections[SHARED] = sections.pop(SHARED)  # comes last
        for heading, rows in sections.items():
            with formatter.section(heading):
                formatter.write_dl(rows)


class LazyCommand(TyperCommand):
    """A command of which only name and summary are known until it is called."""

    def __init__(self, name: str, entry: Entry, group: str) -> None:
        super().__init__(name, help=entry.about, short_help=entry.about, rich_help_panel=group, rich_markup_mode=None)
        self.entry = entry

    def make_context(self, info_name: Any, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Load the command, and go on with it."""
        module, _, function = self.entry.place.partition(":")
        command = getattr(import_module(f"toolkit.cli.{module}"), function)
        single = typer.main.get_command(make_single(command, str(self.name)))
        return single.make_context(info_name, args, parent, **extra)


class RoadGroup(TyperGroup):
    """All commands, listed by group; a mistyped one is answered in one line that names the nearest."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        for group, entries in GROUPS.items():
            for name, entry in entries.items():
                self.add_command(LazyCommand(name, entry, group))

    def list_commands(self, ctx: Any) -> list[str]:
        """In the order of the groups."""
        return list(self.commands)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that was typed.

        Raises:
            ToolkitError: there is none of this name.
        """
        if args and args[0] not in self.commands and not args[0].startswith("-") and not ctx.resilient_parsing:
            raise one_of("command", args[0], list(self.commands))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """One section for each group, the summaries below each other."""
        width = max(map(len, self.commands))
        for group, entries in GROUPS.items():
            with formatter.section(group):
                formatter.write_dl([(f"{name:<{width}}", entry.about) for name, entry in entries.items()])


def make_single(function: Callable[..., None], name: str | None = None) -> typer.Typer:
    """The command line of one function, with the help that every command has."""
    single = typer.Typer(add_completion=False, **PLAIN)  # type: ignore[arg-type]
    single.command(name, cls=GroupedCommand)(function)
    return single


def make_app() -> typer.Typer:
    """The whole command line."""
    app = typer.Typer(
        cls=RoadGroup, no_args_is_help=True, pretty_exceptions_enable=False, **PLAIN,  # type: ignore[arg-type]
        help="Boost physical objects for a neural network, and prove it: train, print, plan, shoot, evaluate.",
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
    ) -> None:
        pass

    return app


def list_places() -> Sequence[tuple[str, Entry]]:
    """Every command's name and entry."""
    return [(name, entry) for entries in GROUPS.values() for name, entry in entries.items()]
