"""An entry: a folder with `entry.json` and a booster for each object; its rules, and the workspace it is judged in."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import inside, read_json, write_bytes, write_json
from toolkit.core.names import FileName, is_file_name
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.experiments.challenge.rules import (
    CLOSED_OBJECTS,
    DRAWN_SEED,
    LARGEST_PATCH,
    POSES,
    VARIANT,
    VERSION,
    Budget,
    Division,
    EntryConfig,
)
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import SHA256, NetworkRecord, Patch, Texture, read_patch, read_texture
from toolkit.rig.camera import Camera
from toolkit.rig.plan import CapturePlan, Pose, make_plan, write_plan
from toolkit.rig.requests import Pattern
from toolkit.rig.variants import check_fit, find_booster

ENTRY, BOOSTERS, OBJECTS = "entry.json", "boosters", "objects"
MOST_LETTERS = 2000
MOST_FILE_BYTES = 64 << 20


def _check_text(text: str) -> str:
    if not text.strip() or not all(one.isprintable() or one == "\n" for one in text):
        raise ValueError("expected words: some printable characters")
    return text


def _check_link(link: str) -> str:
    if link and not re.fullmatch(r"https?://[^\s<>\"']+", link):
        raise ValueError("expected an address that begins with https:// or http://, or nothing")
    return link


Line = Annotated[str, Field(max_length=100), AfterValidator(_check_text)]
Text = Annotated[str, Field(max_length=MOST_LETTERS), AfterValidator(_check_text)]


class EntryRecord(BaseModel):
    """`entry.json`: what its authors say of it.

    Attributes:
        name: of the entry, also its folder's in results.
        authors: of whom it is.
        method: how it was made, in some sentences.
        link: to a paper or to code; may be empty.
        division, budget: where it takes part: objects and poses of the kit or one's own, patches or whole surfaces.
        networks: on which it was trained, each with the SHA-256 of its weights. Such a network is no judge of it.
        seed: of its training, where there is one.
        recipe: the settings, or the command line.
        training_hours: what all of it took; None: not known.
        boosters: SHA-256 of each object's picture.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    schema_version: Literal[1] = 1
    challenge_version: int = VERSION
    name: FileName
    authors: tuple[Line, ...] = Field(min_length=1, max_length=50)
    method: Text
    link: Annotated[str, Field(max_length=300), AfterValidator(_check_link)] = ""
    division: Division = "closed"
    budget: Budget = "patch"
    networks: tuple[NetworkRecord, ...] = Field((), max_length=100)
    seed: int | None = None
    recipe: Annotated[str, Field(max_length=MOST_LETTERS)] = ""
    training_hours: float | None = Field(None, ge=0)
    boosters: dict[FileName, Annotated[str, Field(pattern=SHA256)]] = Field(min_length=1, max_length=100)

    @property
    def variant(self) -> str:
        """Of its pictures."""
        return VARIANT[self.budget]


@dataclass(frozen=True)
class ChallengeEntry:
    """A folder that was read.

    Attributes:
        folder: where it is.
        record: what its authors say.
    """

    folder: Path
    record: EntryRecord

    @cached_property
    def objects(self) -> tuple[str, ...]:
        """That are judged, by name."""
        return CLOSED_OBJECTS if self.record.division == "closed" else tuple(sorted(self.record.boosters))

    def picture(self, name: str) -> Path:
        """The PNG of an object's booster."""
        return inside(self.folder, f"{BOOSTERS}/{name}.png")

    def read_booster(self, name: str) -> Patch | Texture:
        """The booster of an object, see `read_booster`."""
        return read_booster(self.picture(name), self.record.budget)


def read_booster(png: Path, budget: Budget) -> Patch | Texture:
    """A booster, checked against its own record; raises as `read_patch` and `read_texture`."""
    return read_patch(png) if budget == "patch" else read_texture(png)


def read_entry(folder: Path) -> ChallengeEntry:
    """Read `entry.json`.

    Raises:
        ToolkitError: there is none, or a field is wrong; the message names it.
    """
    folder = Path(folder)
    if not (folder / ENTRY).is_file():
        raise ToolkitError(
            f"{folder} is not an entry: expected {ENTRY} in it; 'toolkit challenge init {folder}' makes one"
        )
    return ChallengeEntry(folder, read_json(folder / ENTRY, EntryRecord))


