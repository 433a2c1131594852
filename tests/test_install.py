"""The ways to install: what Makefile, scripts, container files and pyproject.toml say of it agree, and scripts run."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from toolkit.rig.graphics import EGL

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PYTHONS = ("3.10", "3.11", "3.12", "3.13", "3.14")


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.fixture
def make_venv(tmp_path):
    """A function (Python, **settings) that runs `scripts/make-venv` beside programs that only note their words."""
    calls = tmp_path / "calls"
    calls.touch()

    def write_program(name: str, body: str) -> Path:
        file = tmp_path / name
        file.write_text(f'#!/bin/sh\necho "{name} $*" >> {calls}\n{body}\n')
        file.chmod(0o755)
        return file

    def run(python: str = "", free_gb: int = 20, **settings: str):
        # a Python that makes an environment whose own Python does nothing
        fake = write_program("python", f'[ "$2" != venv ] || {{ mkdir -p $3/bin; cp {tmp_path}/noted $3/bin/python; }}')
        write_program("noted", "")
        write_program("uv", "")
        write_program("df", f'echo "blocks used available"; echo "/dev/disk 0 0 {free_gb}000000 0% /"')
        path = f"{tmp_path}:{os.environ['PATH']}"
        done = subprocess.run(
            [ROOT / "scripts/make-venv", python or fake, "env"], cwd=tmp_path, capture_output=True, text=True,
            check=False, env={**os.environ, "PATH": path, "UV": "", "TORCH": "", **settings},
        )  # fmt: skip
        return done, [line for line in calls.read_text().splitlines() if not re.match("df|.* (-c|--version)", line)]

    run.folder = tmp_path
    return run


def test_without_uv_pythons_own_module_makes_the_environment(make_venv):
    done, calls = make_venv()
    assert done.returncode == 0, done.stderr
    assert calls == ["python -m venv env"]


def test_uv_makes_it_where_there_is_one(make_venv):
    done, calls = make_venv(UV=str(make_venv.folder / "uv"))
    assert done.returncode == 0, done.stderr
    assert calls == [f"uv venv --quiet --seed --allow-existing --python {make_venv.folder}/python env"]


def test_a_torch_without_cuda_is_found_by_uv(make_venv):
    done, calls = make_venv(UV=str(make_venv.folder / "uv"), TORCH="cpu")
    assert done.returncode == 0, done.stderr
    assert calls[-1] == "uv pip install --quiet --python env/bin/python --torch-backend cpu torch torchvision"


def test_other_torches_are_refused(make_venv):
    done, calls = make_venv(TORCH="cuda")
    assert (done.returncode, calls) == (1, [])
    assert done.stderr == "make: TORCH is cpu or empty, not 'cuda'\n"


def test_a_disk_that_is_too_full_is_refused_before_anything_is_installed(make_venv):
    done, calls = make_venv(free_gb=5)
    assert (done.returncode, calls) == (1, [])
    assert f"need 8 GB of disk, {make_venv.folder} has 5 GB free" in done.stderr and "make TORCH=cpu" in done.stderr
    assert "GB" not in make_venv(free_gb=5, TORCH="cpu")[0].stderr
    (make_venv.folder / "env").mkdir(exist_ok=True)
    assert "GB" not in make_venv(free_gb=5)[0].stderr  # an environment that is there already only gets what is new


def test_a_python_that_does_not_fit_is_refused(make_venv):
    done, _ = make_venv("/bin/false")
    assert done.returncode == 1 and "need a Python from 3.10 to 3.14" in done.stderr
    assert "make PYTHON=" in done.stderr


def test_the_same_pythons_are_named_everywhere():
    allowed = SpecifierSet(PROJECT["requires-python"])
    assert [f"3.{minor}" for minor in range(8, 17) if f"3.{minor}.0" in allowed] == [*PYTHONS]
    assert set(re.search(r"^PYTHON \?= .*foreach v,([\d. ]+),", read("Makefile"), re.MULTILINE)[1].split()) == {
        *PYTHONS
    }
    assert re.search(r"^for version in (.*);", read("scripts/test-versions"), re.MULTILINE)[1].split() == [*PYTHONS]


@pytest.mark.parametrize("python", PYTHONS)
def test_each_python_gets_one_open3d(python):
    needs = [need for need in map(Requirement, PROJECT["dependencies"]) if need.name == "open3d"]
    (need,) = (need for need in needs if need.marker.evaluate({"python_version": python}))
    newer = python in ("3.13", "3.14")  # 0.19 has no wheels for them
    assert ("0.19.0" in need.specifier, "0.20.0" in need.specifier) == (not newer, newer)


def test_containers_and_make_install_the_libraries_that_doctor_names():
    packages = set(EGL.packages.split())
    assert set(re.search(r'^packages="(.*)"', read("scripts/system-libraries"), re.MULTILINE)[1].split()) == packages
    first = read("Dockerfile").partition("&& rm")[0].partition("recommends")[2]
    assert set(re.findall(r"[a-z][\w.-]+", first)) == packages


def test_the_image_holds_what_the_wheel_is_made_of():
    copied = {
        name for line in re.findall(r"^COPY (.*) \S+$", read("Dockerfile"), re.MULTILINE) for name in line.split()
    }
    assert copied == set(re.findall(r"^!(.*)$", read(".dockerignore"), re.MULTILINE))
    assert all((ROOT / name).exists() for name in copied)


def test_the_development_container_is_a_stage_of_the_image():
    wanted = json.loads(read(".devcontainer/devcontainer.json"))
    assert (ROOT / ".devcontainer" / wanted["build"]["dockerfile"]).resolve() == ROOT / "Dockerfile"
    assert f" AS {wanted['build']['target']}\n" in read("Dockerfile")
    assert re.search(rf"^{wanted['postCreateCommand'].split()[1]}:", read("Makefile"), re.MULTILINE)
