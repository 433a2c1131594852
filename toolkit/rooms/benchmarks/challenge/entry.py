"""An entry: a folder with `entry.json` and a booster for each object; its rules, and the workspace of its judging."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import inside, read_bytes, read_json, real_path, write_bytes, write_json
from toolkit.core.rooms import explain_missing
from toolkit.core.text import FileName, is_file_name
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.objects.add import find_named_files
from toolkit.objects.load import load_object
from toolkit.objects.records import SHA256, NetworkRecord
from toolkit.objects.spec import BUILTIN_PREFIX, read_spec
from toolkit.rig import Pattern
from toolkit.rig.applied.base import StoredBooster
from toolkit.rig.camera import Camera
from toolkit.rig.plan import CapturePlan, make_plan, write_plan
from toolkit.rig.variants import KIND_OF, find_booster
from toolkit.rooms.benchmarks.challenge import (
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

ENTRY, BOOSTERS, OBJECTS = "entry.json", "boosters", "objects"
SCORE, SCORE_FILE, OUTCOMES, PICTURES = "score", "score.json", "outcomes.csv", "pictures"
SCORE_FOLDER = re.compile(rf"{SCORE}(-[1-9]\d{{0,2}})?")
"""Folders of scores: by the first judges, and by others."""
MOST_LISTED = 20
"""Largest number of misplaced files that are listed."""
MOST_LETTERS = 2000
MOST_FILE_BYTES = 64 << 20


def _check_text(text: str) -> str:
    if not text.strip() or not all(character.isprintable() or character == "\n" for character in text):
        raise ValueError("expected words: some printable characters")
    return text


def _check_link(link: str) -> str:
    if link and not re.fullmatch(r"https?://[^\s<>\"']+", link):
        raise ValueError("expected an address that begins with https:// or http://, or nothing")
    return link


Line = Annotated[str, Field(max_length=100), AfterValidator(_check_text)]
Text = Annotated[str, Field(max_length=MOST_LETTERS), AfterValidator(_check_text)]


class EntryRecord(BaseModel):
    """`entry.json`, written by the authors of an entry.

    Attributes:
        name: of the entry, and of its folder in results.
        method: some sentences on how it was made.
        link: to a paper or to code; may be empty.
        networks: that trained it, with the SHA-256 of their weights. As judges they count as seen.
        seed: of its training; None without training.
        recipe: the settings, or the command line.
        training_hours: of all boosters; None if unknown.
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
        """Variant of the entry's pictures."""
        return VARIANT[self.budget]


@dataclass(frozen=True)
class ChallengeEntry:
    """The folder of an entry and its record."""

    folder: Path
    record: EntryRecord

    @cached_property
    def objects(self) -> tuple[str, ...]:
        """Names of the judged objects, sorted."""
        return CLOSED_OBJECTS if self.record.division == "closed" else tuple(sorted(self.record.boosters))

    def file_name(self, name: str) -> str:
        """Return the path of an object's booster: the picture of a patch or texture, or the folder of a wrap."""
        return f"{BOOSTERS}/{name}" if self.record.budget == "wrap" else f"{BOOSTERS}/{name}.png"

    def read_booster(self, name: str) -> StoredBooster:
        """The booster of an object, see `read_booster`."""
        return read_booster(inside(self.folder, self.file_name(name)), self.record.budget)

    def check_hash(self, name: str) -> None:
        """Raise a `ToolkitError` if the booster of an object is not the one that the record names."""
        sha256 = self.read_booster(name).sha256
        if sha256 != self.record.boosters.get(name):
            raise ToolkitError(f"{self.file_name(name)}: is not what {ENTRY} names: {sha256[:12]} is its hash")

    def list_files(self, name: str) -> list[tuple[str, Path]]:
        """The files of an object's booster, see `list_files`."""
        return list_files(self.read_booster(name), self.record.budget)


def read_booster(path: Path, budget: Budget) -> StoredBooster:
    """A booster, checked against its own record; raises a `ToolkitError` if that fails, or nothing is trained on it."""
    kind = KIND_OF.get(VARIANT[budget])
    if kind is None or kind.read is None:
        raise explain_missing(f"variant:{VARIANT[budget]}") or LookupError(f"no kind of booster reads a {budget}")
    return kind.read(path)


def list_files(booster: StoredBooster, budget: Budget) -> list[tuple[str, Path]]:
    """Each file of a booster, after its name without the object's."""
    stem = booster.files[0].stem
    return [(f"/{file.name}" if budget == "wrap" else file.name.removeprefix(stem), file) for file in booster.files]


def read_entry(folder: Path) -> ChallengeEntry:
    """Read `entry.json`; a missing file or a wrong field is a `ToolkitError`."""
    folder = Path(folder)
    if not (folder / ENTRY).is_file():
        raise ToolkitError(
            f"{folder} is not an entry: expected {ENTRY} in it; 'toolkit challenge init {folder}' makes one"
        )
    return ChallengeEntry(real_path(folder), read_json(folder / ENTRY, EntryRecord))