def init_entry(workspace: Workspace, folder: Path, config: EntryConfig) -> ChallengeEntry:
    """Make an entry of a workspace's own boosters; the words about it are to be filled in.

    Raises:
        ToolkitError: the folder holds something, or an object has no booster.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ToolkitError(f"{folder} is there already: name a new folder")
    is_closed = config.division == "closed"
    if is_closed and config.objects:
        expected = "the closed division has its own objects: leave it out, or enter the open one"
        raise FieldError(expected, {"objects": config.objects})
    names = CLOSED_OBJECTS if is_closed else config.objects
    if not names:
        raise FieldError("the open division judges objects of your own: name them", {"objects": ()})
    known = workspace.patches() if config.budget == "patch" else workspace.textures()
    trained: dict[str, NetworkRecord] = {}
    hashes = {}
    for name in names:
        worn = find_booster(workspace, load_object(workspace.object_spec(name)), VARIANT[config.budget])
        assert worn is not None  # only of `unpatched` there is none
        own = read_booster(known[worn.name], config.budget).record
        trained |= {network.sha256: network for network in own.networks}
        hashes[name] = own.png_sha256
        for suffix, file in _list_files(known[worn.name]):
            write_bytes(folder / BOOSTERS / f"{name}{suffix}", file.read_bytes(), folder)
        if not is_closed:
            _copy_object(workspace, name, folder / OBJECTS)
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-_")
    record = EntryRecord(
        name=stem if is_file_name(stem) else "entry", authors=("Your name",), method="How it was made.",
        division=config.division, budget=config.budget, networks=tuple(trained.values()), boosters=hashes,
    )  # fmt: skip
    write_json(folder / ENTRY, record.model_dump(mode="json"))
    return read_entry(folder)


def _list_files(png: Path) -> Iterator[tuple[str, Path]]:
    """(what follows the picture's name, file) of a booster: picture, record, and of a texture coordinates and masks."""
    yield ".png", png
    yield ".json", png.with_suffix(".json")
    for pattern in ("-*.uv.npz", "-*.keep.png"):
        for file in sorted(png.parent.glob(png.stem + pattern)):
            yield file.name.removeprefix(png.stem), file


def _copy_object(workspace: Workspace, name: str, folder: Path) -> None:
    """The spec of an object and the files beside it that bear its name, as `toolkit add` writes them."""
    spec = workspace.object_spec(name)
    for file in sorted(spec.parent.glob(f"{name}.*")):
        if file.is_file() and not file.is_symlink():
            write_bytes(folder / file.name, file.read_bytes(), folder)


def check_entry(folder: Path) -> list[str]:
    """Every fault of an entry, a line each; none where it may be judged. The entry stays as it is."""
    try:
        entry = read_entry(folder)
    except ToolkitError as error:
        return [str(error)]
    return list(_list_faults(entry))


def _list_faults(entry: ChallengeEntry) -> Iterator[str]:
    from tempfile import TemporaryDirectory

    record = entry.record
    if record.challenge_version != VERSION:
        yield f"{ENTRY}: challenge_version {record.challenge_version}: expected {VERSION}, which this toolkit judges"
    for name in sorted(set(entry.objects) ^ set(record.boosters)):
        yield f"{ENTRY}: boosters: {name}: " + ("missing" if name in entry.objects else "is no object of the division")
    yield from _list_stray(entry)
    with TemporaryDirectory(prefix="toolkit-entry-") as scratch:
        space, faults = None, []
        try:
            space = open_space(entry, Path(scratch))
        except ToolkitError as error:
            faults = [str(error)]
        yield from faults
        for name in entry.objects if space is not None else ():
            if name in record.boosters:
                try:
                    yield from _list_booster_faults(entry, name, space)
                except ToolkitError as error:
                    yield str(error)


def _list_stray(entry: ChallengeEntry) -> Iterator[str]:
    """What has no place in an entry: links, what is too large, and what no rule knows."""
    known = re.compile(rf"{ENTRY}|README(\.md|\.txt)?|score(/.*)?|{BOOSTERS}(/[^/]+)?|{OBJECTS}(/[^/]+)?")
    for path in sorted(entry.folder.rglob("*")):
        name = path.relative_to(entry.folder).as_posix()
        if path.is_symlink():
            yield f"{name}: a link: expected the file itself"
        elif not known.fullmatch(name) or (name.startswith(OBJECTS) and entry.record.division == "closed"):
            yield f"{name}: has no place in an entry of the {entry.record.division} division: take it out"
        elif path.is_file() and path.stat().st_size > MOST_FILE_BYTES:
            yield f"{name}: {path.stat().st_size >> 20} MiB: expected at most {MOST_FILE_BYTES >> 20}"


def _list_booster_faults(entry: ChallengeEntry, name: str, space: Workspace | None) -> Iterator[str]:
    assert space is not None
    item, booster, where = load_object(space.object_spec(name)), entry.read_booster(name), f"{BOOSTERS}/{name}.png"
    if booster.record.png_sha256 != entry.record.boosters[name]:
        yield f"{where}: another picture than {ENTRY} names: {booster.record.png_sha256[:12]} is its hash"
    wanted = item.spec.class_name
    if wanted not in (booster.record.class_name, booster.record.class_index):
        yield f"{where}: was trained for '{booster.record.class_name}': expected '{wanted}'"
    said = {network.sha256 for network in entry.record.networks}
    for network in booster.record.networks:
        if network.sha256 not in said:
            which = f"{network.arch} ({network.sha256[:12]})"
            yield f"{where}: its record names {which}, {ENTRY} does not: add it to networks"
    if isinstance(booster, Patch):
        side, most = sum(item.spec.sizes_mm(booster.size_mm)), LARGEST_PATCH * longest_mm(item)
        if side > most + 0.05:
            yield f"{where}: {side:.1f} mm on {name}: expected at most {most:.1f}, a third of its length"
    else:
        check_fit(item, booster)


def longest_mm(item: TableObject) -> float:
    """Longest side of an object."""
    return float(item.mesh.size_mm.max())


def open_space(entry: ChallengeEntry, folder: Path) -> Workspace:
    """A new workspace in which an entry is judged: its boosters, the kit's objects or its own, and the poses.

    Raises:
        ToolkitError: a file is missing or leads out of the entry, or an object cannot be read.
    """
    space = make_workspace(folder)
    target = space.patches_dir if entry.record.budget == "patch" else space.textures_dir
    if entry.record.division == "open":
        for file in sorted((entry.folder / OBJECTS).glob("*")):
            if file.is_file():
                write_bytes(space.objects_dir / file.name, inside(entry.folder, f"{OBJECTS}/{file.name}").read_bytes())
    for name in entry.objects:
        picture = entry.picture(name)
        if not picture.is_file():
            raise ToolkitError(f"{BOOSTERS}/{name}.png is missing: expected the booster of {name}")
        entry.read_booster(name)
        for suffix, file in _list_files(picture):
            source = inside(entry.folder, f"{BOOSTERS}/{file.name}")
            write_bytes(target / f"{name}{suffix}", source.read_bytes())
    write_plan(space.plan_file, plan_poses(space, entry.objects))
    return space


def plan_poses(space: Workspace, names: Sequence[str]) -> CapturePlan:
    """The plan's 18 poses of each object, and 18 more that the version draws: anywhere above the table."""
    from toolkit.rig.patch_places import draw_poses

    items = [load_object(space.object_spec(name)) for name in names]
    camera = Camera.from_fov()
    plan = make_plan(items, camera, Pattern(count=POSES))
    drawn = {item.name: draw_poses(item, camera, POSES, DRAWN_SEED) for item in items}
    objects = {
        name: [*poses, *(_renumber(pose, POSES + pose.id) for pose in drawn[name])]
        for name, poses in plan.objects.items()
    }
    return plan.model_copy(update={"objects": objects})


def _renumber(pose: Pose, number: int) -> Pose:
    return pose.model_copy(update={"id": number})
