"""A light session for the studio's tests: two poses of a crate, and an inspector that needs no renderer."""

import io
from dataclasses import dataclass, field

import numpy as np
import pytest
from PIL import Image

from toolkit.rig.plan import read_plan
from toolkit.rooms.photos.gates import Gate
from toolkit.rooms.photos.shot_order import list_shots, order_shots, write_shots

pytest.importorskip("fastapi", reason="needs the extra 'studio' (FastAPI)")

from fastapi.testclient import TestClient

from toolkit.rooms.photos.studio.app import make_app
from toolkit.rooms.photos.studio.inspection import Inspection
from toolkit.rooms.photos.studio.predictor import Predictor
from toolkit.rooms.photos.studio.serve import Access
from toolkit.rooms.photos.studio.session import open_session

HOST = "127.0.0.1:8765"
BARE = "application/octet-stream"
BRIGHT = Gate("brightness", 60.0, "grey level", "use more light", at_most=False)


class QuickInspector:
    """One gate: the mean grey level."""

    def __init__(self, workspace=None, plan=None):
        self.seen = []

    def inspect(self, photo, step, pixels=None):
        self.seen.append((photo.sha256, step.number))
        value = np.asarray(Image.open(photo.path).convert("L")).mean()
        return Inspection(
            photo.sha256, (BRIGHT.judge(value), BRIGHT.skip("never")), None, "no board is seen", None, None
        )

    def warm_up(self, step):
        pass


@dataclass
class Desk:
    """A session, its application, and a browser of sorts."""

    space: object
    session: object
    predictor: Predictor
    app: object
    client: TestClient = field(repr=False)

    def send(self, number, content, **headers):
        return self.client.post(
            f"/api/shots/{number}/photo", content=content, headers={"content-type": BARE, **headers}
        )

    def keep(self, number, sha256):
        return self.client.post(f"/api/shots/{number}/keep", params={"sha256": sha256})

    def send_and_keep(self, number, content):
        answer = self.send(number, content)
        assert answer.status_code == 200, answer.text
        return self.keep(number, answer.json()["sha256"])

    def statuses(self):
        return [shot["status"] for shot in self.client.get("/api/state").json()["shots"]]


def no_network():
    from toolkit.core.errors import ToolkitError

    raise ToolkitError("no weights of resnet18 here")


def open_desk(space, token=None, load=no_network, most_bytes=200_000):
    session = open_session(space, make_inspector=QuickInspector)
    predictor = Predictor(session, load)
    app = make_app(session, Access(frozenset({HOST, "localhost:8765"}), token), predictor, most_bytes)
    return Desk(space, session, predictor, app, TestClient(app, base_url=f"http://{HOST}", follow_redirects=False))


@pytest.fixture
def shot_space(make_crate_space, tmp_path):
    """A workspace with a plan of two poses and the list of four shots."""
    space = make_crate_space(tmp_path / "space")
    plan = read_plan(space.plan_file)
    write_shots(space.root / "rig" / "shots.json", list_shots(plan, order_shots(plan, ["crate"])))
    return space


@pytest.fixture
def reopen(shot_space):
    """A function (token=None, …) that starts the studio on the same folder, as after a restart."""
    return lambda **options: open_desk(shot_space, **options)


@pytest.fixture
def desk(reopen):
    return reopen()


@pytest.fixture
def photo():
    """A function (seed, format) -> the bytes of a photograph of noise."""

    def make(seed=0, kind="JPEG", size=(160, 120), level=128):
        rng = np.random.default_rng(seed)
        pixels = np.clip(rng.normal(level, 20, (size[1], size[0], 3)), 0, 255).astype(np.uint8)
        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, kind)
        return buffer.getvalue()

    return make
