"""What `import toolkit` gives: its names, what they cost, and what they say of themselves."""

import ast
import doctest
import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest
from slow_cases import mark_slow

import toolkit as tk

SOURCE = Path(tk.__file__)
STUB = SOURCE.with_suffix(".pyi")
HEAVY = ("torch", "torchvision", "open3d", "numpy", "scipy", "pydantic", "PIL", "cv2", "trimesh", "rich", "typer")


NAMES = sorted(set(tk.__all__) - {"__version__"})


def read_words(name: str) -> str:
    """The docstring of a name, and what the fields of a config say of themselves."""
    thing = getattr(tk, name)
    fields = getattr(thing, "model_fields", {}).values()
    return " ".join([inspect.getdoc(thing) or "", *(str(one.description or "") for one in fields)])


def run(*command: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(SOURCE.parents[1])}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_import_loads_nothing_heavy():
    loaded = run(sys.executable, "-c", f"import toolkit, sys; print([m for m in {HEAVY} if m in sys.modules])")
    assert loaded.strip() == "[]"


def test_a_light_name_loads_nothing_heavy():
    heavy = ("torch", "open3d", "cv2")
    code = f"import toolkit as tk, sys; tk.Workspace, tk.load_object; print([m for m in {heavy} if m in sys.modules])"
    assert run(sys.executable, "-c", code).strip() == "[]"


def test_type_checkers_see_a_stub_of_imports_alone():
    """The stub is what `__init__.py` reads line by line, so it holds whole imports and nothing that it would miss."""
    head, *body = ast.parse(STUB.read_text()).body
    assert isinstance(head, ast.Expr)
    assert ast.unparse(body[0]) == "__version__: str"
    assert {one.names[0].name: one.module for one in body[1:]} == tk._HOMES
    assert all(len(one.names) == 1 and one.names[0].asname == one.names[0].name for one in body[1:])


def test_a_star_import_gives_the_names_and_no_others():
    space: dict[str, object] = {}
    exec("from toolkit import *", space)
    assert set(space) - {"__builtins__"} == set(tk.__all__) <= set(dir(tk))
    assert 20 <= len(NAMES) <= 50


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_what_its_home_calls_so_and_explains_itself(name):
    thing = getattr(tk, name)
    assert thing.__name__ == name and thing.__module__ == tk._HOMES[name]
    assert inspect.getdoc(thing) and len(read_words(name)) > 60
    if inspect.isfunction(thing):
        signature = inspect.signature(thing)
        unsaid = [one for one in signature.parameters.values() if one.annotation is inspect.Parameter.empty]
        assert not unsaid and signature.return_annotation is not inspect.Signature.empty


ARRAYS = {
    "apply_patch": "(b, 3, h, w) float",
    "corrupt": "(b, 3, h, w) float",
    "render": "(n, h, w, 3) uint8 sRGB",
    "mount_patch": "(n, n, 3) uint8 sRGB",
    "train_patch": "(n, n, 3) uint8 sRGB",
    "train_texture": "(n, n, 3) uint8 sRGB",
    "train_wrap": "(n, n, 3) uint8 sRGB",
    "load_captures": "(3, s, s) float32",
    "Camera": "pixels",
    "Pattern": "degrees",
    "plan_objects": "millimetres",
    "print_patch": "millimetres",
}


@pytest.mark.parametrize(("name", "words"), ARRAYS.items())
def test_shapes_and_units_are_said(name, words):
    assert words in read_words(name)


SHOWN = [name for name in NAMES if ">>>" in (inspect.getdoc(getattr(tk, name)) or "")]


@pytest.mark.parametrize("name", mark_slow(SHOWN, "plan_wrap"))
def test_an_example_gives_what_it_says(name, tmp_path, monkeypatch, few_views):
    import trimesh

    monkeypatch.chdir(tmp_path)
    space = {"tk": tk, "Path": Path, "trimesh": trimesh}
    for example in doctest.DocTestFinder(recurse=False).find(getattr(tk, name), name, globs=space):
        assert doctest.DocTestRunner().run(example).failed == 0


@pytest.mark.parametrize("name", [name for name in NAMES if inspect.isfunction(getattr(tk, name))])
def test_functions_that_can_refuse_say_when(name):
    function = getattr(tk, name)
    if "raise " in inspect.getsource(function) or name.startswith(("load_", "read_", "train_", "shoot_", "evaluate_")):
        assert "Raises:" in inspect.getdoc(function)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'toolkit' has no attribute 'no_such_thing'"):
        tk.no_such_thing  # noqa: B018
    assert not hasattr(tk, "torch")


def test_the_version_is_the_packages(tmp_path):
    from importlib.metadata import version

    assert tk.__version__ == version("toolkit-boost")
    # and where the sources were never installed: patches trained there once said that they were of 0.0.0
    (tmp_path / "toolkit").symlink_to(SOURCE.parent)
    alone = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import toolkit; print(toolkit.__version__)"
    assert run(sys.executable, "-I", "-S", "-c", alone).strip() == tk.__version__


def test_the_package_says_that_it_is_typed():
    tomllib = pytest.importorskip("tomllib", reason="Python 3.11 brought it")

    assert SOURCE.with_name("py.typed").is_file()
    settings = tomllib.loads((SOURCE.parents[1] / "pyproject.toml").read_text())["tool"]
    assert "py.typed" in settings["setuptools"]["package-data"]["toolkit"]
    # the examples are type-checked against the list, so that a wrong type there is an error of `make lint`
    assert "examples" in settings["mypy"]["files"]
