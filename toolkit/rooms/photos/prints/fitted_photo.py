"""A photograph of a known printed patch: found, fitted, and with other patches in its place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np

from toolkit.boosters.pixel_config import count_held_out
from toolkit.core.console import progress
from toolkit.core.draws import Draws
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import srgb_to_linear
from toolkit.imaging.read import read_image
from toolkit.objects.records import encode_png
from toolkit.rig.mount import size_on_paper
from toolkit.rig.shading import SHOULDER, LinearView
from toolkit.rooms.photos.photo import Photo, list_photos, load_pixels, read_photo
from toolkit.rooms.photos.prints.align import PatchWarp
from toolkit.rooms.photos.prints.features import LocalFeatures, to_cv
from toolkit.rooms.photos.prints.find import PatchSighting, find_patch, search_photo, shrink_image
from toolkit.rooms.photos.prints.look import PatchScene, PrintedLook, fit_look, no_spread

if TYPE_CHECKING:
    from toolkit.boosters.mounted import MountedViews

T = TypeVar("T")

LEAST_SHOWN = 0.5
MOST_TEXELS = 1024


@dataclass(frozen=True)
class KnownPatch:
    """A patch's name and pixels (n, n, 3) uint8 sRGB."""

    name: str
    pixels: np.ndarray

    @property
    def sha256(self) -> str:
        """SHA-256 of these pixels as a PNG."""
        return sha256_bytes(encode_png(self.pixels))


@dataclass(frozen=True)
class FittedPhoto:
    """A photograph (h, w, 3) uint8 sRGB, upright, whose printed patch was found and fitted."""

    photo: Photo
    image: np.ndarray
    patch: KnownPatch
    sighting: PatchSighting
    look: PrintedLook

    def with_patches(
        self, patches: Sequence[KnownPatch], draws: Draws, look: PrintedLook | None = None
    ) -> list[np.ndarray]:
        """Draw each patch in place of the printed patch, (h, w, 3) uint8 sRGB, by this or another photograph's look."""
        # the same scene for all patches: what hides the printed patch is found once
        scene, pictures = PatchScene(self.image, self.look, self.patch.pixels), []
        # with another photograph's look, its colours and noise are drawn at this photograph's place
        if look is not None:
            look, hidden = replace(look, warp=self.look.warp, ripple=self.look.ripple), scene.hidden
            scene = PatchScene(self.image, look, self.patch.pixels)
            scene.hidden = hidden
        for patch in patches:
            part = scene.put(patch.pixels, draws.of(f"noise {patch.name}"))
            whole = self.image.copy()
            whole[scene.top : scene.top + len(part), scene.left : scene.left + part.shape[1]] = part
            pictures.append(whole)
        return pictures

    def facts(self) -> dict[str, Any]:
        """Facts of the fit for the manifest."""
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
    """Read a patch by its name, or any square PNG of texels by its path; others raise `ToolkitError`."""
    path = Path(wanted)
    file = path if path.suffix.lower() == ".png" else workspace.patch(wanted)
    pixels = read_image(file)
    h, w = pixels.shape[:2]
    if h != w or not 8 <= h <= MOST_TEXELS:
        raise ToolkitError(f"{file}: expected the square file that was printed, 8 to {MOST_TEXELS} texels, got {w}×{h}")
    return KnownPatch(file.stem, pixels)


def fit_photo(file: Path, patches: Sequence[KnownPatch]) -> FittedPhoto:
    """Find which of some patches is printed in a photograph, and fit its look.

    Raises:
        ToolkitError: none is there, it is there twice or mirrored, or too little of it shows.
    """
    photo = read_photo(file)
    image = load_pixels(photo)
    searched = search_photo(image)
    sightings = [(find_patch(searched, patch.pixels), patch) for patch in patches]
    seen = [(sighting, patch) for sighting, patch in sightings if sighting is not None]
    # mirrored prints have the same features: an own message saves a search
    if not seen:
        for patch in patches:
            if find_patch(searched, np.ascontiguousarray(patch.pixels[:, ::-1])) is not None:
                raise ToolkitError(f"the patch '{patch.name}' is there mirrored: mirror the photograph, or the file")
        names = " or ".join(f"'{patch.name}'" for patch in patches)
        raise ToolkitError(f"the patch {names} was not found in it")
    sighting, patch = max(seen, key=lambda pair: pair[0].confidence)
    if sighting.shown < LEAST_SHOWN:
        raise ToolkitError(f"only {sighting.shown:.0%} of the patch '{patch.name}' shows, {LEAST_SHOWN:.0%} are needed")
    # without the features of the first print, only a second print can be found
    uv = sighting.warp.to_patch(searched.features.frames[:, :, 2] / searched.scale)
    kept = ~((uv > -0.1) & (uv < 1.1)).all(axis=1)
    features = LocalFeatures(searched.features.frames[kept], searched.features.descriptors[kept])
    if find_patch(replace(searched, features=features), patch.pixels) is not None:
        raise ToolkitError(f"the patch '{patch.name}' is there twice: hide a copy")
    return FittedPhoto(photo, image, patch, sighting, fit_look(image, sighting, patch.pixels))


