"""All that shows what a world is: pictures by day, at dusk and in fog, a map and a film; what is there stays."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any, Literal
from zlib import crc32

import numpy as np
from PIL import Image, ImageDraw
from pydantic import BaseModel, ConfigDict, ValidationError

from toolkit.core.console import progress
from toolkit.core.errors import FieldError
from toolkit.core.files import delete_file, read_bytes, sha256_file, write_bytes, write_json
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.imaging.plots import read_font
from toolkit.imaging.read import encode_image, read_image
from toolkit.objects.mesh import cast_rays, hash_mesh
from toolkit.rig.camera import Camera, look_at, orbit_pose, project
from toolkit.rig.renderer import Renderer
from toolkit.rig.renderers import RAYCAST
from toolkit.rig.shading import tone_map
from toolkit.rooms.worlds.conditions import CLEAR, ObjectInWorld, PreviewRequest, check_times, parse_weathers
from toolkit.rooms.worlds.own import open_world
from toolkit.rooms.worlds.picture import FPS, leave_empty, make_renderer, see_through, write_film
from toolkit.rooms.worlds.place import Placed, place_object, stand_object
from toolkit.rooms.worlds.sky import Sky, load_sky, make_sky
from toolkit.rooms.worlds.viewpoints import (
    FOV_DEG,
    HEADROOM_M,
    Flight,
    Viewpoint,
    choose_viewpoints,
    clearance,
    plan_flight,
)
from toolkit.rooms.worlds.world import World

Ink = tuple[int, int, int]
ALTITUDE = 10
"""Altitude of the map's camera, in sides of the map. At the edge, tall things lean outwards by 1/20 of their height."""
MARGIN = 1.06
KINDS: dict[str, Ink] = {"ground": (255, 214, 64), "roof": (255, 120, 200), "water": (90, 210, 255)}
PAD: Ink = (120, 255, 120)
CAMERA: Ink = (255, 70, 60)
PATH: Ink = (255, 255, 255)
INK_EDGE: Ink = (20, 20, 20)
LABEL_PX = 17
BARS_M = (5, 10, 20, 50, 100, 200, 500, 1000)
RECORD, MAP, FILM, FRAMES = "preview.json", "map.png", "flythrough.mp4", ".frames"
PREVIEWS = Work("world preview", 1)
QUALITY = 90
OBJECT_VIEWS = {"object": (35.0, 12.0, 1.4), "object-far": (-50.0, 24.0, 3.5)}
"""Azimuth from its front, elevation and distance of pictures of an object; the distance in its lengths."""
DEFAULT_TIMES = ("afternoon", "dusk")
LIGHT, PICTURE, MAP_COST, IN_WEATHER, FRAME = 40, 8, 16, 2, 2
"""Work of a sky's light, a picture, the map, another weather and a frame (rendered, encoded): for the time left."""
TURNS_DEG = sorted(range(-180, 180, 15), key=abs)


@dataclass(frozen=True)
class MapSheet:
    """The camera of a map, straight above a world's core; north, +y, is up."""

    camera: Camera
    T_world_camera: np.ndarray

    @classmethod
    def over(cls, world: World, side_px: int) -> "MapSheet":
        """Over the whole core."""
        middle = np.append(world.core.mean(axis=0), 0.0)
        side = MARGIN * float(np.ptp(world.core, axis=0).max())
        camera = Camera.from_fov(side_px, side_px, 2 * float(np.degrees(np.arctan(0.5 / ALTITUDE))))
        return cls(camera, look_at(middle + [0, 0, ALTITUDE * side], middle, azimuth_deg=-90.0))

    def place(self, points: np.ndarray) -> list[tuple[float, float]]:
        """Pixels of points (n, 3), metres."""
        pixels, _ = project(self.camera, self.T_world_camera, points)
        return [(float(x), float(y)) for x, y in pixels]

    @property
    def px_per_m(self) -> float:
        """On the ground."""
        return self.camera.fx / float(self.T_world_camera[2, 3])


