"""Put another patch into photographs of a printed patch, with their own paper, inks, light, lens and noise.

What `toolkit retexture` runs: `captures/retextured/OBJECT/VARIANT`, which `eval` reads as any capture folder.
"""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import ExifTags, JpegImagePlugin

from toolkit import __version__
from toolkit.captures.manifest import CaptureRecord, append_record, is_finished, read_manifest
from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError
from toolkit.core.files import sha256_bytes, write_bytes
from toolkit.core.text import is_file_name
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import delta_e2000, lab_of_linear, srgb_to_linear
from toolkit.imaging.preprocessing import resize_and_crop
from toolkit.imaging.read import decode_image, encode_image, open_image
from toolkit.models.network import Classifier
from toolkit.models.predict import predict
from toolkit.rooms.photos.config import RetextureConfig
from toolkit.rooms.photos.photo import SUFFIXES, Photo, load_pixels, read_photo
from toolkit.rooms.photos.prints.find import rectify_patch
from toolkit.rooms.photos.prints.fitted_photo import (
    FittedPhoto,
    KnownPatch,
    fit_photo,
    list_files,
    read_known,
    use_each,
)
from toolkit.rooms.photos.prints.look import read_texels

RETEXTURED = "retextured"
AS_TAKEN = "as-taken"
CONTROL_GREY = 128
JPEG_QUALITY = 95
ORIENTATION = 0x0112
PICTURES = Work("retextured picture", 3)


@dataclass(frozen=True)
class RetextureRun:
    """Result of a run.

    Attributes:
        folder: `captures/retextured`.
        object: name of the object's folder.
        variants: names, each with as many images as photographs.
        photos: (file's name, facts) of each photograph that was used.
        skipped: (path, reason) of the others.
        bare: number of true photographs without a patch.
        paired: whether these are paired with the others, in the order that both were given.
    """

    folder: Path
    object: str
    variants: tuple[str, ...]
    photos: tuple[tuple[str, dict[str, Any]], ...]
    skipped: tuple[tuple[str, str], ...]
    bare: int
    paired: bool


def make_controls(size_px: int, seed: int) -> dict[str, KnownPatch]:
    """By variant: a grey patch, and a patch of random texels."""
    grey = np.full((size_px, size_px, 3), CONTROL_GREY, np.uint8)
    noise = Draws(seed, 0, "retexture").of("random patch").integers(0, 256, (size_px, size_px, 3), np.uint8)
    return {"grey-patch": KnownPatch("grey", grey), "random-patch": KnownPatch("random", noise)}


def retexture(workspace: Workspace, photos: Sequence[Path], config: RetextureConfig) -> RetextureRun:
    """Put other patches in the place of a printed patch, into `captures/retextured/OBJECT/VARIANT`.

    A grey patch, a patch of random texels, and the photographs as they were taken come besides. `unpatched` are the
    true photographs without a patch. A picture from the same inputs is kept.

    Raises:
        ToolkitError: a patch is unknown, or none of the photographs shows it.
    """
    found = [read_known(workspace, name) for name in config.found]
    given = [read_known(workspace, name) for name in config.given]
    if not given:
        raise FieldError("expected the patch that takes the printed patch's place", {"given": ()})
    # the first two patches take the evaluation's names of variants
    names = ["patched", "other-patch", *(patch.name for patch in given[2:])]
    variants = dict(zip(names, given, strict=False)) | make_controls(given[0].pixels.shape[0], config.seed)
    name = config.object or _name_object(photos[0])
    root = workspace.source_dir(RETEXTURED)
    done = read_manifest(root) if root.is_dir() else {}
    # numbers are given before anything is opened: an unusable photograph leaves a gap, and moves no other
    files, bare_files = (list_files(given)[0] if given else [] for given in (photos, config.bare))
    paired = len(files) == len(bare_files)
    number_of = {file: number for number, file in enumerate(files, 1)}
    # true photographs take the others' numbers where as many are given, since a number is what pairs them
    bare_number_of = {file: number for number, file in enumerate(bare_files, 1 if paired else len(files) + 1)}
    bare, refused = (
        use_each("reading photographs without a patch", config.bare, read_photo) if config.bare else ([], [])
    )

    def put(file: Path) -> tuple[str, dict[str, Any]]:
        shot = _Shot(root, name, number_of[file], read_photo(file))
        return _retexture(shot, found, variants, config.seed, done)

    kept, skipped = use_each("retexturing", photos, put)
    # true photographs without a patch are copied as they are
    for photo in bare:
        shot, key = _Shot(root, name, bare_number_of[photo.path], photo), PICTURES.key(photo.sha256)
        if not is_finished(root, done.get(shot.path("unpatched")), key):
            shot.write_taken("unpatched", key)
    return RetextureRun(root, name, (*variants, AS_TAKEN), tuple(kept), (*skipped, *refused), len(bare), paired)