def list_files(paths: Sequence[Path]) -> tuple[list[Path], list[tuple[str, str]]]:
    """List photographs, also those in folders, and (path, reason) of links; without any, a `ToolkitError`."""
    files: list[Path] = []
    refused: list[tuple[str, str]] = []
    for path in paths:
        if path.is_dir():
            found = list_photos(path)
            files += found.photos
            refused += [(f"{path}/{name}", why) for name, why in found.refused]
        else:
            files.append(path)
    if not files:
        why = f": {refused[0][0]}: {refused[0][1]}" if refused else ""
        raise ToolkitError(f"{', '.join(map(str, paths))}: no photographs there{why}")
    return files, refused


def use_each(
    title: str, photos: Sequence[Path], use: Callable[[Path], T], least: int = 1
) -> tuple[list[T], list[tuple[str, str]]]:
    """Call `use` with each photograph; returns its results, and (path, reason) of photographs that it refuses.

    `photos` may be folders, and `title` names the progress bar. `use` raises `ToolkitError` for an unusable photograph.
    Fewer than `least` results are a `ToolkitError` with the first reason.
    """
    files, skipped = list_files(photos)
    made: list[T] = []
    with progress(title, len(files)) as bar:
        # an unusable photograph is reported, and the rest goes on
        for file in files:
            try:
                made.append(use(file))
            except ToolkitError as error:
                skipped.append((str(file), str(error).removeprefix(f"{file}: ")))
            bar.advance(note=file.name)
    if len(made) < least:
        needed = f", {least} are needed" if least > 1 else ""
        why = f": {skipped[0][0]}: {skipped[0][1]}" if skipped else ""
        raise ToolkitError(f"{len(made) or 'none'} of {len(files)} photographs could be used{needed}{why}")
    return made, skipped


WINDOW = (0.7, 1.0)
"""Side of the square that a view shows, as a share of the photograph's shorter side."""
BRIGHTEST = 0.98
"""Upper limit of the light that is estimated from a photograph, at which pixels are blown out."""


