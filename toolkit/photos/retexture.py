"""Put another patch into photographs of a printed one, with their own paper, inks, light, lens and noise.

What `toolkit retexture` runs: `captures/retextured/OBJECT/VARIANT`, which `eval` reads as any capture folder.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, JpegImagePlugin

from toolkit import __version__
from toolkit.captures.manifest import CaptureRecord, append_record, is_finished, read_manifest
from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import sha256_bytes, write_bytes
from toolkit.core.names import is_file_name
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import open_image, read_image
from toolkit.objects.records import encode_png
from toolkit.photos.photo import SUFFIXES, Photo, list_photos, load_pixels, read_photo
from toolkit.photos.prints.features import Features
from toolkit.photos.prints.find import PatchSighting, SearchedPhoto, find_patch, search_photo
from toolkit.photos.prints.look import PrintedLook, Scene, fit_look
from toolkit.photos.retexture_config import RetextureConfig

RETEXTURED = "retextured"
AS_TAKEN = "as-taken"
CONTROL_GREY = 128
LEAST_SHOWN = 0.5
MOST_TEXELS = 1024
JPEG_QUALITY = 95
ORIENTATION = 0x0112
VERSION = 1
"""Raised when the same photograph and patches give other pixels."""


@dataclass(frozen=True)
class KnownPatch:
    """A patch's name and pixels (n, n, 3) uint8 sRGB; `sha256` is of its PNG."""

    name: str
    pixels: np.ndarray

    @property
    def sha256(self) -> str:
        """Of these pixels as a PNG."""
        return sha256_bytes(encode_png(self.pixels))


@dataclass(frozen=True)
class FittedPhoto:
    """A photograph whose printed patch was found and fitted.

    Attributes:
        photo: the file.
        image: (h, w, 3) uint8 sRGB, upright.
        patch: that is printed in it.
        sighting: where it was found.
        look: what printer, light and camera made of it.
    """

    photo: Photo
    image: np.ndarray
    patch: KnownPatch
    sighting: PatchSighting
    look: PrintedLook

    def with_patches(self, patches: Sequence[KnownPatch], draws: Draws) -> list[np.ndarray]:
        """The photograph with each patch in the printed one's place, (h, w, 3) uint8 sRGB."""
        scene, pictures = Scene(self.image, self.look, self.patch.pixels), []
        for patch in patches:
            part = scene.put(patch.pixels, draws.of(f"noise {patch.name}"))
            whole = self.image.copy()
            whole[scene.top : scene.top + len(part), scene.left : scene.left + part.shape[1]] = part
            pictures.append(whole)
        return pictures

    def facts(self) -> dict[str, Any]:
        """For the manifest: what was found and how well it was fitted."""
        look = self.look
        return {
            "found": self.patch.name, "found_sha256": self.patch.sha256, "original_sha256": self.photo.sha256,
            "original_name": self.photo.name, "confidence": round(self.sighting.confidence, 4),
            "corners_px": look.warp.corners.round(2).tolist(), "side_px": round(look.warp.side_px, 1),
            "delta_e": round(look.delta_e, 2), "shown": round(look.shown, 3),
            "noise_codes": (255 * look.noise[:, 0]).round(2).tolist(), "grain_px": look.grain_px.round(2).tolist(),
            "light": look.light.round(4).tolist(),
        }  # fmt: skip


@dataclass(frozen=True)
class RetextureRun:
    """What a run made.

    Attributes:
        folder: `captures/retextured`.
        object: name of the object's folder.
        variants: names, each with as many images as photographs.
        photos: (file's name, facts) of each photograph that was used.
        skipped: (path, reason) of those that could not be.
        bare: how many true photographs without a patch lie beside them.
        paired: whether these are paired with the others.
    """

    folder: Path
    object: str
    variants: tuple[str, ...]
    photos: tuple[tuple[str, dict[str, Any]], ...]
    skipped: tuple[tuple[str, str], ...]
    bare: int
    paired: bool


def read_known(workspace: Workspace, wanted: str) -> KnownPatch:
    """A patch by its name, or any square PNG of texels by its path.

    Raises:
        ToolkitError: there is none of the name, or the picture is not square or has too many pixels for texels.
    """
    path = Path(wanted)
    file = path if path.suffix.lower() == ".png" else workspace.patch(wanted)
    pixels = read_image(file)
    h, w = pixels.shape[:2]
    if h != w or not 8 <= h <= MOST_TEXELS:
        raise ToolkitError(f"{file}: expected the square file that was printed, 8 to {MOST_TEXELS} texels, got {w}×{h}")
    return KnownPatch(file.stem, pixels)


