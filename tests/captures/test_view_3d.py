"""The live viewer: what it is told to show, asked of a running one on this machine."""

import re
import signal
import socket
import subprocess
import sys
import urllib.request
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from one_line import error_of
from PIL import Image

from toolkit.captures.manifest import read_manifest
from toolkit.captures.shoot import shoot_plan
from toolkit.captures.view_3d import gather_view, open_viewer, show_view
from toolkit.core.workspace import make_workspace
from toolkit.objects.load import load_object
from toolkit.rig.camera import as_quaternion
from toolkit.rig.plan import open_plan, read_plan
from toolkit.rooms.wraps.config import WrapConfig
from toolkit.rooms.wraps.wrap import write_wrap
from toolkit.rooms.wraps.wrap_plan import plan_wrap


@pytest.fixture(scope="module")
def space(tmp_path_factory, make_crate_space):
    """A crate with a wrap, shot at two poses, and a photograph of which no camera is known."""
    space = make_crate_space(tmp_path_factory.mktemp("view") / "w")
    shoot_plan(space, open_plan(space), ["crate"])
    item = load_object(space.object_spec("crate"))
    write_wrap(space.wraps_dir / "crate", plan_wrap(item, WrapConfig(sheet_mm=(62, 102), views=8, texel_mm=2.0)))
    photo = space.captures_dir / "real/crate/patched/1.png"
    photo.parent.mkdir(parents=True)
    Image.new("RGB", (32, 24), "red").save(photo)
    return space


def read_nodes(server) -> dict[str, dict]:
    """The messages that a browser gets, by the name of their node; the form is that of viser's own recordings."""
    import msgspec
    import zstandard

    content = server.get_scene_serializer().serialize()
    plain = zstandard.ZstdDecompressor().decompressobj().decompress(content[8:])
    told = msgspec.msgpack.decode(plain[8 : 8 + int.from_bytes(plain[:8], "little")])
    found: dict[str, dict] = {}

    def collect(part) -> None:
        if isinstance(part, dict):
            if isinstance(part.get("name"), str):
                found.setdefault(part["name"], {}).update(part)
            for one in part.values():
                collect(one)
        elif isinstance(part, list | tuple):
            for one in part:
                collect(one)

    collect(told)
    return found


def test_the_scene_has_object_pieces_and_cameras(space):
    pytest.importorskip("viser", reason="needs the extra view")
    view = gather_view(space)
    server = open_viewer()
    try:
        show_view(server, view)
        with urllib.request.urlopen(f"http://127.0.0.1:{server.get_port()}", timeout=30) as page:
            assert page.status == 200
        nodes = read_nodes(server)
    finally:
        server.stop()
    numbers = range(1, len(view.pieces["wrap"].faces) + 1)
    assert len(numbers) > 1
    expected = {"/table", "/object", *(f"/wrap/{what}{k}" for k in numbers for what in ("piece ", "numbers/"))}
    expected |= {f"/plan/pose {k}" for k in (1, 2)}
    expected |= {f"/captures/sim/{variant}/pose {k}" for variant in ("patched", "unpatched") for k in (1, 2)}
    assert expected <= set(nodes)
    assert not [name for name in nodes if "real" in name]
    record = read_manifest(space.captures_dir / "sim")["crate/patched/pose_01.jpg"]
    T_world_camera = np.array(record.T_world_camera)
    told = nodes["/captures/sim/patched/pose 1"]
    assert told["position"] == pytest.approx(T_world_camera[:3, 3] / 1000, abs=1e-6)
    assert told["wxyz"] == pytest.approx(as_quaternion(T_world_camera[:3, :3]), abs=1e-6)


def test_cameras_are_as_the_plan_and_the_manifest_have_them(space):
    view = gather_view(space, "crate", ["sim"])
    plan = read_plan(space.plan_file)
    frusta = {one.name: one for one in view.frusta}
    fov = np.degrees(frusta["/plan/pose 1"].fov)
    assert fov == pytest.approx(2 * np.degrees(np.arctan(plan.camera.height / 2 / plan.camera.fy)))
    for name, one in frusta.items():
        if one.capture is not None:  # shot as planned: the same frustum
            planned = frusta[f"/plan/{name.rsplit('/', 1)[1]}"]
            np.testing.assert_allclose(one.T_world_camera, planned.T_world_camera, atol=1e-6)
            assert (one.fov, one.aspect) == pytest.approx((planned.fov, planned.aspect))
    count = len(view.pieces["wrap"].faces)
    assert view.left_out == ()
    assert list(view.lines()) == [f"crate: 2 planned poses, 4 images, {count} pieces of its wrap"]


def test_looking_at_an_object_that_the_plan_lacks_changes_no_file(space):
    before = space.plan_file.read_bytes()
    assert [frustum.capture for frustum in gather_view(space, "racer").frusta] == []
    assert space.plan_file.read_bytes() == before


def test_images_without_a_camera_are_named(space):
    assert gather_view(space).left_out == (("real/crate/patched/1.png", "its camera is not known"),)


def test_a_quaternion_turns_as_its_matrix():
    rng = np.random.default_rng(4)
    for _ in range(5):
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        rotation = q @ np.diag(np.sign(np.diag(r)))
        rotation = rotation * np.linalg.det(rotation)
        w, *v = as_quaternion(rotation)
        point = rng.normal(size=3)
        # Rodrigues' formula for a unit quaternion
        turned = point + 2 * w * np.cross(v, point) + 2 * np.cross(v, np.cross(v, point))
        np.testing.assert_allclose(turned, rotation @ point, atol=1e-9)


def test_what_cannot_be_shown_in_one_line(space, tmp_path, monkeypatch):
    empty = make_workspace(tmp_path / "empty")
    assert "which object?" in error_of(lambda: gather_view(empty))
    assert "nosuch" in error_of(lambda: gather_view(space, "nosuch"))
    assert "nosuch" in error_of(lambda: gather_view(space, "crate", ["nosuch"]))
    bare = gather_view(empty, "eggnog")  # an object alone is something to see
    assert bare.frusta == () and replace(bare).item.name == "eggnog"
    monkeypatch.setitem(sys.modules, "viser", None)
    assert "pip install '.[view]'" in error_of(open_viewer)


def test_a_taken_port_is_told():
    pytest.importorskip("viser", reason="needs the extra view")
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        assert "taken by another program" in error_of(lambda: open_viewer(busy.getsockname()[1]))


def test_without_the_extra_the_command_says_so(space, type_toolkit, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    code, _, err = type_toolkit("view", "--workspace", space.root)
    assert code == 2 and "'.[view]'" in err and len(err.strip().splitlines()) == 1


def test_the_command_serves_until_it_is_interrupted(space):
    pytest.importorskip("viser", reason="needs the extra view")
    words = [sys.executable, "-u", "-m", "toolkit", "view", "--object", "crate", "--workspace", str(space.root)]
    # a shell that runs the tests in the background lets its children ignore Ctrl-C
    heed = partial(signal.signal, signal.SIGINT, signal.default_int_handler)
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True, preexec_fn=heed) as running:
        said = []
        for line in running.stdout:
            said.append(line)
            if found := re.search(r"open (http://127\.0\.0\.1:\d+)", line):
                with urllib.request.urlopen(found[1], timeout=30) as page:
                    assert b"<html" in page.read().lower()
                running.send_signal(signal.SIGINT)
                break
        _, errors = running.communicate(timeout=60)
    assert running.returncode == 0 and "Traceback" not in errors
    assert "2 planned poses, 4 images" in "".join(said) and "its camera is not known" in errors
