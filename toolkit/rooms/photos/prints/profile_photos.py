"""From photographs of a printed page to a print profile: what `toolkit print-profile` runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from toolkit import __version__
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.workspace import Workspace
from toolkit.imaging.colour import srgb_to_linear
from toolkit.imaging.printer import PrintProfile, ProfileMade, white_paper
from toolkit.objects.records import Patch, read_patch
from toolkit.printing.page import Paper
from toolkit.printing.print_patches import choose_wearer, say_sizes, select_patches
from toolkit.rooms.photos.photo import load_pixels, read_photo
from toolkit.rooms.photos.prints.colours import (
    ColourComparison,
    PrintedColours,
    compare_colours,
    compare_light,
    read_colours,
)
from toolkit.rooms.photos.prints.find import SIZE_TOLERANCE, find_patch, measure_on_page
from toolkit.rooms.photos.prints.fit_profile import FittedColours, StripReading, fit_colours, fit_texels, read_strip
from toolkit.rooms.photos.prints.fitted_photo import KnownPatch, fit_photo, use_each
from toolkit.rooms.photos.prints.look import even_texels

SMALL_PX = 150.0
"""Side below which texels run into each other, and a profile says little of single colours."""


@dataclass(frozen=True)
class ProfiledPhoto:
    """Measures of a photo: the side of the patch in pixels, and in mm by the sheet's edges, and the print's colours."""

    name: str
    sha256: str
    side_px: float
    colour: ColourComparison
    has_strip: bool
    size_mm: float | None


@dataclass(frozen=True)
class ProfileRun:
    """A fitted profile, its photos, (path, reason) of unusable photos, held-out median ΔE00 by model, and warnings."""

    profile: PrintProfile
    photos: tuple[ProfiledPhoto, ...]
    skipped: tuple[tuple[str, str], ...]
    tried: dict[str, float]
    warnings: tuple[str, ...]


def choose_printed(workspace: Workspace, class_name: str, size_mm: float | None) -> tuple[Patch, float]:
    """Return the patch of a name or class, and its printed side: as given, else as `toolkit print` makes it.

    Raises:
        FieldError: several patches are meant, or the object has sheets of several sizes and none is given.
    """
    chosen = select_patches(workspace, [class_name])
    if len(chosen) > 1:
        names = ", ".join(file.stem for file in chosen)
        raise FieldError(f"means {len(chosen)} patches: choose by the file's name: {names}", {"class_name": class_name})
    patch = read_patch(chosen[0])
    if size_mm is not None:
        return patch, size_mm
    # the printed side depends on the object that wears the patch
    wearer = choose_wearer(workspace, chosen[0])
    if wearer is not None and len(set(wearer.sizes_mm)) > 1:
        raise FieldError(f"{wearer.object} has it at {say_sizes(wearer.sizes_mm)}: give {{size_mm}}", {})
    return patch, wearer.sizes_mm[0] if wearer else patch.size_mm


def profile_photos(
    paths: Sequence[Path], patch: Patch, paper: Paper, size_mm: float | None = None, name: str | None = None,
    by: str | None = None,
) -> ProfileRun:  # fmt: skip
    """Fit a print profile to photographs of a printed patch.

    Args:
        paths: photographs, or folders of them.
        patch: the file that was printed.
        paper: the sheet, for photos that show all of it.
        size_mm: side of the printed patch; by default that of its record.
        name: of the profile; by default the patch's.
        by: name of the person who measured.

    Raises:
        ToolkitError: a folder cannot be read, or no photo could be used; the message says why of the first.
    """
    # colours and strip of each photograph, then a transform for all
    expected_mm = size_mm or patch.size_mm
    read, skipped = use_each("reading prints", paths, lambda file: _read_print(file, patch, paper, expected_mm))
    photos, about = [photo for photo, _, _ in read], patch.record
    fitted = fit_colours(
        [part for _, part, _ in read], patch.pixels, [strip for _, _, strip in read if strip is not None]
    )
    profile = _make_profile(fitted, (about.name, about.png_sha256), name or about.name, photos, by)
    return ProfileRun(profile, tuple(photos), tuple(skipped), fitted.tried, tuple(_warn(photos, expected_mm)))


def profile_patches(
    paths: Sequence[Path], patches: Sequence[KnownPatch], name: str, by: str | None = None
) -> ProfileRun:
    """Fit a print profile to photographs of patches whose files are known, cut tight or not: white is their own.

    Raises:
        ToolkitError: no photo shows any of the patches.
    """
    read, skipped = use_each("reading prints", paths, lambda file: _read_patch(file, patches))
    photos = [photo for photo, _, _ in read]
    fitted = fit_texels([part for _, _, part in read])
    used = list({patch.name: patch for _, patch, _ in read}.values())
    profile = _make_profile(fitted, ("+".join(patch.name for patch in used), used[0].sha256), name, photos, by)
    return ProfileRun(profile, tuple(photos), tuple(skipped), fitted.tried, ())


def _read_patch(
    file: Path, patches: Sequence[KnownPatch]
) -> tuple[ProfiledPhoto, KnownPatch, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A photograph, the patch that it shows, and that file's pixels, its texels' light and where they show."""
    # the look has the texels' light and the paper's white
    found = fit_photo(file, patches)
    pixels = found.patch.pixels
    seen, trust = even_texels(found.image, found.sighting, found.look, pixels.shape[0])
    colour = compare_light(seen[trust > 0], srgb_to_linear(pixels.reshape(-1, 3)[trust > 0] / 255.0), "texels")
    photo = ProfiledPhoto(file.name, found.photo.sha256, found.look.warp.side_px, colour, False, None)
    return photo, found.patch, (pixels, seen, trust)


