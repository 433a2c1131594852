"""A workspace with a bit of everything that is read from files, and the functions that read it."""

import io
import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hostile_inputs import damaged, json_texts, toml_texts
from hypothesis import strategies as st
from PIL import Image

from toolkit.core.workspace import Workspace, open_workspace

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LENS = {"width": 640, "height": 480, "fx": 800.0, "fy": 800.0, "cx": 320.0, "cy": 240.0}


def draw_noise(seed: int = 0, size: tuple[int, int] = (96, 72)) -> Image.Image:
    return Image.fromarray(np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), np.uint8))


def encode(kind: str, seed: int = 0, **options) -> bytes:
    buffer = io.BytesIO()
    draw_noise(seed).save(buffer, kind, **options)
    return buffer.getvalue()


LABELS = ["crate", "box"]
EVAL = ("eval", "captures/real", "--model", "python:hostile_space:tell_crates", "--run", "run")


def put_result(space: Path, evaluated: dict[str, bytes], name: str = "old") -> Path:
    """Write the files of a result to eval/NAME."""
    folder = space / "eval" / name
    folder.mkdir(parents=True)
    for file, content in evaluated.items():
        (folder / file).write_bytes(content)
    return folder


def tell_crates():
    """A classifier of two labels, named `python:hostile_space:tell_crates`."""
    import torch

    class Brightness(torch.nn.Module):
        def forward(self, batch):
            means = batch.mean((1, 2, 3))
            return torch.stack([means, 1 - means], 1)

    return Brightness(), {"size": 32, "labels": LABELS}