def init_entry(workspace: Workspace, folder: Path, config: EntryConfig) -> ChallengeEntry:
    """Make an entry of a workspace's boosters; authors and method are placeholders.

    Raises:
        ToolkitError: the folder holds something, or an object has no booster.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ToolkitError(f"{folder} is there already: name a new folder")
    # the objects of the division
    is_closed = config.division == "closed"
    if is_closed and config.objects:
        expected = "the closed division has its own objects: leave it out, or enter the open division"
        raise FieldError(expected, {"objects": config.objects})
    names = CLOSED_OBJECTS if is_closed else config.objects
    if not names:
        raise FieldError("the open division judges your own objects: name them", {"objects": ()})
    places = {"patch": workspace.patches, "wrap": workspace.wraps, "texture": workspace.textures}
    # copy each booster, and note the networks that trained it: as judges they count as seen
    trained: dict[str, NetworkRecord] = {}
    hashes = {}
    for name in names:
        worn = find_booster(workspace, load_object(workspace.object_spec(name)), VARIANT[config.budget])
        assert worn is not None  # only of `unpatched` there is none
        own = read_booster(places[config.budget]()[worn.name], config.budget)
        trained |= {network.sha256: network for network in own.networks}
        hashes[name] = own.sha256
        for suffix, file in list_files(own, config.budget):
            write_bytes(folder / BOOSTERS / f"{name}{suffix}", file.read_bytes(), folder)
        if not is_closed:
            _copy_object(workspace.object_spec(name).parent, name, folder / OBJECTS)
    # the record is a draft: authors and method are for the entrant to fill in
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-_")
    record = EntryRecord(
        name=stem if is_file_name(stem) else "entry", authors=("Your name",), method="How it was made.",
        division=config.division, budget=config.budget, networks=tuple(trained.values()), boosters=hashes,
    )  # fmt: skip
    write_json(folder / ENTRY, record.model_dump(mode="json"))
    return read_entry(folder)


def _list_object_files(folder: Path, name: str) -> list[str]:
    """Paths in a folder of an object's spec, its mesh, unless that is built in, and the files that the mesh names.

    Raises:
        ToolkitError: the spec or the mesh cannot be read, or names a file outside of its folder.
    """
    spec = f"{name}.toml"
    mesh = read_spec(inside(folder, spec)).mesh
    if mesh.startswith(BUILTIN_PREFIX):
        return [spec]
    named = find_named_files(inside(folder, mesh))
    root = real_path(folder)
    return [spec, PurePosixPath(mesh).as_posix(), *(file.relative_to(root).as_posix() for file in named)]


def _copy_object(folder: Path, name: str, target: Path) -> None:
    """Copy the files of an object to another folder of specs; raises as `_list_object_files`."""
    for path in _list_object_files(folder, name):
        write_bytes(target / path, read_bytes(inside(folder, path), MOST_FILE_BYTES), target)


def list_score_folders(folder: Path) -> list[Path]:
    """Folders of an entry's scores."""
    return sorted(place for place in Path(folder).glob(f"{SCORE}*") if SCORE_FOLDER.fullmatch(place.name))


def check_entry(folder: Path) -> list[str]:
    """List every fault of an entry, a line each; none if it may be judged. The entry stays as it is."""
    try:
        entry = read_entry(folder)
    except ToolkitError as error:
        return [str(error)]
    return list(_list_faults(entry))


def _list_faults(entry: ChallengeEntry) -> Iterator[str]:
    record = entry.record
    # version and objects of the record
    if record.challenge_version != VERSION:
        yield f"{ENTRY}: challenge_version {record.challenge_version}: expected {VERSION}, which this toolkit judges"
    for name in sorted(set(entry.objects) ^ set(record.boosters)):
        yield f"{ENTRY}: boosters: {name}: " + ("missing" if name in entry.objects else "is no object of the division")
    # which files the folder has; without all of them nothing can be opened
    yield from _list_stray(entry)
    missing = list(_list_missing(entry))
    yield from missing
    if missing:
        return
    # whether each booster can be read, and fits its object
    with TemporaryDirectory(prefix="toolkit-entry-") as scratch:
        try:
            space = open_space(entry, Path(scratch))
        except ToolkitError as error:
            yield str(error)
            return
        for name in entry.objects:
            if name in record.boosters:
                try:
                    yield from _list_booster_faults(entry, name, space)
                except ToolkitError as error:
                    yield str(error)


def _list_missing(entry: ChallengeEntry) -> Iterator[str]:
    for name in entry.objects:
        if not (entry.folder / entry.file_name(name)).exists():
            yield f"{entry.file_name(name)} is missing: expected the booster of {name}"
        spec = f"{OBJECTS}/{name}.toml"
        if entry.record.division == "open" and not (entry.folder / spec).is_file():
            yield f"{spec} is missing: the open division judges your own objects, which go into the entry"


