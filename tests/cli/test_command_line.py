"""The command line as a whole: quick to start, and short with people who mistype."""

import subprocess
import sys

import pytest


@pytest.fixture
def run(monkeypatch, type_toolkit, tmp_path):
    """A function (arguments) -> exit code, stdout, stderr of `toolkit ...` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return type_toolkit


def in_a_process(code, *arguments, cwd=None):
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)


KINDS = "'numpy', 'PIL', 'torch', 'torchvision', 'open3d', 'matplotlib', 'cv2', 'trimesh', 'scipy', 'numba', 'rich'"
HEAVY = f"heavy = sorted({{{KINDS}}} & set(sys.modules))"


def test_the_help_of_every_command_needs_nothing_heavy():
    code = f"""
import sys
import typer
from toolkit.cli.app import list_places, make_app
commands = typer.main.get_command(make_app()).commands
for name, _ in list_places():
    command = commands[name].load()
    command.get_help(command.make_context(name, [], resilient_parsing=True))
    {HEAVY}
    if heavy:
        sys.exit(f"{{name}}: {{heavy}}")
"""
    assert in_a_process(code).stderr == ""


def test_what_is_read_before_work_begins_is_light():
    """Evaluation refuses a folder before a network is loaded; a studio is described without the renderer."""
    code = "import sys; import toolkit.evaluation.evaluate, toolkit.rig.studio; "
    done = in_a_process(f"{code}{HEAVY}; print([one for one in heavy if one not in ('numpy', 'PIL', 'rich')])")
    assert done.stdout == "[]\n", done.stdout + done.stderr


@pytest.mark.slow
def test_planning_needs_neither_torch_nor_open3d(tmp_path, make_crate_space):
    space = make_crate_space(tmp_path)
    code = f"""
import sys
from toolkit.cli import main
try:
    main()
except SystemExit as ended:
    {HEAVY}
    print("HEAVY", [name for name in heavy if name in ("torch", "torchvision", "open3d", "matplotlib")], ended.code)