def draw_map(
    picture: np.ndarray, sheet: MapSheet, world: World, viewpoints: Sequence[Viewpoint], path: np.ndarray | None = None
) -> np.ndarray:
    """(h, w, 3) uint8 a picture from above with all that is known of a world drawn on it.

    Args:
        picture: (h, w, 3) uint8 sRGB, seen by the sheet's camera.
        world: its spots are drawn as far as they are free, its pads green.
        path: (n, 3) of a flight.
    """
    image = Image.fromarray((picture * np.float32(0.8)).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    # the flight, and a circle of free ground round each place
    pads = {pad.name for pad in world.pads}
    if path is not None:
        draw.line(sheet.place(path), fill=PATH, width=2)
    labels: list[tuple[float, float, str, Ink]] = []
    for spot in world.spots:
        ink = PAD if spot.name in pads else KINDS[spot.kind]
        x, y = sheet.place(np.array([spot.position]))[0]
        radius = max(spot.free_radius_m * sheet.px_per_m, 4)
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), outline=ink, width=3)
        labels.append((x, y, spot.name, ink))
    # camera positions
    for viewpoint in viewpoints:
        labels.append((*_draw_camera(draw, sheet, viewpoint), viewpoint.name, CAMERA))
    # labels moved apart, each with a line to its point
    font = read_font("sans", LABEL_PX)
    sizes = [(draw.textlength(name, font) + 6, LABEL_PX + 4.0) for _, _, name, _ in labels]
    middles = spread_labels([(x, y) for x, y, *_ in labels], sizes, (image.width, image.height))
    for (x, y, _, ink), middle in zip(labels, middles, strict=True):
        draw.line((x, y, *middle), fill=ink, width=1)
    for (_, _, name, ink), middle in zip(labels, middles, strict=True):
        draw.text(middle, name, ink, font, anchor="mm", stroke_width=2, stroke_fill=INK_EDGE)
    _draw_scale(draw, sheet, world)
    return np.asarray(image)


def spread_labels(
    wanted: Sequence[tuple[float, float]], sizes: Sequence[tuple[float, float]], within: tuple[int, int]
) -> list[tuple[float, float]]:
    """Middles of labels that do not overlap, each as near as may be to where it is wanted.

    Each label in turn takes the nearest free place on rings about the wanted place; if none is free, the wanted place.

    Args:
        wanted: (x, y) of the middles, pixels.
        sizes: (width, height) of each label, pixels.
        within: width and height of the picture, which no label leaves.
    """
    # candidates: the wanted place, then 24 on each ring of growing radius
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    rings = np.concatenate([np.zeros((1, 2)), *(radius * circle for radius in range(8, 200, 8))])
    middles, halves = np.zeros((0, 2)), np.array(sizes).reshape(-1, 2) / 2
    for (x, y), half in zip(wanted, halves, strict=True):
        tried = np.clip(rings + (x, y), half, np.maximum(np.array(within) - half, half))
        # rectangles are apart if they are apart along x or along y
        apart = np.abs(tried[:, None] - middles) >= halves[: len(middles)] + half
        free = apart.any(axis=2).all(axis=1)
        middles = np.vstack([middles, tried[int(np.argmax(free))]])
    return [(float(x), float(y)) for x, y in middles]


def _draw_camera(draw: ImageDraw.ImageDraw, sheet: MapSheet, viewpoint: Viewpoint) -> tuple[float, float]:
    """An arrow the way a camera looks; returns where its name goes."""
    ahead = viewpoint.T_world_camera[:3, 2] * [1, 1, 0]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    foot = viewpoint.position * [1, 1, 0]
    aside = np.array([-ahead[1], ahead[0], 0.0])
    unit = 14 / sheet.px_per_m
    corners = [foot + 2.2 * unit * ahead, foot + 0.8 * unit * aside, foot - 0.8 * unit * aside]
    draw.polygon(sheet.place(np.array(corners)), fill=CAMERA, outline=INK_EDGE)
    x, y = sheet.place(np.array([foot - 1.2 * unit * ahead]))[0]
    return x, y


