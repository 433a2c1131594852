"""Pictures of the grid from a running simulator: the same object, places and cameras, its own sky and weather."""

from collections.abc import Iterator, Sequence
from dataclasses import astuple
from itertools import groupby
from pathlib import Path

import numpy as np

from toolkit.core.console import progress
from toolkit.core.errors import ToolkitError
from toolkit.core.files import sha256_json, write_bytes
from toolkit.core.work import NOWHERE, Work
from toolkit.objects.export_mesh import to_glb
from toolkit.objects.mesh import cast_rays, hash_mesh
from toolkit.rig.camera import pixel_rays
from toolkit.rig.lighting import Shape
from toolkit.rooms.worlds.airsim import Address, AirSim, SimulatorShot
from toolkit.rooms.worlds.conditions import CLEAR
from toolkit.rooms.worlds.depth_weather import to_airsim
from toolkit.rooms.worlds.evaluation import ABSENT
from toolkit.rooms.worlds.evaluation.cameras import PlaceCameras
from toolkit.rooms.worlds.evaluation.frames import OBJECT_ID, SKY_ID, Frame, PictureTask, Stage
from toolkit.rooms.worlds.evaluation.keep import KeptFrames, ShotFrames, choose_shown, encode_frame, pose_of
from toolkit.rooms.worlds.world import SceneClass

DEPTH_SLACK, DEPTH_SLACK_M = 0.02, 0.05
LEAST_AGREEING = 0.5
LEAST_PIXELS = 20
MOST_ELSEWHERE = 0.05
"""Share of the pixels off the object that may have its colour in segmentations; with more, it is not the object's."""
Colour = tuple[int, int, int]


def name_actor(name: str, variant: str) -> str:
    """Name of an object in a variant in the simulator: `warplane_grey_texture`."""
    return f"{name}_{variant}".replace("-", "_")


def write_objects(folder: Path, stage: Stage, name: str) -> dict[str, Path]:
    """Write every variant as a GLB in metres, to be imported into the simulator's project; by variant."""
    return {
        variant: write_bytes(
            folder / f"{name_actor(name, variant)}.glb",
            to_glb(variant_mesh.mesh, name_actor(name, variant), units_per_m=1.0),
        )
        for variant, variant_mesh in stage.variants.items()
        if variant != ABSENT
    }


def shoot_missing(
    address: Address, stage: Stage, places: Sequence[PlaceCameras], tasks: Sequence[PictureTask], kept: KeptFrames
) -> ShotFrames:
    """Shoot what is not in the folder yet; the simulator need not run where all is there.

    The objects are written as GLBs to the folder `objects` beside the frames: for the simulator's project.

    Raises:
        ToolkitError: as `AirSim` and `shoot_frames`, or the disk is full. Earlier pictures stay.
    """
    name = kept.object_name
    write_objects(kept.folder.parent / "objects", stage, name)
    camera = stage.camera.intrinsics
    meshes = {key: hash_mesh(stage_variant.mesh) for key, stage_variant in stage.variants.items()}
    # the key of a frame: simulator, world, camera, mesh, place and pose
    shared = Work("simulator frame", old_at=NOWHERE).key(list(astuple(address)), stage.world.sha256, camera)
    # weathers that are not on disk yet; a frame with all of its weathers is not shot again
    missing = []
    for task in tasks:
        stand = stage.places[task.place].stand
        where = list(stand.place), stand.turn_deg, task.camera.T_world_camera.tolist()
        frame = task._replace(frame=sha256_json([shared, meshes[task.variant], *where]), is_kept=True)
        # weather by weather: a run that was stopped leaves a part of a frame's
        weathers = tuple(weather for weather in task.weathers if kept.lacks(frame._replace(weathers=(weather,))))
        missing += [frame._replace(weathers=weathers)] if weathers else []
    todo = sum(len(task.weathers) for task in missing)
    total = sum(len(task.weathers) for task in tasks)
    if missing:
        with AirSim(address) as simulator, progress("shooting (pictures)", total, done=total - todo) as bar:
            kept.renderer = simulator.describe()
            for shot in shoot_frames(simulator, stage, places, name, missing):
                kept.write(shot.task, encode_frame(shot))
                bar.advance()
    return ShotFrames(kept.folder, tuple(place.spot.name for place in stage.places), kept.describe_renderers(tasks))


