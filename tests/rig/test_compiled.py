"""The compiled renderer's cache: said when it is cold, silent when it is warm, never beside the code."""

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from test_frames import CAMERA, POSES, make_renderer

import toolkit
from toolkit.core.console import quietly
from toolkit.core.files import sha256_bytes
from toolkit.rig import raycast
from toolkit.rig.kernel import compiled

PACKAGE = Path(toolkit.__file__).parent


@pytest.fixture
def start(monkeypatch):
    """A function (cache) -> None: as if Python had just been started, with this cache."""

    def run(cache: Path) -> None:
        monkeypatch.setenv("TOOLKIT_CACHE", str(cache))
        monkeypatch.setattr(compiled, "_prepared", False)
        compiled.cache_folder.cache_clear()

    yield run
    monkeypatch.undo()
    compiled.cache_folder.cache_clear()


def test_a_cold_cache_is_compiled_and_said_once(start, tmp_path, capsys):
    done = []
    for _ in range(2):  # two starts
        start(tmp_path)
        for _ in range(3):  # three renderers
            compiled.prepare(lambda: done.append(compiled.is_compiled()))
    assert done == [False] and compiled.is_compiled()
    said = capsys.readouterr()
    assert said.out == "" and said.err.splitlines() == ["compiling the renderer for this machine: some seconds, once"]


@pytest.mark.parametrize("at", [0, -1])
def test_code_in_which_a_bit_has_flipped_is_compiled_anew(start, tmp_path, capsys, at):
    start(tmp_path)
    code = compiled.cache_folder() / "kernel_1" / "tone.nbc"
    done = []

    def compile_all() -> None:
        done.append(code.exists())
        code.parent.mkdir(exist_ok=True)
        code.write_bytes(b"machine code")

    compiled.prepare(compile_all)
    damaged = bytearray(b"machine code")
    damaged[at] ^= 1
    code.write_bytes(damaged)
    for _ in range(2):
        start(tmp_path)
        compiled.prepare(compile_all)
    assert done == [False, False] and "is not as it was written" in capsys.readouterr().err


def test_it_is_not_said_quietly(start, tmp_path, capsys):
    start(tmp_path)
    with quietly():
        compiled.prepare(lambda: None)
    assert capsys.readouterr().err == "" and compiled.is_compiled()