def _draw_scale(draw: ImageDraw.ImageDraw, sheet: MapSheet, world: World) -> None:
    """A bar of round length, north, and what the marks mean."""
    side = sheet.camera.width
    # the longest round length that takes less than 30 % of the map
    length = max((bar_m for bar_m in BARS_M if bar_m * sheet.px_per_m < 0.3 * side), default=BARS_M[0])
    font, left, low = read_font("sans", 20), 30, side - 34
    right = left + length * sheet.px_per_m
    draw.line((left, low, right, low), fill=PATH, width=5)
    draw.text((left, low - 8), f"{length} m", PATH, font, anchor="ld", stroke_width=2, stroke_fill=INK_EDGE)
    draw.text((side - 30, 30), "N ↑", PATH, font, anchor="rt", stroke_width=2, stroke_fill=INK_EDGE)
    # the legend names only what this map shows
    kinds = {spot.kind for spot in world.spots}
    rows: list[tuple[str, Ink]] = [(f"free {kind}", ink) for kind, ink in KINDS.items() if kind in kinds]
    rows += [("landing pad", PAD)] if world.pads else []
    for k, (words, ink) in enumerate([*rows, ("camera", CAMERA), ("flythrough", PATH)]):
        draw.text((30, 30 + 26 * k), words, ink, font, anchor="lt", stroke_width=2, stroke_fill=INK_EDGE)


@dataclass(frozen=True)
class PreviewSettings:
    """What to make."""

    resolution: tuple[int, int] = (960, 540)  # width and height of pictures, pixels
    film_size: tuple[int, int] = (480, 270)  # and of the film; both even
    map_px: int = 1400  # side of the map
    film_s: float = 3.0  # length of the film, seconds; 0 leaves it out
    # (name, severity) in which the first sky is seen besides clear air
    weathers: tuple[tuple[str, int], ...] = (("fog", 1),)
    seed: int = 0  # of viewpoints, flight, grain and weather
    renderer: str = RAYCAST  # what draws them

    def __post_init__(self) -> None:
        for name in ("resolution", "film_size"):
            width, height = getattr(self, name)
            if not (64 <= width <= 7680 and 64 <= height <= 7680) or (
                name == "film_size" and (width % 2 or height % 2)
            ):
                even = ", even" if name == "film_size" else ""
                raise FieldError(f"expected 64 to 7680 pixels{even}", {name: (width, height)})
        if not 64 <= self.map_px <= 8192:
            raise FieldError("expected 64 to 8192 pixels", {"map_px": self.map_px})
        if not 0 <= self.film_s <= 300:
            raise FieldError("expected 0 to 300 seconds", {"film_s": self.film_s})

    @property
    def frames(self) -> int:
        """Number of frames of the film; 0 without a film."""
        return round(self.film_s * FPS)


@dataclass(frozen=True)
class PreviewResult:
    """The folder and its files."""

    folder: Path  # of all
    made: list[str]  # made, kept: names of the files made by this call, and of those that were there
    kept: list[str]


