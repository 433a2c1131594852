"""Every command and code block of README and docs does what it says, as far as that can be had in a minute."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from pages import DOCS, LANGUAGES, PAGES, ROOT, list_blocks, list_commands, list_mentions, read_page

SHELL = {"cd", "export", "pip", "python", ".", "uv", "docker"}
"""What the pages call beside `toolkit` and `make`."""
Command = list[str]


def parse(words: Command, whole: bool = True) -> None:
    """Give a command to the real command line without running it.

    Args:
        words: `toolkit plan --count 12`, or a call of make.
        whole: whether all that the command needs must be there; a mention in prose may leave it out.
    """
    import typer

    from toolkit.cli import app

    program, *rest = words
    if rest[:1] == ["help"]:
        return
    if program == "make":
        targets = {name for line in read_targets() for name in line.split()}
        unknown = [one for one in rest if "=" not in one and one not in targets]
        assert not unknown, f"no such target in the Makefile: {unknown}"
    elif program == "toolkit":
        commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
        name, *arguments = [" ".join(rest[:2]), *rest[2:]] if " ".join(rest[:2]) in commands else rest
        assert name in commands, f"no such command: {name}"
        try:
            commands[name].make_context(name, arguments)
        except Exception as error:  # Click's own, or of the copy that newer typers carry
            is_partial = type(error).__name__ == "MissingParameter" and not whole
            if type(error).__name__ not in ("Exit", "NoArgsIsHelpError") and not is_partial:
                raise AssertionError(f"{' '.join(words)}: {error}") from error
    else:
        assert program in SHELL, f"what is {program}?"


def read_targets() -> list[str]:
    return re.findall(r"^([a-z][a-z -]*):(?!=)", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_known(page: str) -> None:
    for words in list_commands(read_page(page)):
        parse(words)


@pytest.mark.parametrize("page", PAGES)
def test_commands_in_the_prose_are_known(page: str) -> None:
    for words in list_mentions(read_page(page)):
        if words[1].islower() and words[1][0] != "-":  # neither COMMAND nor --help
            parse(words, whole=False)


@pytest.mark.parametrize("script", sorted((DOCS / "scripts").glob("run-*")), ids=lambda file: file.name)
def test_the_runs_behind_the_results_call_known_commands(script: Path, tmp_path: Path) -> None:
    """Each runs to its end beside programs that do nothing, so that it changes nothing, and what it calls is parsed."""
    calls = tmp_path / "calls"
    for name in ("toolkit", "python", "cp", "mv", "rm", "mkdir"):
        note = f'printf "%s\\0" "$@" >> {calls}; echo >> {calls}' if name == "toolkit" else ":"
        (tmp_path / name).write_text(f"#!/bin/sh\n{note}\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "resnet18-imagenet.pth").touch()
    settings = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "TOOLKIT_WEIGHTS": str(tmp_path)}
    given = [str(tmp_path / "toolkit"), *[str(tmp_path)] * 3]
    done = subprocess.run([script, *given], capture_output=True, env=settings, check=False, text=True)
    assert done.returncode == 0, done.stderr
    lines = calls.read_text().splitlines()
    assert len(lines) > 1
    for line in lines:
        parse(["toolkit", *line.split("\0")[:-1]])


@pytest.mark.parametrize(
    "line",
    [
        "toolkit nosuch", "toolkit print --al", "toolkit plan --count many", "toolkit eval captures/ --modl resnet18",
        "toolkit train-classifier --data rig", "toolkit plan --fov 400", "make nosuch", "tolkit plan",
    ],
)  # fmt: skip
def test_a_wrong_command_is_found(line: str) -> None:
    with pytest.raises(AssertionError):
        parse(line.split())


def test_a_wrong_mention_is_found() -> None:
    parse(["toolkit", "train-patch", "--recipe", "paper"], whole=False)
    with pytest.raises(AssertionError):
        parse(["toolkit", "train-patch", "--recepi", "paper"], whole=False)


@pytest.mark.parametrize("page", PAGES)
def test_blocks_say_their_language(page: str) -> None:
    text = read_page(page)
    assert {block.language for block in list_blocks(text)} <= set(LANGUAGES)
    assert text.count("\n```") == 2 * len(list_blocks(text)), "a block is not closed"
    outside = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    assert not re.search(r"\n\n {4,}(?![-*\d ])", outside), "an indented block: fence it"


@pytest.mark.parametrize("page", PAGES)
def test_settings_are_valid(page: str) -> None:
    """Files that a page shows are read by the models that read the user's."""
    from toolkit.models.find import NetworkSet
    from toolkit.models.labels import LabelsFile
    from toolkit.objects.spec import ObjectSpec
    from toolkit.rig.board_file import BoardSpec
    from toolkit.rooms.worlds.own import KitLayout

    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    for block in list_blocks(read_page(page), "toml"):
        content = tomllib.loads(block.body)
        if "mesh" in content:
            ObjectSpec.model_validate(content)
        elif "kind" in content:
            BoardSpec.model_validate(content).make()
        elif "rows" in content:
            KitLayout.model_validate(content)
        else:
            assert not LabelsFile.model_validate(content).model_extra
    for block in list_blocks(read_page(page), "json"):
        content = json.loads(block.body)
        if "networks" in content:
            NetworkSet.model_validate(content)
            continue
        labels = LabelsFile.model_validate(content)
        assert not labels.model_extra


