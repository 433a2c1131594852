"""A refined network: its loss and gradient, flat minima by their formulas, what is written and found by one name."""

import json
import shutil

import numpy as np
import pytest
import torch
from colour_folder import write_colours
from forked import TOOLKIT, run, run_two
from killed_runs import train_killed
from PIL import Image
from safetensors.torch import load_file, save_file
from slow_cases import mark_slow
from tiny_network import tiny_config, train_tiny, write_photos
from torch.nn.functional import softmax
from typer.testing import CliRunner

from toolkit.boosters.detectors import load_networks
from toolkit.boosters.pixels import choose_turn
from toolkit.cli import app
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.core.work import Work
from toolkit.core.workspace import make_workspace
from toolkit.imaging.read import read_image
from toolkit.models.architectures import build_network
from toolkit.models.load import load_classifier
from toolkit.training.classifier_task import find_worst_images
from toolkit.training.images import find_photographs
from toolkit.training.loop import FitConfig, TrainingTask, fit, make_steps
from toolkit.training.refine import RefineTask, distill_loss, refine_network
from toolkit.training.refine_config import RefineConfig

KILLED = """
import sys
from pathlib import Path
from dying import die_at_step
from toolkit.core.workspace import open_workspace
from toolkit.models.load import load_classifier
from toolkit.training.refine import refine_network
from toolkit.training.refine_config import RefineConfig
from toolkit.training.refine import RefineTask

die_at_step(RefineTask, 4)
space = open_workspace(Path(sys.argv[1]))
config = RefineConfig(name="new", data=(sys.argv[2],), **eval(sys.argv[3]))
teacher = load_classifier("own", device="cpu", folder=space.classifiers_dir)
refine_network(config, space, teacher, checkpoint_every_s=0)
"""
pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def colours(tmp_path_factory):
    return write_colours(tmp_path_factory.mktemp("images") / "colours", 10)


def make_space(folder):
    """A workspace with the classifier `own`: random weights, and statistics of batch normalisation to tell."""
    space = make_workspace(folder)
    space.classifiers_dir.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(3)
    module = build_network("cifar_resnet8", 3)
    for layer in module.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            layer.running_mean.normal_(0, 0.1)
            layer.running_var.uniform_(0.5, 2)
        if isinstance(layer, torch.nn.Linear):
            layer.weight.data.mul_(20)  # so that answers depend on the picture
    save_file(module.state_dict(), space.classifiers_dir / "own.safetensors")
    about = {"arch": "cifar_resnet8", "labels": ["red", "green", "blue"], "size": 16, "name": "own"}
    (space.classifiers_dir / "own.json").write_text(json.dumps(about))
    return space


def refine(space, colours, **settings):
    config = RefineConfig(name="new", data=(str(colours),), **{"steps": 8, "batch": 6, "lr": 0.05, **settings})
    teacher = load_classifier("own", device="cpu", folder=space.classifiers_dir)
    return refine_network(config, space, teacher)


def read_written(space):
    """Every file of `new`, by its name."""
    return {file.name: file.read_bytes() for file in sorted(space.classifiers_dir.glob("new*"))}


def test_a_network_has_no_distance_from_itself_and_the_gradient_is_that_of_differences():
    generator = torch.Generator().manual_seed(0)
    teacher, student = torch.randn(2, 5, 7, generator=generator, dtype=torch.float64) * 3
    assert distill_loss(teacher, teacher, 2.0) == 0
    p, q = softmax(teacher / 2, 1), softmax(student / 2, 1)
    assert distill_loss(student, teacher, 2.0) == pytest.approx(float(4 * (p * (p / q).log()).sum(1).mean()))
    assert torch.autograd.gradcheck(lambda logits: distill_loss(logits, teacher, 2.0), student.requires_grad_())
    # at T the gradient by the logits is T (q - p) / b (Hinton et al. 2015, equation 2, times T²)
    (gradient,) = torch.autograd.grad(distill_loss(student, teacher, 2.0), student)
    assert torch.allclose(gradient, 2 * (q - p) / 5)


def test_the_gradient_by_the_weights_is_that_of_differences(colours, tmp_path):
    tasks = {}

    def keep(self, history, finish=RefineTask.finish):
        tasks["task"] = self
        return finish(self, history)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RefineTask, "finish", keep)
        refine(make_space(tmp_path / "space"), colours, steps=4)
    task = tasks["task"]
    task._precision = "float32"
    views = task._draw_views(0)[0].double()
    task.student.module.double(), task.inputs.teacher.module.double()
    task._views = (0, views, task.inputs.teacher.logits(views))
    task.student.module.zero_grad()  # of the last step
    task.loss(0)[0].backward()
    for name in ("conv1.weight", "layer3.bn1.weight", "fc.bias"):
        value = task.parameters()[name]
        place = np.unravel_index(int(value.grad.abs().argmax()), value.shape)
        ends = []
        with torch.no_grad():
            for move in (1e-6, -2e-6):
                value[place] += move
                ends.append(task.loss(0)[0].item())
            value[place] += 1e-6
        assert value.grad[place].item() == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-3)