def view_photos(
    workspace: Workspace, photos: Sequence[Path], found: Sequence[str], *, size_px: int, size_mm: float, count: int,
    image_px: int, seed: int, device: str,
) -> tuple["MountedViews", list[tuple[str, str]]]:  # fmt: skip
    """Views of photographs, linear in the colours of the patch that replaces the printed patch.

    Each shows a random square of a photograph, with the patch's middle in it. The last fifth of the photographs by name
    is held out.

    Args:
        workspace: has the patches.
        photos: photographs, or folders of them.
        found: the printed patches' names or PNG files.
        size_px, size_mm: of the patch that is trained.
        count: number of views, about.
        image_px: their side.
        seed: of the squares.
        device: of the views.

    Returns:
        The views, and (path, reason) of photographs that show none of the patches.

    Raises:
        ToolkitError: fewer than two photographs show any of them.
    """
    patches = [read_known(workspace, name) for name in found]
    fitted, skipped = use_each("finding the patch", photos, lambda file: fit_photo(file, patches), least=2)
    # every photograph gives the same number of views
    each, views = max(1, -(-count // len(fitted))), []
    for number, photo in enumerate(fitted):
        with_hidden = _add_hidden(photo)
        for k in range(each):
            # each window has its own draws: more views of a photograph do not change those of the others
            rng = Draws(seed, number * each + k, "found views").of("window")
            views.append(_view(photo, with_hidden, image_px, (size_px, size_mm), rng))
    from toolkit.boosters.mounted import stack_views  # torch, which only training needs

    stacked = stack_views(views, (size_mm,), device)
    return replace(stacked, held_out=each * count_held_out(len(fitted))), skipped


def _add_hidden(photo: FittedPhoto) -> np.ndarray:
    """(h, w, 4) uint8: the photograph, and how far something hides the patch, from 0 to 255."""
    scene, hidden = PatchScene(photo.image, photo.look, photo.patch.pixels), np.zeros(photo.image.shape[:2], np.uint8)
    h, w = scene.hidden.shape
    hidden[scene.top : scene.top + h, scene.left : scene.left + w] = np.rint(255 * scene.hidden)
    return np.dstack([photo.image, hidden])


def _view(
    photo: FittedPhoto, with_hidden: np.ndarray, image_px: int, sheet: tuple[int, float], rng: np.random.Generator
) -> LinearView:
    """A random square of a photograph round the patch's middle, with paper of `sheet` texels and mm in its place."""
    (h, w), middle = photo.image.shape[:2], photo.look.warp.corners.mean(axis=0)
    # a random square that holds the patch's middle
    side = rng.uniform(*WINDOW) * min(h, w)
    low = np.clip(middle - side, 0, [w - side, h - side])
    high = np.clip(middle, 0, [w - side, h - side])
    left, top = rng.uniform(low, np.maximum(low, high))
    scale = min(1.0, image_px / side)
    # shrunk, then cut by an affine map that the patch's warp follows
    small = shrink_image(with_hidden, scale)
    zoom = image_px / side
    T = np.array([[zoom / scale, 0, -left * zoom], [0, zoom / scale, -top * zoom], [0, 0, 1.0]])
    picture = cv2.warpAffine(
        small, to_cv(T)[:2], (image_px, image_px),
        flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    there = photo.look.warp.scaled(scale)
    warp = PatchWarp(T @ there.homography, there.bend * T[0, 0])
    picture, hidden = np.ascontiguousarray(picture[..., :3]), picture[..., 3] / np.float32(255)
    # the linear view has no spread of its own: the picture's blur stays in the picture
    kernels, wide = no_spread()
    scene = PatchScene(picture, replace(photo.look, warp=warp, kernels=kernels, wide=wide), photo.patch.pixels)
    return _make_linear(picture, scene, hidden, sheet)


def _make_linear(picture: np.ndarray, scene: PatchScene, hidden: np.ndarray, sheet: tuple[int, float]) -> LinearView:
    """The picture's light without the patch, and the light that white paper in its place would have."""
    (h, w), (n, size_mm) = scene.cover.shape, sheet
    repeat, margin = size_on_paper(n, size_mm)
    light = srgb_to_linear(picture.astype(np.float32) / 255)
    cut = light[scene.top : scene.top + h, scene.left : scene.left + w]
    hidden = hidden[scene.top : scene.top + h, scene.left : scene.left + w, None]
    # the patch's share of each pixel, and the light of all else
    share = (scene.cover * (1 - hidden[..., 0])).astype(np.float32)
    behind = hidden * cut + (1 - hidden) * scene.around
    dark, coverage = _before_shoulder(light), np.zeros(light.shape[:2], np.float32)
    there = np.where(share[..., None] > 0, (1 - share[..., None]) * _before_shoulder(behind), _before_shoulder(cut))
    dark[scene.top : scene.top + h, scene.left : scene.left + w] = there
    coverage[scene.top : scene.top + h, scene.left : scene.left + w] = share
    rows, columns = np.nonzero(share > 0)
    white = srgb_to_linear(scene.look.colours(np.full((1, 1, 3), 255, np.uint8))[0, 0]) * scene.gain[rows, columns]
    # places on the paper with its white margin, and texels per pixel for the level of detail
    uv, paper = scene.uv[rows, columns], n * repeat + 2 * margin
    place = (margin + np.clip(uv, 0, 1) * n * repeat) / paper
    texels = np.maximum(scene.step[rows, columns].max(axis=1) * n * repeat, 1e-6)
    return LinearView(
        behind=np.zeros_like(dark), dark=dark.astype(np.float32), coverage=coverage,
        pixel=((rows + scene.top) * picture.shape[1] + columns + scene.left).astype(np.int32),
        # v runs upwards in texture coordinates, rows downwards in the patch
        uv=np.stack([place[:, 0], 1 - place[:, 1]], axis=1).astype(np.float32),
        lod=np.log2(texels).astype(np.float32),
        gain=(_before_shoulder(white) * share[rows, columns, None]).astype(np.float32),
    )  # fmt: skip


def _before_shoulder(light: np.ndarray) -> np.ndarray:
    """Light that the rig's tone curve develops to this: its highlights, which it compresses, are stretched."""
    light = np.clip(light, 0, BRIGHTEST)
    over = np.clip((light - SHOULDER) / (1 - SHOULDER), 0, None)
    return np.where(light > SHOULDER, SHOULDER - (1 - SHOULDER) * np.log1p(-over), light)
