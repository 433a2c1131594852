"""An object whose spec holds its class alone: enough for photographs, and refused clearly where a mesh is needed."""

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.core.workspace import make_workspace
from toolkit.evaluation.evaluate import evaluate_captures
from toolkit.objects.load import load_object
from toolkit.objects.spec import names_with_mesh, read_spec
from toolkit.rig.plan import open_plan


@pytest.fixture
def space(workspace):
    space = make_workspace(workspace.root)
    (space.objects_dir / "robin.toml").write_text('class = "racer"\n')
    return space


def test_photographs_are_judged_by_it(space, put, colour_classifier):
    """Red is the class that the spec names; of an object by that name alone nothing would be known."""
    for variant, says in (("unpatched", "warplane"), ("patched", "racer")):
        put(f"real/robin/{variant}/1.png", says)
    result = evaluate_captures(space.captures_dir / "real", space, colour_classifier)
    found = {(row["object"], row["variant"]): row["top1"] for row in result.summary["groups"]}
    assert found["robin", "patched"] == 1 and found["robin", "unpatched"] == 0


def test_the_list_of_objects_shows_it(space, type_toolkit):
    code, out, _ = type_toolkit("objects", "--workspace", str(space.root))
    assert code == 0 and "photographs only" in out


def test_commands_that_need_the_mesh_say_so_in_one_line(space):
    with pytest.raises(ToolkitError, match=r"robin\.toml: 'robin' has no mesh.*add 'mesh' and 'length_mm'") as caught:
        load_object(space.object_spec("robin"))
    assert "\n" not in str(caught.value)


def test_all_objects_are_those_with_a_mesh_and_a_note_names_the_others(space, capsys):
    assert "robin" not in names_with_mesh(space)
    assert "robin (no mesh in the spec)" in capsys.readouterr().err
    assert "robin" not in open_plan(space).objects


def test_a_mesh_without_a_length_is_still_refused(space):
    (space.objects_dir / "robin.toml").write_text('class = "robin"\nmesh = "robin.glb"\n')
    with pytest.raises(ToolkitError, match="field 'length_mm' is missing"):
        read_spec(space.object_spec("robin"))
