"""Training images from the rig: renders of the bare object, kept on disk until the run is finished."""

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np

from toolkit import __version__
from toolkit.boosters.folder_data import Loaded
from toolkit.classifiers.preprocessing import Preprocessing, resize_and_crop
from toolkit.errors import ToolkitError
from toolkit.files import inside, sha256_bytes, sha256_file, write_bytes
from toolkit.objects.spec import read_spec
from toolkit.workspace import Workspace

RIG = "rig"


def is_rig_source(source: str) -> bool:
    """Whether `--data` asks for renders: `rig`, or `rig:OBJECT`. The folder of that name is `./rig`."""
    return source == RIG or source.startswith(f"{RIG}:")


def choose_object(workspace: Workspace, source: str, names: frozenset[str]) -> str:
    """The object to render: the one that is named after the colon, else the one whose class is trained.

    Raises:
        ToolkitError: there is none, or several have that class.
    """
    _, colon, name = source.partition(":")
    if colon:
        workspace.object_spec(name)
        return name
    specs = {name: read_spec(file) for name, file in workspace.object_specs().items()}
    fitting = [name for name, spec in specs.items() if str(spec.class_name).lower().replace("_", " ") in names]
    if len(fitting) == 1:
        return fitting[0]
    known = ", ".join(fitting or sorted(specs))
    what = "several objects have" if fitting else "no object has"
    raise ToolkitError(f"--data rig: {what} the class {' or '.join(sorted(names))}: say --data rig:NAME, of {known}")


def load_renders(
    workspace: Workspace, name: str, count: int, seed: int, how: Preprocessing, keep: Path, quiet: bool
) -> Loaded:
    """Render `count` images of an object, or take those that an interrupted run of the same inputs left in `keep`.

    Rendering takes longer than reading, and a GPU driver need not give the same bits twice: a run that goes on must
    see the images that it began with.
    """
    inputs = _hash_inputs(workspace.object_spec(name), count, seed, how)
    file = keep / f"renders-{inputs[:16]}.npy"
    record = {"source": f"{RIG}:{name}", "use": "class", "found": count, "used": count}
    kept = _read_kept(file, (count, how.resize_px, how.resize_px, 3))
    if kept is not None:
        return Loaded(kept, (), record)
    from toolkit.rig.training import render_training_images

    square = replace(how, crop_px=how.resize_px)
    renders = render_training_images(workspace, name, count, seed, quiet)
    images = np.stack([resize_and_crop(np.ascontiguousarray(render), square) for render in renders])
    buffer = BytesIO()
    np.save(buffer, images, allow_pickle=False)
    write_bytes(file, buffer.getvalue())
    return Loaded(images, (), record)


def _hash_inputs(spec_file: Path, count: int, seed: int, how: Preprocessing) -> str:
    spec = read_spec(spec_file)
    mesh = spec.mesh
    if not mesh.startswith("builtin:") and (path := inside(spec_file.parent, mesh)).is_file():
        mesh = sha256_file(path)
    inputs = [spec.model_dump(mode="json"), mesh, count, seed, how.resize_px, how.filter_name, __version__]
    return sha256_bytes(json.dumps(inputs).encode())


def _read_kept(file: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    try:
        images = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None  # absent or damaged: rendered anew
    return images if images.shape == shape and images.dtype == np.uint8 else None
