"""`toolkit eval` as a user calls it, with a real network of random weights."""

import json

import pytest
import torch
import torchvision
from typer.testing import CliRunner

from toolkit.cli.app import make_single
from toolkit.cli.evaluate import evaluate
from toolkit.core.errors import ToolkitError

app = make_single(evaluate)


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    file = tmp_path_factory.mktemp("weights") / "random.pth"
    torch.manual_seed(0)
    torch.save(torchvision.models.squeezenet1_1().state_dict(), file)
    return file


@pytest.fixture
def call(weights, workspace):
    def run(*arguments):
        fixed = ["--model", "squeezenet1_1", "--weights", str(weights), "--workspace", str(workspace.root)]
        return CliRunner().invoke(app, [*map(str, arguments), *fixed, "--device", "cpu"])

    return run


def test_table_files_and_exit_codes(call, put, workspace):
    for pose in (1, 2):
        put(f"sim/racer/unpatched/{pose}.png", "racer")
        put(f"sim/racer/patched/{pose}.png", "racer")
    done = call("--quiet")
    assert done.exit_code == 0, done.output
    assert "racer" in done.stdout and "report.html" in done.stdout
    assert (workspace.eval_dir / "squeezenet1_1-random-sim" / "summary.json").is_file()
    put("sim/racer/patched/3.png", "racer").write_bytes(b"")
    partly = call("--run", "again", "--quiet")
    assert partly.exit_code == 1
    assert "sim/racer/patched/3.png: the file is empty" in partly.stderr
    assert (workspace.eval_dir / "again" / "report.html").is_file()


def test_saliency_is_a_choice(call, put, workspace, monkeypatch):
    from toolkit.evaluation import evaluate as run

    asked = []
    real = run.draw_saliency
    monkeypatch.setattr(run, "draw_saliency", lambda *args: asked.append(args[2]) or real(*args))
    put("sim/racer/unpatched/1.png", "racer")
    put("sim/racer/patched/1.png", "racer")
    for arguments in ([], ["--saliency"], ["--no-saliency"]):
        assert call("--quiet", *arguments).exit_code == 0
    assert asked == [None, True, False]


def test_json(call, put):
    put("sim/racer/unpatched/1.png", "racer")
    done = call("--json", "--quiet")
    assert json.loads(done.stdout)["groups"][0]["n"] == 1


def test_bad_input_is_one_line(call, put, workspace):
    put("sim/racer/unpatched/1.png", "racer")
    for arguments in (["gone"], ["--object", "race"], ["--variant", "patchd"], ["--run", "../x"]):
        error = call(*arguments).exception
        assert isinstance(error, ToolkitError)
        assert "\n" not in str(error)
