"""The list of commands: groups, places, and what a mistyped command is told."""

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from toolkit import __version__
from toolkit.cli import app
from toolkit.cli.app import GROUPS, list_places
from toolkit.core.errors import ToolkitError
from toolkit.core.rooms import load
from toolkit.core.workspace import make_workspace


def test_the_help_lists_every_command_once_under_its_group():
    text = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "80"}).output
    assert [text.index(f"\n{group}:\n") for group in GROUPS] == sorted(text.index(f"\n{group}:\n") for group in GROUPS)
    for name, entry in list_places():
        assert text.count(f"\n  {name} ") == 1
        assert entry.about in text, "no summary is cut off at 80 columns"


@pytest.mark.parametrize(("name", "entry"), list_places())
def test_every_entry_names_a_function_with_a_docstring(name, entry):
    assert load(entry.place).__doc__, name


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("name", [name for name, _ in list_places()])
def test_a_commands_help_reads_well(name, columns):
    text = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": str(columns)}, prog_name="toolkit").output
    assert text.startswith(f"Usage: toolkit {name} [OPTIONS]") and "\nEvery command:\n" in text
    assert max(map(len, text.splitlines())) <= columns
    lines = [line for line in text.splitlines() if line.startswith("  -")]
    assert lines and not any(mark in line for line in lines for mark in ("<", "…", "..."))
    assert "x>=" not in text and "<=x" not in text


def test_an_earlier_spelling_works_where_it_is_no_options_name():
    shown = CliRunner().invoke(app, ["plan", "--help"]).output
    assert "--resolution" in shown and "--size" not in shown
    for name, entry in list_places():
        parameters = typer.main.get_command(app).commands[name].load().params
        known = {opt for one in parameters for opt in (*one.opts, *one.secondary_opts)}
        assert {today for earlier, today in entry.old.items() if earlier not in known} <= known, name


def test_a_mistyped_command_is_answered_by_the_nearest():
    outcome = CliRunner().invoke(app, ["trian-patch"])
    assert isinstance(outcome.exception, ToolkitError)
    assert str(outcome.exception) == "no command called 'trian-patch': did you mean train-patch or train-patches?"


def test_toolkit_alone_prints_the_commands_of_the_road_and_where_the_others_are():
    outcome = CliRunner().invoke(app, [])
    assert outcome.exit_code == 2 and len(outcome.output.splitlines()) <= 12
    words = [line.split()[1] for line in outcome.output.splitlines() if line.startswith("  toolkit ")]
    assert words == ["train-patch", "print", "plan", "capture-sim", "eval"]
    assert "'toolkit --help'" in outcome.output and "'toolkit demo'" in outcome.output


@pytest.mark.parametrize(("name", "entry"), list_places())
def test_a_commands_help_begins_with_its_verb(name, entry):
    first, verb = load(entry.place).__doc__.split()[0], entry.about.split()[0]
    assert first[0].isupper() and not first.endswith(("s", "ing", "ed")) and verb == verb.lower(), (name, first)


def test_the_version_is_printed():
    assert CliRunner().invoke(app, ["--version"]).output == f"toolkit {__version__}\n"


