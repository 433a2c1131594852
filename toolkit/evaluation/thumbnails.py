"""Small copies of images, embedded in the report."""

import base64
import io
import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

from PIL import Image

from toolkit.captures.read import Capture
from toolkit.classifiers.network import Classifier
from toolkit.evaluation.corrupted import laid_on
from toolkit.evaluation.predict import CPU_BATCH, decode_ahead
from toolkit.images import UnreadableImage, read_image

SIDE_PX = 240
MAX_BYTES = 12_000
QUALITIES = (80, 65, 50, 35, 20)


def make_thumbnails(captures: Iterable[Capture], classifier: Classifier) -> dict[str, str]:
    """JPEG `data:` URIs of at most 12 kB by the image's path; an image that does not decode any more is left out.

    An image that is corrupted when it is read is shown as the network sees it, resized and cut.
    """
    wanted = list({capture.path: capture for capture in captures}.values())
    corrupted = [capture for capture in wanted if laid_on(capture) is not None]
    plain = [capture for capture in wanted if laid_on(capture) is None]
    with ThreadPoolExecutor(max(1, min(8, os.cpu_count() or 1))) as pool:
        made = pool.map(_make, plain)
        uris = {capture.path: uri for capture, uri in zip(plain, made, strict=True) if uri}
    for capture, pixels in zip(corrupted, decode_ahead(corrupted, classifier, CPU_BATCH), strict=True):
        if not isinstance(pixels, str):
            uris[capture.path] = encode_jpeg(Image.fromarray(pixels))
    return uris


def _make(capture: Capture) -> str | None:
    try:
        image = Image.fromarray(read_image(capture.file, SIDE_PX))
    except UnreadableImage:
        return None
    return encode_jpeg(image)


def encode_jpeg(image: Image.Image) -> str:
    """A picture as a JPEG `data:` URI of at most 240 px and, by its quality, 12 kB."""
    image.thumbnail((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS)
    content = b""
    for quality in QUALITIES:
        buffer = io.BytesIO()
        image.save(buffer, "JPEG", quality=quality, optimize=True)
        content = buffer.getvalue()
        if len(content) <= MAX_BYTES:
            break
    return "data:image/jpeg;base64," + base64.b64encode(content).decode("ascii")