class _Record(BaseModel):
    """`preview.json`, as far as it is read back.

    Attributes:
        files: name -> hash of what it was made from, and of its bytes.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)
    files: dict[str, tuple[str, str]] = {}


@dataclass(frozen=True)
class _Job:
    """A file to make."""

    file: str  # its name
    kind: Literal["picture", "map", "film"]  # what it is
    sky: int  # number of the sky
    item: int = 0  # number of the view
    weather: tuple[str, int] = CLEAR  # of a picture


@dataclass(frozen=True)
class _Show:
    world: World
    skies: Sequence[Sky]
    placed: Placed | None
    settings: PreviewSettings
    folder: Path
    facts: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def viewpoints(self) -> tuple[Viewpoint, ...]:
        """Viewpoints of all pictures; those that show an object come first."""
        around: list[Viewpoint] = []
        if self.placed is not None:
            length = float(np.ptp(self.placed.mesh.bounds, axis=0).max())
            around = [
                Viewpoint(name, find_clear_orbit(self.world, self.placed, turn, up, far * length))
                for name, (turn, up, far) in OBJECT_VIEWS.items()
            ]
        return (*around, *choose_viewpoints(self.world, self.settings.seed))

    @cached_property
    def flight(self) -> Flight:
        """Flight of the film's camera."""
        return plan_flight(self.world, self.viewpoints, self.settings.seed)

    @property
    def camera(self) -> Camera:
        """Camera of all pictures."""
        return Camera.from_fov(*self.settings.resolution, FOV_DEG)

    def list_jobs(self) -> Iterator[_Job]:
        """Every file, those of the same sky side by side."""
        for k, sky in enumerate(self.skies):
            weathers = (CLEAR, *self.settings.weathers) if k == 0 else (CLEAR,)
            for item, view in enumerate(self.viewpoints):
                for weather in weathers:
                    words = [name_sky(sky), *([] if weather == CLEAR else [f"{weather[0]}-{weather[1]}"]), view.name]
                    yield _Job(f"{'-'.join(words)}.jpg", "picture", k, item, weather)
            if k == 0:
                yield _Job(MAP, "map", k)
                if self.settings.frames:
                    yield _Job(FILM, "film", k)

    def key(self, job: _Job) -> str:
        """Key of a file: of all that decides what it shows."""
        sky, settings = self.skies[job.sky], self.settings
        painted = crc32(sky.panorama.tobytes())
        parts: list[object] = [job.kind, sky.name, sky.exposure, sky.sun, sky.lamps, painted, self.facts]
        if job.kind == "picture":
            parts += [settings.resolution, job.weather, settings.seed, job.item]
            parts += [self.viewpoints[job.item].T_world_camera.round(6).tolist()]
        else:
            parts += [settings.seed, settings.map_px, settings.film_size, settings.film_s]
        return PREVIEWS.key(*parts)


def find_clear_orbit(world: World, placed: Placed, turn_deg: float, up_deg: float, distance_m: float) -> np.ndarray:
    """(4, 4) camera that looks at an object from about there, from where the world hides least of its box."""
    # in the order of how far they leave the wanted direction: of equal views the first is taken
    azimuths = [placed.stand.turn_deg + turn_deg + turn for turn in TURNS_DEG]
    poses = [orbit_pose(placed.centre, azimuth, up_deg, distance_m) for azimuth in azimuths]
    low, high = placed.mesh.bounds
    shares = np.stack(np.meshgrid(*[np.linspace(0.1, 0.9, 9)] * 2, [0.3, 0.5, 0.8], indexing="ij"), -1).reshape(-1, 3)
    targets = placed.stand.to_world(low + shares * (high - low))  # close enough together for a lamp post
    eyes = np.array([pose[:3, 3] for pose in poses])
    ways = targets[None] - eyes[:, None]
    rays = np.concatenate([np.broadcast_to(eyes[:, None], ways.shape), ways], axis=2).astype(np.float32)
    # rays are as long as the way, so that 1 is the object itself
    met = cast_rays(world.shape.rays, rays)  # in shares of the way
    free = (met > 0.97).mean(axis=1) - (clearance(world, eyes) < HEADROOM_M) - world.inside_building(eyes)
    return poses[int(free.argmax())]


def name_sky(sky: Sky) -> str:
    """`dusk` of `dusk/0`, as it stands in names of files; `sky-NAME` of a panorama's."""
    name, drawn, _ = sky.name.partition("/")
    return (name if drawn else f"sky-{name}").replace(" ", "-")