# What really runs: in a workspace of one light object, two poses and small pictures, with the bundled network.
QUICK: dict[str, Command] = {
    "init": [],
    "objects": [],
    "wrap": ["--views", "8", "--texel-mm", "3"],
    "print": [],
    "plan": ["--object", "warplane", "--count", "2", "--resolution", "160", "120"],
    "capture-sim": [],
    "corrupt": [],
    "add": [],
    "eval": ["--model", "rig18", "--no-saliency"],
    "runs": [],
    "compare": [],
    "report": [],
    "export": [],
    "baseline": [],
    "sweep": ["--object", "warplane", "--model", "rig18", "--values", "1"],
    "train-patch": [
        *("--model", "rig18", "--steps", "1", "--batch", "2", "--images", "4", "--mounted-views", "10"),
    ],
    "train-wrap": ["--model", "rig18", "--steps", "1", "--batch", "2"],
    "zero-shot": [],
    "models": [],
    "head": ["--per-class", "3", "--views", "1", "--held-out", "0.4"],
    "world-eval": [
        *("--model", "rig18", "--world", "grass", "--places", "1", "--grid", "3x3x1", "--sample", "1"),
        *("--variant", "unpatched", "--variant", "patched"),
    ],
}
"""By command: what is added so that it takes seconds."""
NEEDS = (
    "--like",
    "--paper",
    "photographs",
    "textured",
    "captures/real",
    "parts",
    "PHOTOS",
    "print/profiles",
    "patches-100",
    "--board",
)
"""What a line needs that the small workspace has not, or what takes long: a board makes every picture large."""


MADE = {"four-objects": "torch", "hues": "tokenizers", "hf:tiny-vit": "transformers"}
"""Networks that the pages make or name, with the library that they need."""


def put_light_objects(folder: Path) -> None:
    """Boxes in the place of the objects that come with the kit: a workspace's own objects win."""
    import trimesh

    from toolkit.objects.load import BUILTIN

    box = trimesh.creation.box((270, 200, 90)).subdivide()
    uv = (box.vertices @ [[1, 0], [0, 1], [0.4, 0.3]]) / 400 + 0.5  # no side without an area
    box.visual = trimesh.visual.TextureVisuals(uv=uv)
    box.export(folder / "rig/objects/box.obj")
    for name in BUILTIN:
        spec = f'class = "{name}"\nmesh = "box.obj"\nlength_mm = 270\n[patch]\nsize_mm = 88\n'
        (folder / f"rig/objects/{name}.toml").write_text(spec, encoding="utf-8")


def put_networks(folder: Path, library: str) -> None:
    """A small network such as the pages name: two towers with classes and templates, or a ViT of transformers."""
    from two_towers import COLOURS, write_towers

    if library == "transformers":
        import transformers

        config = transformers.ViTConfig(
            hidden_size=16, num_hidden_layers=1, num_attention_heads=2, intermediate_size=16, image_size=32,
            patch_size=8, num_labels=4,
        )  # fmt: skip
        transformers.ViTForImageClassification(config).save_pretrained(folder / "tiny-vit")
        transformers.ViTImageProcessor(size={"height": 32, "width": 32}).save_pretrained(folder / "tiny-vit")
    if library != "tokenizers" or (folder / "image.pt2").is_file():
        return
    write_towers(folder, "pt2")
    (folder / "classes.txt").write_text("\n".join(COLOURS), encoding="utf-8")
    (folder / "templates.txt").write_text("a photo of a {}.\nthe {} thing\n", encoding="utf-8")


