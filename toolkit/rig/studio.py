"""The table-top studio: key light, room, table and backdrop, all from one seed."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from toolkit.colour import srgb_to_linear
from toolkit.errors import one_of
from toolkit.rig import materials
from toolkit.rig.room import paint_room

ENVIRONMENT_SHAPE = (256, 512)


@dataclass(frozen=True)
class KeyLight:
    """A soft box, far enough away to shine evenly.

    Attributes:
        azimuth_deg, elevation_deg: where it stands.
        radius_deg: half of its apparent size; larger is softer.
        irradiance: (3,) linear RGB on a surface that faces it.
    """

    azimuth_deg: float = 40.0
    elevation_deg: float = 52.0
    radius_deg: float = 7.0
    irradiance: tuple[float, float, float] = (2.2, 2.15, 2.05)


@dataclass(frozen=True)
class Studio:
    """Everything in the picture but the object.

    Attributes:
        name: for the manifest.
        key: the main light.
        environment: (h, w, 3) linear radiance of the room in all directions, equirectangular: row 0 is straight up,
            the middle column azimuth 0, azimuth grows to the left.
        table: (h, w, 3) uint8 sRGB picture of the table top; its middle is the origin, image right +x, image up +y.
        table_mm: (width along x, height along y) of the table top.
        table_roughness: 0 mirror … 1 matte.
        exposure: factor from radiance to the picture's linear values.
    """

    name: str
    key: KeyLight
    environment: np.ndarray
    table: np.ndarray
    table_mm: tuple[float, float]
    table_roughness: float
    exposure: float


LIGHTS: dict[str, KeyLight] = {
    "studio": KeyLight(),
    "side": KeyLight(azimuth_deg=95, elevation_deg=24, radius_deg=5, irradiance=(2.9, 2.8, 2.7)),
    "warm": KeyLight(azimuth_deg=-35, elevation_deg=48, irradiance=(2.6, 1.95, 1.25)),
    "dim": KeyLight(elevation_deg=60, radius_deg=12, irradiance=(0.55, 0.55, 0.6)),
}
ROOM_LIGHT = {"studio": 1.0, "side": 0.55, "warm": 0.75, "dim": 0.45}
BACKDROPS = tuple(materials.TABLES)


@lru_cache(maxsize=4)
def make_studio(
    seed: int | tuple[int, ...] = 0, scale_mm: float = 270.0, backdrop: str | None = None, light: str = "studio"
) -> Studio:
    """A studio whose backdrop, unless named, and details follow from the seed.

    Args:
        seed: equal seeds give equal studios.
        scale_mm: longest side of the object; the table is sized to it.
        backdrop: one of `BACKDROPS`.
        light: one of `LIGHTS`.

    Raises:
        ToolkitError: an unknown backdrop or light.
    """
    if light not in LIGHTS:
        raise one_of("light", light, list(LIGHTS))
    if backdrop is not None and backdrop not in materials.TABLES:
        raise one_of("backdrop", backdrop, list(BACKDROPS))
    seeds = (seed,) if isinstance(seed, int) else seed
    rng = np.random.default_rng([*seeds, 0x57D10])
    drawn = BACKDROPS[int(rng.integers(len(BACKDROPS)))]
    table_kind = materials.TABLES[backdrop or drawn]
    key = LIGHTS[light]
    table_mm = (6.4 * scale_mm, 4.8 * scale_mm)
    table = table_kind.paint(rng, table_mm)
    warmth = np.array([key.irradiance[0], key.irradiance[1], key.irradiance[2]]) / max(key.irradiance)
    environment = paint_room(rng, ENVIRONMENT_SHAPE) * np.float32(ROOM_LIGHT[light]) * warmth.astype(np.float32)
    name = f"{backdrop or drawn}/{light}/{'-'.join(map(str, seeds))}"
    return Studio(
        name=name, key=key, environment=environment, table=table, table_mm=table_mm,
        table_roughness=table_kind.roughness, exposure=_expose(key, environment, table),
    )  # fmt: skip


def _expose(key: KeyLight, environment: np.ndarray, table: np.ndarray) -> float:
    """Meter the open table as a camera would: bright tables stay bright, dark ones dark, dim light a bit dim."""
    rows = environment.shape[0] // 2
    elevation = np.pi / 2 - (np.arange(rows) + 0.5) * np.pi / environment.shape[0]
    weights = np.sin(elevation) * np.cos(elevation)
    room = np.pi * (environment[:rows].mean(axis=1) * weights[:, None]).sum(axis=0) / weights.sum()
    irradiance = float((room + np.sin(np.radians(key.elevation_deg)) * np.array(key.irradiance)).mean())
    albedo = float(srgb_to_linear(table[::8, ::8] / 255).mean())
    wanted = 0.62 * albedo**0.65
    metered = wanted / (albedo * irradiance / np.pi)
    full = 0.9
    return metered * (1 if irradiance > full else (irradiance / full) ** 0.5)
