"""Train a wrap from Python."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from toolkit.boosters.train import as_list
from toolkit.core.workspace import Workspace
from toolkit.models.network import Classifier
from toolkit.rooms.wraps import wrap_task
from toolkit.rooms.wraps.wrap_config import make_wrap_config
from toolkit.rooms.wraps.wrap_task import TrainedWrap


def train_wrap(
    workspace: Workspace, object_name: str, classifiers: Classifier | Sequence[Classifier], *,
    class_name: str | None = None, recipe: str = "default", backgrounds: Path | None = None,
    print_profile: Path | None = None, seed: int = 0, restart: bool = False, workers: int | None = None,
    **settings: Any,
) -> TrainedWrap:  # fmt: skip
    """Train what is on the flat pieces of an object's wrap, into `print/wraps/NAME`: a picture of each, and a record.

    The object's own plan is used, and a default plan is made if it has none. In training the pieces are printed, and
    stuck on a little beside their places. Interrupted runs resume, and a finished run is returned as it is.

    Args:
        workspace: whose object is meant, and where the wrap is written.
        object_name: of the object.
        classifiers: the networks that shall see its class; the labels and the preprocessing of the first lead.
        class_name: a label of the classifiers, an index, or a WordNet id; by default the object's own class.
        recipe: `default`.
        backgrounds: folder of photographs to stand behind the object.
        print_profile: file of a printer that was measured, in place of printers that are drawn.
        seed: of every random draw.
        restart: forget what an earlier run left.
        workers: threads that render ahead; 0: none; by default a thread for each core.
        settings: instead of the recipe's: steps, batch, lr and so on, by the names of
            `toolkit.rooms.wraps.wrap_config.WrapTrainConfig`; `misfit=False` sticks each piece exactly in its place.

    Returns:
        `wrap` (its `pixels` are (n, n, 3) uint8 sRGB, a texel is `wrap.record.texel_mm` millimetres), `files`, and per
        network its accuracy on held-out views with the wrap stuck on and in the object's own paint.

    Raises:
        ToolkitError: an unknown object, recipe or setting, a value out of its range, a plan of another mesh, no
            piece that lies flat, photographs that cannot be used, or the disk is full.

    Example:
        >>> _ = trimesh.creation.box((0.1, 0.06, 0.04)).export("crate.glb")
        >>> space, network = tk.make_workspace(Path("space")), tk.load_classifier("rig18")
        >>> _ = tk.add_object(space, Path("crate.glb"), tk.ObjectRequest(class_name="crate"))
        >>> with tk.quietly():
        ...     made = tk.train_wrap(space, "crate", network, class_name="warplane", steps=1, batch=2, workers=0)
        >>> made.wrap.record.class_name, made.wrap.pixels.shape[2]
        ('warplane', 3)
    """
    overrides = {**settings, "objects": (object_name,), "backgrounds": backgrounds, "seed": seed}
    config = make_wrap_config(recipe, overrides, print_profile)
    return wrap_task.train_wrap(
        config, as_list(classifiers), workspace, class_name=class_name, restart=restart, workers=workers
    )