def preview_world(
    world: World, skies: Sequence[Sky], folder: Path, settings: PreviewSettings, placed: Placed | None = None
) -> PreviewResult:
    """Make the pictures, the map and the film of a world in a folder; what is there from the same request stays.

    Args:
        skies: each gives a picture from every viewpoint; the first sky also the weathers, the map and the film.
        placed: an object in the world, under whatever sky.

    Raises:
        ToolkitError: nowhere in it is there room for a camera, or a file cannot be written.
    """
    # the facts that every file depends on, for the record and the keys
    facts: dict[str, Any] = {"world": world.name, "world_sha256": world.sha256, "seed": settings.seed}
    if settings.renderer != RAYCAST:
        facts["renderer"] = settings.renderer
    if placed is not None:
        facts |= {"object_sha256": hash_mesh(placed.mesh), "place": placed.spot.name}
    show = _Show(world, skies, placed, settings, Path(folder), facts)
    # pictures of an earlier run are kept if their inputs and bytes are the same
    jobs = list(show.list_jobs())
    known = _read_record(show.folder)
    record = {job.file: known[job.file] for job in jobs if _is_there(show, job, known)}
    missing = [job for job in jobs if job.file not in record]
    if not missing:
        return PreviewResult(show.folder, [], [job.file for job in jobs])
    # the light of a sky is worked out once for all of its pictures
    work = LIGHT * len({job.sky for job in missing}) + sum(_cost(job, settings) for job in missing)
    with progress(f"preview of {world.name}", work) as bar:
        for k, of_sky in groupby(missing, key=lambda job: job.sky):
            renderer = _light(show, skies[k])
            bar.advance(LIGHT)
            views = list(of_sky)
            for _, group in groupby(views, key=lambda job: (job.kind, job.item)):
                for job, content in _make(show, renderer, list(group), bar.advance):
                    if content is not None:
                        write_bytes(show.folder / job.file, content)
                    # the record grows with every picture, so that an interrupted run resumes
                    record[job.file] = (show.key(job), sha256_file(show.folder / job.file))
                    _write_record(show, record)
                    bar.advance(0 if job.kind == "film" else _cost(job, settings), job.file)
    made = [job.file for job in missing]
    return PreviewResult(show.folder, made, [job.file for job in jobs if job.file not in made])


def _cost(job: _Job, settings: PreviewSettings) -> int:
    if job.kind == "film":
        return FRAME * settings.frames
    return MAP_COST if job.kind == "map" else PICTURE if job.weather == CLEAR else IN_WEATHER


def preview_request(
    space: Workspace, world: str, request: PreviewRequest, item: ObjectInWorld, *, scale: float = 1.0,
    out: Path | None = None, seed: int = 0,
) -> tuple[str, PreviewResult]:  # fmt: skip
    """Open a world by name or file, stand an object in it if it is named, and make the pictures.

    Returns:
        The world's name, and what was made; by default below the workspace's `rig/worlds`.

    Raises:
        ToolkitError: world, sky, time, weather, object or place are unknown, or a number is out of range.
    """
    weathers = tuple(weather for weather in parse_weathers(request.weathers) if weather != CLEAR)
    settings = PreviewSettings(
        request.resolution, film_s=request.film_s, weathers=weathers, seed=seed, renderer=request.renderer
    )
    item.check()
    # a panorama of the user's replaces the default times, but not times that were asked for
    times = request.times or (() if request.sky else DEFAULT_TIMES)
    wanted = check_times(tuple(dict.fromkeys(times)))
    skies = [load_sky(request.sky)] if request.sky else []
    opened = open_world(space, world, seed, scale)
    skies += [make_sky(time) for time in wanted]
    folder = out or space.worlds_dir / opened.name
    placed = None
    # an object's images get a folder of their own, beside those of the empty world
    if item.object_name is not None:
        placed = stand_object(space, opened, item, skies[0], seed)
        folder = out or folder / item.title
    return opened.name, preview_world(opened, skies, folder, settings, placed)


def _light(show: _Show, sky: Sky) -> Renderer:
    """The renderer of world and object under a sky."""
    if show.placed is None:
        return make_renderer(leave_empty(show.world, sky), show.settings.renderer)
    placed = place_object(show.placed.mesh, show.world, show.placed.spot, sky)
    return make_renderer(placed, show.settings.renderer)