def shoot_frames(
    simulator: AirSim, stage: Stage, places: Sequence[PlaceCameras], name: str, tasks: Sequence[PictureTask]
) -> Iterator[Frame]:
    """The frames of tasks, one weather at a time: a frame's weathers come apart.

    Weather takes a while to come up, so all cameras of a place and variant are shot in a weather before the next.

    Args:
        simulator: is moved, and left with the last object in its place.
        stage: the objects; of its camera, field of view and size.
        tasks: those of the same place and variant follow each other.

    Raises:
        ToolkitError: the simulator fails, its pictures have another size, or the object is not where it should be.
    """
    simulator.set_camera(stage.camera.fov_deg)
    simulator.number_things()
    for variant in stage.variants:
        if variant != ABSENT:  # a missing variant is reported before the first picture, not after hours
            simulator.place(name_actor(name, variant), None)
    standing = ""
    for (place, variant), own in groupby(tasks, lambda task: (task.place, task.variant)):
        group, actor = list(own), "" if variant == ABSENT else name_actor(name, variant)
        # the variant before would stand in the picture
        if standing and standing != actor:
            simulator.place(standing, None)
        standing, colour = actor, None
        if actor:
            simulator.place(actor, pose_of(stage.places[place].stand))
            # found in clear conditions, which leave depth and colours as they are
            simulator.set_weather({})
            colour = find_object(simulator, stage, places[place], variant, actor)
        # weather outside, cameras inside: a change of weather costs seconds, a camera does not
        for weather in dict.fromkeys(weather for task in group for weather in task.weathers):
            simulator.set_weather(to_airsim(*weather))
            for task in group:
                if weather in task.weathers:
                    shot = shoot(simulator, stage, task.camera.T_world_camera)
                    yield make_frame(task._replace(weathers=(weather,)), shot, colour)


def make_frame(task: PictureTask, shot: SimulatorShot, colour: Colour | None) -> Frame:
    """A shot as a frame; depth and classes come with the picture in clear conditions."""
    if not task.is_kept or task.weathers != (CLEAR,):
        return Frame(task, (shot.picture,))
    classes = np.full(shot.depth_m.shape, SceneClass.OTHER, np.uint8)
    classes[np.isinf(shot.depth_m)] = SKY_ID
    if colour is not None:
        classes[(shot.segmentation == colour).all(axis=-1)] = OBJECT_ID
    return Frame(task, (shot.picture,), shot.depth_m, classes)


def shoot(simulator: AirSim, stage: Stage, T_world_camera: np.ndarray) -> SimulatorShot:
    """A shot whose pictures are as large as they were asked for."""
    shot, camera = simulator.shoot(T_world_camera), stage.camera
    for plane in (shot.picture, shot.depth_m, shot.segmentation):
        if plane.shape[:2] != (camera.height, camera.width):
            raise ToolkitError(
                f"{simulator.address}: its pictures have {plane.shape[1]} × {plane.shape[0]} pixels, expected "
                f"{camera.width} × {camera.height}: set Width and Height of ImageType 0, 2 and 5 in CaptureSettings of "
                "its settings.json, and start it again"
            )
    return shot


def find_object(simulator: AirSim, stage: Stage, place: PlaceCameras, variant: str, actor: str) -> Colour | None:
    """Its colour in segmentations, from the camera that sees it best; None where others share it.

    The simulator's depth must be that of the object's mesh where its outline is: scale, origin and axes are right then.

    Raises:
        ToolkitError: it is not.
    """
    camera = choose_shown(place)
    shot = shoot(simulator, stage, camera.T_world_camera)
    expected_m, around_m = measure_depths(stage, place, variant, camera.T_world_camera)
    outline = np.isfinite(expected_m)
    # pixels of the object that nothing in our copy of the world hides
    seen = outline & (expected_m < around_m)
    agrees = seen.copy()
    off_m = np.abs(shot.depth_m[seen] - expected_m[seen])
    # in proportion to the distance, and never less than 5 cm
    agrees[seen] = off_m <= np.maximum(DEPTH_SLACK * expected_m[seen], DEPTH_SLACK_M)
    # too small in this camera to tell
    if seen.sum() < LEAST_PIXELS:
        return None
    share = float(agrees.sum() / seen.sum())
    if share < LEAST_AGREEING:
        raise ToolkitError(
            f"{simulator.address}: '{actor}' is not seen where it stands at '{place.placed.spot.name}': depth agrees "
            f"on {share:.0%} of its pixels; import {actor}.glb in metres and unturned, the world's GLB at the origin, "
            "or say where that lies: airsim://HOST?origin=NORTH,EAST,DOWN"
        )
    # the commonest colour where the depth says that it is the object
    colours, counts = np.unique(shot.segmentation[agrees], axis=0, return_counts=True)
    colour = colours[counts.argmax()]
    elsewhere = (shot.segmentation[~outline] == colour).all(axis=-1)
    # a colour that much else has tells nothing of the object
    if len(elsewhere) and elsewhere.mean() > MOST_ELSEWHERE:
        return None
    red, green, blue = (int(channel) for channel in colour)
    return red, green, blue


def measure_depths(
    stage: Stage, place: PlaceCameras, variant: str, T_world_camera: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(h, w) metres along each pixel's ray to the object, and to the world around it; inf where it meets nothing."""
    camera, stand = stage.camera, place.placed.stand
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = pixel_rays(camera, T_world_camera, np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float32))
    own = np.concatenate([(rays[:, :3] - stand.place) @ stand.turn, rays[:, 3:] @ stand.turn], axis=1)
    shapes = (Shape.of(stage.variants[variant].mesh), own), (stage.world.shape, rays)
    hits = [cast_rays(shape.rays, lines) for shape, lines in shapes]
    object_m, around_m = (distances.reshape(camera.height, camera.width) for distances in hits)
    return object_m, around_m