def _name_object(path: Path) -> str:
    folder = (path if path.is_dir() else path.parent).resolve().name
    if not is_file_name(folder):
        raise FieldError(f"give a name: the folder's, '{folder}', is not allowed", {"object": None})
    return folder


@dataclass(frozen=True)
class _Shot:
    """A photograph, and its number among those of an object below a folder of captures."""

    root: Path
    object: str
    number: int
    photo: Photo

    def path(self, variant: str) -> str:
        suffix = SUFFIXES[self.photo.kind] if self.photo.kind in ("jpeg", "png") else ".jpg"
        return f"{self.object}/{variant}/pose_{self.number:02d}{suffix}"

    def write(
        self, variant: str, key: str, content: bytes, made: dict[str, Any], booster_sha256: str | None = None
    ) -> None:
        write_bytes(self.root / self.path(variant), content, self.root.parent)
        append_record(self.root, CaptureRecord(
            path=self.path(variant), object=self.object, variant=variant, pose_id=self.number,
            booster_sha256=booster_sha256, image_sha256=sha256_bytes(content), inputs_sha256=key,
            made={"with": f"toolkit {__version__}"} | made,
        ))  # fmt: skip

    def write_taken(self, variant: str, key: str, booster_sha256: str | None = None) -> None:
        """Write the photograph as it was taken."""
        made = {"original_name": self.photo.name, "original_sha256": self.photo.sha256}
        self.write(variant, key, encode_like(self.photo, None), made, booster_sha256)


def _retexture(
    shot: _Shot, found: Sequence[KnownPatch], variants: dict[str, KnownPatch], seed: int, done: dict[str, CaptureRecord]
) -> tuple[str, dict[str, Any]]:
    """Name and facts of a photograph, its variants written."""
    photo = shot.photo
    # pictures of an earlier run are kept if their inputs are the same
    known = [patch.sha256 for patch in found]
    keys = {variant: PICTURES.key(photo.sha256, known, patch.sha256, seed) for variant, patch in variants.items()}
    keys[AS_TAKEN] = PICTURES.key(photo.sha256)
    records = {variant: done.get(shot.path(variant)) for variant in keys}
    finished = {variant for variant, record in records.items() if is_finished(shot.root, record, keys[variant])}
    # all is there: the facts were written by the earlier run
    first = records[next(iter(variants))]
    if first is not None and len(finished) == len(keys):
        return photo.name, dict(first.made[RETEXTURED])
    # fit the look of the photograph, then draw each patch by it
    fitted = fit_photo(photo.path, found)
    facts = fitted.facts()
    pictures = fitted.with_patches(list(variants.values()), Draws(seed, shot.number, "retexture"))
    for (variant, patch), picture in zip(variants.items(), pictures, strict=True):
        if variant not in finished:
            shot.write(variant, keys[variant], encode_like(photo, picture), {RETEXTURED: facts}, patch.sha256)
    if AS_TAKEN not in finished:
        shot.write_taken(AS_TAKEN, keys[AS_TAKEN], fitted.patch.sha256)
    return photo.name, facts


def encode_like(photo: Photo, picture: np.ndarray | None) -> bytes:
    """Encode a picture (h, w, 3) uint8 sRGB, upright, as the photograph is: JPEG with its tables and EXIF, or PNG.

    Its chroma is not subsampled: it was drawn as smooth as the photograph's. None is the photograph itself, by its own
    bytes if it is a JPEG or PNG.
    """
    if picture is None and photo.kind in ("jpeg", "png"):
        return photo.path.read_bytes()
    if picture is None:
        picture = load_pixels(photo)
    if photo.kind == "png":
        return encode_image(picture, "PNG")
    # what has no JPEG tables of its own is written with high quality
    how: dict[str, Any] = {"quality": JPEG_QUALITY}
    if photo.kind == "jpeg":
        with open_image(photo.path) as original:
            exif = original.getexif()
            if isinstance(original, JpegImagePlugin.JpegImageFile):
                # the camera's own tables, so that unchanged parts lose nothing again
                how = {"qtables": original.quantization}
        if len(exif):
            exif[ORIENTATION] = 1  # the picture is upright already, and sRGB, whatever the camera's colours were
            exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ColorSpace] = 1
            how["exif"] = exif.tobytes()
    return encode_image(picture, "JPEG", subsampling=0, **how)


RECTIFIED_PX = 400
BANDS = 4


