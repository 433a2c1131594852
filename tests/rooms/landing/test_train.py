"""Regressors: they learn, go on, are measured as the closed forms say, and refuse what is not theirs."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from drawn import OPTICS, draw, write_drawn, write_start

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.rooms.landing.config import RECIPES, CameraConfig, LandingTrainConfig
from toolkit.rooms.landing.dataset import SampleSet, read_split
from toolkit.rooms.landing.regressor import (
    Regressor,
    RegressorRecord,
    as_batch,
    build_module,
    find_saliency,
    load_regressor,
    pick_samples,
    regressors_dir,
    summarise_errors,
    write_saliency,
)
from toolkit.rooms.landing.train import (
    RIDGE,
    RegressorTask,
    TrainedRegressor,
    export_onnx,
    fit_ridge,
    train_regressor,
    turn_offsets,
)

Made = tuple[Workspace, LandingTrainConfig, TrainedRegressor]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    space = make_workspace(tmp_path_factory.mktemp("train") / "work")
    write_drawn(space.captures_dir / "landing" / "drawn")
    config = LandingTrainConfig(
        arch="shufflenet_v2_x0_5",
        pool="average",
        init=write_start(space.root / "start.pth"),
        epochs=28,
        batch=32,
        lr=3e-3,
        probe=False,
        uncertainty=True,
    )
    return space, config, train_regressor(space, "drawn", config, seed=1, device="cpu")


def test_it_learns_where_the_square_is(made: Made) -> None:
    rows = made[2].regressor.record.held_out
    blind = summarise_errors(np.zeros((64, 2)), read_split(made[0].captures_dir / "landing" / "drawn", "held_out"))
    assert rows[0].by == "all"
    assert rows[0].n == rows[0].found == 64
    assert (rows[0].share or 1) < 0.35 * (blind[0].share or 0)
    assert {row.by for row in rows} == {"all", "height", "angle", "weather"}
    assert sum(row.n for row in rows if row.by == "weather") == 64


def test_its_uncertainty_is_calibrated(made: Made) -> None:
    """Two of three errors along an axis lie within one standard deviation."""
    samples = read_split(made[0].captures_dir / "landing" / "drawn", "held_out")
    answers = made[2].regressor.answer(samples.images)
    within = np.abs(answers[:, :2] - samples.offsets) < answers[:, 2:]
    assert 0.5 < within.mean() < 0.88


def test_answers_have_the_same_bytes_alone_and_together(made: Made) -> None:
    images = np.stack([draw(index).image for index in range(64)])
    together = made[2].regressor.predict(images)
    for one in (0, 17, 63):
        assert made[2].regressor.predict(images[one : one + 1]).tobytes() == together[one : one + 1].tobytes()


def test_it_is_finished_once(made: Made) -> None:
    space, config, _ = made
    assert train_regressor(space, "drawn", config, seed=1, device="cpu").was_finished


def test_it_goes_on_to_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    space = make_workspace(tmp_path / "work")
    write_drawn(space.captures_dir / "landing" / "few", 32, 4)
    config = LandingTrainConfig(
        arch="shufflenet_v2_x0_5", pool="average", init=write_start(tmp_path / "start.pth"), epochs=2, batch=8
    )
    whole = train_regressor(space, "few", config, device="cpu").file
    content = whole.read_bytes()
    whole.unlink()
    loss = RegressorTask.loss

    def stop(self: RegressorTask, step: int) -> object:
        if step == 5:
            raise KeyboardInterrupt
        return loss(self, step)

    monkeypatch.setattr(RegressorTask, "loss", stop)
    with pytest.raises(KeyboardInterrupt):
        train_regressor(space, "few", config, device="cpu")
    monkeypatch.setattr(RegressorTask, "loss", loss)
    again = train_regressor(space, "few", config, device="cpu")
    assert again.resumed_from == 5
    assert again.file.read_bytes() == content


def test_several_sets_train_one_network(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    folder = space.captures_dir / "landing"
    write_drawn(folder / "one", 24, 4)
    write_drawn(folder / "other", 16, 6, first=28)
    config = LandingTrainConfig(
        arch="shufflenet_v2_x0_5", pool="average", init=write_start(tmp_path / "start.pth"), epochs=1, batch=8
    )
    record = train_regressor(space, ["one", "other"], config, device="cpu").regressor.record
    assert record.name == "one-other"
    assert (record.data["n"], record.data["world"]) == (40, "drawn")
    assert [(one["name"], one["n"], int(one["inputs_sha256"])) for one in record.data["sets"]] == [
        ("one", 24, 0), ("other", 16, 28),
    ]  # fmt: skip
    rows = {row.group: row for row in record.held_out if row.by in ("all", "data")}
    assert {name: row.n for name, row in rows.items()} == {"all": 10, "one": 4, "other": 6}
    squares = {name: row.n * (row.rmse_cm or 0) ** 2 for name, row in rows.items()}
    assert squares["all"] == pytest.approx(squares["one"] + squares["other"], rel=1e-3)
    alone = summarise_errors(
        load_regressor(space, "one-other").predict(read_split(folder / "other", "held_out").images),
        read_split(folder / "other", "held_out"),
    )
    assert rows["other"].rmse_cm == alone[0].rmse_cm
    assert train_regressor(space, ["one", "other"], config, device="cpu").was_finished


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "b: this data set is named twice"),
        ({"inputs_sha256": "1", "size_m": 1.0}, "b: its pad's side is 1 m, that of .*a is 2 m"),
        (
            {"inputs_sha256": "1", "pad": "grey", "pad_sha256": "2" * 64},
            "its pad is grey 22222222, .* is plain 11111111",
        ),
        (
            {"inputs_sha256": "1", "camera": OPTICS.camera.intrinsics | {"fx": 50.0}},
            "its camera is 48 × 48 px with fx 50,",
        ),
    ],
)
def test_sets_of_other_cameras_and_pads_are_refused(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    space = make_workspace(tmp_path / "work")
    for name in ("a", "b"):
        write_drawn(space.captures_dir / "landing" / name, 16, 4)
    file = space.captures_dir / "landing" / "b" / "dataset.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    with pytest.raises(ToolkitError, match=words):
        train_regressor(space, ["a", "b"], LandingTrainConfig(), device="cpu")


def test_the_ridge_is_scikits() -> None:
    linear_model = pytest.importorskip("sklearn.linear_model")
    rng = np.random.default_rng(0)
    features = (rng.normal(2, 3, (80, 12)) * np.arange(1, 13)).astype(np.float32)
    offsets, weight = rng.normal(0, 1, (80, 2)), rng.uniform(0.2, 2, 80)
    weights, bias, residual = fit_ridge(features, offsets, weight)
    mean, spread = features.mean(axis=0), features.std(axis=0) + 1e-6
    peer = linear_model.Ridge(alpha=RIDGE * 80).fit((features - mean) / spread, offsets, sample_weight=weight**2)
    expected = peer.predict((features - mean) / spread)
    assert np.allclose(features @ weights + bias, expected, atol=1e-4)
    assert residual == pytest.approx(float(np.sqrt(np.square(expected - offsets).mean())), rel=1e-3)


def test_a_turned_picture_has_a_turned_truth() -> None:
    for index in range(4):
        sample = draw(index)
        offsets = np.array([[sample.truth.x_m, sample.truth.y_m]], np.float32)
        for turns in range(4):
            mask = torch.rot90(torch.from_numpy(sample.mask.copy()), turns).numpy()
            row, column = np.argwhere(mask).mean(axis=0) + 0.5
            x, y = turn_offsets(offsets, np.array([turns]))[0] / sample.truth.z_m * OPTICS.camera.fx + 24
            if not (mask[[0, -1]].any() or mask[:, [0, -1]].any()):
                assert (column, row) == pytest.approx((x, y), abs=1.0)


def test_errors_are_those_of_the_closed_form() -> None:
    samples = [draw(index) for index in range(10)]
    group = SampleSet(np.stack([one.image for one in samples]), tuple(one.truth for one in samples))
    answers = group.offsets + np.array([0.3, 0.4])
    answers[0] = np.nan
    first = summarise_errors(answers, group)[0]
    assert (first.n, first.found) == (10, 9)
    assert first.rmse_cm == pytest.approx(50, abs=0.01)
    assert first.share == pytest.approx(float((0.5 / group.heights[1:]).mean()), abs=1e-4)


def make_linear(record: RegressorRecord, side_px: int) -> Regressor:
    torch.manual_seed(0)
    return Regressor(record, torch.nn.Sequential(torch.nn.Flatten(), torch.nn.Linear(3 * side_px**2, 2)))


def test_saliency_of_a_linear_network_is_its_weights(made: Made) -> None:
    record = made[2].regressor.record
    regressor = make_linear(record, 8)
    weights = next(regressor.module.parameters()).detach().numpy().reshape(2, 3, 8, 8)
    weights = weights / np.array(record.std)[:, None, None]
    found = find_saliency(regressor, np.random.default_rng(0).integers(0, 256, (2, 8, 8, 3), np.uint8))
    assert np.allclose(found, np.sqrt(np.square(weights).sum(axis=(0, 1))), rtol=1e-5)


def test_saliency_is_drawn(made: Made, tmp_path: Path) -> None:
    """What looks at all pixels alike has the pad's share of the area on the pad."""
    dataset = made[0].captures_dir / "landing" / "drawn"
    even = make_linear(made[2].regressor.record, 48)
    torch.nn.init.ones_(next(even.module.parameters()))
    shares = write_saliency(even, dataset, tmp_path / "seen.png")
    assert (tmp_path / "seen.png").read_bytes().startswith(b"\x89PNG")
    samples = pick_samples(dataset)
    assert [sample.truth.z_m for sample in samples] == sorted(sample.truth.z_m for sample in samples)
    assert shares == pytest.approx([sample.mask.mean() for sample in samples], rel=1e-4)


