"""A photograph in which one of some known patches is printed: found, fitted, and with others in its place."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.read import read_image
from toolkit.objects.records import encode_png
from toolkit.photos.photo import Photo, list_photos, load_pixels, read_photo
from toolkit.photos.prints.features import Features
from toolkit.photos.prints.find import PatchSighting, SearchedPhoto, find_patch, search_photo
from toolkit.photos.prints.look import PrintedLook, Scene, fit_look

LEAST_SHOWN = 0.5
MOST_TEXELS = 1024


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


def list_files(paths: Sequence[Path]) -> list[Path]:
    """Photographs that are named, and those in folders that are.

    Raises:
        ToolkitError: there are none.
    """
    files = [file for path in paths for file in (list_photos(path).photos if path.is_dir() else [path])]
    if not files:
        raise ToolkitError(f"{', '.join(map(str, paths))}: no photographs there")
    return files
