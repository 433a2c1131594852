import time
from pathlib import Path

import pytest

from toolkit.core.errors import ToolkitError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.models.weights import WeightsFile


@pytest.fixture(scope="module")
def brightness():
    """Labels other, crate: the second where the picture is brighter than middle grey."""
    import torch

    from toolkit.models.network import Classifier

    class Brightness(torch.nn.Module):
        seen = 0

        def forward(self, batch):
            self.seen += 1
            level = batch.mean((1, 2, 3))
            return torch.stack([torch.zeros_like(level), 40 * (level - 0.5)], dim=1)

    how = Preprocessing(64, 64, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    file = WeightsFile(Path("bright.pth"), "cd" * 32, "bright.pth")
    return Classifier("brightness", Brightness().eval(), ["other", "crate"], how, file, "cpu", False)


def wait_for(desk, what):
    for _ in range(300):
        state = desk.client.get("/api/state").json()
        if what(state):
            return state
        time.sleep(0.05)
    raise AssertionError(f"this never came: {state['network']}, {state['predictions']}")


def test_kept_photographs_are_classified_once_each(reopen, photo, brightness):
    desk = reopen(load=lambda: brightness)
    desk.predictor.start()
    wait_for(desk, lambda state: state["network"]["status"] == "ready")
    desk.send_and_keep(1, photo(1, level=200))
    desk.send_and_keep(2, photo(2, level=80))
    desk.send(3, photo(3))  # waits, and is nobody's business yet
    state = wait_for(desk, lambda state: len(state["predictions"]) == 2)
    rows = [(row["number"], row["label"], row["right"]) for row in state["predictions"]]
    assert rows == [(1, "crate", True), (2, "other", False)]
    assert state["predictions"][0]["probability"] > 0.99 and state["predictions"][1]["rank"] == 2
    desk.predictor.wake()
    time.sleep(0.3)
    assert brightness.module.seen == 2
    desk.predictor.stop()
    assert not desk.predictor._thread.is_alive()


def test_a_retake_is_classified_anew(reopen, photo, brightness):
    desk = reopen(load=lambda: brightness)
    desk.predictor.start()
    desk.send_and_keep(1, photo(1, level=80))
    wait_for(desk, lambda state: [row["right"] for row in state["predictions"]] == [False])
    desk.send_and_keep(1, photo(2, level=200, size=(200, 150)))
    wait_for(desk, lambda state: [row["right"] for row in state["predictions"]] == [True])
    desk.predictor.stop()


def test_without_weights_the_page_says_so_and_goes_on(desk, photo):
    desk.predictor.start()
    state = wait_for(desk, lambda state: state["network"]["status"] != "loading")
    assert state["network"] == {"status": "missing", "message": "no weights of resnet18 here", "notes": []}
    assert desk.send_and_keep(1, photo()).status_code == 200
    assert desk.client.get("/api/state").json()["predictions"] == []


def test_an_object_that_the_network_does_not_know_is_noted(reopen, photo, brightness):
    desk = reopen(load=lambda: brightness)
    spec = desk.space.objects_dir / "crate.toml"
    spec.write_text(spec.read_text().replace('class = "crate"', 'class = "zebra"'))
    desk.predictor.start()
    desk.send_and_keep(1, photo())
    state = wait_for(desk, lambda state: state["network"]["notes"])
    assert "crate is left out" in state["network"]["notes"][0] and "zebra" in state["network"]["notes"][0]
    desk.predictor.stop()


def test_the_end_waits_until_the_network_is_loaded(reopen):
    """Cut off while it imports torch, the thread would abort the process."""
    loaded = []

    def load():
        time.sleep(2.5)
        loaded.append(True)
        raise ToolkitError("no weights here")

    desk = reopen(load=load)
    desk.predictor.start()
    desk.predictor.stop()
    assert loaded
