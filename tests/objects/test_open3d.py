"""Open3D without its notebooks and data sets: less to load, the same to use."""

import ast
from pathlib import Path

import pytest

import toolkit
from toolkit.core.child import run_python

LOAD = "from toolkit.objects.mesh import load_open3d; o3d = load_open3d(); "


def say(code: str) -> str:
    done = run_python(LOAD + code)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode().strip()


def test_what_nobody_uses_is_not_loaded():
    assert say("print([name for name in ('sklearn', 'pandas', 'dash', 'plotly') if name in sys.modules])") == "[]"


def test_what_the_kit_uses_is_there():
    scene = "scene = o3d.t.geometry.RaycastingScene(); print(o3d.__version__, load_open3d() is o3d)"
    assert say(f"import open3d; {scene}").endswith(" True")


@pytest.mark.slow
def test_what_was_left_out_can_be_imported():
    assert say("import open3d.ml; print(open3d.ml.__file__)").endswith("__init__.py")


def test_every_module_loads_it_so():
    package = Path(toolkit.__file__).parent
    found = {
        str(file.relative_to(package))
        for file in package.rglob("*.py")
        if "open3d" in (text := file.read_text(encoding="utf-8"))  # to parse all takes seconds
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import) and any(one.name.partition(".")[0] == "open3d" for one in node.names)
    }
    assert found == {"objects/mesh.py"}