def test_a_start_that_was_interrupted_while_compiling_is_made_up_for(start, tmp_path):
    def interrupt() -> None:
        raise KeyboardInterrupt

    start(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        compiled.prepare(interrupt)
    assert not compiled.is_compiled()
    start(tmp_path)
    compiled.prepare(lambda: None)
    assert compiled.is_compiled()


@pytest.mark.parametrize("is_interrupted", [False, True])
def test_a_second_thread_waits_and_ends_with_the_first(start, tmp_path, is_interrupted):
    start(tmp_path)
    begun, done = threading.Event(), []

    def compile_all() -> None:
        begun.set()
        time.sleep(0.3)  # the second waits by now
        done.append("compiled")
        if is_interrupted:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(compiled.prepare, compile_all)
        assert begun.wait(60)
        second = pool.submit(compiled.prepare, compile_all)
        found = [future.exception() for future in (first, second)]
    assert done == ["compiled"] and compiled.is_compiled() is not is_interrupted
    assert [type(one) for one in found] == 2 * [KeyboardInterrupt if is_interrupted else type(None)]


@pytest.mark.parametrize("cores", [1, 2])
def test_a_second_core_compiles_half_of_it(start, tmp_path, monkeypatch, cores):
    start(tmp_path)
    asked = []
    monkeypatch.setattr(raycast, "count_cores", lambda: cores)
    monkeypatch.setattr(raycast, "run_python", lambda code, **_: asked.append(code))
    compiled.prepare(raycast._compile_all)
    assert len(asked) == cores - 1
    for code in asked:
        start(tmp_path / "other")
        exec(code)
        # sealed by the process that has all
        assert not (compiled.cache_folder() / compiled.SEAL).exists()


def test_renderers_wait_for_what_was_begun(start, tmp_path, monkeypatch):
    start(tmp_path)
    held, done = threading.Event(), []
    monkeypatch.setattr(raycast, "_compile_all", lambda: (held.set(), time.sleep(0.3), done.append("compiled")))
    raycast.begin_compiling()
    assert held.wait(60) and not done
    raycast.compile_ahead()
    assert done == ["compiled"]


def test_without_a_folder_to_write_to_each_start_compiles_and_says_so(start, tmp_path, capsys):
    (tmp_path / "file").write_text("no folder")
    for _ in range(2):
        start(tmp_path / "file")
        assert compiled.cache_folder() is None and not compiled.is_compiled()
        compiled.prepare(lambda: pytest.fail("numba compiles what is used, when it is used"))
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and said[0] == said[1] and "every start" in said[0]


@pytest.fixture
def sources(monkeypatch, tmp_path):
    """A copy of the kernel's sources, which stands for the installed ones."""
    copy = Path(shutil.copytree(Path(compiled.__file__).parent, tmp_path / "install" / "kernel"))
    monkeypatch.setattr(compiled, "__file__", str(copy / "compiled.py"))
    return copy


def test_each_version_of_the_sources_has_a_folder_of_its_own(start, sources, tmp_path):
    def folder() -> Path:
        start(tmp_path / "cache")
        found = compiled.cache_folder()
        assert found is not None and found.parent == tmp_path / "cache" and found.is_dir()
        return found

    first = folder()
    assert folder() == first
    text = (sources / "light.py").read_text()
    (sources / "light.py").write_text(text.replace("0.0425", "0.0426"))
    assert folder() != first


def test_sources_that_were_installed_again_are_compiled_again_as_numba_does(start, sources, tmp_path):
    """It goes by a file's place and time: what it would not load is not said to be compiled."""
    start(tmp_path / "cache")
    compiled.prepare(lambda: None)
    os.utime(sources / "light.py", ns=(0, 10**18))
    start(tmp_path / "cache")
    assert not compiled.is_compiled()


def test_folders_of_versions_that_nobody_uses_are_cleared_away(start, sources, tmp_path):
    now = (sources / "compiled.py").stat().st_mtime
    for name, days in (("kernel-old", 31), ("kernel-other", 2), ("kernel-thesis", 400), ("pictures", 400)):
        (tmp_path / "cache" / name).mkdir(parents=True)
        for file in ("complete", "kernel" if name == "kernel-thesis" else compiled.MARK):
            (tmp_path / "cache" / name / file).touch()
            os.utime(tmp_path / "cache" / name / file, (now - 86400 * days,) * 2)
    start(tmp_path / "cache")
    compiled.prepare(lambda: None)
    left = sorted(path.name for path in (tmp_path / "cache").iterdir())
    assert left == sorted([compiled.cache_folder().name, "kernel-other", "kernel-thesis", "pictures"])


def plant(folder: Path, how: str) -> None:
    """Make a folder, or what lies in it, one that somebody else could have filled."""
    (folder / "sub").mkdir(exist_ok=True)
    (folder / "sub" / "tone.nbi").write_bytes(b"a pickle")
    if how == "owner":
        os.chown(folder, 12345, -1)
    elif how == "file's owner":
        os.chown(folder / "sub" / "tone.nbi", 12345, -1)
    elif how == "mode":
        folder.chmod(0o777)
    elif how == "file's mode":
        folder.chmod(0o755)
        (folder / "sub" / "tone.nbi").chmod(0o646)
    elif how == "parent's mode":
        folder.parent.chmod(0o777)
    elif how == "link":
        folder.rename(folder.with_name("elsewhere"))
        folder.symlink_to("elsewhere")
    else:
        (folder / "sub" / "more.nbi").symlink_to(__file__)


PLANTED = {
    "owner": "belongs to another user", "file's owner": "tone.nbi belongs to another user",
    "mode": "others may write to", "file's mode": "others may write to", "parent's mode": "others may write to",
    "link": "is a link", "file's link": "more.nbi is a link",
}  # fmt: skip


@pytest.mark.parametrize("how", PLANTED)
def test_a_cache_that_another_user_could_have_filled_is_not_loaded(start, tmp_path, capsys, how):
    if "owner" in how and os.geteuid() != 0:
        pytest.skip("only root may give a file away")
    start(tmp_path / "cache")
    compiled.prepare(lambda: None)
    planted = compiled.cache_folder()
    plant(planted, how)
    capsys.readouterr()
    start(tmp_path / "cache")
    compiled.prepare(lambda: None)
    said = capsys.readouterr().err
    assert PLANTED[how] in said and "set TOOLKIT_CACHE to your own folder" in said and said.count("\n") == 1
    fresh = compiled.cache_folder()
    assert not fresh.is_relative_to(tmp_path) and fresh.stat().st_mode & 0o077 == 0
    assert [path.name for path in fresh.iterdir() if path.name != "complete"] == [compiled.MARK]
    assert os.environ["TOOLKIT_CACHE"] == str(fresh.parent)  # processes that this one starts compile nothing anew
    compiled.cache_folder.cache_clear()
    assert compiled.cache_folder() == fresh and compiled.find_refusal() == ""


def test_a_cache_of_ones_own_is_used_whatever_the_umask(start, tmp_path):
    for umask in (0o002, 0o000):
        before = os.umask(umask)
        try:
            start(tmp_path / f"{umask}" / "cache")
            compiled.prepare(lambda: None)
            (compiled.cache_folder() / "kernel").mkdir()
            (compiled.cache_folder() / "kernel" / "tone.nbi").write_bytes(b"")
        finally:
            os.umask(before)
        start(tmp_path / f"{umask}" / "cache")
        assert compiled.cache_folder().is_relative_to(tmp_path) and compiled.is_compiled()
        (tmp_path / f"{umask}" / "cache").rename(tmp_path / f"{umask}" / "there")
        (tmp_path / f"{umask}" / "cache").symlink_to("there")  # as many move their cache to another disk
        start(tmp_path / f"{umask}" / "cache")
        assert compiled.cache_folder().is_relative_to(tmp_path) and compiled.is_compiled()


PROGRAM = """
import gc, json, sys
from dataclasses import replace
import numpy as np
import test_frames as frames
from numba.core.dispatcher import Dispatcher
from toolkit.core.files import sha256_bytes
from toolkit.objects.mesh import place_on_table
from toolkit.rooms.worlds.content.modelling import assemble, box
from toolkit.rig import raycast
from toolkit.rig.camera import Camera, orbit_pose
from toolkit.rig.kernel import compiled
from toolkit.rig.lighting import BakeDetail
from toolkit.rig.scene import KeyLight, Scene, Stand, Table
from toolkit.rig.shading import tone_map

def count():
    ours = [one for one in gc.get_objects() if isinstance(one, Dispatcher) and one.py_func.__module__.startswith("toolkit.")]
    kernels = [one for one in ours if not one.targetoptions.get("forceinline")]
    return {k.py_func.__name__: sum(k.stats.cache_misses.values()) for k in kernels}, {k._cache.cache_path for k in kernels}

def solid(size):
    return place_on_table(assemble(box(size, paint=(150, 150, 150)), {"paint": (0.8, 0.0)}, 32))

compiled.prepare(raycast._compile_all)
prepared = count()[0]
mesh, quick, camera = solid((100.0, 60.0, 40.0)), BakeDetail(4, 8, 0.2, 0.2), Camera.from_fov(24, 16, 40)
pose = orbit_pose(np.zeros(3), 20, 40, 250)
studio = Scene("", KeyLight(), np.ones((64, 128, 3), np.float32), 1.0, Table(np.full((8, 8, 3), 99, np.uint8), (400.0, 300.0), 0.5))
world = replace(studio, table=None, surroundings=solid((900.0, 900.0, 2.0)))
pictures = []
for scene in (studio, world):
    renderer = raycast.RaycastRenderer(mesh, scene, quick, Stand((9.0, 5.0, 2.0), 30.0))
    pictures += [tone_map(light, (1,)) for light in renderer.render_many([(camera, pose)] * 2)]
    renderer.render_linear(camera, pose, mesh.materials[0].texture)
    renderer.buffers(camera, pose)
renderer = frames.make_renderer(place_on_table(assemble(box((100.0, 60.0, 40.0), paint=(150, 150, 150)), {"paint": (0.8, 0.0)}, 128)))
raycast.count_cores = lambda: int(sys.argv[1])
views = renderer.render_many((frames.CAMERA, pose) for pose in frames.POSES[:4])
found = [sha256_bytes(picture.tobytes()) for picture in views]
found.append(renderer.render_linear(frames.CAMERA, frames.POSES[0], renderer._mesh.materials[0].texture).sha256)
after, places = count()
print(json.dumps({"prepared": prepared, "after": after, "places": sorted(map(str, places)), "mean": float(np.mean(pictures)), "found": found}))
"""  # noqa: E501


def run_program(cache: Path, threads: int = 2) -> SimpleNamespace:
    command = [sys.executable, "-c", PROGRAM, str(threads)]
    path = f"{Path(__file__).parent}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    environment = {**os.environ, "TOOLKIT_CACHE": str(cache), "PYTHONPATH": path}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return SimpleNamespace(said=done.stderr.count("compiling"), stderr=done.stderr, **json.loads(done.stdout))


@pytest.mark.slow
def test_all_is_compiled_under_the_one_notice_and_loaded_by_the_next_start_for_the_same_bytes(make_box, tmp_path):
    """Once with an empty cache and two threads, once with what the first left and eight."""
    renderer = make_renderer(make_box())
    here = [sha256_bytes(renderer.render(CAMERA, pose).tobytes()) for pose in POSES[:4]]
    here.append(renderer.render_linear(CAMERA, POSES[0], renderer._mesh.materials[0].texture).sha256)
    cold, warm = run_program(tmp_path, 2), run_program(tmp_path, 8)
    assert cold.found == warm.found == here
    assert (cold.said, warm.said) == (1, 0)
    assert cold.prepared == cold.after  # nothing waits for the first picture
    # compiled by this process or by the one that it shares the work with
    kept = {path.name.split(".")[1].split("-")[0] for path in tmp_path.rglob("*.nbi")}
    assert kept == set(cold.prepared)
    assert set(warm.after.values()) == {0}
    assert cold.mean == warm.mean
    assert all(Path(place).is_relative_to(tmp_path) for place in cold.places)
    assert not [path for path in PACKAGE.rglob("*.nb[ic]")]  # the code may lie where nothing can be written


@pytest.mark.slow
def test_it_renders_where_nothing_can_be_kept(tmp_path):
    (tmp_path / "file").write_text("no folder")
    without = run_program(tmp_path / "file")
    assert without.said == 1 and "every start" in without.stderr
    assert without.places == ["None"] and without.mean > 10
    assert not [path for path in PACKAGE.rglob("*.nb[ic]")]
