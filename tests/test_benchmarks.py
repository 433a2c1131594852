"""`make bench` runs to its end: each benchmark starts, and all that it imports comes with its extra."""

import ast
import importlib.util
import re
import sys
from functools import partial
from importlib import import_module
from importlib.metadata import packages_distributions
from inspect import isfunction, signature
from pathlib import Path
from subprocess import CompletedProcess
from types import SimpleNamespace

import forked
import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted(file.stem for file in (ROOT / "benchmarks").glob("bench_*.py"))
SMALL = {
    "ROUNDS": 1, "UNCOUNTED": 0, "MEMORY_COUNTS": (2, 4), "SECONDS": 1, "TRIANGLES": (1000,), "SIZES": ((224, 224),),
    "CUTS": 1, "OBJECTS": ("eggnog",), "SMALL": (1, 1), "LARGE": (1, 1), "IMAGES": 4, "BATCH": 4, "FRAMES": 2,
    "UNITS": 2, "PLACES": 2, "EPISODES": 2, "ALONE": 1, "LONGEST_S": 1.0, "WORLD": "grass", "WEATHERS": ("fog:3",),
    "CELLS": [("fog", 3)],
    "RECIPE": {"objects": ("warplane",), "size_px": 200, "studios": 1, "per_studio": 4, "batch": 4},
}  # fmt: skip
LOOKED_FOR = {"rotorpy", "ray"}
"""Peers that are timed only where they are installed."""
DISTRIBUTIONS = {"pyrender": "pyrender", "skimage": "scikit-image", "art": "adversarial-robustness-toolbox"}
"""Of the extra, which the tests run without."""


def list_imports(file: Path) -> set[str]:
    """Packages that a file imports, and those that the files beside it import which it imports."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {one.name.partition(".")[0] for one in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            package, _, name = (node.module or "").partition(".")
            found |= list_imports(file.with_name(f"{name}.py")) if package == "benchmarks" else {package}
    return found - set(sys.stdlib_module_names) - {"benchmarks", "toolkit"}


def read_requirements(*extras: str) -> set[str]:
    """Names of distributions, those of extras within extras too."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    dependencies = re.search(r"^dependencies = \[(.*?)^\]", text, re.M | re.S)[1]
    lists = [dependencies] + [re.search(rf"^{one} = \[(.*?)\](?:  #.*)?$", text, re.M | re.S)[1] for one in extras]
    wanted = {name for one in lists for name in re.findall(r'"([A-Za-z0-9_.-]+)', one)}
    inner = [
        name for one in lists for some in re.findall(r"toolkit-boost\[([\w,]+)\]", one) for name in some.split(",")
    ]
    return wanted | (read_requirements(*inner) if inner else set())


def test_what_a_benchmark_imports_comes_with_its_extra():
    wanted = {name.lower().replace("_", "-") for name in read_requirements("bench")}
    places = packages_distributions()
    for module in sorted({name for file in (ROOT / "benchmarks").glob("*.py") for name in list_imports(file)}):
        names = {one.lower().replace("_", "-") for one in places.get(module, [DISTRIBUTIONS.get(module, module)])}
        assert module in LOOKED_FOR or names & wanted, f"{module} is in no list of pyproject.toml"


def test_make_bench_runs_every_benchmark():
    assert sorted(import_module("benchmarks.__main__").MODULES) == MODULES


CHILD = f"""
import sys
from pathlib import Path
head, _, end = Path(sys.argv.pop(1)).read_text(encoding="utf-8").partition('if __name__ == "__main__":')
exec(head)
globals().update({{name: value for name, value in {SMALL}.items() if name in globals()}})
exec("if True:" + end)
"""
"""As `python -m benchmarks.NAME ARGUMENTS`, with small settings there too."""
SMALL_PLAN = ("plan", "--count", "2", "--resolution", "160", "120")


def run_child(command, **_):
    done = forked.run(CHILD, ROOT / f"{command[2].replace('.', '/')}.py", *command[3:])
    assert done.returncode == 0 or command[3] != "rig", done.stderr.decode()
    return CompletedProcess(command, done.returncode, done.stdout.decode(), done.stderr.decode())


def run_command(folder, *command):
    """In the place of `bench_start`'s own: with few small pictures."""
    program, words = (forked.TOOLKIT, command[3:]) if command[1] == "-m" else (command[2], ())
    each = {"demo": [("init", *words[1:]), (*SMALL_PLAN, "--workspace", *words[1:]), words], "plan": [SMALL_PLAN]}
    for one in each.get(words[0] if words else "", [words]):
        done = forked.run(program, *one, cwd=folder)
        assert done.returncode == 0, done.stderr.decode()


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_a_benchmark_starts(name, monkeypatch, forked_workers):
    for peer in list_imports(ROOT / "benchmarks" / f"{name}.py") - LOOKED_FOR:
        if importlib.util.find_spec(peer) is None and peer != "pyrender":  # which has a process of its own
            pytest.skip(f"{peer} is not installed")
    monkeypatch.chdir(ROOT)
    module = import_module(f"benchmarks.{name}")
    smaller = {setting: value for setting, value in SMALL.items() if hasattr(module, setting)}
    for function in filter(isfunction, vars(module).values()):
        if (repeats := signature(function).parameters.get("repeats")) and repeats.default is not repeats.empty:
            smaller[function.__name__] = partial(function, repeats=1)
    for setting, value in smaller.items():
        monkeypatch.setattr(module, setting, value)
    stand_ins = {
        "subprocess": SimpleNamespace(run=run_child), "run_command": run_command,
        "multiprocessing": SimpleNamespace(get_context=lambda _: forked.parent()),
    }  # fmt: skip
    for place in (module, import_module("benchmarks.peers")):
        for one, stand_in in stand_ins.items():
            if hasattr(place, one):
                monkeypatch.setattr(place, one, stand_in)
    found = module.run()
    assert found and None not in found.values()