@dataclass(frozen=True)
class PredictedPhoto:
    """A true photograph, predicted from another.

    Attributes:
        source, truth: names of the photographs; the same if its own patch was put back.
        delta_e: median ΔE00 of the texels' means.
        sharpness: root mean square of the luma's Laplacian over the patch, predicted over true.
        spectrum: the same for each octave of the straightened patch's luma, from fine to coarse.
        noise: deviation of luma within texels, predicted over true.
        answers: by network, the first answers on the predicted and on the true photograph.
        there: by network, the first answer on the true photograph with its own patch drawn by the source's look.
    """

    source: str
    truth: str
    delta_e: float
    sharpness: float
    spectrum: tuple[float, ...]
    noise: float
    answers: dict[str, tuple[str, str]]
    there: dict[str, str]


@dataclass(frozen=True)
class RetextureCheck:
    """Predictions of photographs that differ only in their patch, and of each from itself.

    Attributes:
        others: predicted from a photograph of another patch in the same place.
        own: the photograph's own patch, put back.
        same_scene: by network, how many pairs of photographs of the same place are answered alike with grey paper in
            both, and of how many: an upper limit for the predictions.
        skipped: (path, reason) of photographs that could not be used.
    """

    others: tuple[PredictedPhoto, ...]
    own: tuple[PredictedPhoto, ...]
    same_scene: dict[str, tuple[int, int]]
    skipped: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """All of it for a script."""
        return asdict(self) | {"summary": {"others": summarise(self.others), "own": summarise(self.own)}}


def summarise(rows: Sequence[PredictedPhoto]) -> dict[str, Any]:
    """Medians over predictions, and by network how many are answered alike, of how many; `alike_there` by `there`."""
    if not rows:
        return {"n": 0}
    networks = rows[0].answers
    return {
        "n": len(rows),
        "delta_e_median": round(float(np.median([row.delta_e for row in rows])), 2),
        "delta_e_p90": round(float(np.percentile([row.delta_e for row in rows], 90)), 2),
        "sharpness": round(float(np.median([row.sharpness for row in rows])), 3),
        "noise": round(float(np.median([row.noise for row in rows])), 3),
        "spectrum": [round(float(x), 3) for x in np.median([row.spectrum for row in rows], axis=0)],
        "alike": {name: [sum(len(set(row.answers[name])) == 1 for row in rows), len(rows)] for name in networks},
        "alike_there": {
            name: [sum(row.there[name] == row.answers[name][1] for row in rows), len(rows)] for name in networks
        },
    }


def check_retexture(
    workspace: Workspace, photos: Sequence[Path], found: Sequence[str], classifiers: Sequence[Classifier], seed: int = 0
) -> RetextureCheck:
    """Predict each photograph of a known patch from those of other patches in the same place, and compare.

    Names of photographs of the same place differ only in the name of the patch, as in `bear1_over.jpg` and
    `bear2_over.jpg`.

    Raises:
        ToolkitError: no photograph shows any of the patches.
    """
    patches = [read_known(workspace, name) for name in found]
    # a file's name may say which patch it shows: then the others are not looked for
    made, skipped = use_each(
        "fitting", photos, lambda file: fit_photo(file, [p for p in patches if p.name in file.stem] or patches)
    )
    fitted = {photo.photo.path.stem: photo for photo in made}
    answers = {stem: _ask(classifiers, photo.image) for stem, photo in fitted.items()}
    # pairs: each photograph predicts itself, and those of other patches in its place
    places = {stem: _place(stem, photo) for stem, photo in fitted.items()}
    # names that differ only in the patch's name mean the same place
    apart = [(a, b) for a, b in itertools.permutations(fitted, 2) if places[a] == places[b]]
    pairs = [(stem, stem) for stem in fitted] + apart
    rows = []
    with progress("comparing", len(pairs)) as bar:
        for number, (source, truth) in enumerate(pairs):
            rows.append(_predict(source, truth, fitted, answers, classifiers, Draws(seed, number, "retexture check")))
            bar.advance()
    own = tuple(row for row in rows if row.source == row.truth)
    others = tuple(row for row in rows if row.source != row.truth)
    same_scene = _same_scene(fitted, apart, classifiers, Draws(seed, 0, "retexture check grey"))
    return RetextureCheck(others, own, same_scene, tuple(skipped))


def _place(stem: str, photo: FittedPhoto) -> str | None:
    """Return a file's name without its patch's; a name without a patch has a place of its own."""
    return stem.replace(photo.patch.name, "", 1) if photo.patch.name in stem else f"\0{stem}"


