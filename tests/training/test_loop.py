"""The loop knows nothing of what it trains: a regressor of a few lines goes through it, through kills, to the byte."""

import os
import signal

import numpy as np
import pytest
import torch
from killed_runs import train_killed
from tiny_regressor import STEPS, Regressor, train_regressor

from toolkit.core.errors import ToolkitError
from toolkit.core.work import Work
from toolkit.training import loop
from toolkit.training.checkpoint import Checkpoint
from toolkit.training.loop import FitConfig, History, TrainingTask, fit

KILLED = """
import sys
from pathlib import Path
from dying import die_at_step
from tiny_regressor import Regressor, train_regressor

die_at_step(Regressor, 9)
train_regressor(Path(sys.argv[1]))
"""
pytestmark = pytest.mark.usefixtures("one_thread")


def test_a_regressor_finds_the_line_that_its_data_lie_on():
    found = fit(Regressor(), FitConfig(steps=500, lr=0.1, schedule="cosine", optimiser="adam")).made
    assert torch.allclose(torch.from_numpy(found["weight"]), Regressor.TRUE, atol=0.02)


@pytest.mark.slow
def test_kill_9_then_the_same_again_ends_with_the_same_bytes(tmp_path):
    train_killed(KILLED, tmp_path / "killed", is_forked=False)
    whole, resumed = (train_regressor(tmp_path / name) for name in ("whole", "killed"))
    assert (whole.resumed_from, resumed.resumed_from) == (0, 9)
    assert all(np.array_equal(whole.made[name], resumed.made[name]) for name in whole.made)
    assert whole.made.keys() == {"weight", "bias", "running_mean", "loss", "error_m"}
    assert not (tmp_path / "killed").exists(), "the checkpoint of a finished run is gone"


@pytest.fixture
def heeds_ctrl_c():
    """Also where the tests run in the background of a shell, which leaves SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_in_the_middle_of_a_loss_takes_the_step_back(tmp_path, heeds_ctrl_c):
    """Buffers that the loss has changed already are as they were: the run goes on to the same bytes."""

    class Interrupted(Regressor):
        def loss(self, step):
            found = super().loss(step)
            if step == 5:
                os.kill(os.getpid(), signal.SIGINT)
            return found

    with pytest.raises(KeyboardInterrupt):
        train_regressor(tmp_path / "stopped", Interrupted())
    resumed, whole = train_regressor(tmp_path / "stopped"), train_regressor(tmp_path / "whole")
    assert resumed.resumed_from == 5
    assert all(np.array_equal(whole.made[name], resumed.made[name]) for name in whole.made)


def test_ctrl_c_while_the_parameters_are_moved_waits_for_them(tmp_path, heeds_ctrl_c):
    class Interrupted(Regressor):
        def adjust_gradients(self, step):
            if step == 5:
                os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        train_regressor(tmp_path / "stopped", Interrupted())
    resumed, whole = train_regressor(tmp_path / "stopped"), train_regressor(tmp_path / "whole")
    assert resumed.resumed_from == 6
    assert all(np.array_equal(whole.made[name], resumed.made[name]) for name in whole.made)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_checkpoints_are_shown_and_a_restart_forgets_them(tmp_path):
    class Stopped(Regressor):
        def finish(self, history):
            raise KeyboardInterrupt

    task = Stopped()
    with pytest.raises(KeyboardInterrupt):
        train_regressor(tmp_path / "run", task)
    assert task.shown == STEPS + 1, "after every step, as asked for, and at the end"
    assert train_regressor(tmp_path / "run", restart=True).resumed_from == 0


def test_a_checkpoint_of_another_kind_is_refused(tmp_path):
    class Other(Regressor):
        work = Work("other")

        def finish(self, history):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_regressor(tmp_path / "run", Other())
    with pytest.raises(ToolkitError, match=r"another version or kind .*restart"):
        train_regressor(tmp_path / "run")


def test_what_is_finished_is_not_trained_again(tmp_path):
    class Finished(Regressor):
        def find_finished(self):
            return {"found": np.zeros(1)}

        def loss(self, step):
            pytest.fail("trained again")

    fitted = train_regressor(tmp_path / "run", Finished())
    assert fitted.was_finished and fitted.resumed_from == STEPS and list(fitted.made) == ["found"]


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_loss_that_is_no_number_stops_with_the_reason_and_keeps_what_is_done(tmp_path, value):
    class Broken(Regressor):
        advice = "feed it less"

        def loss(self, step):
            loss, figures = super().loss(step)
            return (loss * value if step == 4 else loss), figures

    with pytest.raises(ToolkitError, match=r"at step 5 is not a finite number \(loss (nan|inf)\): feed it less"):
        train_regressor(tmp_path / "run", Broken())
    assert train_regressor(tmp_path / "run").resumed_from == 4


def test_a_gradient_that_is_no_number_stops_too():
    """The loss is 0, and its root's slope there is not."""

    class Root(TrainingTask):
        work = Work("root")

        def __init__(self):
            self.at = torch.zeros(1, requires_grad=True)

        def parameters(self):
            return {"at": self.at}

        def loss(self, step):
            return self.at.abs().sqrt().sum() * 0, {}

        def finish(self, history):
            return None

    with pytest.raises(ToolkitError, match=r"not a finite number \(loss 0.0\)"):
        fit(Root(), FitConfig(steps=1, lr=0.1))