"""
    done = in_a_process(code, "plan", "--object", "crate", cwd=space.root)
    assert done.stdout.strip().splitlines()[-1] in ("HEAVY [] 0", "HEAVY [] None"), done.stdout + done.stderr


def test_help_lists_the_road(run):
    code, out, _ = run("--help")
    assert code == 0
    places = [
        out.index(f"  {name} ") for name in ("demo", "init", "train-patch", "print", "plan", "capture-sim", "eval")
    ]
    assert all(place > 0 for place in places)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan", "--object", "racr"], "error: no object called 'racr': did you mean racer?"),
        (
            ["plan", "--object", "eggnog", "--pattern", "gird"],
            "error: --pattern gird: expected grid, ring, hemisphere or fibonacci; did you mean grid?",
        ),
        (
            ["plan", "--object", "eggnog", "--resolution", "8", "8"],
            "error: a resolution of 8×8 px: expected both sides between 16 and 16384 px",
        ),
        (
            ["plan", "--object", "eggnog", "--elevation", "60", "20"],
            "error: --elevation 60 20: expected two rising numbers from 0 to 90",
        ),
        (
            ["plan", "--object", "eggnog", "--distance", "-5", "20"],
            "error: --distance -5 20: expected two distances over 0 and under 1000000 mm, the nearer first",
        ),
        (["plan", "--object", "eggnog", "--count", "0"], "error: --count 0: expected 1 to 10000"),
        (["plan", "--count", "many"], "error: --count many: expected a whole number"),
        (["plan", "--fov", "200"], "error: --fov 200: expected at most 120"),
        (["plan", "--fov", "nan"], "error: --fov nan: expected a number"),
        (["plan", "--count", "9" * 400], "error: --count 99999"),
        (["eval", "captures", "--run", ""], "error: --run : expected letters, digits"),
        (["eval", "captures", "--run", "../x"], "error: --run ../x: expected letters, digits"),
        (["check", "--source", "../../x"], "error: --source '../../x': expected the name of one folder below"),
        (["plan", "--count"], "error: option '--count' requires an argument: see 'toolkit plan --help'"),
        (["plan", "--cout", "3"], "error: no option called '--cout': did you mean --count"),
        (["plan", "-z"], "error: no option called '-z': see 'toolkit plan --help'"),
        (["plan", "somewhere"], "error: got unexpected extra argument(s) (somewhere): see 'toolkit plan --help'"),
        (["calibrate"], "error: PHOTOS is missing: see 'toolkit calibrate --help'"),
        (["corrupt", "in", "out"], "error: --corrupt is missing: see 'toolkit corrupt --help'"),
        (["--verison"], "error: no option called '--verison': did you mean --version?"),
        (["plam"], "error: no command called 'plam': did you mean plan or place?"),
        (["capture-sim", "--object", "egnog"], "error: no object called 'egnog': did you mean eggnog?"),
        (["objects", "--workspace", "nowhere"], "error: nowhere is not a workspace"),
        (["doctor", "--workspace", "nowhere"], "error: nowhere is not a workspace"),
    ],
)
def test_a_users_error_is_one_line_and_exit_code_2(run, arguments, words):
    if arguments[0] in ("plan", "capture-sim"):  # which need a workspace
        run("init", ".")
    code, out, err = run(*arguments)
    assert code == 2
    assert err.startswith(words) and err.count("\n") == 1
    assert "Traceback" not in out + err


def test_eval_misses_its_images_before_it_loads_a_network(run, monkeypatch, tmp_path):
    def load(*_, **__):
        raise AssertionError("a network was loaded")

    monkeypatch.setattr("toolkit.models.load.load_classifier", load)
    code, _, err = run("eval", "captres")
    assert code == 2 and err.startswith("error: captres does not exist: expected a folder of images")
    (tmp_path / "captures").mkdir()
    code, _, err = run("eval")
    assert code == 2 and "captures holds no images: expected " in err


def test_ctrl_c_says_how_to_go_on(run, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("toolkit.cli.setup.make_workspace", stop)
    code, _, err = run("init", "here")
    assert code == 130 and "Traceback" not in err
    assert err == "stopped: finished work is kept; run the same command again to resume\n"


def test_init_makes_a_workspace_and_says_what_is_next(run, tmp_path):
    code, out, _ = run("init", "here")
    assert code == 0 and "toolkit plan" in out and "capture-sim" in out
    for folder in ("rig/objects", "print/patches", "captures", "eval"):
        assert (tmp_path / "here" / folder).is_dir()
    (tmp_path / "file").write_text("")
    code, _, err = run("init", "file")
    assert code == 2 and "is a file" in err and err.count("\n") == 1


def test_a_table_breaks_no_word_and_becomes_blocks_where_it_does_not_fit(capsys, monkeypatch):
    from toolkit.cli.output import show_table
    from toolkit.core.console import console

    monkeypatch.setattr(console, "_width", 60)
    show_table(
        ["variant", "what is said of it"], [["warplane/eggnog", "one two three four five six seven eight nine ten"]]
    )
    said = capsys.readouterr().out
    assert "warplane/eggnog" in said and all(len(line) <= 60 for line in said.splitlines())
    show_table(["run", *("abc" * 4 for _ in range(5))], [["resnet18-imagenet", *("warplane/eggnog" for _ in range(5))]])
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["run           resnet18-imagenet", *["abcabcabcabc  warplane/eggnog"] * 5, ""]


def test_a_column_gets_its_words_however_wide_its_neighbour_is(capsys, monkeypatch):
    from toolkit.cli.output import show_table
    from toolkit.core.console import console

    monkeypatch.setattr(console, "_width", 60)
    titles = ["object", "mesh", "size, mm (x × y × z)", "patch"]
    show_table(titles, [["coffeepot", "builtin:coffeepot", "144.5 × 270 × 239.8", "top"]])
    lines = capsys.readouterr().out.splitlines()
    assert {len(line) for line in lines} == {60} and all(line[-1] in "┓┃┩│┘" for line in lines)


def test_names_in_a_narrow_table_are_broken_after_a_slash():
    from rich.console import Console

    from toolkit.core import console, tables

    narrow = Console(width=40)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(console.console, "_width", 40)
        table = tables.build_table(
            "", ("run", "variant"), ("n", "correct % (95 %)"), [("landing/apriltag", "a", "4", "100")]
        )
    with narrow.capture() as shown:
        narrow.print(table)
    assert [line.split()[0] for line in shown.get().splitlines()] == ["run", "landing/", "apriltag"]


def test_no_number_is_cut_off_where_heads_are_long():
    """Of p = 0.031 at 80 columns `0.03` was left."""
    from rich.console import Console

    from toolkit.core.tables import build_table

    heads = ("n", "failed a gate", "top-1 %", "95 %", "top-5 %", "prob", "gained", "lost", "p")
    row = ("coffeepot", "unpatched", "12", "2", "75", "47–91", "92", "0.50", "6", "0", "0.031")
    narrow = Console(width=80)
    with narrow.capture() as shown:
        narrow.print(build_table("", ("object", "variant"), heads, [row]))
    assert shown.get().split()[-len(row) :] == list(row)