def make_controls(size_px: int, seed: int) -> dict[str, KnownPatch]:
    """By variant: a grey patch, and one of random texels."""
    grey = np.full((size_px, size_px, 3), CONTROL_GREY, np.uint8)
    noise = Draws(seed, 0, "retexture").of("random patch").integers(0, 256, (size_px, size_px, 3), np.uint8)
    return {"grey-patch": KnownPatch("grey", grey), "random-patch": KnownPatch("random", noise)}


def fit_photo(file: Path, patches: Sequence[KnownPatch]) -> FittedPhoto:
    """Find which of some patches is printed in a photograph, and fit what was made of it.

    Raises:
        ToolkitError: none is there, it is there twice or mirrored, or too little of it shows.
    """
    photo = read_photo(file)
    image = load_pixels(photo)
    searched = search_photo(image)
    sightings = [(find_patch(searched, patch.pixels), patch) for patch in patches]
    seen = [(sighting, patch) for sighting, patch in sightings if sighting is not None]
    if not seen:
        for patch in patches:
            if find_patch(searched, np.ascontiguousarray(patch.pixels[:, ::-1])) is not None:
                raise ToolkitError(f"the patch '{patch.name}' is there mirrored: mirror the photograph, or the file")
        names = " or ".join(f"'{patch.name}'" for patch in patches)
        raise ToolkitError(f"the patch {names} was not found in it")
    sighting, patch = max(seen, key=lambda one: one[0].confidence)
    if sighting.shown < LEAST_SHOWN:
        raise ToolkitError(f"only {sighting.shown:.0%} of the patch '{patch.name}' shows, {LEAST_SHOWN:.0%} are needed")
    elsewhere = _without(searched, sighting)
    if find_patch(elsewhere, patch.pixels) is not None:
        raise ToolkitError(f"the patch '{patch.name}' is there twice: hide one of them")
    return FittedPhoto(photo, image, patch, sighting, fit_look(image, sighting, patch.pixels))


def _without(searched: SearchedPhoto, sighting: PatchSighting) -> SearchedPhoto:
    """The photo with the features of a place taken away, so that only another one is found."""
    places = searched.features.frames[:, :, 2] / searched.scale
    uv = sighting.warp.to_patch(places)
    kept = ~((uv > -0.1) & (uv < 1.1)).all(axis=1)
    features = Features(searched.features.frames[kept], searched.features.descriptors[kept])
    return replace(searched, features=features)


def retexture_photos(workspace: Workspace, photos: Sequence[Path], config: RetextureConfig) -> RetextureRun:
    """Put other patches in the place of a printed one, into `captures/retextured/OBJECT/VARIANT`.

    Beside those that are asked for come a grey patch and one of random texels, and the photographs as they were taken;
    `unpatched` are the true ones without a patch. One that was made from the same inputs before is kept.

    Args:
        workspace: where patches are known and the result goes.
        photos: photographs, or folders of them.
        config: what is found, and what takes its place.

    Raises:
        ToolkitError: a patch is unknown, or none of the photographs shows it.
    """
    files = list_files(photos)
    found = [read_known(workspace, name) for name in config.found]
    given = [read_known(workspace, name) for name in config.given]
    if not given:
        raise FieldError("expected the patch that takes the printed one's place", {"given": ()})
    names = ["patched", "other-patch", *(patch.name for patch in given[2:])]
    variants = dict(zip(names, given, strict=False)) | make_controls(given[0].pixels.shape[0], config.seed)
    name = config.object or _name_object(photos[0])
    root = workspace.source_dir(RETEXTURED)
    done, kept, skipped = read_manifest(root) if root.is_dir() else {}, [], []
    with progress("retexturing", len(files)) as bar:
        for number, file in enumerate(files, 1):
            try:
                kept.append(_retexture(root, name, number, file, found, variants, config.seed, done))
            except ToolkitError as error:
                skipped.append((str(file), str(error).removeprefix(f"{file}: ")))
            bar.advance(note=file.name)
    if not kept:
        raise ToolkitError(f"none of {len(files)} photographs could be used: {skipped[0][0]}: {skipped[0][1]}")
    bare = list_files(config.bare) if config.bare else []
    numbers = [number for number, _, _ in kept]
    paired = len(bare) == len(numbers)
    for k, file in enumerate(bare):
        number = numbers[k] if paired else len(files) + 1 + k
        photo = read_photo(file)
        if is_finished(root, done.get(_path(name, "unpatched", number, photo)), photo.sha256):
            continue
        made = {"with": f"toolkit {__version__}", "original_name": photo.name, "original_sha256": photo.sha256}
        content = encode_like(photo, None)
        _write(root, name, "unpatched", number, photo, content, None, made, photo.sha256)
    shown = tuple((one, facts) for _, one, facts in kept)
    return RetextureRun(root, name, (*variants, AS_TAKEN), shown, tuple(skipped), len(bare), paired)


