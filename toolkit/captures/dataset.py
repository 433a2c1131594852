"""Captures as a `torch.utils.data.Dataset`: preprocessed images, their class and metadata."""

from collections.abc import Callable, Mapping
from typing import TypedDict

import numpy as np
import torch
from torch.utils.data import Dataset

from toolkit.captures.capture import Capture
from toolkit.captures.read import CaptureFolder, read_crop
from toolkit.core.errors import ToolkitError
from toolkit.imaging.preprocessing import Preprocessing
from toolkit.imaging.read import UnreadableImage


class CaptureInfo(TypedDict):
    """Metadata of an image, in types that PyTorch's `default_collate` joins into batches.

    Attributes:
        pose_id: number of the plan's pose; -1 if it is not known.
        T_world_camera: (4, 4) float32, OpenCV axes, millimetres; NaN if it is not known.
    """

    path: str
    source: str
    object: str
    variant: str
    pose_id: int
    T_world_camera: torch.Tensor


Sample = tuple[torch.Tensor, int, CaptureInfo]


class CaptureDataset(Dataset[Sample]):
    """Samples `(image, target, info)` of a capture folder, for a `DataLoader` with any workers.

    - `image`: (3, s, s) float32, sRGB-encoded in [0, 1], resized and cut for the network, not normalised: an input of
      `Classifier.logits` and `apply_patch`.
    - `target`: index of the object's class, -1 if `targets` does not name the object.
    - `info`: a `CaptureInfo`.

    Attributes:
        captures: images in the order of the samples.
        refused: (path, reason) of files that may not be opened, such as links out of the folder; they are no samples.
    """

    def __init__(
        self, folder: CaptureFolder, targets: Mapping[str, int], preprocessing: Preprocessing,
        transform: Callable[[torch.Tensor], torch.Tensor] | None = None,
    ) -> None:  # fmt: skip
        """Take the images of a folder, without reading them.

        Args:
            targets: class index of each object by name.
            transform: transform of the finished image; with workers it must be picklable.
        """
        # what cannot be shown is listed, not left out silently
        self.captures = tuple(capture for capture in folder.captures if capture.refused is None)
        self.refused = (
            *((capture.path, capture.refused) for capture in folder.captures if capture.refused is not None),
            *folder.refused_folders,
        )
        self.targets, self.preprocessing, self.transform = dict(targets), preprocessing, transform

    def __len__(self) -> int:
        return len(self.captures)

    def __getitem__(self, index: int) -> Sample:
        """Return a sample; an image that cannot be read is a `ToolkitError` that names it."""
        capture = self.captures[index]
        try:
            pixels = read_crop(capture, self.preprocessing)
        except UnreadableImage as error:
            raise ToolkitError(f"{capture.path}: {error.reason}: remove it from the folder, or correct it") from None
        image = torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).float().div_(255)
        if self.transform is not None:
            image = self.transform(image)
        return image, self.targets.get(capture.object, -1), _describe(capture)


def _describe(capture: Capture) -> CaptureInfo:
    rows = capture.T_world_camera
    # a batch needs a tensor of every sample: NaN means unknown
    T_world_camera = torch.full((4, 4), torch.nan) if rows is None else torch.tensor(rows, dtype=torch.float32)
    return CaptureInfo(
        path=capture.path, source=capture.source, object=capture.object, variant=capture.variant,
        pose_id=-1 if capture.pose_id is None else capture.pose_id, T_world_camera=T_world_camera,
    )  # fmt: skip