def _same_scene(
    fitted: dict[str, FittedPhoto], pairs: Sequence[tuple[str, str]], classifiers: Sequence[Classifier], draws: Draws
) -> dict[str, tuple[int, int]]:
    answers = {}
    for stem in dict.fromkeys(stem for pair in pairs for stem in pair):
        photo = fitted[stem]
        (picture,) = photo.with_patches([make_controls(photo.patch.pixels.shape[0], 0)["grey-patch"]], draws)
        answers[stem] = _ask(classifiers, decode_image(encode_like(photo.photo, picture), photo.photo.path))
    both = [(answers[a], answers[b]) for a, b in pairs if a < b]
    return {
        classifier.name: (sum(a[classifier.name] == b[classifier.name] for a, b in both), len(both))
        for classifier in classifiers
    }


def _ask(classifiers: Sequence[Classifier], image: np.ndarray) -> dict[str, str]:
    """By network, its first answer."""
    crops = [resize_and_crop(image, network.preprocessing) for network in classifiers]
    return {
        network.name: network.labels[int(predict([crop], network).argmax())]
        for network, crop in zip(classifiers, crops, strict=True)
    }


def predict_texels(
    first: FittedPhoto, other: FittedPhoto, draws: Draws
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The other patch put into the first photograph, through JPEG and back; and its texels there and as they are.

    These are (n², 3) sRGB-encoded means, and (n²,) bool where they lie in both pictures.
    """
    # JPEG and back, since the true photograph went through it as well
    (picture,) = first.with_patches([other.patch], draws)
    predicted = decode_image(encode_like(first.photo, picture), first.photo.path)
    (said, shows), (seen, also) = (
        # all cells count: the two photographs hide different parts
        read_texels(
            image, replace(of.sighting, agreement=np.ones_like(of.sighting.agreement)), len(other.patch.pixels), of.look
        )
        for image, of in ((predicted, first), (other.image, other))
    )
    return predicted, said, seen, (shows > 0) & (also > 0)


def redraw(first: FittedPhoto, other: FittedPhoto, draws: Draws) -> np.ndarray:
    """The other photograph, its own patch drawn again in the colours, light, sharpness and noise of the first."""
    (picture,) = other.with_patches([other.patch], draws, first.look)
    return decode_image(encode_like(other.photo, picture), other.photo.path)


def _predict(
    source: str, truth: str, fitted: dict[str, FittedPhoto], answers: dict[str, dict[str, str]],
    classifiers: Sequence[Classifier], draws: Draws,
) -> PredictedPhoto:  # fmt: skip
    first, other = fitted[source], fitted[truth]
    # colours: ΔE00 of texels that show in both
    predicted, said, seen, good = predict_texels(first, other, draws)
    difference = delta_e2000(*(lab_of_linear(srgb_to_linear(values[good])) for values in (said, seen)))
    lumas = [
        # straightened to the same size, so that octaves mean the same in both
        cv2.cvtColor(
            rectify_patch(image, replace(of.sighting, warp=of.look.warp), RECTIFIED_PX), cv2.COLOR_RGB2GRAY
        ).astype(np.float32)
        for image, of in ((predicted, first), (other.image, other))
    ]
    # grain and sharpness, as ratios of the prediction to the photograph
    spectra = [_octaves(luma) for luma in lumas]
    sharp = [float(np.sqrt((cv2.Laplacian(luma, cv2.CV_32F) ** 2).mean())) for luma in lumas]
    noise = [_within_texels(luma, len(other.patch.pixels)) for luma in lumas]
    asked = _ask(classifiers, predicted)
    there = asked if source == truth or not classifiers else _ask(classifiers, redraw(first, other, draws))
    return PredictedPhoto(
        source, truth, float(np.median(difference)), sharp[0] / max(sharp[1], 1e-6),
        tuple(a / max(b, 1e-6) for a, b in zip(*spectra, strict=True)), noise[0] / max(noise[1], 1e-6),
        {name: (asked[name], answers[truth][name]) for name in asked}, there,
    )  # fmt: skip


def _octaves(luma: np.ndarray) -> list[float]:
    """Deviation of each octave, from fine to coarse (a Laplacian pyramid's)."""
    found = []
    for _ in range(BANDS):
        coarse = cv2.pyrDown(luma)
        found.append(float((luma - cv2.pyrUp(coarse, dstsize=luma.shape[::-1])).std()))
        luma = coarse
    return found


def _within_texels(luma: np.ndarray, n: int) -> float:
    """Median deviation of luma within the middle of a texel, codes."""
    side = max(luma.shape[0] // n, 4)
    wide = cv2.resize(luma, (side * n, side * n), interpolation=cv2.INTER_LINEAR)
    texels = wide.reshape(n, side, n, side).transpose(0, 2, 1, 3)
    # half of a texel's side: the other half holds its neighbours' blur
    inner = texels[:, :, side // 4 : side - side // 4, side // 4 : side - side // 4]
    return float(np.median(inner.std(axis=(2, 3))))
