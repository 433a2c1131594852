"""What `toolkit baseline` is asked for."""

from dataclasses import dataclass

from toolkit.benchmark.baselines.baseline import Baseline
from toolkit.benchmark.baselines.codes import APRILTAG, PAPER_BORDER, QR, AprilTags, QrCodes
from toolkit.benchmark.baselines.fixed_pattern import FixedPatterns
from toolkit.benchmark.baselines.photos import BestImages, RandomImages
from toolkit.benchmark.images import ImageSet
from toolkit.classifiers.network import Classifier
from toolkit.errors import ToolkitError, one_of
from toolkit.workspace import PATCH_SET_NAME

BEST_IMAGE, RANDOM_IMAGE, FIXED_PATTERN = "best-image", "random-image", "fixed-pattern"
KINDS = (QR, APRILTAG, BEST_IMAGE, RANDOM_IMAGE, FIXED_PATTERN)
NEED_DATA = (BEST_IMAGE, RANDOM_IMAGE)


@dataclass(frozen=True)
class BaselineRequest:
    """Patch sets of one kind to make.

    Attributes:
        kind: one of `KINDS`.
        class_names: labels, indices or WordNet ids; all that there are where none is named.
        sizes_px: sides of the pictures, a set for each.
        data: images, see `toolkit.benchmark.images.open_images`.
        set_name: of the sets, without the size; by default the kind.
        border: white modules around a code; None for one.
        seed: of every random draw.
    """

    kind: str
    class_names: tuple[str, ...] = ()
    sizes_px: tuple[int, ...] = (100,)
    data: str | None = None
    set_name: str | None = None
    border: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise one_of("baseline", self.kind, list(KINDS))
        if self.kind in NEED_DATA and self.data is None:
            raise ToolkitError(f"{self.kind}: expected training images, one folder per class: name them with --data")
        if self.border is not None and self.kind not in (QR, APRILTAG):
            raise ToolkitError(f"--border {self.border}: {self.kind} is no code and has none: leave it out")
        if self.set_name is not None and not PATCH_SET_NAME.fullmatch(self.set_name):
            raise ToolkitError(f"--set '{self.set_name}': expected letters, digits, '-' and '_'")

    def name_set(self, size_px: int) -> str:
        """Folder of the pictures of one size."""
        return f"{self.set_name or self.kind}-{size_px}"

    def prepare(self, images: ImageSet | None, classifier: Classifier) -> Baseline:
        """What makes the pictures."""
        classes, border = len(classifier.labels), PAPER_BORDER if self.border is None else self.border
        if self.kind == QR:
            return QrCodes(classes, border)
        if self.kind == APRILTAG:
            return AprilTags(classes, border)
        if self.kind == FIXED_PATTERN:
            return FixedPatterns(self.seed)
        assert images is not None, "checked when the request was made"
        if self.kind == BEST_IMAGE:
            return BestImages(images, classifier)
        return RandomImages(images, classifier, self.seed)