def furnish(space: Workspace) -> None:
    """Add to a crate's workspace what else a session leaves behind."""
    from safetensors.numpy import save_file

    from toolkit.captures.manifest import CaptureRecord, append_record
    from toolkit.captures.shoot import shoot_plan
    from toolkit.core.files import sha256_bytes
    from toolkit.corruptions.folder import corrupt_images
    from toolkit.rig.board import DEFAULT_BOARD
    from toolkit.rig.board_file import BoardSpec, boards_dir, write_board, write_spec
    from toolkit.rig.plan import read_plan
    from toolkit.rooms.photos.gates import GateResult
    from toolkit.rooms.photos.gates.check_captures import append_check
    from toolkit.rooms.photos.gates.check_photo import PhotoCheck
    from toolkit.rooms.photos.shot_order import list_shots, order_shots, write_shots

    plan = read_plan(space.plan_file)
    # the renderer is compiled once on each machine: not within the time that an input has
    shutil.rmtree(shoot_plan(space, plan, ["crate"], ["unpatched"], source="first").source_dir)
    write_shots(space.root / "rig" / "shots.json", list_shots(plan, order_shots(plan, ["crate"])))
    write_board(space, DEFAULT_BOARD)
    spec = BoardSpec(
        kind="charuco", columns=7, rows=5, square_mm=30, marker_mm=22.5, dictionary="DICT_4X4_50", first_id=2
    )
    write_spec(boards_dir(space) / "card.toml", spec)
    lens = LENS | {
        "camera": "a phone", "focal_35mm_mm": 26.0, "distortion": [0.1, 0.0, 0.0, 0.0, 0.0], "reprojection_px": 0.3,
        "focal_sigma_px": 1.0, "views": 12, "coverage": 0.8,
    }  # fmt: skip
    (space.root / "rig" / "lens.json").write_text(json.dumps({"schema_version": 1, "lenses": [lens]}))
    for source in ("sim", "real"):
        folder = space.captures_dir / source
        for variant in ("unpatched", "patched"):
            for pose in plan.objects["crate"]:
                path = f"crate/{variant}/pose_{pose.id:02d}.jpg"
                content = encode("JPEG", pose.id + 10 * (variant == "patched"))
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                (folder / path).write_bytes(content)
                made = (
                    {"renderer": "raycast"} if source == "sim" else {"distortion": [0.1, 0.0], "original_sha256": "ab"}
                )
                append_record(folder, CaptureRecord(
                    path=path, object="crate", variant=variant, pose_id=pose.id, image_sha256=sha256_bytes(content),
                    T_world_camera=pose.matrix().tolist(), intrinsics=plan.camera.intrinsics, made=made,
                    booster_sha256="ab" * 32 if (source, variant) == ("sim", "patched") else None,
                ))  # fmt: skip
                gates = (GateResult("sharpness", 1.0, 2.0, "px", "failed", "again"),)
                append_check(folder, path, sha256_bytes(content), PhotoCheck(gates, None), "setup")
    photos = space.root / "photos"
    photos.mkdir()
    for kind, suffix in (
        ("JPEG", "jpg"),
        ("PNG", "png"),
        ("WEBP", "webp"),
        ("TIFF", "tif"),
        ("BMP", "bmp"),
        ("GIF", "gif"),
    ):
        (photos / f"pose_{len(suffix):02d}.{suffix}").write_bytes(encode(kind))
    corrupt_images(photos, space.root / "corrupted", [("fog", 1)])
    own = space.classifiers_dir
    own.mkdir(parents=True, exist_ok=True)
    save_file(
        {"fc.weight": np.zeros((2, 512), np.float32), "fc.bias": np.zeros(2, np.float32)}, own / "mine.safetensors"
    )
    labels = {
        "labels": ["crate", "box"], "arch": "resnet18", "resize_px": 64, "crop_px": 56, "mean": [0.5, 0.5, 0.5],
        "std": [0.2, 0.2, 0.2], "filter_name": "BILINEAR",
    }  # fmt: skip
    (own / "mine.json").write_text(json.dumps(labels))
    several = {"name": "several", "networks": ["several-01", "several-02"], "inputs_sha256": "ab" * 32}
    (own / "several.json").write_text(json.dumps(several))
    profile = {
        "schema_version": 1, "name": "p", "patch": "crate", "patch_sha256": "0" * 64, "model": "linear", "power": 2.2,
        "exponents": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "coefficients": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "paper_linear": [0.9, 0.9, 0.9], "photos": ["a"], "n_samples": 3, "strip_cells": 0,
        "without": {"median": 1.0, "p95": 2.0}, "held_out": {"median": 1.0, "p95": 2.0},
        "made": {"on": "2026-01-01", "with_version": "0", "by": None},
    }  # fmt: skip
    heads = "".join(
        f"property {kind}\n" for kind in ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue")
    )
    (space.root / "tiles").mkdir()
    (space.root / "tiles" / "road.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex 4\n{heads}element face 2\nproperty list uchar int vertex_indices\n"
        "end_header\n"
        "-1 -1 0 90 90 90\n1 -1 0 90 90 90\n1 1 0 90 80 90\n-1 1 0 90 90 90\n3 0 1 2\n3 0 2 3\n"
    )
    (space.root / "town.toml").write_text(
        'pieces = "tiles"\nscale = 10.0\ntile = 2.0\nrows = ["AA", "A "]\nplace = [{ piece = "road", yaw = 90.0 }]\n'
        '[legend]\nA = [{ piece = "road", at = [0.0, 0.0, 0.5], class = "ground" }]\n'
    )
    (space.root / "print" / "profiles").mkdir(parents=True)
    (space.root / "print" / "profiles" / "p.json").write_text(json.dumps(profile))


@dataclass(frozen=True)
class Reader:
    """A file of the workspace, what may become of it, and what reads it."""

    path: str
    read: Callable[[Path], object]
    kind: str = "json"

    def contents(self, whole: bytes) -> st.SearchStrategy[bytes]:
        """Bad versions of the file."""
        if self.kind == "json":
            return json_texts(json.loads(whole))
        if self.kind == "toml":
            return toml_texts(tomllib.loads(whole.decode()))
        if self.kind == "lines":
            lines = whole.splitlines()
            return st.lists(
                json_texts(json.loads(lines[0])).map(lambda line: line.replace(b"\n", b" ")), max_size=3
            ).map(lambda bad: b"\n".join([*bad, *lines])) | damaged(whole)
        return damaged(whole)


def _read_manifest(root: Path) -> None:
    from toolkit.captures.manifest import describe_transforms, read_manifest

    describe_transforms(list(read_manifest(root / "captures/real").values()))


def _read_captures(root: Path) -> None:
    from toolkit.captures.read import read_captures

    read_captures(root / "captures")


def _read_photo(file: str) -> Callable[[Path], object]:
    def read(root: Path) -> None:
        from toolkit.rooms.photos.photo import load_pixels, read_photo

        load_pixels(read_photo(root / file))

    return read


