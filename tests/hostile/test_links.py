"""Workspaces with links: whatever folder or file a command writes may be one, and nothing changes where it leads."""

import os
import shutil
from pathlib import Path

import pytest
from hostile_checks import count
from hostile_space import EVAL, put_result
from slow_cases import mark_slow
from test_commands import IMPORT

WRITERS = {
    "plan": ("plan", "--object", "crate", "--preview"),
    "shot list": ("plan", "--shot-list", "--object", "crate"),
    "print": ("print", "--class", "crate"),
    "board": ("print", "--board"),
    "add": ("add", "crate.obj", "--class", "crate", "--name", "new"),
    "import": IMPORT,
    "check": ("check",),
    "corrupt": ("corrupt", "photos", "print/out", "--corrupt", "contrast:1"),
    "capture-sim": ("capture-sim", "--object", "crate", "--variant", "unpatched"),
    "eval": EVAL,
    "export": ("export", "old", "--to", "csv"),
    "compare": ("compare", "old", "old"),
    "export meshes": ("objects", "--export", "print/meshes"),
    "challenge init": ("challenge", "init", "eval/entry", "--division", "open", "--object", "crate"),
    "place": ("place", "--object", "crate", "--write"),
}


def look(space: Path) -> dict[str, tuple[int, int]]:
    files = (path for path in space.rglob("*") if not path.is_dir())
    return {path.relative_to(space).as_posix(): (path.lstat().st_size, path.lstat().st_mtime_ns) for path in files}


def make_space(sandbox, evaluated) -> Path:
    space = sandbox.renew()
    shutil.copy(space / "rig/objects/crate.obj", space / "crate.obj")
    put_result(space, evaluated)
    return space


@pytest.fixture
def written(sandbox, evaluated):
    """Run a command in a plain workspace: the files that it writes, and their folders."""

    def run(words: tuple[str, ...]) -> list[str]:
        space = make_space(sandbox, evaluated)
        before = look(space)
        assert sandbox.run(*words) in (0, 1), sandbox.err
        changed = {path for path, facts in look(space).items() if before.get(path) != facts}
        folders = {up.as_posix() for path in changed for up in Path(path).parents} - {"."}
        return sorted(folders) + sorted(changed)[:: max(1, len(changed) // 2)]

    return run


@pytest.mark.parametrize("name", mark_slow(WRITERS, "place", "export meshes"))
def test_what_is_written_may_be_a_link(sandbox, evaluated, written, name):
    outside = sandbox.root / "a" / "outside"
    places = written(WRITERS[name])
    assert places, "nothing is written: this tries nothing"
    for place in places:
        space = make_space(sandbox, evaluated)
        shutil.rmtree(outside, ignore_errors=True)
        outside.mkdir()
        (outside / "toolkit.toml").write_text("schema_version = 1\n")
        link, is_folder = space / place, "." not in Path(place).name
        if link.exists():
            os.rename(link, outside / link.name)  # noqa: PTH104
        elif is_folder:
            (outside / link.name).mkdir()
        else:
            (outside / link.name).write_bytes(b"mine")
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(outside / link.name)
        count("links")
        code = sandbox.run(*WRITERS[name])  # which looks at what lies outside
        assert code == 2 or not is_folder, f"{place}: {code}\n{sandbox.out}{sandbox.err}"
        said = ("is a link: nothing is written", "leaves its folder", "leads outside", "is there already")
        assert not is_folder or any(words in sandbox.err for words in said), f"{place}: {sandbox.err}"
    shutil.rmtree(outside)