def test_onnx_says_the_same(made: Made, tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    file = export_onnx(made[2].regressor, tmp_path / "pad.onnx")
    images = np.stack([draw(index).image for index in range(3)])
    session = runtime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    found = session.run(None, {"image": as_batch(images).numpy()})[0]
    assert np.allclose(found[:, :2], made[2].regressor.predict(images), atol=1e-4)


def test_a_grid_of_features_is_for_resnets() -> None:
    module = build_module("resnet18", 2, "grid", 96)
    assert module.get_submodule("fc").in_features == 512 * 9
    assert module(torch.zeros(1, 3, 96, 96)).shape == (1, 2)
    with pytest.raises(FieldError, match="grid is for ResNets"):
        build_module("shufflenet_v2_x0_5", 2, "grid", 96)


def test_the_papers_recipe() -> None:
    paper = RECIPES["paper"]
    fit = paper.fit_config(16_000, 0)
    assert (fit.optimiser, fit.lr, fit.schedule, fit.weight_decay) == ("sgd", 0.001, "constant", 1e-4)
    assert (paper.batch, paper.epochs, paper.loss, paper.arch) == (512, 10, "mse", "resnet18")
    assert fit.steps == 310


def test_other_weights_are_refused(made: Made, tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    folder = regressors_dir(space)
    shutil.copytree(regressors_dir(made[0]), folder)
    with pytest.raises(ToolkitError, match="no regressor called 'drown': did you mean drawn"):
        load_regressor(space, "drown")
    file, record = folder / "drawn.safetensors", folder / "drawn.json"
    about = json.loads(record.read_text())
    record.write_text(json.dumps(about | {"outputs": 2}))
    with pytest.raises(ToolkitError, match="its weights are not those of shufflenet_v2_x0_5 with 2 outputs"):
        load_regressor(space, "drawn")
    record.write_text(json.dumps(about))
    file.write_bytes(file.read_bytes()[:-4] + b"0000")
    with pytest.raises(ToolkitError, match="the weights are of another regressor, or damaged"):
        load_regressor(space, "drawn")
    record.unlink()
    with pytest.raises(ToolkitError, match=r"no record drawn\.json beside it"):
        load_regressor(space, "drawn")
    with pytest.raises(FieldError, match="was trained on pictures of 48 px and 70°"):
        made[2].regressor.check(CameraConfig(image_px=96))
    with pytest.raises(ToolkitError, match="takes pictures of 48 px, found 64 × 64"):
        made[2].regressor.predict(np.zeros((1, 64, 64, 3), np.uint8))


def test_what_cannot_be_trained_on_is_one_line(tmp_path: Path) -> None:
    space = make_workspace(tmp_path / "work")
    with pytest.raises(ToolkitError, match="no landing data set called 'none'"):
        train_regressor(space, "none", LandingTrainConfig())
    write_drawn(space.captures_dir / "landing" / "few", 16, 4)
    with pytest.raises(FieldError, match="holds no weights of resnet50"):
        other = LandingTrainConfig(arch="resnet50", init=write_start(tmp_path / "start.pth"))
        train_regressor(space, "few", other, device="cpu")
