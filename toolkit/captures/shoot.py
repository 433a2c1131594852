"""`toolkit capture-sim`: shoot every object at every pose of the plan, with and without its patch."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from toolkit import __version__
from toolkit.boosters.transforms.camera import LEAST_DEFOCUS_PX, CameraBlur, Exposure
from toolkit.boosters.transforms.printing import SHEEN, PrintProcess, ProfiledPrint, use_profile
from toolkit.captures.capture import RENDERER_VERSION
from toolkit.captures.manifest import (
    LEFT_OUT,
    CaptureRecord,
    append_record,
    is_finished,
    read_manifest,
    write_transforms,
)
from toolkit.core.config import Config
from toolkit.core.console import Ticker, errors
from toolkit.core.draws import Draws
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import inside, sha256_bytes, sha256_json, write_bytes
from toolkit.core.records import hold_folder
from toolkit.core.threads import map_ahead
from toolkit.core.work import Work
from toolkit.core.workspace import Workspace
from toolkit.engine.local import InProcess
from toolkit.engine.units import Engine, Unit, cut_groups, run_resumable
from toolkit.imaging.printer import read_print_profile
from toolkit.imaging.read import encode_image
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.mesh import Mesh
from toolkit.objects.spec import Margin
from toolkit.rig import PAIR
from toolkit.rig.applied.base import AppliedBooster
from toolkit.rig.board import Board
from toolkit.rig.camera import Camera
from toolkit.rig.plan import CapturePlan, Pose, check_poses
from toolkit.rig.renderers import RAYCAST, RENDERERS, check_renderer, describe_cost, make_renderer
from toolkit.rig.scene import Scene
from toolkit.rig.studio import LIGHTS, add_board, make_studio, name_studio, name_with_board
from toolkit.rig.variants import apply_booster, find_booster, note_booster

NETWORK_PX = 224
"""Side of a network's input, to which the pixels of `CameraBlur` refer."""
LARGEST_SCALE = 10
"""Largest factor of the blur, for images of 2240 px and more."""
FORMATS = ("jpg", "png")
UNIT_SHOTS = 64
"""Largest number of shots in a unit."""
NOT_WANTED = "of another plan or file format than the images that were shot last"
SHOTS = Work("shot", 4)
_painting = Lock()
Printer = PrintProcess | ProfiledPrint


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

    printer: Printer = field(default_factory=lambda: PrintProcess(probability=1.0))
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
        """Return all settings and the version of the method, which the key of an image holds."""
        settings = {item.name: getattr(self, item.name) for item in fields(self)}
        return {"version": 5} | {
            name: value.model_dump() if isinstance(value, Config) else value for name, value in settings.items()
        }

    def tape(self, mesh: Mesh) -> Mesh:
        """The mesh with tape over what is taped on it; the pieces of a wrap are glued."""
        materials = tuple(
            replace(material, roughness=self.tape_roughness) if material.sheet == "taped" else material
            for material in mesh.materials
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
        return encode_image(pixels, "JPEG", quality=self.jpeg_quality)


def print_booster(
    booster: AppliedBooster | None, printer: Printer | None, seed: int, name: str
) -> AppliedBooster | None:
    """The booster as it comes out of the printer; a texture, which is not printed, as it is.

    Args:
        booster: what is printed.
        printer: inks and paper; None: colours are those of the file.
        seed: of what the printer draws.
        name: of the object: its sheets come out of one printer.
    """
    if booster is None or printer is None or booster.texel_mm is None:
        return booster
    # ink spreads by millimetres, however many texels a sheet has
    to_size = printer.with_overrides(texel_mm=booster.texel_mm)
    return booster.printed(lambda pixels: print_pixels(to_size, pixels, seed, name))


def print_pixels(printer: Printer, pixels: np.ndarray, seed: int, name: str) -> np.ndarray:
    """(n, n, 3) uint8 sRGB on the printer's paper of the same pixels in a file; draws depend on seed and name alone."""
    import torch

    from toolkit.boosters.pixels import quantise  # brings torch as well, which planning does not need

    given = torch.from_numpy(pixels.transpose(2, 0, 1) / np.float32(255))
    printed = printer.change(given, Draws(seed, 0, "rehearse").of(f"print {name}"))
    return np.ascontiguousarray(quantise(printed))


def make_rehearsal(print_profile: Path | None = None) -> Rehearsal:
    """Return the rehearsal on a random printer, or on that of a profile; a `ToolkitError` if it cannot be read."""
    return Rehearsal() if print_profile is None else Rehearsal(read_printer(print_profile))


def read_printer(print_profile: Path) -> ProfiledPrint:
    """Return the printer of a profile; a `ToolkitError` if it cannot be read."""
    return use_profile(read_print_profile(print_profile), SHEEN)


@dataclass(frozen=True)
class StoredImage:
    """A finished image and what its source's manifest says of it."""

    file: Path
    record: CaptureRecord


def index_images(source_dir: Path) -> dict[str, StoredImage]:
    """Return the images of a source by their key; a `ToolkitError` if the manifest is broken."""
    return {
        record.inputs_sha256: StoredImage(inside(source_dir, path), record)
        for path, record in read_manifest(source_dir).items()
        if record.inputs_sha256
    }


def copy_image(stored: StoredImage, source_dir: Path, path: str) -> bool:
    """Copy an image to `source_dir / path` and into its manifest; False where its file is gone or was changed.

    Raises:
        ToolkitError: the disk is full or read-only.
    """
    try:
        content = stored.file.read_bytes()
    except OSError:
        return False
    # a picture that somebody has edited is not what its hash of inputs says
    if sha256_bytes(content) != stored.record.image_sha256:
        return False
    write_bytes(Path(source_dir) / path, content, Path(source_dir))
    # a stored image may have been left out of results where it lies; here it counts
    append_record(source_dir, without_mark(stored.record).model_copy(update={"path": path}))
    return True


def without_mark(record: CaptureRecord) -> CaptureRecord:
    """The record of an image that counts, whether or not it was left out before."""
    made = {name: value for name, value in record.made.items() if name != LEFT_OUT}
    return record.model_copy(update={"made": made})


def leave_out(source_dir: Path, reasons: Mapping[str, str]) -> None:
    """Note in a source's manifest why images no longer count; `reasons` are by path below the source."""
    known = read_manifest(source_dir) if reasons else {}
    for path, reason in reasons.items():
        marked = {**known[path].made, LEFT_OUT: reason}
        if known[path].made != marked:
            append_record(source_dir, known[path].model_copy(update={"made": marked}))


@dataclass(frozen=True)
class ShootSettings:
    """How to shoot.

    Attributes:
        seed: of backdrop and sensor noise.
        backdrop: a table top by name; None: one per object, drawn by the seed.
        light: a light by name.
        renderer: a name of `toolkit.rig.renderers.RENDERERS`.
        image_format: `jpg` (quality 95, no chroma subsampling) or `png`.
        board: the printed board that lies under the object; None for the bare table.
        rehearsal: what print, hand and phone do to the shots; None: nothing.
        perfect: a wrap's pieces lie exactly in their places.
        coverage: share of what cameras see that a wrap's best pieces may cover, the others are left off; None: all.
        margin: what is on the paper around a patch; None: what its record states.
        printer: inks and paper of all that is printed; None: colours are those of the file. A rehearsal has its own.
    """

    seed: int = 0
    backdrop: str | None = None
    light: str = "studio"
    renderer: str = "raycast"
    image_format: str = "jpg"
    board: Board | None = None
    rehearsal: Rehearsal | None = None
    perfect: bool = False
    coverage: float | None = None
    margin: Margin | None = None
    printer: ProfiledPrint | None = None

    def find_booster(self, workspace: Workspace, item: TableObject, variant: str) -> AppliedBooster | None:
        """What is put on an object; raises as `toolkit.rig.variants.find_booster`."""
        booster = find_booster(workspace, item, variant, perfect=self.perfect, seed=self.seed)
        if booster is not None and self.margin is not None:
            booster = replace(booster, margin=self.margin)
        return booster if self.coverage is None or booster is None else booster.covering(item, self.coverage)


@dataclass(frozen=True)
class Shot:
    """One image to take.

    Attributes:
        item, variant: what it shows.
        pose_id: of the plan's pose, None where it is not known; it also draws the noise.
        camera, T_world_camera: from where.
        path: below the source's folder.
        key: of the image, from `SHOTS`.
        made: what the manifest says of it besides how it was rendered.
    """

    item: TableObject
    variant: str
    pose_id: int | None
    camera: Camera
    T_world_camera: np.ndarray
    path: str
    key: str
    made: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ShootResult:
    """What a run made.

    Attributes:
        source_dir: where the images are.
        shot, kept: images shot now, and kept from before.
        stale: images of another plan that are still there; the manifest says that they no longer count.
        failed: (what, reason) of shots that could not be made; the next run tries them again.
    """

    source_dir: Path
    shot: int
    kept: int
    stale: list[str]
    failed: tuple[tuple[str, str], ...] = ()

    def joined(self, other: "ShootResult") -> "ShootResult":
        """Both results, of runs that shot into one folder."""
        counts = self.shot + other.shot, self.kept + other.kept
        return ShootResult(self.source_dir, *counts, self.stale + other.stale, self.failed + other.failed)


def shoot_plan(
    workspace: Workspace, plan: CapturePlan, objects: Iterable[str], variants: Iterable[str] = PAIR,
    settings: ShootSettings | None = None, source: str = "sim", *,
    captures_dir: Path | None = None, patch_mm: float | None = None, stored: Mapping[str, StoredImage] | None = None,
    engine: Engine | None = None, bar: Ticker | None = None,
) -> ShootResult:  # fmt: skip
    """Shoot what the plan asks for and is not there yet.

    Each finished image is on disk and in the manifest before the next begins, so a run that was stopped goes on where
    it was.

    Args:
        workspace: whose objects and patches are meant.
        plan: camera and poses.
        objects: what is shot.
        variants: and with what on them.
        settings: how.
        source: folder below `captures_dir`.
        captures_dir: where to, by default the workspace's `captures/`.
        patch_mm: printed side of every patch, by default as the object's spec or the patch's record says.
        stored: images by the hash of their inputs (`index_images`) that are copied instead of shot again.
        engine: where images are shot; by default in this process.
        bar: counts each image that is shot; by default a bar of its own.

    Raises:
        ToolkitError: an object, variant, backdrop, light, renderer or source is unknown, an object is not in the plan,
            has no patch, or a pose of the plan cannot be shot; or the disk is full or read-only.
    """
    settings = settings or ShootSettings()
    check_settings(workspace, settings, source)
    variants = tuple(dict.fromkeys(variants))  # named twice is shot once
    # objects are loaded once, however many variants are shot
    items = {name: _load_item(workspace, name, patch_mm) for name in objects}
    shots = [
        shot
        for item in items.values()
        for variant in variants
        for shot in plan_scene(workspace, plan, item, variant, settings)
    ]
    source_dir = (captures_dir or workspace.captures_dir) / source
    return take_shots(workspace, shots, settings, source_dir, stored, engine=engine, bar=bar)


def check_settings(workspace: Workspace, settings: ShootSettings, source: str) -> None:
    """Raise a `ToolkitError` for an unknown renderer or image format, or a source that is not a folder's name."""
    check_renderer(settings.renderer)
    if settings.image_format not in FORMATS:
        raise one_of("image format", settings.image_format, list(FORMATS))
    if settings.rehearsal is not None and settings.image_format != "jpg":
        raise FieldError("a rehearsal makes a phone's JPEGs: leave out {image_format} png", {"rehearse": True})
    workspace.source_dir(source)


def check_no_photographs(source_dir: Path, known: Mapping[str, CaptureRecord]) -> None:
    """Raise a `ToolkitError` if the manifest lists a photograph: it cannot be made again."""
    photograph = next((path for path, record in known.items() if "renderer" not in record.made), None)
    if photograph is not None:
        raise FieldError(
            f"{source_dir} holds photographs ({photograph}), which the rig would overwrite: name another {{source}}", {}
        )


def take_shots(
    workspace: Workspace, shots: Iterable[Shot], settings: ShootSettings, source_dir: Path,
    stored: Mapping[str, StoredImage] | None = None, *, engine: Engine | None = None, bar: Ticker | None = None,
) -> ShootResult:  # fmt: skip
    """Take the shots that are not there yet.

    Those that follow each other and share object and variant are one scene, and its light is baked once; a scene of
    over 64 shots is cut into several units, and its light is baked for each.

    Raises:
        ToolkitError: a patch is missing, a backdrop or light is unknown, the folder holds photographs, or the disk is
            full or read-only.
    """
    # the records of the shots that are missing, filled as units are listed
    wanted, planned = {shot.path: shot for shot in shots}, dict[str, CaptureRecord]()

    def keep(path: str, shot: Shot, content: bytes) -> None:
        write_bytes(source_dir / path, content, source_dir)
        # after the file: a line in the manifest means a whole image
        append_record(source_dir, planned[path].model_copy(update={"image_sha256": sha256_bytes(content)}))

    # the lock keeps other runs out, so that the manifest changes here alone
    with hold_folder(source_dir):
        known = read_manifest(source_dir)
        check_no_photographs(source_dir, known)
        missing = {
            path: shot
            for path, shot in wanted.items()
            if not is_finished(source_dir, known.get(path), shot.key)
            and not _copy_stored(shot, stored or {}, source_dir)
        }
        # images that fit the plan again count again
        for path in wanted.keys() - missing.keys():
            if path in known and LEFT_OUT in known[path].made:
                append_record(source_dir, without_mark(known[path]))
        sizes = [shot.camera.width * shot.camera.height for shot in missing.values()]
        if cost := describe_cost(settings.renderer, sizes):
            errors.print(f"note: {cost}", markup=False, soft_wrap=True)
        # an image and its line are written as soon as it is shot: interrupted runs resume
        units = _list_units(workspace, missing, settings, planned)
        ran = run_resumable("shooting", wanted, missing, units, keep, engine or InProcess(), source_dir, bar=bar)
        records = read_manifest(source_dir)
        folders = {Path(path).parent for path in wanted}
        # of the whole source: other objects and variants lie there too
        there = {path: one for path, one in sorted(records.items()) if (source_dir / path).is_file()}
        # of folders that were shot into: other variants are left alone
        stale = [path for path in there if path not in wanted and Path(path).parent in folders]
        leave_out(source_dir, dict.fromkeys(stale, NOT_WANTED))
        write_transforms(source_dir, list(there.values()))
    return ShootResult(source_dir, ran.made, ran.kept, stale, ran.failed)


def _load_item(workspace: Workspace, name: str, patch_mm: float | None) -> TableObject:
    item = load_object(workspace.object_spec(name))
    return item if patch_mm is None else replace(item, spec=item.spec.with_patch_size(patch_mm))


def _copy_stored(shot: Shot, stored: Mapping[str, StoredImage], source_dir: Path) -> bool:
    image = stored.get(shot.key)
    return image is not None and copy_image(image, source_dir, shot.path)


def studio_for(item: TableObject, settings: ShootSettings) -> Scene:
    """The studio of an object: its backdrop and details follow from (seed, name) alone, and the board lies in it."""
    size = float(item.mesh.size_mm.max())
    with _painting:  # once, where two threads set up scenes of one object
        studio = make_studio(_seed_of(item, settings), size, settings.backdrop, settings.light, keep=True)
    return studio if settings.board is None else add_board(studio, settings.board)


def _seed_of(item: TableObject, settings: ShootSettings) -> tuple[int, int]:
    # by name and not by place in the list: an object keeps its table whatever else is shot
    return settings.seed, int.from_bytes(hashlib.sha256(item.name.encode()).digest()[:4], "big")


def _describe_studio(item: TableObject, settings: ShootSettings) -> dict[str, Any]:
    """Name and light of `studio_for`, which is not painted for it."""
    name = name_studio(_seed_of(item, settings), settings.backdrop, settings.light)
    return {
        "studio": name if settings.board is None else name_with_board(name), "light": asdict(LIGHTS[settings.light])
    }  # fmt: skip


def plan_scene(
    workspace: Workspace, plan: CapturePlan, item: TableObject, variant: str, settings: ShootSettings
) -> list[Shot]:
    """The shots of one object in one variant; raises as `shoot_plan`."""
    name = item.name
    if name not in plan.objects:
        raise ToolkitError(f"object '{name}' is not in {workspace.plan_file}: run 'toolkit plan --object {name}'")
    camera = plan.camera
    # poses of the file may have been edited by hand
    check_poses(item, camera, plan.objects[name])
    # the key of a shot is all that its picture depends on
    look = describe_look(workspace, item, variant, settings) | {"camera": camera.intrinsics}

    # a rehearsed camera is held by hand, near the pose
    def stand(pose: Pose) -> np.ndarray:
        if settings.rehearsal is None:
            return pose.matrix()
        rng = Draws(settings.seed, pose.id, "rehearse").of(f"hand {name} {variant}")
        return settings.rehearsal.perturb_pose(pose.matrix(), pose.distance_mm, rng)

    return [
        Shot(
            item, variant, pose.id, camera, stand(pose),
            path=f"{name}/{variant}/pose_{pose.id:02d}.{settings.image_format}",
            key=SHOTS.key(look | {"pose": pose.model_dump()}),
        )
        for pose in plan.objects[name]
    ]  # fmt: skip


def describe_look(workspace: Workspace, item: TableObject, variant: str, settings: ShootSettings) -> dict[str, Any]:
    """Return all inputs of an object's images in a variant, but for camera and pose.

    Raises:
        ToolkitError: a variant, backdrop or light is unknown, or the patch is missing.
    """
    how = asdict(settings)
    del how["perfect"], how["coverage"], how["margin"]  # said with the booster that they act on
    for absent in [name for name in ("board", "rehearsal", "printer") if how[name] is None]:
        del how[absent]  # images from before there was one keep their hash
    # a renderer of a newer version may draw other pictures
    if (version := RENDERERS[check_renderer(settings.renderer)].version) is not None:
        how[settings.renderer] = version
    if settings.rehearsal is not None:
        how["rehearsal"] = settings.rehearsal.describe()
    if settings.printer is not None:
        how["printer"] = settings.printer.model_dump()
    # the object, its studio and its settings; what is on it follows
    look = {"mesh": item.mesh_sha256, **_describe_studio(item, settings), "variant": variant, **how}
    booster = settings.find_booster(workspace, item, variant)
    if booster is not None:
        look |= booster.describe(item)
    return look


def _list_units(
    workspace: Workspace, missing: Mapping[str, Shot], settings: ShootSettings, planned: dict[str, CaptureRecord]
) -> Iterator[Unit[bytes]]:
    """Units of images; `planned` gets the records of their shots, but for the hash of the image."""
    for paths, shots in cut_groups(missing, lambda shot: (shot.item.name, shot.variant), UNIT_SHOTS):
        item, variant = shots[0].item, shots[0].variant
        booster = settings.find_booster(workspace, item, variant)
        made = describe_made(item, booster, settings)
        planned.update((shot.path, _describe_shot(shot, booster, made)) for shot in shots)
        places = [(shot.camera, shot.T_world_camera, shot.pose_id or 0) for shot in shots]
        inputs = (item, variant, booster, settings, places)
        # a ray scene is built on one core: the next one is, while this one is shot
        yield Unit(paths, shoot_unit, inputs, f"{item.name} {variant}", begins_early=settings.renderer == RAYCAST)


def describe_made(item: TableObject, booster: AppliedBooster | None, settings: ShootSettings) -> dict[str, Any]:
    """What a manifest says of how an image was made: what two images of a pair must share, and what is put on."""
    # what two images must share to be compared, as a hash
    studio = _describe_studio(item, settings)
    how = {name: value for name, value in asdict(settings).items() if name in ("board", "renderer")}
    rehearsal = settings.rehearsal and settings.rehearsal.describe()
    printed = {} if settings.printer is None else {"printer": settings.printer.model_dump()}
    scene = how | studio | {"rehearsal": rehearsal} | printed
    made = {
        "with": f"toolkit {__version__}", "renderer": settings.renderer, "look": SHOTS.version,
        "studio": studio["studio"], "scene_sha256": sha256_json(scene), "seed": settings.seed,
        "mesh_sha256": item.mesh_sha256,
        "class": str(item.spec.class_name), **note_booster(booster),
        **({} if settings.rehearsal is None else {"rehearsed": True}),
    }  # fmt: skip
    # a library's renderer draws other pictures in another version of it
    if library := RENDERERS[settings.renderer].describe()[0]:
        made[RENDERER_VERSION] = library
    # the sheet's place, as two images of a booster in two places are no pair
    if booster is not None and (place := booster.describe_place(item)):
        made["sheet_sha256"] = sha256_json(place)
    return made


def _describe_shot(shot: Shot, booster: AppliedBooster | None, made: Mapping[str, Any]) -> CaptureRecord:
    return CaptureRecord(
        path=shot.path, object=shot.item.name, variant=shot.variant, pose_id=shot.pose_id,
        # six digits: below what any pixel shows, above what float noise changes
        T_world_camera=np.round(shot.T_world_camera, 6).tolist(), intrinsics=shot.camera.intrinsics,
        booster_sha256=booster.sha256 if booster else None, made={**made, **shot.made},
        inputs_sha256=shot.key,
    )  # fmt: skip


def shoot_unit(
    item: TableObject, variant: str, booster: AppliedBooster | None, settings: ShootSettings,
    places: Sequence[tuple[Camera, np.ndarray, int]],
) -> Iterator[bytes]:  # fmt: skip
    """The work of a unit: the image files of one object in one variant.

    Args:
        item, variant, booster: what is shot.
        settings: how.
        places: camera, `T_world_camera` and number of the sensor's noise of each shot.
    """
    from toolkit.rig.shading import tone_map  # brings the compiler, which needs to load only to shoot

    rehearsal = settings.rehearsal
    # a rehearsal brings its own printer
    printer = settings.printer if rehearsal is None else rehearsal.printer
    mesh = apply_booster(item, print_booster(booster, printer, settings.seed, item.name))
    if rehearsal is not None:
        mesh = rehearsal.tape(mesh)
    renderer = make_renderer(settings.renderer, mesh, studio_for(item, settings))
    # frame by frame, so that a scene of many does not fill the memory
    pictures = renderer.render_many((camera, pose) for camera, pose, _ in places)
    taken = zip((number for _, _, number in places), pictures, strict=True)
    if rehearsal is None:
        # developed beside the frames that are rendered next
        yield from map_ahead(
            lambda shot: _encode(tone_map(shot[1], (settings.seed, shot[0])), settings.image_format), taken
        )
        return
    for number, picture in taken:
        # by variant, as two boosters may have one name; drawn before the light, so that each step has its own numbers
        rng = Draws(settings.seed, number, "rehearse").of(f"phone {item.name} {variant}")
        grain = int(rng.integers(1 << 62))
        developed = tone_map(rehearsal.expose(picture, rng), (settings.seed, number, grain), rehearsal.noise)
        yield rehearsal.encode(developed)


def _encode(pixels: np.ndarray, image_format: str) -> bytes:
    if image_format == "png":
        return encode_image(pixels, "PNG", compress_level=3)  # a quarter of the default's time, a tenth more bytes
    # no chroma subsampling: coloured texels keep their edges
    return encode_image(pixels, "JPEG", quality=95, subsampling=0)