def is_quick(words: Command) -> bool:
    """Whether a command of a page is run."""
    if words[0] != "toolkit" or words[1] not in QUICK:
        return False
    named = [value for flag, value in pairwise(words) if flag in ("--model", "--source", "--recipe")]
    is_here = all(value in ("rig18", "sim", "sim-mine") for value in named)
    if words[1] == "train-patch" and not {"--out", "mug"} & set(words):
        return False  # some of them are enough
    if words[1] == "head":
        return "rig18" in words
    if words[1] == "zero-shot":
        return "image.pt2" in words
    if words[1] == "models":
        return words[-1] in MADE
    if words[1] == "sweep":
        return any(word.startswith("tag:") for word in words)  # the others are many pictures
    if words[1] == "print":
        return not any(one in word for word in words for one in NEEDS[2:-1])
    return (
        is_here
        and not any(one in word for word in words for one in NEEDS)
        and ("racer" not in words or words[1] in ("wrap", "train-wrap", "export"))
    )


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[Command], None]:
    """A function that runs a command in this process and fails where it does."""
    from toolkit.cli import main

    monkeypatch.setenv("OMP_NUM_THREADS", "1")

    def call(words: Command) -> None:
        extra = QUICK[words[1]]
        for option, *smaller in (("--distance", "500", "700"), ("--pieces", "1..2")):
            if words[1] in ("plan", "train-wrap") and option in words:
                extra = [*extra, option, *smaller]
        monkeypatch.setattr(sys, "argv", [*words, *extra])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code, f"{' '.join(sys.argv)}\n{capsys.readouterr().err}"

    return call


