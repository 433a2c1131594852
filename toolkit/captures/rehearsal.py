"""What a print, a hand and a phone make of a shot: `capture-sim --rehearse`, before a sheet of paper is spent."""

from dataclasses import dataclass, field, fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from toolkit.boosters.pixels import quantise
from toolkit.boosters.transforms.camera import LEAST_DEFOCUS_PX, CameraBlur, Exposure
from toolkit.boosters.transforms.printing import PrintProcess, ProfiledPrint, use_profile
from toolkit.core.config import Config
from toolkit.core.draws import Draws
from toolkit.imaging.printer import read_print_profile
from toolkit.objects.mesh import Mesh
from toolkit.rig.mount import PAPER_MATERIAL
from toolkit.rig.variants import Paint, Sheets, Worn

NETWORK_PX = 224
"""The side of a network's image, of which the pixels of `CameraBlur` are."""
LARGEST_SCALE = 10
"""Pictures above 2240 px are blurred as one of that size: `CameraBlur` goes no further."""


@dataclass(frozen=True)
class Rehearsal:
    """What is drawn for each print and each photograph; other draws for each variant, as for real photographs.

    Attributes:
        printer: inks and paper, drawn once for each object.
        tape_roughness: of the clear tape over a sheet; bare paper has 0.75.
        stray_share: how far the camera is from where the plan wants it, standard deviation along each axis, as a share
            of its distance.
        stray_deg: and how far it is turned, about each axis.
        blur: of focus and shake, as far as the gate of sharpness lets it pass.
        exposure: of the photograph, and how far its white balance is off.
        noise: of the sensor, as of `toolkit.rig.shading.tone_map`.
        jpeg_quality: of the file, with the colours at half the size.
    """

    printer: PrintProcess | ProfiledPrint = field(default_factory=lambda: PrintProcess(probability=1.0))
    tape_roughness: float = 0.2
    stray_share: float = 0.03
    stray_deg: float = 1.5
    exposure: Exposure = field(default_factory=lambda: Exposure(factor=(0.75, 1.33), tint=0.12))
    noise: float = 0.017
    blur: CameraBlur = field(
        default_factory=lambda: CameraBlur(defocus_px=(0.05, 0.2), motion_px=(0.0, 0.3), probability=1.0)
    )
    jpeg_quality: int = 90

    def describe(self) -> dict[str, Any]:
        """All that it does, and the version of how: what a picture's hash is made of."""
        settings = {one.name: getattr(self, one.name) for one in fields(self)}
        return {"version": 3} | {
            name: value.model_dump() if isinstance(value, Config) else value for name, value in settings.items()
        }

    def print_booster(self, booster: Worn | None, seed: int, name: str) -> Worn | None:
        """The booster as it comes out of the printer; a texture, which is not printed, as it is."""
        if booster is None or isinstance(booster, Paint):
            return booster
        import torch

        # ink spreads by millimetres, however many texels a sheet has
        texel_mm = (
            booster.wrap.record.texel_mm if isinstance(booster, Sheets) else booster.sizes_mm[0] / len(booster.pixels)
        )
        printer = self.printer.with_overrides(texel_mm=texel_mm)
        pixels = torch.from_numpy(booster.pixels.transpose(2, 0, 1) / np.float32(255))
        printed = printer.change(pixels, Draws(seed, 0, "rehearse").of(f"print {name}"))
        return replace(booster, pixels=np.ascontiguousarray(quantise(printed)))

    def tape(self, mesh: Mesh) -> Mesh:
        """The mesh with tape over its sheets of paper."""
        materials = tuple(
            replace(one, roughness=self.tape_roughness) if one.name == PAPER_MATERIAL else one for one in mesh.materials
        )
        return replace(mesh, materials=materials)

    def perturb_pose(self, T_world_camera: np.ndarray, distance: float, rng: np.random.Generator) -> np.ndarray:
        """(4, 4) where a hand holds the camera that should stand at (4, 4), so far from what it looks at."""
        from scipy.spatial.transform import Rotation

        strayed = np.array(T_world_camera, float)
        # by distance: a hand misses more from farther away
        strayed[:3, 3] += rng.normal(0, self.stray_share * distance, 3)
        turn = Rotation.from_rotvec(rng.normal(0, self.stray_deg, 3), degrees=True)
        # about the camera's own axes: from the right
        strayed[:3, :3] = strayed[:3, :3] @ turn.as_matrix()
        return strayed

    def expose(self, picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(h, w, 3) linear light as it falls on the sensor: blurred by lens and hand, its channels weighed."""
        import torch

        # the blur is stated in pixels of a network's image, and the picture is larger
        scale = min(min(picture.shape[:2]) / NETWORK_PX, LARGEST_SCALE)
        (sharpest, softest), (still, moved) = self.blur.defocus_px, self.blur.motion_px
        defocus_px = max(sharpest * scale, LEAST_DEFOCUS_PX), max(softest * scale, LEAST_DEFOCUS_PX)
        blur = self.blur.with_overrides(defocus_px=defocus_px, motion_px=(still * scale, moved * scale))
        light = blur.change(torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32)), rng)
        factors = self.exposure.draw(rng, 1, torch.zeros(1, dtype=torch.float32))
        return np.ascontiguousarray((light * factors[0]).numpy().transpose(1, 2, 0))

    def encode(self, pixels: np.ndarray) -> bytes:
        """The JPEG of a developed picture, (h, w, 3) uint8 sRGB."""
        buffer = BytesIO()
        Image.fromarray(pixels).save(buffer, "JPEG", quality=self.jpeg_quality)
        return buffer.getvalue()


def make_rehearsal(print_profile: Path | None = None) -> Rehearsal:
    """The rehearsal on a printer drawn at random, or on one's own.

    Raises:
        ToolkitError: the profile cannot be read.
    """
    return Rehearsal() if print_profile is None else Rehearsal(use_profile(read_print_profile(print_profile)))