def test_the_attack_stays_in_the_ball_and_raises_the_loss(colours, tmp_path, monkeypatch):
    seen = []

    def attack(images, measure, how):
        worst = find_worst_images(images, measure, how)
        seen.append((images, worst, measure))
        return worst

    monkeypatch.setattr("toolkit.training.refine.find_worst_images", attack)
    refine(make_space(tmp_path / "space"), colours, robust="l2:0.5", steps=6)
    trained = seen[:6]
    for images, worst, _ in trained:
        away = (worst - images).flatten(1).norm(dim=1)
        assert (away <= 0.5 * (1 + 1e-5)).all() and away.max() > 0.2 and worst.min() >= 0 and worst.max() <= 1
    images, worst, measure = trained[-1]
    with torch.no_grad():
        assert (measure(worst) >= measure(images)).all() and measure(worst).mean() > measure(images).mean()


class Quadratic(TrainingTask[torch.Tensor]):
    """½ wᵀ A w, whose gradient is A w."""

    work = Work("quadratic")

    def __init__(self):
        self.matrix = torch.diag(torch.tensor([1.0, 4.0, 9.0], dtype=torch.float64))
        self.w = torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64, requires_grad=True)

    def parameters(self):
        return {"w": self.w}

    def loss(self, step):
        return self.w @ self.matrix @ self.w / 2, {}

    def finish(self, history):
        return self.w.detach().clone()


def test_sam_on_a_quadratic_is_its_formula():
    """W ← w − η A (w + ρ A w / |A w|), equations 2 and 3 of Foret et al. 2021."""
    task, rho, lr = Quadratic(), 0.3, 0.05
    expected = task.w.detach().clone()
    for _ in range(5):
        gradient = task.matrix @ expected
        expected = expected - lr * task.matrix @ (expected + rho * gradient / gradient.norm())
    found = fit(task, FitConfig(5, lr, momentum=0.0, rho=rho)).made
    assert torch.allclose(found, expected, atol=1e-12)
    assert not torch.allclose(found, fit(Quadratic(), FitConfig(5, lr, momentum=0.0)).made, atol=1e-3)


def test_swa_is_the_mean_of_the_weights_of_the_second_half(colours, tmp_path, monkeypatch):
    kept = []

    def watch(self, step, usual=RefineTask.watch):
        kept.append({name: value.detach().clone() for name, value in self.parameters().items()})
        usual(self, step)

    monkeypatch.setattr(RefineTask, "watch", watch)
    space = make_space(tmp_path / "space")
    refine(space, colours, flat="swa")
    written = load_file(space.classifiers_dir / "new.safetensors")
    assert len(kept) == 8
    for name, value in written.items():
        if name in kept[0]:
            mean = torch.stack([one[name] for one in kept[4:]]).mean(0)
            assert torch.allclose(value.float(), mean, rtol=1e-3, atol=1e-4), name
    assert not torch.allclose(written["fc.weight"].float(), kept[-1]["fc.weight"], rtol=1e-3, atol=1e-4)


def test_statistics_stay_weights_move_and_the_record_counts(colours, tmp_path):
    space = make_space(tmp_path / "space")
    own = sha256_file(space.classifiers_dir / "own.safetensors")
    made = refine(space, colours, robust="l2:0.5", flat="sam")
    before, after = (load_file(space.classifiers_dir / f"{name}.safetensors") for name in ("own", "new"))
    for name, value in before.items():
        is_statistic = name.endswith(("running_mean", "running_var"))
        assert torch.equal(value.half(), after[name]) if is_statistic else True, name
    assert not torch.equal(before["conv1.weight"].half(), after["conv1.weight"])
    assert sha256_file(space.classifiers_dir / "own.safetensors") == own
    (record,) = made.records
    assert record.refined.teacher_sha256 == own and record.refined.step == 8
    assert record.refined.before.n == record.refined.after.n == record.held_out.n == 6, "a fifth of 30"
    assert record.refined.before.agreed == 6, "the teacher agrees with itself"
    assert record.settings["rho"] == 0.005 and record.settings["robust"]["eps"] == 0.5
    assert json.loads((space.classifiers_dir / "new.json").read_text())["data"]["held_out"]["images"] == 6
    # what is counted is what the written file says
    network, teacher = (load_classifier(name, device="cpu", folder=space.classifiers_dir) for name in ("new", "own"))
    held_out = find_photographs(colours, 0.2).held_out
    batch = torch.stack([network.preprocess(read_image(one.path, 16)) for one in held_out])
    answers = network.logits(batch).argmax(1)
    truth = torch.tensor([network.labels.index(one.label) for one in held_out])
    assert record.refined.after.correct == int((answers == truth).sum())
    assert record.refined.after.agreed == int((answers == teacher.logits(batch).argmax(1)).sum())