def _read_index(root: Path) -> None:
    from toolkit.rooms.photos.importing.gather import index_source

    index_source(root / "captures/real")


def _read_labels(root: Path) -> None:
    from toolkit.imaging.preprocessing import Preprocessing
    from toolkit.models.labels import adapt_preprocessing, choose_labels, read_labels_file

    weights = root / "rig/classifiers/mine.safetensors"
    own = read_labels_file(weights)
    adapt_preprocessing(Preprocessing(256, 224, (0, 0, 0), (1, 1, 1)), own)
    choose_labels(weights, own.labels, ["a"] * 1000, 2)


def _read_set(root: Path) -> None:
    from toolkit.models.find import read_set

    read_set("several", root / "rig/classifiers")


def _load_classifier(root: Path) -> None:
    from toolkit.models.load import load_classifier

    load_classifier("mine", None, "cpu", root / "rig/classifiers")


def _list_plan(root: Path) -> None:
    from toolkit.rig.plan import read_plan
    from toolkit.rooms.photos.shot_order import hash_poses, order_shots

    plan = read_plan(root / "rig/plan.json")
    for name in plan.objects:
        hash_poses(plan, name)
    order_shots(plan, list(plan.objects))


def _read_checks(root: Path) -> None:
    from toolkit.rooms.photos.gates.check_captures import read_checks

    read_checks(root / "captures/real", "setup")


def _read_card(root: Path) -> None:
    from toolkit.rig.board_file import with_board

    with_board(open_workspace(root), "card")


def _by(name: str, *arguments: str) -> Callable[[Path], object]:
    """`module:function` called with paths below the workspace, or with the workspace itself."""

    def read(root: Path) -> object:
        from importlib import import_module

        module, _, function = name.partition(":")
        given = [root / path for path in arguments] or [open_workspace(root)]
        return getattr(import_module(f"toolkit.{module}"), function)(*given)

    return read


MESH = "rig/objects/crate.obj"
READERS = {
    "plan": Reader("rig/plan.json", _list_plan),
    "shot list": Reader("rig/shots.json", _by("rooms.photos.shot_order:read_shots", "rig/shots.json")),
    "board": Reader("rig/board.json", _by("rig.board_file:read_board")),
    "card": Reader("rig/boards/card.toml", _read_card, "toml"),
    "lenses": Reader("rig/lens.json", _by("rooms.photos.lens:read_lenses")),
    "print profile": Reader(
        "print/profiles/p.json", _by("imaging.printer:read_print_profile", "print/profiles/p.json")
    ),
    "patch record": Reader("print/patches/crate.json", _by("objects.records:read_patch", "print/patches/crate.png")),
    "patch": Reader("print/patches/crate.png", _by("objects.records:read_patch", "print/patches/crate.png"), "bytes"),
    "labels": Reader("rig/classifiers/mine.json", _read_labels),
    "network set": Reader("rig/classifiers/several.json", _read_set),
    "weights": Reader("rig/classifiers/mine.safetensors", _load_classifier, "bytes"),
    "object": Reader("rig/objects/crate.toml", _by("objects.load:load_object", "rig/objects/crate.toml"), "toml"),
    "mesh": Reader(MESH, _by("objects.load:load_object", "rig/objects/crate.toml"), "bytes"),
    "kit": Reader("town.toml", _by("rooms.worlds.own:load_kit", "town.toml"), "toml"),
    "marker": Reader("toolkit.toml", _by("core.workspace:open_workspace", "."), "toml"),
    "manifest": Reader("captures/real/manifest.jsonl", _read_manifest, "lines"),
    "captures": Reader("captures/sim/manifest.jsonl", _read_captures, "lines"),
    "imported": Reader("captures/real/manifest.jsonl", _read_index, "lines"),
    "gates": Reader("captures/real/gates.jsonl", _read_checks, "lines"),
    "corrupted": Reader("corrupted/corrupted.jsonl", _by("corruptions.folder:read_finished", "corrupted"), "lines"),
    **{
        f"photo.{suffix}": Reader(
            f"photos/pose_{len(suffix):02d}.{suffix}", _read_photo(f"photos/pose_{len(suffix):02d}.{suffix}"), "bytes"
        )
        for suffix in ("jpg", "webp", "tif")
    },
    "picture": Reader("photos/pose_03.png", _by("imaging.read:read_image", "photos/pose_03.png"), "bytes"),
}