def _make(show: _Show, renderer: Renderer, jobs: list[_Job], advance: Any) -> Iterator[tuple[_Job, bytes | None]]:
    """The content of files of a view; None where it is written already."""
    first = jobs[0]
    sky = show.skies[first.sky]
    if first.kind == "picture":
        # all weathers of a view come from a single render
        view = show.camera, show.viewpoints[first.item].T_world_camera
        seed = show.settings.seed, first.item
        pictures = see_through(renderer, show.world, sky, view, [job.weather for job in jobs], seed)
        yield from zip(jobs, map(encode_jpeg, pictures), strict=True)
    elif first.kind == "map":
        sheet = MapSheet.over(show.world, show.settings.map_px)
        # a map is drawn over: no vignette
        above = tone_map(renderer.render(sheet.camera, sheet.T_world_camera), (show.settings.seed,), falloff=0.0)
        path = show.flight.points if show.settings.frames else None
        drawn = draw_map(above, sheet, show.world, show.viewpoints, path)
        yield first, encode_image(drawn, "PNG")
    else:
        _make_film(show, renderer, advance, show.key(first))
        yield first, None


def _make_film(show: _Show, renderer: Renderer, advance: Any, key: str) -> None:
    """Frames first, each in a file, so that an interrupted film resumes; then the film of them."""
    folder = show.folder / FRAMES
    camera = Camera.from_fov(*show.settings.film_size, FOV_DEG)
    # the key is in the name: frames of another request do not match
    poses = show.flight.poses(show.settings.frames)
    files = [folder / f"{key[:12]}-{k:05d}.jpg" for k in range(len(poses))]
    todo = [k for k, file in enumerate(files) if not file.is_file()]
    # a frame counts FRAME steps, the last for its part in the film
    advance((len(files) - len(todo)) * (FRAME - 1))
    for k, light in zip(todo, renderer.render_many((camera, poses[k]) for k in todo), strict=True):
        write_bytes(files[k], encode_jpeg(tone_map(light, (show.settings.seed, k)), 97))
        advance(FRAME - 1)
    # left by a killed run
    for old in show.folder.glob(".*.partial.mp4"):
        delete_file(old)

    def read(file: Path) -> np.ndarray:
        advance()
        return read_image(file)

    write_film(show.folder / FILM, map(read, files), show.settings.film_size, len(files))
    # the film is complete: its frames are no longer needed
    for file in folder.glob("*.jpg"):
        delete_file(file)
    if not any(folder.iterdir()):
        folder.rmdir()


def encode_jpeg(picture: np.ndarray, quality: int = QUALITY) -> bytes:
    """(h, w, 3) uint8 as JPEG, colour at full resolution."""
    return encode_image(picture, "JPEG", quality=quality, subsampling=0)


def _is_there(show: _Show, job: _Job, known: dict[str, tuple[str, str]]) -> bool:
    file, (key, sha256) = show.folder / job.file, known.get(job.file, ("", ""))
    return key == show.key(job) and file.is_file() and sha256_file(file) == sha256


def _read_record(folder: Path) -> dict[str, tuple[str, str]]:
    """Files of an earlier call; none if its record is damaged, for all can be made again."""
    file = folder / RECORD
    if not file.is_file():
        return {}
    try:
        return _Record.model_validate_json(read_bytes(file, 16 << 20)).files
    except ValidationError:
        return {}


def _write_record(show: _Show, record: dict[str, tuple[str, str]]) -> None:
    cameras = {viewpoint.name: viewpoint.T_world_camera.round(6).tolist() for viewpoint in show.viewpoints}
    content = {"schema_version": 1, **show.facts, "camera": show.camera.intrinsics, "T_world_camera": cameras}
    write_json(show.folder / RECORD, {**content, "files": dict(sorted(record.items()))})