def _list_known(entry: ChallengeEntry) -> Iterator[str]:
    """The files that may be in an entry, by their paths below its folder."""
    yield from (ENTRY, "README", "README.md", "README.txt")
    # scores with their pictures and pages
    pictures = (f"{PICTURES}/{name}.png" for name in entry.objects)
    page = (f"page/{name}" for name in ("index.html", "board.csv", f"{entry.record.name}.json"))
    names = (SCORE_FILE, OUTCOMES, *pictures, *page)
    yield from (f"{place.name}/{name}" for place in list_score_folders(entry.folder) for name in names)
    # boosters, and objects of the open division
    for name in entry.objects:
        own, objects = [entry.file_name(name), f"{BOOSTERS}/{name}.json"], [f"{OBJECTS}/{name}.toml"]
        with suppress(ToolkitError):  # another fault
            own = [f"{BOOSTERS}/{name}{suffix}" for suffix, _ in entry.list_files(name)]
        yield from own
        if entry.record.division == "open":
            with suppress(ToolkitError):
                objects = [f"{OBJECTS}/{path}" for path in _list_object_files(inside(entry.folder, OBJECTS), name)]
            yield from objects


def _list_stray(entry: ChallengeEntry) -> Iterator[str]:
    """List links, large files and files without a place in an entry; only the first lines of many."""
    known = set(_list_known(entry))
    # folders that lead to a known file; all others are strays as a whole
    folders = {up.as_posix() for name in known for up in PurePosixPath(name).parents}
    faults: list[str] = []
    waiting = ["."]
    while waiting:
        # folders without a place are not searched, however much or deep they hold
        for path in sorted((entry.folder / waiting.pop()).iterdir()):
            name = path.relative_to(entry.folder).as_posix()
            if path.is_symlink():
                faults.append(f"{name}: a link: expected the file itself")
            elif name in folders and path.is_dir():
                waiting.append(name)
            elif name not in known and not (
                SCORE_FOLDER.fullmatch(name.partition("/")[0]) and name.endswith(".partial")
            ):
                faults.append(f"{name}: has no place in an entry of the {entry.record.division} division: take it out")
            elif not path.is_file():
                faults.append(f"{name}: is no file: expected a plain file")
            elif path.stat().st_size > MOST_FILE_BYTES:
                faults.append(f"{name}: {path.stat().st_size >> 20} MiB: expected at most {MOST_FILE_BYTES >> 20}")
    yield from faults[:MOST_LISTED]
    if len(faults) > MOST_LISTED:
        yield f"{entry.folder}: {len(faults) - MOST_LISTED} more files that have no place in it: take them out"


def _list_booster_faults(entry: ChallengeEntry, name: str, space: Workspace) -> Iterator[str]:
    item, booster, where = load_object(space.object_spec(name)), entry.read_booster(name), entry.file_name(name)
    try:
        entry.check_hash(name)
    except ToolkitError as error:
        yield str(error)
    # trained for the object's own class
    wanted = item.spec.class_name
    if wanted not in (booster.class_name, booster.class_index):
        yield f"{where}: was trained for '{booster.class_name}': expected '{wanted}'"
    # the entry names every network of the training, so that none counts as unseen
    said = {network.sha256 for network in entry.record.networks}
    for network in booster.networks:
        if network.sha256 not in said:
            which = f"{network.arch} ({network.sha256[:12]})"
            yield f"{where}: its record names {which}, {ENTRY} does not: add it to networks"
    # the size of a patch is bounded; a wrap or a texture must be of this mesh
    booster.check(item)
    if booster.size_mm is not None:
        side, most = sum(item.spec.sizes_mm(booster.size_mm)), LARGEST_PATCH * float(item.mesh.size_mm.max())
        if side > most + 0.05:
            yield f"{where}: {side:.1f} mm on {name}: expected at most {most:.1f}, a third of its length"


def open_space(entry: ChallengeEntry, folder: Path) -> Workspace:
    """Make a workspace with the boosters, objects and poses of an entry, in which it is judged.

    Raises:
        ToolkitError: a file is missing or leads out of the entry, or an object cannot be read.
    """
    space = make_workspace(folder)
    target = {"patch": space.patches_dir, "wrap": space.wraps_dir, "texture": space.textures_dir}[entry.record.budget]
    for fault in _list_missing(entry):
        raise ToolkitError(fault)
    # only files inside of the entry, of limited size
    for name in entry.objects:
        if entry.record.division == "open":
            _copy_object(inside(entry.folder, OBJECTS), name, space.objects_dir)
        for suffix, file in entry.list_files(name):
            source = inside(entry.folder, file.relative_to(entry.folder).as_posix())
            write_bytes(target / f"{name}{suffix}", read_bytes(source, MOST_FILE_BYTES))
    # poses follow from the objects alone: all entries are seen from the same places
    write_plan(space.plan_file, plan_poses(space, entry.objects))
    return space


def plan_poses(space: Workspace, names: Sequence[str]) -> CapturePlan:
    """Plan 18 poses of each object, and draw 18 more of the version, anywhere above the table."""
    from toolkit.rig.patch_places import draw_poses

    items = [load_object(space.object_spec(name)) for name in names]
    camera = Camera.from_fov()
    plan = make_plan(items, camera, Pattern(count=POSES))
    drawn = {item.name: draw_poses(item, camera, POSES, DRAWN_SEED) for item in items}
    for name, poses in drawn.items():
        plan.objects[name].extend(pose.model_copy(update={"id": POSES + pose.id}) for pose in poses)
    return plan
