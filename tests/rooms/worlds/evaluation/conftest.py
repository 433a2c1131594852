"""What the tests of evaluations in a world share: a small field, and one finished run in it."""

import pytest
from walled_field import make_config, make_field, make_onlooker, stand_in

from toolkit.rooms.worlds.evaluation.world_run import WorldRun, evaluate_world
from toolkit.rooms.worlds.world import World


@pytest.fixture(scope="session")
def field() -> World:
    return make_field()


@pytest.fixture
def in_field(monkeypatch) -> None:
    stand_in(monkeypatch, is_drawn=False)


@pytest.fixture(scope="session")
def finished(tmp_path_factory, make_crate_space) -> WorldRun:
    """A run with every frame kept."""
    with pytest.MonkeyPatch.context() as patch:
        stand_in(patch)
        space = make_crate_space(tmp_path_factory.mktemp("finished"))
        return evaluate_world(space, make_onlooker(), make_config(keep=True))