def test_it_is_shown_images_as_its_teacher_is(colours, tmp_path):
    space = make_space(tmp_path)
    about = space.classifiers_dir / "own.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | {"channels": "BGR", "squash": True}))
    refine(space, colours, steps=2)
    teacher, new = (load_classifier(name, device="cpu", folder=space.classifiers_dir) for name in ("own", "new"))
    assert new.preprocessing == teacher.preprocessing
    assert new.preprocessing.channels == "BGR" and new.preprocessing.squash


def test_the_fifth_is_the_same_in_every_run_and_takes_classes_of_one_photograph(tmp_path):
    folder = write_colours(tmp_path / "one", 1)
    write_colours(tmp_path / "many", 10)
    assert len(find_photographs(folder, 0.2).held_out) == 1 and len(find_photographs(folder, 0.2).train) == 2
    found = find_photographs(tmp_path / "many", 0.2)
    assert len(found.held_out) == 6 and not {*found.held_out} & {*found.train}
    names = [(one.label, one.path.name) for one in found.held_out]
    write_colours(tmp_path / "elsewhere", 10, seed=5)
    assert [(one.label, one.path.name) for one in find_photographs(tmp_path / "elsewhere", 0.2).held_out] == names


SAM, SWA = {"checkpoints": 3, "flat": "sam"}, {"flat": "swa", "robust": "l2:0.5"}


@pytest.mark.parametrize("settings", mark_slow([SAM, SWA], SWA))
def test_a_killed_run_goes_on_to_the_same_bytes(settings, colours, tmp_path):
    whole, killed = make_space(tmp_path / "whole"), make_space(tmp_path / "killed")
    refine(whole, colours, **settings)
    given = repr({"steps": 8, "batch": 6, "lr": 0.05, **settings})
    train_killed(KILLED, killed.root, colours, given)
    made = refine(killed, colours, **settings)
    assert made.resumed_from == 4
    assert read_written(killed) == read_written(whole)
    assert not (killed.classifiers_dir / ".training").exists()
    assert refine(killed, colours, **settings).was_finished


def test_networks_are_the_same_bytes_after_a_booster_was_trained_on_them(colours, tmp_path):
    space = make_space(tmp_path / "space")
    refine(space, colours, checkpoints=2)
    networks = load_networks(["new", "own"], None, "cpu", space.classifiers_dir)

    def read():
        states = [one.module.state_dict() for one in networks]
        return [[value.numpy().tobytes() for value in state.values()] for state in states], read_written(space)

    before = read()
    photos = write_photos(tmp_path / "photos", 8)
    made = train_tiny(space.root, photos, tiny_config(6, size_px=8), class_name="red", networks=networks)
    assert made.patch.record.final["loss"] > 0 and read() == before
    assert not any(one.module.training for one in networks)


def test_a_set_is_one_name_for_all_its_networks(colours, tmp_path):
    space = make_space(tmp_path / "space")
    made = refine(space, colours, checkpoints=4)
    assert [one.refined.step for one in made.records] == [2, 4, 6, 8]
    networks = load_networks(["new", "own"], None, "cpu", space.classifiers_dir)
    assert [one.name for one in networks] == ["new-01", "new-02", "new-03", "new-04", "own"]
    assert len({one.weights.sha256 for one in networks}) == 5
    assert sorted(choose_turn(0, step, [1] * 4) for step in range(4)) == [0, 1, 2, 3], "a step asks one of them"
    with pytest.raises(ToolkitError, match=r"model new: is a set of 4 networks.*such as new-04"):
        load_classifier("new", device="cpu", folder=space.classifiers_dir)
    with pytest.raises(ToolkitError, match="is a set of 4 networks"):
        load_networks(["new"], None, "cpu", space.classifiers_dir, with_sets=False)
    (space.classifiers_dir / "new.json").write_text('{"networks": 3}')
    with pytest.raises(ToolkitError, match=r"new\.json"):
        load_networks(["new"], None, "cpu", space.classifiers_dir)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--robust", "l3:1"], "--robust l3:1: expected l2:EPS or linf:EPS"),
        (["--flat", "wide"], "--flat wide: expected"),
        (["--rho", "0.1"], "--rho 0.1: expected together with --flat sam"),
        (["--checkpoints", "9", "--steps", "3"], "--checkpoints 9: expected at most 3, one for each of the --steps"),
        (["--flat", "swa", "--checkpoints", "3"], "swa makes one network of the way"),
        (["--data", "nowhere"], "--data nowhere: does not exist: expected a folder with one folder per class"),
        (["--lr", "0"], "--lr 0: expected a number above 0"),
        (["--attack-steps", "2"], "--attack-steps 2: expected together with --robust"),
    ],
)
def test_bad_input_is_a_line(words, expected, colours, tmp_path):
    space = make_space(tmp_path / "space")
    typed = ["refine-network", "new", "--model", "own", "--device", "cpu", "--workspace", str(space.root)]
    typed += words if "--data" in words else ["--data", str(colours), *words]
    shown = CliRunner().invoke(app, typed)
    assert shown.exit_code and expected in str(shown.exception) and "\n" not in str(shown.exception)


