"""Settings of the attack, and the workspace that it is made on.

A plain run tries some hundreds of inputs, the same each time; `make fuzz` tries many more, others each time.
"""

import ctypes
import os

import pytest
from hypothesis import HealthCheck, settings

# One heap for all threads: at a bound on memory glibc looks for room in the heaps that threads of earlier tests left
# behind, at every allocation anew, and a test takes minutes by what ran before it.
if mallopt := getattr(ctypes.CDLL(None), "mallopt", None):
    mallopt(-8, 1)  # M_ARENA_MAX

QUIET = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None}
settings.register_profile("plain", max_examples=15, derandomize=True, **QUIET)
settings.register_profile("fuzz", max_examples=int(os.environ.get("FUZZ", "200")), print_blob=True, **QUIET)
settings.load_profile("fuzz" if "FUZZ" in os.environ else "plain")


def pytest_terminal_summary(terminalreporter):
    """How much was tried."""
    from hostile_checks import TRIED

    if TRIED:
        terminalreporter.write_line(f"{sum(TRIED.values())} bad inputs: {TRIED}")


@pytest.fixture(scope="session")
def template(make_crate_space, tmp_path_factory):
    """A workspace with a bit of everything: object, patch, plan, list, lens, board, captures, results of `corrupt`."""
    import hostile_space

    folder = tmp_path_factory.mktemp("template") / "space"
    hostile_space.furnish(make_crate_space(folder))
    return folder


@pytest.fixture(scope="session")
def sandbox(template, tmp_path_factory):
    """See `Sandbox`."""
    from hostile_checks import Sandbox

    root = tmp_path_factory.mktemp("sandbox")
    (root / "a" / "b").mkdir(parents=True)
    (root / "a" / "precious.txt").write_text("mine")
    return Sandbox(root, template)


@pytest.fixture(scope="session")
def evaluated(sandbox):
    """The files of a result, by name, for commands that read them."""
    from hostile_space import EVAL

    space = sandbox.renew()
    assert sandbox.run(*EVAL) == 0, sandbox.err
    return {file.name: file.read_bytes() for file in (space / "eval" / "run").iterdir() if file.is_file()}
