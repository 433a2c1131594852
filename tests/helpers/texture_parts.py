"""A light object, its atlas and views, and settings for a tiny network."""

import numpy as np

from toolkit.boosters.texture_config import TextureConfig
from toolkit.objects.atlas import Atlas, make_atlas
from toolkit.objects.load import load_object
from toolkit.objects.mesh import Mesh
from toolkit.rig.camera import Camera
from toolkit.rig.raycast import RaycastRenderer
from toolkit.rig.scene import Scene
from toolkit.rig.studio import make_studio
from toolkit.rig.views import FOV_DEG, NEAR_VIEWS, PaintableObject, ViewSettings, random_pose

SIDE, TEXELS = 48, 32
VIEWS = ViewSettings(image_px=SIDE, studios=1, per_studio=4)


def make_crate(space) -> tuple[Mesh, Atlas]:
    """The crate on its table and its atlas of 32 × 32 texels."""
    mesh = load_object(space.object_spec("crate")).mesh
    return mesh, make_atlas(mesh, TEXELS)


def make_subject(space) -> PaintableObject:
    mesh, atlas = make_crate(space)
    return PaintableObject(atlas.mesh, int(atlas.mesh.face_material[atlas.trained][0]), mesh)


def render_linear(atlas: Atlas, count: int = 2, side: int = SIDE):
    """Views of an atlas' mesh with the studio, camera and poses they were taken in."""
    studio: Scene = make_studio(3, 100.0, "oak")
    camera = Camera.from_fov(side, side, FOV_DEG)
    texture = atlas.mesh.materials[atlas.mesh.face_material[atlas.trained][0]].texture
    renderer = RaycastRenderer(atlas.mesh, studio)
    poses = [random_pose(np.random.default_rng([4, i]), atlas.mesh.vertices, camera, NEAR_VIEWS) for i in range(count)]
    return [renderer.render_linear(camera, pose, texture) for pose in poses], studio, camera, poses


def crate_config(steps: int = 6, **changes) -> TextureConfig:
    settings = {
        "objects": ("crate",), "size_px": TEXELS, "steps": steps, "batch": 2, "lr": 0.1, "studios": 1, "per_studio": 4,
        "reuse": 2, "held_out": 1,
    }  # fmt: skip
    return TextureConfig(**(settings | changes))
