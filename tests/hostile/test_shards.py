"""Landing data sets from anybody: what lies in a shard is looked at before it is unpacked."""

import gzip
import io
import json
import lzma
import tarfile

import cv2
import numpy as np
import pytest
from hostile_checks import count, limited
from hostile_inputs import damaged, documents
from hypothesis import given
from hypothesis import strategies as st

from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_file
from toolkit.rooms.landing.dataset import DATASET, Sample, Truth, encode_sample, read_split
from toolkit.rooms.landing.regressor import pick_samples

SIDE = 32
TRUTH = Truth(
    index=0, seed=3, x_m=0.1, y_m=0.2, z_m=5, yaw_deg=0, place="a", time="noon", weather="clear", severity=0, seen_px=9
)
PARTS = encode_sample(Sample(np.zeros((SIDE, SIDE, 3), np.uint8), np.zeros((SIDE, SIDE), bool), TRUTH))
CAMERA = {"width": SIDE, "height": SIDE, "fx": 40.0, "fy": 40.0, "cx": 16.0, "cy": 16.0}
LARGE = 64 << 20


def describe(**changes):
    return {
        "inputs_sha256": "0" * 64, "seed": 3, "world": "grass", "world_seed": 0, "pad": "plain", "pad_sha256": "0" * 64,
        "size_m": 1.0, "camera": CAMERA, "places": {}, "settings": {}, "complete": True, "toolkit_version": "0",
        "shards": [{"file": "a.tar", "split": split, "n": 1, "sha256": "0" * 64} for split in ("train",)], **changes,
    }  # fmt: skip


def add(tar, name, content=b"", **facts):
    entry = tarfile.TarInfo(name)
    entry.size = len(content)
    for fact, value in facts.items():
        setattr(entry, fact, value)
    tar.addfile(entry, io.BytesIO(content))


def pack(parts=PARTS, more=None) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        if more:
            more(tar)
        for name, content in parts.items():
            add(tar, name, content)
    return buffer.getvalue()


def change(kind: str, content: bytes) -> dict[str, bytes]:
    return {name: content if name.endswith(kind) else one for name, one in PARTS.items()}


def encode(width: int, height: int) -> bytes:
    return cv2.imencode(".png", np.zeros((height, width), np.uint8))[1].tobytes()


SHARDS = {
    "gz bomb": lambda: gzip.compress(pack(change("json", b" " * LARGE))),
    "xz bomb": lambda: lzma.compress(pack(change("json", b" " * LARGE)), preset=0),
    "long truth": lambda: pack(change("json", b" " * LARGE)),
    "sparse": lambda: pack(more=lambda tar: add(
        tar, "0.json", b"x", pax_headers={"GNU.sparse.map": "0,1", "GNU.sparse.size": str(2**40)})),
    "link": lambda: pack(more=lambda tar: add(tar, "0.json", type=tarfile.SYMTYPE, linkname="/etc/passwd")),
    "hard link": lambda: pack(more=lambda tar: add(tar, "0.json", type=tarfile.LNKTYPE, linkname="/etc/passwd")),
    "device": lambda: pack(more=lambda tar: add(tar, "0.json", type=tarfile.CHRTYPE, devmajor=1, devminor=5)),
    "folder": lambda: pack(more=lambda tar: add(tar, "0.json", type=tarfile.DIRTYPE)),
    "way out": lambda: pack(more=lambda tar: add(tar, "../../x.y", b"")),
    "same twice": lambda: pack(more=lambda tar: add(tar, "0.json", PARTS["00000000.json"])),
    "large picture": lambda: pack(change("0.png", encode(9000, 9000))),
    "other size": lambda: pack(change("seg.png", encode(SIDE, SIDE + 1))),
    "deep truth": lambda: pack(change("json", b"[" * 100_000)),
    "no tar": lambda: b"hello" * 1000,
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("set")


def read(folder, content: bytes, about: dict | None = None):
    """The samples, by both readers, or None after a line; the shard's hash is right: it was made so."""
    (folder / "a.tar").write_bytes(content)
    about = describe() if about is None else about
    for shard in about["shards"] if isinstance(about.get("shards"), list) else ():
        if isinstance(shard, dict) and shard.get("file") == "a.tar" and "sha256" in shard:
            shard["sha256"] = sha256_file(folder / "a.tar")
    (folder / DATASET).write_text(json.dumps(about))
    count("shards")
    try:
        with limited():
            return read_split(folder, "train"), pick_samples(folder)
    except ToolkitError as error:
        said = str(error)
        assert "\n" not in said and len(said) < 800 and "Error" not in said, said
        return None


def test_a_whole_set_is_read(folder):
    found, picked = read(folder, pack())
    assert found.truths == (TRUTH,) and picked[0].truth == TRUTH


@pytest.mark.parametrize("kind", SHARDS)
def test_what_is_no_shard_is_a_line(folder, kind):
    assert read(folder, SHARDS[kind]()) is None


@pytest.mark.parametrize(
    "changes",
    [
        {"camera": CAMERA | {"width": 0}}, {"camera": CAMERA | {"fx": 0}}, {"camera": CAMERA | {"height": 10**6}},
        {"camera": {"width": SIDE}}, {"camera": CAMERA | {"fy": -1}}, {"shards": []},
        {"shards": describe()["shards"] * 60_000},
        {"shards": [describe()["shards"][0] | {"file": f"{k}.tar"} for k in range(60_000)]},
    ],
)  # fmt: skip
def test_a_description_that_cannot_be_is_a_line(folder, changes):
    assert read(folder, pack(), describe(**changes)) is None


@given(content=damaged(pack()))
def test_a_damaged_shard(folder, content):
    read(folder, content)


@given(about=documents(describe()))
def test_a_damaged_description(folder, about):
    if isinstance(about, dict):
        read(folder, pack(), about)


@given(at=st.integers(0, 8 * len(pack()) - 1))
def test_a_shard_in_which_a_bit_has_flipped_is_refused_by_its_hash(folder, at):
    content = bytearray(pack())
    (folder / "a.tar").write_bytes(content)
    about = describe()
    about["shards"][0]["sha256"] = sha256_file(folder / "a.tar")
    (folder / DATASET).write_text(json.dumps(about))
    assert read_split(folder, "train").truths == (TRUTH,)
    content[at // 8] ^= 1 << at % 8
    (folder / "a.tar").write_bytes(content)
    count("flipped bits")
    for call in (lambda: read_split(folder, "train"), lambda: pick_samples(folder)):
        with pytest.raises(ToolkitError, match=r"a\.tar"):
            call()