def test_a_folder_of_other_classes_is_a_line(colours, tmp_path):
    space = make_space(tmp_path / "space")
    (colours / "red").rename(colours / "purple")
    try:
        with pytest.raises(ToolkitError, match=r"'purple' is not a class of own .*\{?model"):
            refine(space, colours)
    finally:
        (colours / "purple").rename(colours / "red")


def test_a_class_without_a_usable_photograph_is_said_and_does_not_stop_it(colours, tmp_path):
    folder, space = tmp_path / "set", make_space(tmp_path / "space")
    shutil.copytree(colours, folder)
    for file in (folder / "red").iterdir():
        Image.new("RGB", (3, 2)).save(file)
    shutil.rmtree(folder / "green")
    (folder / "green").mkdir()
    made = refine(space, folder)
    why = dict(made.skipped)
    assert why.pop("set/green") == "a class without images"
    assert len(why) == 10 and all("set/red/" in path and "3×2 px, too small" in why[path] for path in why)
    assert made.records[0].data["trained_on"]["images"] + made.records[0].data["held_out"]["images"] == 10
    for file in (folder / "blue").iterdir():
        Image.new("RGB", (3, 2)).save(file)
    with pytest.raises(ToolkitError, match=r"class 'blue': none of its images can be used; set/blue/.*too small"):
        refine(space, folder)


def test_the_command_says_before_and_after(colours, tmp_path):
    space = make_space(tmp_path / "space")
    typed = ["refine-network", "new", "--data", str(colours), "--model", "own", "--device", "cpu", "--steps", "4"]
    typed += ["--batch", "6", "--workspace", str(space.root)]
    shown = CliRunner().invoke(app, [*typed, "--checkpoints", "2", "--quiet"])
    assert shown.exit_code == 0, shown.output
    assert "new-01: held-out photographs, correct" in shown.output and "--model new" in shown.output
    assert "under attack (l2 0.5), correct" in shown.output
    told = json.loads(CliRunner().invoke(app, [*typed, "--checkpoints", "2", "--json"]).stdout)
    assert told["was_finished"] and len(told["records"]) == 2


def test_rho_zero_draws_as_before():
    """The loop of a task without SAM asks it once a step, and SAM's twice."""
    counts = []
    for rho in (0.0, 0.1):
        task = Quadratic()
        asked = []
        task.loss = lambda step, asked=asked, task=task: asked.append(step) or Quadratic.loss(task, step)
        for _ in make_steps(task, FitConfig(3, 0.1, rho=rho)):
            pass
        counts.append(asked)
    assert counts == [[0, 1, 2], [0, 0, 1, 1, 2, 2]]


@pytest.mark.slow
def test_two_processes_make_the_network_of_one(colours, tmp_path):
    """Its weights move as those of one process do, to the rounding of bfloat16; the first process alone speaks."""
    spaces = [make_space(tmp_path / name) for name in ("one", "two")]
    typed = ["refine-network", "new", "--data", colours, "--model", "own", "--device", "cpu", "--steps", "6"]
    typed += ["--batch", "6", "--lr", "0.05", "--flat", "sam", "--robust", "l2:0.5", "--workspace"]
    for done, *others in ([run(TOOLKIT, *typed, spaces[0].root)], run_two(TOOLKIT, *typed, spaces[1].root)):
        assert done.returncode == 0 and done.stdout.count(b"new: held-out photographs") == 1, done.stderr
        assert not any(one.returncode or one.stdout for one in others)
    refused, _ = run_two(TOOLKIT, *typed, spaces[1].root, "--batch", "5")
    assert b"error: --batch 5: expected a multiple of 2, the processes that share it" in refused.stderr
    own, *both = (
        load_file(space.classifiers_dir / f"{name}.safetensors")
        for space, name in ((spaces[0], "own"), (spaces[0], "new"), (spaces[1], "new"))
    )
    moved, apart = (
        torch.cat([(a[name].float() - b[name].float()).flatten() for name in own if "running" not in name]).norm()
        for a, b in ((both[0], own), (both[0], both[1]))
    )
    assert apart < 0.15 * moved
