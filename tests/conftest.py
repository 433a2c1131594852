"""What tests share: the data beside the checkout, where there is any."""

import gc
import os
import sys
from pathlib import Path

# Test processes side by side share the cores; set before torch is loaded, and for the processes that tests start.
if (WORKERS := int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))) > 1:
    for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, str(max(1, (os.cpu_count() or 1) // WORKERS)))

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else every process that a test starts compiles the package anew

import pytest
from hypothesis import HealthCheck, settings

sys.dont_write_bytecode = False  # else each run works out the assertions of all tests anew
# a machine that is busy with something else is no fault
settings.register_profile("steady", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("steady")
SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_collection_modifyitems(items):
    """Each process begins with a share of the files that hold slow tests, and ends with short ones, which others take.

    With `--dist worksteal` a process gets a part of the list as it stands; one that is done takes from the ends.
    """
    slow = {item.path: False for item in items}
    slow |= {item.path: True for item in items if item.get_closest_marker("slow")}
    kinds = [[path for path in slow if slow[path] is is_slow] for is_slow in (True, False)]
    order = [path for share in range(WORKERS) for kind in kinds for path in kind[share::WORKERS]]
    rank = {path: at for at, path in enumerate(order)}
    items.sort(key=lambda item: rank[item.path])


def pytest_collection_finish():
    """What is imported by now is not searched for garbage again and again."""
    gc.freeze()


def pytest_unconfigure():
    """The end of Python finds it again: triton prints what is left."""
    gc.unfreeze()


@pytest.fixture
def type_toolkit(monkeypatch, capsys):
    """A function (words) -> exit code, stdout and stderr of `toolkit WORDS` in this process."""
    from toolkit.cli import main

    def run(*words) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["toolkit", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return (int(ended.value.code or 0), *capsys.readouterr())

    return run


@pytest.fixture
def one_thread():
    """For bytes that are compared with another process's: a sum depends on how it is split."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def forked_workers(monkeypatch):
    """Pools have the workers of `forked`, which begin at once; spawned ones are tested in `engine` too."""
    from forked import parent

    monkeypatch.setattr("toolkit.core.child._Context", parent)


@pytest.fixture
def few_views(monkeypatch):
    """Wraps are trained on 4 views and judged by 4, not by 96 and 72."""
    from toolkit.rooms.wraps.wrap_config import WRAP_RECIPES

    fewer = WRAP_RECIPES["default"].model_copy(update={"studios": 1, "per_studio": 4, "held_out": 1})
    monkeypatch.setitem(WRAP_RECIPES, "default", fewer)


@pytest.fixture
def forked_trials(monkeypatch):
    """ONNX graphs are tried in processes of `forked`, not anew; what ends such a process is tested in `models`."""
    from forked import run

    monkeypatch.setattr("toolkit.models.onnx_graphs.run_python", lambda code, most_s: run(code))


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of photographs and meshes for development; its tests are skipped where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("needs the development data in ../shared, which is not here")
    return SHARED


@pytest.fixture(scope="session")
def real_weights() -> Path:
    """A folder with real ImageNet weights `resnet18-*.pth`; skipped where there is none."""
    for folder in (os.environ.get("TOOLKIT_WEIGHTS"), SHARED / "weights"):
        if folder and any(Path(folder).glob("resnet18-*.pth")):
            return Path(folder)
    pytest.skip("needs real weights: set TOOLKIT_WEIGHTS to a folder with resnet18-*.pth")


@pytest.fixture(scope="session")
def make_box():
    """A function (size_mm, paint) -> a light box on the table, 12 triangles, one material."""
    from toolkit.objects.mesh import place_on_table
    from toolkit.rooms.worlds.content.modelling import assemble, box

    def make(size_mm=(100.0, 60.0, 40.0), paint=(150, 150, 150), roughness=0.8):
        return place_on_table(assemble(box(size_mm, paint=paint), {"paint": (roughness, 0.0)}, 128))

    return make


@pytest.fixture(scope="session")
def make_crate_space(make_box):
    """A function (folder) -> a workspace with one light object `crate`, its patch, and a plan of two small images."""
    import numpy as np

    from toolkit.core.workspace import make_workspace
    from toolkit.objects.load import load_object
    from toolkit.objects.records import write_patch
    from toolkit.rig import Pattern
    from toolkit.rig.camera import Camera
    from toolkit.rig.plan import make_plan, write_plan

    def make(folder):
        space = make_workspace(folder)
        mesh = make_box()
        lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
        (space.objects_dir / "crate.obj").write_text("\n".join(lines) + "\n")
        (space.objects_dir / "crate.toml").write_text(
            'name = "crate"\nclass = "crate"\nmesh = "crate.obj"\nlength_mm = 100\n[patch]\nsize_mm = 40\n'
        )
        pixels = np.random.default_rng(5).integers(0, 256, (12, 12, 3), dtype=np.uint8)
        write_patch(space.patches_dir, pixels, make_patch_record("crate"))
        item = load_object(space.object_spec("crate"))
        pattern = Pattern(name="ring", count=2, elevation_deg=(40, 40))
        write_plan(space.plan_file, make_plan([item], Camera.from_fov(96, 72), pattern))
        return space

    return make


def make_patch_record(name: str) -> dict:
    return {
        "name": name, "class_name": name, "class_index": 1, "networks": [], "data": {}, "seed": 0, "settings": {},
        "final": {}, "toolkit_version": "0",
    }  # fmt: skip


@pytest.fixture
def patch_record():
    """A function (name) -> the fields that `write_patch` asks for."""
    return make_patch_record


@pytest.fixture
def space(tmp_path, make_crate_space, monkeypatch):
    """In a workspace with the light object `crate` and without the package's own objects, which are heavy."""
    made = make_crate_space(tmp_path / "space")
    monkeypatch.setattr("toolkit.core.workspace.PACKAGE_DATA", tmp_path / "none")
    monkeypatch.chdir(made.root)
    return made