@pytest.fixture(scope="module")
def shot_space(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace in which the warplane was shot at two poses, without and with its patch."""
    from toolkit.captures.shoot import shoot_plan
    from toolkit.core.workspace import make_workspace
    from toolkit.objects.load import load_object
    from toolkit.rig import Pattern
    from toolkit.rig.camera import Camera
    from toolkit.rig.plan import make_plan, write_plan

    space = make_workspace(tmp_path_factory.mktemp("docs") / "lab")
    put_light_objects(space.root)
    item = load_object(space.object_spec("warplane"))
    plan = make_plan([item], Camera.from_fov(160, 120, 40.0), Pattern(count=2))
    write_plan(space.plan_file, plan)
    shoot_plan(space, plan, ["warplane"])
    return space.root


@pytest.fixture
def lab(shot_space: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, few_views: None) -> Path:
    """A copy of that workspace, to work in, with a mesh that is no object yet, and tables of other programs."""
    import trimesh
    from PIL import Image

    folder = Path(shutil.copytree(shot_space, tmp_path / "lab"))
    trimesh.creation.cylinder(30, 90).export(folder / "mug.glb")
    for name in ("camouflage", "livery"):
        Image.new("RGB", (12, 8), "olive").save(folder / f"{name}.png")
    for name, right in (("theirs", 0), ("ours", 1)):
        (folder / f"{name}.csv").write_text(f"image,correct,scene\none.png,{right},1\ntwo.png,1,2\n", encoding="utf-8")
    monkeypatch.chdir(folder)
    return folder


RUNNING = [page for page in PAGES if any(map(is_quick, list_commands(read_page(page))))]


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in RUNNING if page not in ("README.md", "docs/tutorial.md")])
def test_quick_commands_run(page: str, lab: Path, run: Callable[[Command], None]) -> None:
    for words in list_commands(read_page(page)):
        if any("mitsuba" in word for word in words):
            pytest.importorskip("mitsuba", reason="needs the extra mitsuba")
        needed = [library for name, library in MADE.items() if name in words]
        if is_quick(words) and needed:
            pytest.importorskip(needed[0], reason="needs the extra clip or hub")
            put_networks(lab, needed[0])
        if is_quick(words):
            run(words)


@pytest.mark.slow
def test_the_tutorial_runs_from_an_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[[Command], None]
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = []
    for words in list_commands(read_page("docs/tutorial.md")):
        if words[0] == "cd":
            monkeypatch.chdir(words[1])
            put_light_objects(Path.cwd())
        elif is_quick(words):
            run(words)
            ran.append(words[1])
    assert {"init", "plan", "capture-sim", "eval", "print"} <= set(ran)
    assert list(tmp_path.glob("lab/eval/*/report.html"))


TOUR: dict[str, Command] = {
    "plan": ["--count", "2", "--resolution", "160", "120"],
    "train-patch": ["--steps", "1", "--batch", "2", "--images", "4", "--mounted-views", "10"],
    "world": ["--resolution", "160", "90", "--film-s", "0.2"],
}
"""By command of the README's tour: what is added so that it takes seconds."""
ASK = """#!/bin/sh
{ pwd; for word; do printf '%s\\n' "$word"; done; } > "$TOUR/asked"
read -r code < "$TOUR/answered"
exit "$code"
"""
"""A `toolkit` for the shell: this process starts what it is asked for, in processes that have the kit imported."""


def stand_for_the_city() -> None:
    """For `begin`: a field in the place of the city, which takes a minute to build and to light."""
    from walled_field import make_field

    from toolkit.rooms.worlds.content import city

    city.build_city = lambda seed: replace(make_field(), name="city")


@pytest.mark.slow
def test_the_tour_can_be_pasted_into_a_new_shell(tmp_path: Path) -> None:
    """Every line of the README's tour, in order, in a shell that stops at the first error; three objects are boxes.

    The network is a ResNet-18 of random weights; the racer stays the built-in object, as its wrap fits no box.
    """
    import forked
    import torch
    import torchvision

    _, _, rest = read_page("README.md").partition("## The tour")
    (block, *_) = list_blocks(rest, "sh")
    program, asked, answered = tmp_path / ".venv/bin/toolkit", tmp_path / "asked", tmp_path / "answered"
    program.parent.mkdir(parents=True)
    program.write_text(ASK, encoding="utf-8")
    program.chmod(0o755)
    torch.save(torchvision.models.resnet18().state_dict(), tmp_path / "resnet18-imagenet.pth")
    settings = {"TOOLKIT_WEIGHTS": str(tmp_path), "TOUR": str(tmp_path)}
    for pipe in (asked, answered):
        os.mkfifo(pipe)
    said = ""
    words = ["bash", "-euc", f"trap toolkit EXIT\n{block.body}"]  # at its end it asks for nothing
    with subprocess.Popen(words, cwd=tmp_path, env=os.environ | settings) as shell:
        while command := (lines := asked.read_text(encoding="utf-8").splitlines())[1:]:
            more = TOUR.get(command[0], [])
            where = {"cwd": Path(lines[0]), "environment": settings, "begin": stand_for_the_city}
            done = forked.run(forked.TOOLKIT, *command, *more, **where)
            said += f"{command}\n{done.stderr.decode()[-2000:]}\n"
            if command[0] == "init":
                put_light_objects(tmp_path / "lab")
                (tmp_path / "lab/rig/objects/racer.toml").unlink()
            answered.write_text(f"{done.returncode}\n", encoding="utf-8")
        answered.write_text("0\n", encoding="utf-8")
    assert shell.returncode == 0, said
    made = (
        "eval/index.html",
        "eval/mine/report.html",
        "print/warplane.pdf",
        "print/racer-wrap.pdf",
        "print/shot_list.pdf",
        "rig/worlds/city/flythrough.mp4",
    )
    assert [file for file in made if not (tmp_path / "lab" / file).is_file()] == []


def test_a_command_that_is_refused_is_found(lab: Path, run: Callable[[Command], None]) -> None:
    with pytest.raises(AssertionError, match="in a call of its own"):
        run(["toolkit", "print", "--all", "--board"])


SMALLER = {
    "count=18": "count=2",
    "640, 480": "160, 120",
    "steps=20": "steps=1, batch=2",
    "pieces=6": "pieces=2, views=8, texel_mm=3.0",
}
"""In Python blocks, what is put in the place of settings that take minutes."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if list_blocks(read_page(page), "python") and page != "README.md"]
)
def test_python_runs(page: str, lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That of the README is run from the wheel, by tests/test_wheel.py."""
    monkeypatch.chdir(lab.parent)  # what a block calls `lab` is there already
    scope: dict[str, object] = {"__name__": "__main__"}
    for block in list_blocks(read_page(page), "python"):
        body = block.body
        for setting, smaller in SMALLER.items():
            body = body.replace(setting, smaller)
        exec(compile(body, page, "exec"), scope)


def test_reports_and_pages_are_where_the_docs_say(lab: Path, run: Callable[[Command], None]) -> None:
    run(["toolkit", "eval", "captures/"])
    assert {file.name for file in (lab / "eval/rig18-sim").iterdir()} >= {
        "report.html",
        "predictions.csv",
        "summary.json",
    }
    heads = (lab / "eval/rig18-sim/predictions.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    page = (DOCS / "reference/files.md").read_text(encoding="utf-8")
    shown = page.split("### `eval/RUN/predictions.csv`")[1].split(".\n")[0]
    assert re.findall(r"`(\w+)`", shown) == heads
