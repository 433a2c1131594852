"""What lies on the images, and who answers, a network or a reader of codes: the rows of the benchmark's table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from toolkit.benchmark.answers import NETWORK, NOT_DECODED, READER, RIGHT, UNPATCHED, WRONG
from toolkit.boosters.baselines.codes import APRILTAG, DICTIONARIES, QR, tag_dictionary
from toolkit.boosters.patch_sets import PatchSet, read_patch_set
from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.workspace import Workspace
from toolkit.corruptions.digital import to_bytes

if TYPE_CHECKING:
    import torch

Decode = Callable[[np.ndarray], Sequence[str]]
PYZBAR = "pip install pyzbar, and the library zbar itself: on Debian apt install libzbar0"


@dataclass(frozen=True)
class Reader:
    """A library that reads codes.

    Attributes:
        name: of the library.
        version: of the library.
        decode: (h, w) uint8 grey -> the texts of all codes in it.
    """

    name: str
    version: str
    decode: Decode

    def read(self, picture: np.ndarray) -> tuple[str, ...]:
        """The texts of all codes in a picture, (h, w, 3) uint8 sRGB; none where it finds or understands none."""
        if picture.size == 0:
            return ()
        # grey for all: pyzbar takes the first channel of an array for it, and zxing-cpp expects BGR
        grey = cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY)
        return tuple(text for text in self.decode(grey) if text)


def find_readers(kind: str, dictionary: str = "36h11") -> tuple[list[Reader], list[tuple[str, str]]]:
    """The readers of a kind of code that are installed, and (name, reason) of those that are not.

    Args:
        kind: `qr` or `apriltag`.
        dictionary: family of the AprilTags, `36h11` or `36h10`; the code's record names it.

    Raises:
        ToolkitError: unknown kind or family.
    """
    if kind == APRILTAG:
        if dictionary not in DICTIONARIES:
            raise one_of("family of AprilTags", dictionary, list(DICTIONARIES))
        return [Reader("opencv", cv2.__version__, partial(_read_tags, dictionary))], []
    if kind != QR:
        raise one_of("code", kind, [QR, APRILTAG])
    readers, missing = [], []
    try:
        import zxingcpp  # noqa: F401

        readers.append(Reader("zxing-cpp", version("zxing-cpp"), _read_zxing))
    except ImportError:
        missing.append(("zxing-cpp", "not installed: pip install zxing-cpp"))
    try:
        import pyzbar.pyzbar  # noqa: F401

        readers.append(Reader("pyzbar", f"{version('pyzbar')}, zbar {_zbar_version()}", _read_zbar))
    except ImportError:  # raised as well where only zbar's own library is missing
        missing.append(("pyzbar", f"not installed: {PYZBAR}"))
    readers.append(Reader("opencv", cv2.__version__, _read_opencv))
    return readers, missing


def judge_texts(texts: Sequence[str], truth: str) -> int:
    """`RIGHT` where the true text is among those that were read, `NOT_DECODED` where none was, else `WRONG`."""
    if truth in texts:
        return RIGHT
    return WRONG if texts else NOT_DECODED


def read_codes(reader: Reader, images: "torch.Tensor", truths: Sequence[str]) -> np.ndarray:
    """What a reader makes of images.

    The images are rounded to 8 bits. The paper's release casts them as `255 * uint8(x)`, which blackens every pixel
    below full white: under noise, fog, JPEG or a changed contrast its reader is shown nothing.

    Args:
        reader: reads.
        images: (b, 3, h, w) float sRGB-encoded in [0, 1].
        truths: text of the code in each.

    Returns:
        (b,) int32, `RIGHT`, `WRONG` or `NOT_DECODED`.
    """
    pictures = to_bytes(images)
    ranks = [judge_texts(reader.read(one), truth) for one, truth in zip(pictures, truths, strict=True)]
    return np.array(ranks, np.int32)


def _read_zxing(grey: np.ndarray) -> list[str]:
    import zxingcpp

    return [code.text for code in zxingcpp.read_barcodes(grey, formats=zxingcpp.barcode_formats_from_str("QRCode"))]


def _read_zbar(grey: np.ndarray) -> list[str]:
    from pyzbar.pyzbar import ZBarSymbol, decode

    # of this one kind alone: the decoders of bar codes write warnings to stderr
    return [code.data.decode(errors="replace") for code in decode(grey, symbols=[ZBarSymbol.QRCODE])]


def _zbar_version() -> str:
    from ctypes import byref, c_uint

    from pyzbar.wrapper import zbar_version

    major, minor = c_uint(), c_uint()
    zbar_version(byref(major), byref(minor))
    return f"{major.value}.{minor.value}"


def _read_opencv(grey: np.ndarray) -> list[str]:
    try:
        return [cv2.QRCodeDetector().detectAndDecode(grey)[0]]
    except cv2.error:  # a shape that it takes for a code can fail its own checks
        return []


def _read_tags(dictionary: str, grey: np.ndarray) -> list[str]:
    detector = cv2.aruco.ArucoDetector(tag_dictionary(dictionary), cv2.aruco.DetectorParameters())
    try:
        ids = detector.detectMarkers(grey)[1]
    except cv2.error:
        return []
    return [] if ids is None else [str(index) for index in ids.ravel()]


@dataclass(frozen=True)
class Answerer:
    """A classifier, or a reader of codes."""

    network: Any = None
    reader: Reader | None = None

    @property
    def name(self) -> str:
        """Of the network or the library."""
        return self.network.name if self.reader is None else self.reader.name

    @property
    def kind(self) -> str:
        """`network` or `reader`."""
        return NETWORK if self.reader is None else READER

    @property
    def address(self) -> list[str]:
        """All of it that decides an answer."""
        if self.reader is not None:
            return [READER, self.reader.name, self.reader.version]
        return [self.network.arch, self.network.weights.sha256]


@dataclass(frozen=True)
class Variant:
    """One way of showing the images.

    Attributes:
        name: `unpatched`, or that of the patch set.
        patches: None for `unpatched`.
        classifier: whose preprocessing the images get, and who answers.
        readers: answer as well, where the patches are codes.
    """

    name: str
    patches: PatchSet | None
    classifier: Any
    readers: tuple[Reader, ...] = ()

    @property
    def answerers(self) -> tuple[Answerer, ...]:
        """The network, then the readers."""
        return (Answerer(self.classifier), *(Answerer(reader=reader) for reader in self.readers))


def open_variants(
    workspace: Workspace, words: Sequence[str], classifier: Any, load: Callable[[str], Any]
) -> tuple[list[Variant], list[str]]:
    """`unpatched`, once for each network, and the variants that `SET` or `SET@MODEL` name.

    Args:
        workspace: whose `print/patches` holds the sets.
        words: as on the command line.
        classifier: who answers where no other is named.
        load: the classifier of a name.

    Returns:
        The variants, and notes on readers that are not installed.

    Raises:
        ToolkitError: an unknown set or model, a set of other classes, a patch that is larger than the network's image,
            or networks that do not share their labels.
    """
    networks: dict[str, Any] = {"": classifier}
    boosted: list[Variant] = []
    notes: list[str] = []
    for word in dict.fromkeys(words):
        name, _, model = word.partition("@")
        network = networks.setdefault(model, None) or load(model)
        networks[model] = network
        if network.labels != classifier.labels:
            raise ToolkitError(
                f"--patches {word}: {network.name} answers with other classes than {classifier.name}: evaluate it in a "
                f"run of its own, with --model {model}"
            )
        patches = read_patch_set(workspace, name, network.labels)
        crop_px = network.preprocessing.crop_px
        if patches.n_px > crop_px:
            raise ToolkitError(
                f"--patches {name}: its patches of {patches.n_px} px are larger than the {crop_px} px that "
                f"{network.name} sees: make smaller ones with --size"
            )
        readers, missing = _find_readers(patches)
        notes += [f"{name} is not read by {reader}: {reason}" for reader, reason in missing]
        boosted.append(Variant(name, patches, network, tuple(readers)))
    distinct = {(one.name, one.weights.sha256): one for one in networks.values()}
    names = [name for name, _ in distinct]
    for name in names:
        if names.count(name) > 1:
            raise ToolkitError(f"two networks of this run are called '{name}': evaluate them in runs of their own")
    variants = [Variant(UNPATCHED, None, classifier)]
    for variant in boosted:
        if all(one.classifier.name != variant.classifier.name for one in variants):
            variants.append(Variant(UNPATCHED, None, variant.classifier))
        variants.append(variant)
    return variants, list(dict.fromkeys(notes))


def _find_readers(patches: PatchSet) -> tuple[list[Reader], list[tuple[str, str]]]:
    if patches.code_kind is None:
        return [], []
    code = next(iter(patches.patches.values())).record.settings["code"]
    return find_readers(code["kind"], code.get("dictionary", ""))


def share_classes(variants: Sequence[Variant], available: Sequence[int]) -> list[int]:
    """Classes that have images and a picture in every set: all variants are shown the same images.

    Raises:
        ToolkitError: there is none.
    """
    shared = set(available)
    for variant in variants:
        if variant.patches is not None:
            shared &= set(variant.patches.patches)
            if not shared:
                raise ToolkitError(
                    f"set '{variant.name}' has no picture for any class that has images and is in the other sets: make "
                    "one for them, or evaluate the sets in runs of their own"
                )
    return sorted(shared)
