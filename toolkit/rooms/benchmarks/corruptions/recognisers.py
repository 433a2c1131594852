"""Recognisers of images: classifiers and readers of codes, with their answers as ranks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version

import cv2
import numpy as np
import torch

from toolkit.core.errors import one_of
from toolkit.corruptions.digital import to_bytes
from toolkit.models.network import Classifier, check_finite
from toolkit.models.predict import rank_true
from toolkit.rig.markers import find_markers
from toolkit.rooms.benchmarks.patch_sets.baselines.drawn import APRILTAG, DICTIONARIES, QR

NETWORK, READER = "network", "reader"
RIGHT, WRONG, NOT_DECODED = 1, 2, 0
"""Answers of a reader, as ranks."""
Decode = Callable[[np.ndarray], Sequence[str]]
RankImages = Callable[["torch.Tensor", np.ndarray, Sequence[str]], np.ndarray]
PYZBAR = "pip install pyzbar, and the library zbar itself: on Debian apt install libzbar0"


@dataclass(frozen=True)
class Recogniser:
    """A classifier, or a reader of codes.

    Attributes:
        kind: `network` or `reader`.
        identity: of its weights or version, for the keys of its answers.
        rank: images (b, 3, m, m) float, classes (b,) and texts of codes -> (b,) int32, the rank of the true class by a
            network, from 1, or `RIGHT`, `WRONG` or `NOT_DECODED` by a reader.
    """

    name: str
    kind: str
    identity: tuple[str, ...]
    rank: RankImages


def recognise_by_network(network: Classifier) -> Recogniser:
    """A classifier as recogniser."""
    identity = (network.arch, network.weights.sha256)
    return Recogniser(network.name, NETWORK, identity, partial(rank_classes, network))


def recognise_by_reader(reader: "Reader") -> Recogniser:
    """A reader of codes as recogniser."""
    identity = (READER, reader.name, reader.version)
    return Recogniser(reader.name, READER, identity, partial(_rank_codes, reader))


def _rank_codes(reader: "Reader", images: torch.Tensor, _: np.ndarray, texts: Sequence[str]) -> np.ndarray:
    return read_codes(reader, images, texts)


def rank_classes(network: Classifier, images: torch.Tensor, classes: np.ndarray, _: Sequence[str] = ()) -> np.ndarray:
    """(b,) int32, the rank of each image's class among the network's guesses, from 1; ties go to the lower index.

    Raises:
        BadAnswer: the network's output is not finite.
    """
    logits = network.logits(images).float()
    check_finite(logits, network.arch, network.weights)
    return rank_true(logits, torch.from_numpy(classes)).int().cpu().numpy()


@dataclass(frozen=True)
class Reader:
    """A library that reads codes; `decode` takes (h, w) uint8 grey and returns the texts of all codes in it."""

    name: str
    version: str
    decode: Decode

    def read(self, picture: np.ndarray) -> tuple[str, ...]:
        """Read the texts of all codes in a picture (h, w, 3) uint8 sRGB."""
        if picture.size == 0:
            return ()
        # grey for all: pyzbar reads the first channel of an array, and zxing-cpp expects BGR
        grey = cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY)
        # OpenCV returns an empty text if it reads nothing
        return tuple(text for text in self.decode(grey) if text)


def find_readers(kind: str, dictionary: str = "36h11") -> tuple[list[Reader], list[tuple[str, str]]]:
    """Find installed readers for a kind of code, `qr` or `apriltag`, and (name, reason) of the missing readers.

    `dictionary` is the family of AprilTags, `36h11` or `36h10`. Unknown kinds and families are a `ToolkitError`.
    """
    if kind == APRILTAG:
        if dictionary not in DICTIONARIES:
            raise one_of("family of AprilTags", dictionary, list(DICTIONARIES))
        return [Reader("opencv", cv2.__version__, partial(_read_tags, DICTIONARIES[dictionary]))], []
    if kind != QR:
        raise one_of("code", kind, [QR, APRILTAG])
    # readers of QR codes, if they are installed; OpenCV always is
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
    """Return `RIGHT` if the true text was read, `NOT_DECODED` if no text was, else `WRONG`."""
    if truth in texts:
        return RIGHT
    return WRONG if texts else NOT_DECODED


def read_codes(reader: Reader, images: torch.Tensor, truths: Sequence[str]) -> np.ndarray:
    """Rank images (b, 3, h, w) float sRGB-encoded by the true texts of their codes; (b,) int32, see `judge_texts`.

    The images are rounded to 8 bits. The paper's release casts them as `255 * uint8(x)`, which blackens every pixel
    below full white, so that its reader fails under noise, fog, JPEG or a changed contrast.
    """
    pictures = to_bytes(images)
    ranks = [judge_texts(reader.read(picture), truth) for picture, truth in zip(pictures, truths, strict=True)]
    return np.array(ranks, np.int32)


def _read_zxing(grey: np.ndarray) -> list[str]:
    import zxingcpp

    return [code.text for code in zxingcpp.read_barcodes(grey, formats=zxingcpp.barcode_formats_from_str("QRCode"))]


def _read_zbar(grey: np.ndarray) -> list[str]:
    from pyzbar.pyzbar import ZBarSymbol, decode

    # for this kind alone: the decoders of bar codes write warnings to stderr
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
    return [str(number) for number, _ in find_markers(dictionary, grey)]