def list_files(paths: Sequence[Path]) -> list[Path]:
    """Photographs that are named, and those in folders that are.

    Raises:
        ToolkitError: there are none.
    """
    files = [file for path in paths for file in (list_photos(path).photos if path.is_dir() else [path])]
    if not files:
        raise ToolkitError(f"{', '.join(map(str, paths))}: no photographs there")
    return files


def _name_object(path: Path) -> str:
    folder = (path if path.is_dir() else path.parent).resolve().name
    if not is_file_name(folder):
        raise FieldError(f"give a name: the folder's, '{folder}', cannot be one", {"object": None})
    return folder


def _retexture(
    root: Path, name: str, number: int, file: Path, found: Sequence[KnownPatch], variants: dict[str, KnownPatch],
    seed: int, done: dict[str, CaptureRecord],
) -> tuple[int, str, dict[str, Any]]:  # fmt: skip
    """Number, name and facts of one photograph, its variants written."""
    photo = read_photo(file)
    inputs = {
        variant: sha256_bytes(repr((VERSION, photo.sha256, [one.sha256 for one in found], patch.sha256, seed)).encode())
        for variant, patch in variants.items()
    }
    paths = {variant: _path(name, variant, number, photo) for variant in variants}
    records = [done.get(paths[variant]) for variant in variants]
    if all(is_finished(root, one, inputs[variant]) for one, variant in zip(records, variants, strict=True)):
        first = records[0]
        assert first is not None
        return number, photo.name, dict(first.made[RETEXTURED])
    fitted = fit_photo(file, found)
    facts = fitted.facts()
    made = {"with": f"toolkit {__version__}", RETEXTURED: facts}
    pictures = fitted.with_patches(list(variants.values()), Draws(seed, number, "retexture"))
    for (variant, patch), picture in zip(variants.items(), pictures, strict=True):
        content = encode_like(photo, picture)
        _write(root, name, variant, number, photo, content, patch.sha256, made, inputs[variant])
    taken = {"with": f"toolkit {__version__}", "original_name": photo.name, "original_sha256": photo.sha256}
    _write(root, name, AS_TAKEN, number, photo, encode_like(photo, None), fitted.patch.sha256, taken, photo.sha256)
    return number, photo.name, facts


def _suffix(photo: Photo) -> str:
    return SUFFIXES[photo.kind] if photo.kind in ("jpeg", "png") else ".jpg"


def _path(name: str, variant: str, number: int, photo: Photo) -> str:
    return f"{name}/{variant}/pose_{number:02d}{_suffix(photo)}"


def _write(
    root: Path, name: str, variant: str, number: int, photo: Photo, content: bytes, booster_sha256: str | None,
    made: dict[str, Any], inputs_sha256: str,
) -> None:  # fmt: skip
    path = _path(name, variant, number, photo)
    write_bytes(root / path, content, root.parent)
    append_record(root, CaptureRecord(
        path=path, object=name, variant=variant, pose_id=number, booster_sha256=booster_sha256,
        image_sha256=sha256_bytes(content), made=made, inputs_sha256=inputs_sha256,
    ))  # fmt: skip


def encode_like(photo: Photo, picture: np.ndarray | None) -> bytes:
    """A picture (h, w, 3) uint8 sRGB, upright, as the photograph's file is: JPEG with its tables and EXIF, or PNG.

    None is the photograph itself: its own bytes where it is a JPEG or PNG.
    """
    if picture is None and photo.kind in ("jpeg", "png"):
        return photo.path.read_bytes()
    if picture is None:
        picture = load_pixels(photo)
    buffer = io.BytesIO()
    if photo.kind == "png":
        Image.fromarray(picture).save(buffer, "PNG")
        return buffer.getvalue()
    how: dict[str, Any] = {"quality": JPEG_QUALITY}
    if photo.kind == "jpeg":
        with open_image(photo.path) as original:
            exif = original.getexif()
            if isinstance(original, JpegImagePlugin.JpegImageFile):
                how = {"qtables": original.quantization, "subsampling": JpegImagePlugin.get_sampling(original)}
        if len(exif):
            exif[ORIENTATION] = 1  # the picture is upright already
            how["exif"] = exif.tobytes()
        if how.get("subsampling") == -1:
            del how["subsampling"]
    Image.fromarray(picture).save(buffer, "JPEG", **how)
    return buffer.getvalue()
