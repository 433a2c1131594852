"""State dicts whose names begin with what training programs put before them, and files that hold several networks."""

import pytest
import torch
import torchvision

from toolkit.core.errors import ToolkitError
from toolkit.models.load import load_classifier


@pytest.fixture(scope="module")
def state():
    torch.manual_seed(0)
    return torchvision.models.squeezenet1_1(num_classes=3).state_dict()


def save(state, file, prefix, **more):
    torch.save({"state_dict": {**{f"{prefix}{name}": value for name, value in state.items()}, **more}}, file)
    return file


@pytest.mark.parametrize(
    "prefix",
    [
        "_orig_mod.", "module.", "model.", "net.", "module._orig_mod.", "_orig_mod.module.", "model._orig_mod.",
        "model.net.", "student.backbone.", "_fsdp_wrapped_module.", "model._forward_module.",
    ],
)  # fmt: skip
def test_any_prefix_that_all_names_share_is_read(tmp_path, state, prefix):
    file = save(state, tmp_path / "mine.pth", prefix)
    loaded = load_classifier("squeezenet1_1", file, "cpu").module.state_dict()
    assert all(torch.equal(loaded[name], value) for name, value in state.items())


def test_what_lightning_keeps_beside_the_network_is_left_out(tmp_path, state):
    file = save(state, tmp_path / "mine.ckpt", "model.", **{"criterion.weight": torch.ones(3)})
    assert load_classifier("squeezenet1_1", file, "cpu").labels == ["class 0", "class 1", "class 2"]


def test_parts_that_were_compiled_alone_are_read(tmp_path, state):
    torch.save({name.replace("features.", "features._orig_mod."): value for name, value in state.items()},
               tmp_path / "mine.pth")  # fmt: skip
    assert load_classifier("squeezenet1_1", tmp_path / "mine.pth", "cpu").labels == ["class 0", "class 1", "class 2"]


def test_two_networks_are_refused_with_their_prefixes(tmp_path, state):
    file = save(state, tmp_path / "mine.pth", "model.", **{f"ema.{name}": value for name, value in state.items()})
    with pytest.raises(ToolkitError, match=r"mine\.pth holds 2 such networks.*'ema\.' and 'model\.'") as caught:
        load_classifier("squeezenet1_1", file, "cpu")
    assert "\n" not in str(caught.value)


def test_another_network_is_refused_with_the_prefix_of_its_names(tmp_path, state):
    file = save(state, tmp_path / "mine.pth", "net.")
    with pytest.raises(ToolkitError, match=r"holds no weights of resnet18.*begin with 'net\.'"):
        load_classifier("resnet18", file, "cpu")


def test_timm_networks_are_read_likewise(tmp_path):
    timm = pytest.importorskip("timm")
    torch.manual_seed(0)
    state = timm.create_model("resnet10t", num_classes=4).state_dict()
    loaded = load_classifier("timm:resnet10t", save(state, tmp_path / "mine.pth", "model._orig_mod."), "cpu")
    assert len(loaded.labels) == 4 and torch.equal(loaded.module.state_dict()["fc.weight"], state["fc.weight"])


@pytest.mark.parametrize(
    "wrap",
    [
        lambda state: {"model_state_dict": state, "optimizer_state_dict": {"param_groups": []}, "epoch": 3},
        lambda state: {"model_state": state, "iteration": 7}, lambda state: {"net": state, "acc": 90.5},
        lambda state: {"state_dict_ema": state}, lambda state: {"ema": {"module": state, "updates": 5}},
        lambda state: {"weights": state},
        lambda state: {"state_dict": state, "state_dict_ema": {**state, "n": torch.ones(1)}},
        lambda state: {f"module.{name}": value for name, value in state.items()} | {"n_averaged": torch.tensor(5)},
        lambda state: {name.replace("features.", "features._fsdp_wrapped_module."): state[name] for name in state},
        lambda state: {name.replace("fire.", "fire._checkpoint_wrapped_module."): state[name] for name in state},
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["mine.pth", "model_best.pth.tar", "pytorch_model.bin", "MINE.PT"])
def test_a_state_dict_is_found_under_any_name(tmp_path, state, wrap, name):
    torch.save(wrap(state), tmp_path / name)
    loaded = load_classifier("squeezenet1_1", tmp_path / name, "cpu").module.state_dict()
    assert all(torch.equal(loaded[name], value) for name, value in state.items())


def test_the_state_dicts_that_are_left_out_are_noted(tmp_path, state, capsys):
    torch.save({"model": state, "model_ema": state}, tmp_path / "mine.pth")
    load_classifier("squeezenet1_1", tmp_path / "mine.pth", "cpu")
    assert capsys.readouterr().err.strip().endswith("mine.pth: 'model' is read, 'model_ema' left out")


def test_state_dicts_under_unusual_names_are_refused(tmp_path, state):
    torch.save({"teacher": state, "student": state}, tmp_path / "mine.pth")
    with pytest.raises(ToolkitError, match=r"mine\.pth holds 2 state dicts, 'teacher' and 'student'"):
        load_classifier("squeezenet1_1", tmp_path / "mine.pth", "cpu")