def test_torchs_own_draws_depend_on_seed_and_step_alone(tmp_path):
    """Dropout draws the same in step i, whatever was drawn before; the caller's generator is left as it was."""

    class Drawing(Regressor):
        def __init__(self):
            super().__init__()
            self.drawn = []

        def loss(self, step):
            self.drawn.append(float(torch.rand(())))
            return super().loss(step)

    torch.manual_seed(3)
    expected = torch.rand(())
    torch.manual_seed(3)
    first, other = Drawing(), Drawing()
    fit(first, FitConfig(steps=4, lr=0.1, seed=1))
    assert torch.rand(()) == expected
    fit(other, FitConfig(steps=4, lr=0.1, seed=1))
    assert first.drawn == other.drawn and len(set(first.drawn)) == 4


def test_the_sign_step_moves_every_number_by_the_learning_rate():
    task = Regressor()
    before = task.weight.detach().clone()
    fit(task, FitConfig(steps=1, lr=0.25, optimiser="sign"))
    moved = (task.weight - before).abs()
    assert torch.allclose(moved, torch.full_like(moved, 0.25))


def test_momentum_and_weight_decay_are_torchs_and_biases_do_not_decay():
    class Still(Regressor):
        def loss(self, step):
            return 0 * self.weight.sum() + 0 * self.bias.sum(), {}

    task = Still()
    weight, bias = torch.ones_like(task.weight), torch.ones_like(task.bias)
    with torch.no_grad():
        task.weight.copy_(weight)
        task.bias.copy_(bias)
    fit(task, FitConfig(steps=1, lr=0.5, momentum=0.9, weight_decay=0.2))
    assert torch.allclose(task.weight, weight * (1 - 0.5 * 0.2)) and torch.equal(task.bias, bias)


@pytest.mark.parametrize(("schedule", "middle"), [("constant", 1.0), ("linear", 0.525), ("cosine", 0.525)])
def test_the_learning_rate_falls_as_named(schedule, middle):
    config = FitConfig(steps=100, lr=0.2, schedule=schedule)
    assert config.lr_at(0) == pytest.approx(0.2)
    assert config.lr_at(50) == pytest.approx(0.2 * middle)
    assert config.lr_at(99) > 0


def test_one_cycle_is_torchs():
    config = FitConfig(steps=40, lr=0.1, schedule="one-cycle", warm_up=0.25)
    optimiser = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=0.1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 0.1, 40, pct_start=0.25, cycle_momentum=False)
    for step in range(40):
        assert config.lr_at(step) == pytest.approx(optimiser.param_groups[0]["lr"], rel=1e-6, abs=1e-9)
        optimiser.step()
        schedule.step()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"schedule": "cosin"}, "did you mean cosine"),
        ({"optimiser": "adamw"}, "did you mean adam"),
        ({"steps": 0}, "steps 0: expected at least 1"),
    ],
)
def test_settings_that_cannot_be(settings, words):
    with pytest.raises(ToolkitError, match=words):
        FitConfig(**({"steps": 1, "lr": 0.1} | settings))


def test_history_tells_the_mean_of_the_last_steps():
    history = History()
    for value in (5.0, 1.0, 2.0):
        history.append({loop.LOSS: value, "error_m": 2 * value})
    assert len(history) == 3 and history.recent(2) == {"loss": 1.5, "error_m": 3.0}


def test_a_parameter_that_the_loss_does_not_use_stays(tmp_path):
    class Unused(Regressor):
        def parameters(self):
            return super().parameters() | {"unused": self.unused}

        def __init__(self):
            super().__init__()
            self.unused = torch.ones(2, 2, requires_grad=True)

    task = Unused()
    fit(task, FitConfig(steps=3, lr=0.1, weight_decay=0.1))
    assert torch.equal(task.unused, torch.ones(2, 2))


def test_a_checkpoint_is_named_by_its_hash(tmp_path):
    assert Checkpoint(tmp_path, "ab" * 32).file.name == "abababababababab.safetensors"