def _read_print(
    file: Path, patch: Patch, paper: Paper, size_mm: float
) -> tuple[ProfiledPhoto, PrintedColours, StripReading | None]:
    about = read_photo(file)
    image = load_pixels(about)
    sighting = find_patch(image, patch.pixels)
    if sighting is None:
        raise ToolkitError(
            f"the patch '{patch.record.name}' was not found in it: photograph the whole page flat, sharp and in even "
            "light, and name the patch that is on it"
        )
    # colours against paper, and the size against the sheet's edges
    strip = read_strip(image)
    white = None if strip is None else strip.white_linear
    part = read_colours(image, sighting, size_mm, white, patch.pixels, patch.record.margin)
    page = measure_on_page(image, sighting, paper)
    photo = ProfiledPhoto(
        file.name, about.sha256, sighting.warp.side_px, compare_colours(part, patch.pixels), strip is not None,
        size_mm=None if page is None else float(np.sqrt(page[0] * page[1])),
    )  # fmt: skip
    return photo, part, strip


def _make_profile(
    fitted: FittedColours, patch: tuple[str, str], name: str, photos: Sequence[ProfiledPhoto], by: str | None
) -> PrintProfile:
    """The profile as it is written; `patch` is the name and hash of what was printed."""
    coefficients = tuple((float(r), float(g), float(b)) for r, g, b in fitted.coefficients.round(6))
    return PrintProfile(
        name=name, patch=patch[0], patch_sha256=patch[1], model=fitted.model,
        power=fitted.power, exponents=fitted.exponents, coefficients=coefficients, paper_linear=white_paper(),
        photos=tuple(photo.sha256 for photo in photos), n_samples=fitted.n_samples, strip_cells=fitted.strip_cells,
        without=fitted.without, held_out=fitted.held_out,
        made=ProfileMade(on=datetime.now(timezone.utc).date().isoformat(), with_version=__version__, by=by),
    )  # fmt: skip


def _warn(photos: Sequence[ProfiledPhoto], expected_mm: float) -> list[str]:
    """A line for each fault of the print or the photos."""
    lines = []
    # each photograph's own faults, then those of the whole set
    for photo in photos:
        if photo.size_mm is not None and abs(photo.size_mm / expected_mm - 1) > SIZE_TOLERANCE:
            lines.append(
                f"{photo.name}: by the sheet's edges the patch is {photo.size_mm:.1f} mm, not {expected_mm:.1f} mm "
                f"({photo.size_mm / expected_mm:.1%}): print it at 100 %, 'actual size'"
            )
        if photo.side_px < SMALL_PX:
            lines.append(
                f"{photo.name}: the patch is {photo.side_px:.0f} px wide: {SMALL_PX:.0f} px or more are better"
            )
    if not any(photo.has_strip for photo in photos):
        lines.append("no photo shows the colour strip: colours that the patch lacks are guessed from those it has")
    return lines