@pytest.mark.parametrize(("typed", "offered"), [("toolkit cap", "capture-sim"), ("toolkit plan --ob", "--object")])
def test_the_shell_completes_commands_and_options(typed, offered):
    asked = {"_TOOLKIT_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    assert offered in CliRunner().invoke(app, [], env=asked, prog_name="toolkit").output


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("toolkit world", "preview"), ("toolkit plan --object", "racer"), ("toolkit plan --pattern", "fibonacci"),
        ("toolkit world preview", "harbour"), ("toolkit print --patches", "rig18"), ("toolkit compare", "mine"),
        ("toolkit eval --model", "rig18"), ("toolkit capture-sim --variant", "grey-patch"),
        ("toolkit baseline", "apriltag"),
    ],
)  # fmt: skip
def test_the_shell_completes_values(tmp_path, monkeypatch, typed, offered):
    space = make_workspace(tmp_path)
    (space.eval_dir / "mine").mkdir()
    (space.eval_dir / "mine" / "summary.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    asked = {"_TOOLKIT_COMPLETE": "complete_bash", "COMP_WORDS": f"{typed} ", "COMP_CWORD": str(len(typed.split()))}
    assert offered in CliRunner().invoke(app, [], env=asked, prog_name="toolkit").output.split()


def ask(*words: str) -> str:
    outcome = CliRunner().invoke(app, words, prog_name="toolkit")
    assert outcome.exit_code == 0, outcome.exception
    return outcome.output


@pytest.mark.parametrize("word", ["world", "landing"])
def test_commands_that_begin_with_one_word_are_a_group(word):
    said = ask(word, "--help")
    assert said == ask("help", word) and said.startswith(f"Usage: toolkit {word} [OPTIONS] COMMAND")
    for name, entry in list_places():
        first, _, rest = name.partition(" ")
        assert first != word or (f"\n  {rest} " in said and entry.about in said)


def test_help_is_a_command():
    assert ask("help") == ask("--help")
    assert ask("help", "plan") == ask("plan", "--help") and ask("help", "world", "list") == ask("world", "list", "-h")
    assert str(CliRunner().invoke(app, ["help", "plam"]).exception).startswith("no command called 'plam': did you mean")


def test_every_command_can_be_quiet_and_give_json_but_for_those_that_the_docs_name():
    without = {"--quiet": set(), "--json": {"studio", "view", "demo", "landing demo"}}
    page = (Path(__file__).parents[2] / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    for option, known in without.items():
        found = set()
        for name, _ in list_places():
            parameters = typer.main.get_command(app).commands[name].load().params
            if option not in {flag for one in parameters for flag in one.opts}:
                found.add(name)
        assert found == known
        said = [line for line in page.split("\n") if f"no `{option}`" in line]
        assert bool(said) == bool(known) and all(f"`{name}`" in "".join(said) for name in known)


@pytest.mark.parametrize(
    "words", [("plan",), ("add", "mug.glb", "--class", "cup"), ("world", "preview", "grass"),
              ("world", "export", "grass"), ("capture-sim", "--object", "racer"), ("print", "--all"),
              ("print", "--board", "--out", "pages"), ("studio",), ("import", ".")]
)  # fmt: skip
def test_what_writes_into_a_workspace_makes_no_workspace_of_any_folder(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    outcome = CliRunner().invoke(app, words)
    assert isinstance(outcome.exception, ToolkitError)
    assert str(outcome.exception) == (
        "this folder is not in a workspace: change into one, or name one with --workspace; "
        "'toolkit init FOLDER' makes one"
    )
    assert not list(tmp_path.iterdir())


RANGES = {"--fill": "one share for a plan, a range to draw from in training"}
KINDS_OF_FOLDER = {"--out": "a file or a folder, as the command makes one or many", "--data": "what a command can use"}
SETS = {
    "--patches": "a set; corrupt-eval may name its model too",
    "--format": "the same two",
    "--schedule": "of the learning rate; a landing's may also rise first",
    "--optimiser": "a landing has no signs",
    "--board": "one that is looked for; of a new page the switch that prints it",
    "--square-mm": "of a board that is found, or of one that is printed: mm, the page takes the words of a range",
    "--pieces": "at most so many; in training the two ends between which the count is chosen",
    "--roll": "of a camera, a range of turns; of paper, its width",
    "--renderer": "a world may be shot in a simulator, a table top by Filament",
}


def test_an_option_means_one_thing_in_all_commands():
    """The same spelling takes the same kind of value everywhere, and is a switch everywhere or nowhere."""
    kinds: dict[str, dict[tuple, list[str]]] = {}
    for name, _ in list_places():
        for one in typer.main.get_command(app).commands[name].load().params:
            for option in one.opts if one.param_type_name == "option" else ():
                if option.startswith("--"):
                    kinds.setdefault(option, {}).setdefault((one.metavar, one.nargs, one.is_flag), []).append(name)
    several = {option: found for option, found in kinds.items() if len(found) > 1}
    assert set(several) <= RANGES.keys() | KINDS_OF_FOLDER.keys() | SETS.keys(), several


def test_the_earlier_switches_of_a_patch_go_on_working():
    from toolkit.cli.app import LazyCommand

    (entry,) = (entry for name, entry in list_places() if name == "train-patch")
    for typed, expected in (
        (["--no-pose", "--light"], (False, True)),
        (["--no-vary-pose", "--no-light"], (False, False)),
    ):
        context = LazyCommand("train-patch", entry, "").make_context("train-patch", ["--class", "x", *typed])
        assert (context.params["pose"], context.params["light"]) == expected


def test_a_part_of_a_name_is_answered_by_all_commands_that_have_it():
    outcome = CliRunner().invoke(app, ["train"])
    assert str(outcome.exception) == (
        "no command called 'train': did you mean train-patch or train-texture or train-wrap or "
        "train-classifier or train-patches?"
    )
