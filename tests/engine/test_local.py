"""Units in this process and in a pool: the same results in the same order, and what a bad unit does to the others."""

import os
import threading

import engine_work
import numpy as np
import pytest
import torch

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.engine import EngineConfig, local
from toolkit.engine.local import InProcess, LocalPool
from toolkit.engine.units import Unit, explain_failure


def units_of(work, *each):
    """Units of one result each; their keys are their numbers."""
    return [Unit((at,), work, inputs, str(at)) for at, inputs in enumerate(each)]


def outcomes(engine, units):
    with engine:
        return [(int(one.unit.name), one.result, one.reason) for one in engine.run(units)]


@pytest.mark.parametrize("engine", [InProcess(), LocalPool(2)], ids=["here", "pool"])
def test_results_come_in_the_order_of_the_units(engine):
    counts = [1, 3, 0, 2]
    units = [
        Unit(tuple((at, k) for k in range(count)), engine_work.count_to, (count,), "")
        for at, count in enumerate(counts)
    ]
    with engine:
        found = [(one.key, one.result, one.reason) for one in engine.run(units)]
    assert found == [((at, k), k, "") for at, count in enumerate(counts) for k in range(count)]


@pytest.mark.parametrize("early", [True, False])
def test_a_unit_may_begin_beside_the_one_before_it(monkeypatch, early):
    monkeypatch.setattr(local, "count_cores", lambda: 2)
    begun = [threading.Event() for _ in range(4)]

    def work(at):
        begun[at].set()
        if at == 2:
            raise KeyError("x")
        yield at
        # its own first result is there: by now the next unit has begun, if it may
        yield at < 3 and begun[at + 1].wait(60 if early else 0.1)

    units = [Unit((0, 1), work, (at,), str(at), begins_early=early) for at in range(4)]
    with InProcess() as engine:
        found = [(one.unit.name, one.result) for one in engine.run(units)]
    assert found == [
        ("0", 0), ("0", early), ("1", 1), ("1", early), ("2", None), ("3", 3), ("3", False)
    ]  # fmt: skip


@pytest.mark.parametrize("engine", [InProcess(), LocalPool(1)], ids=["here", "pool"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_unit_with_another_number_of_results_than_keys_fails(engine, count):
    *_, last = outcomes(engine, [Unit(("a", "b"), engine_work.count_to, (count,), "0")])
    assert last[2]


@pytest.mark.parametrize("engine", [InProcess(), LocalPool(2)], ids=["here", "pool"])
def test_a_shared_value_is_the_same_everywhere(engine):
    values = np.random.default_rng(0).random(5)
    with engine:
        shared = engine.share(values)
        found = [one.result for one in engine.run(units_of(engine_work.weigh, *((shared, at) for at in range(5))))]
    assert found == values.tolist()


@pytest.mark.parametrize("engine", [InProcess(), LocalPool(2)], ids=["here", "pool"])
def test_a_poisoned_unit_fails_alone_and_says_why(engine):
    for error, words in (
        (ToolkitError("no such fog"), "no such fog"),
        (KeyError("x"), "KeyError in engine_work.py, line"),
    ):
        found = outcomes(engine, units_of(engine_work.fail_at, *((at, 1, error) for at in range(4))))
        assert [(tag, result) for tag, result, _ in found] == [(0, 0), (1, None), (2, 2), (3, 3)]
        assert found[1][2].startswith(words) and "\n" not in found[1][2]


@pytest.mark.slow
def test_a_unit_that_kills_its_worker_is_given_up_and_the_others_are_done():
    found = outcomes(LocalPool(2), units_of(engine_work.die, *((at, 2) for at in range(6))))
    assert [(tag, result) for tag, result, _ in found] == [(0, 0), (1, 1), (2, None), (3, 3), (4, 4), (5, 5)]
    assert "was killed" in found[2][2]


@pytest.mark.parametrize("engine", [InProcess(), LocalPool(1)], ids=["here", "pool"])
def test_a_unit_that_wants_too_much_memory_is_listed_and_the_others_are_done(engine):
    found = outcomes(engine, units_of(engine_work.allocate, (0.001,), (8,), (0.001,)))
    assert [(tag, bool(result), reason) for tag, result, reason in found] == [
        (0, True, ""), (1, False, "the memory is full"), (2, True, ""),
    ]  # fmt: skip


def test_what_torch_says_of_full_memory_is_said_in_short():
    words = "[enforce fail at alloc_cpu.cpp:127] err == 0. DefaultCPUAllocator: can't allocate memory: you tried to"
    assert explain_failure(RuntimeError(words)) == "the memory is full"
    assert explain_failure(torch.cuda.OutOfMemoryError("CUDA out of memory. Tried")) == "the GPU's memory is full"


def test_a_worker_that_dies_once_costs_nothing(tmp_path):
    found = outcomes(LocalPool(2), units_of(engine_work.die_once, *((at, str(tmp_path / "marker")) for at in range(4))))
    assert found == [(at, at, "") for at in range(4)]


@pytest.mark.slow
def test_workers_are_others_and_use_one_core_each():
    pool = LocalPool(2)
    with pool:
        found = {one.result for one in pool.run(units_of(engine_work.who, *[(0.3,)] * 6))}
        (cores,) = {one.result for one in pool.run(units_of(engine_work.tell_cores, (), ()))}
    assert len(found) == 2 and os.getpid() not in found and cores == (1, 1)


def test_no_more_units_are_read_than_the_workers_need_next():
    read = []

    def lazily():
        for unit in units_of(engine_work.add, *((at, 1) for at in range(20))):
            read.append(int(unit.name))
            yield unit

    pool = LocalPool(1)
    with pool:
        first = next(iter(pool.run(lazily())))
    assert first.result == 1 and len(read) <= 3
    read.clear()
    next(iter(InProcess().run(lazily())))
    assert read == [0]


def test_shared_values_leave_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    pool = LocalPool(1)
    with pool:
        first = pool.share([1])
        assert len(list(tmp_path.glob("*/*"))) == 1
        pool.share([2])  # nobody holds it
        assert len(list(tmp_path.glob("*/*"))) == 1 and first.get() == [1]
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_sent_is_a_line():
    with LocalPool(1) as pool, pytest.raises(ToolkitError, match="function cannot be sent to another process"):
        pool.share(lambda: None)
    found = outcomes(LocalPool(1), units_of(engine_work.add, (1, lambda: None), (1, 2)))
    assert [result for _, result, _ in found] == [None, 3] and found[0][2]


def test_where_it_runs_is_chosen_by_a_config():
    assert isinstance(EngineConfig().open(), InProcess)
    pool = EngineConfig(workers=3).open()
    assert isinstance(pool, LocalPool) and pool.workers == 3
    with pytest.raises(FieldError, match="engine"):
        EngineConfig(address="somewhere:6379").open()
