"""Results for a mesh, a picture or a sky, kept for renderers that have the same."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from threading import RLock
from typing import Any, NamedTuple, TypeVar
from weakref import ref

import numpy as np

from toolkit.core.cache import keep_arrays
from toolkit.objects.mesh import Mesh, hash_triangles
from toolkit.rig.kernel.scene import FACE, LitMesh, as_rotation, as_triple
from toolkit.rig.kernel.textures import Texels, fill_colours
from toolkit.rig.lighting import Shape, bake_surroundings
from toolkit.rig.scene import AT_ORIGIN, Scene, Stand
from toolkit.rig.textures import pack_textures
from toolkit.rig.trace import LitBody

F = TypeVar("F")

_in_use: OrderedDict[tuple[object, ...], tuple[list[ref[Any]], Any]] = OrderedDict()
_keeping = RLock()
MOST_KEPT = 10


def kept(make: Callable[..., F], *sources: object) -> F:
    """`make` of meshes or pictures, worked out once for those that were used last and are still in use."""
    # by identity: comparing the pixels would cost as much as the work. A result goes with its source: none could ask
    # for it again, and another object may have the source's id
    key = make.__qualname__, *map(id, sources)
    with _keeping:
        found = _in_use.pop(key, None)
        if found is None:
            found = [ref(one, lambda _: _in_use.pop(key, None)) for one in sources], make(*sources)
        _in_use[key] = found
        while len(_in_use) > MOST_KEPT:
            _in_use.popitem(last=False)
    made: F = found[1]
    return made


class PackedPaint(NamedTuple):
    """Paint of a mesh, ready for the kernel."""

    texels: Texels
    texture: np.ndarray
    density: np.ndarray
    mean_colour: np.ndarray


class Glow(NamedTuple):
    """Light that a mesh's materials give off; the fields of `LitMesh`."""

    glow: np.ndarray
    glow_lod: np.ndarray
    glow_texels: Texels


class BakedLight(NamedTuple):
    """Light on a mesh at its samples: (m,) how fine each face's is and where it begins, and `LitMesh.stored`."""

    steps: np.ndarray
    first: np.ndarray
    stored: np.ndarray


NO_PICTURE = np.zeros((1, 1, 3), np.uint8)


def pack_one(picture: np.ndarray) -> Texels:
    """The pyramid of a picture."""
    return pack_textures([picture])


def paint_of(mesh: Mesh) -> PackedPaint:
    """Pyramids and densities of a mesh."""
    return kept(_prepare_paint, mesh)


def _prepare_paint(mesh: Mesh) -> PackedPaint:
    # materials that share a picture share its pyramid
    distinct = list({id(m.texture): m.texture for m in mesh.materials}.values())
    number = {id(texture): index for index, texture in enumerate(distinct)}
    texture = np.array([number[id(m.texture)] for m in mesh.materials], np.int32)
    texels = pack_textures(distinct)
    corners, corner_uv = mesh.vertices[mesh.faces], mesh.uv[mesh.faces]
    surface = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    a, b = corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]
    # twice the area of the triangle on the texture, against twice that in space: texels per millimetre
    chart = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    counts = np.array([picture.shape[0] * picture.shape[1] for picture in distinct])
    of_face = texture[mesh.face_material]
    density = np.sqrt(chart * counts[of_face] / np.maximum(surface, 1e-12)).astype(np.float32)
    colour = np.empty((len(of_face), 3), np.float32)
    fill_colours(texels, of_face, corner_uv.mean(axis=1), np.zeros(len(of_face), np.float32), colour)
    # weighted by area: what the whole mesh sends back on the mean
    mean = (colour * surface[:, None]).sum(axis=0) / max(float(surface.sum()), 1e-9)
    return PackedPaint(texels, texture, density, mean)


def _prepare_glow(mesh: Mesh) -> Glow:
    """Pyramids of what the materials of a mesh give off."""
    lit = [material.emission for material in mesh.materials if material.emission is not None]
    distinct = list({id(emission): emission for emission in lit}.values())
    number = {id(emission): index for index, emission in enumerate(distinct)}
    glow = np.array([-1 if m.emission is None else number[id(m.emission)] for m in mesh.materials], np.int32)
    # the level of detail is worked out for the texture; the picture of what is given off may be finer or coarser
    finer = [1.0 if m.emission is None else m.emission.shape[1] / m.texture.shape[1] for m in mesh.materials]
    return Glow(glow, np.log2(finer).astype(np.float32), pack_textures(distinct or [NO_PICTURE]))


def light_mesh(mesh: Mesh, paint: PackedPaint, light: BakedLight, stand: Stand) -> LitMesh:
    """A mesh with paint and light on it, ready for the kernel; it gives off none itself, see `with_lamps`."""
    # columns as the kernel reads them: corners, material, texel density and where the light of a face is stored
    materials, faces = mesh.materials, np.empty(len(mesh.faces), FACE)
    faces["a"], faces["b"], faces["c"] = mesh.faces.T
    faces["material"], faces["density"] = mesh.face_material, paint.density
    faces["steps"], faces["first"] = light.steps, light.first
    corners = np.empty((len(mesh.vertices), 5), np.float32)
    # files may hold NaN, which a kernel without checks must never meet
    corners[:, :3], corners[:, 3:] = np.nan_to_num(mesh.normals), np.nan_to_num(mesh.uv).clip(-1e6, 1e6)
    return LitMesh(
        faces=faces, corners=corners, texture=paint.texture,
        # looks of each material, by its number
        roughness=np.array([m.roughness for m in materials], np.float32),
        metallic=np.array([m.metallic for m in materials], np.float32),
        finely=np.array([bool(m.sheet) for m in materials]),
        left_out=np.zeros(len(materials), bool), texels=paint.texels,
        # no lamp is lit until `with_lamps` says so
        glow=np.full(len(materials), -1, np.int32), glow_lod=np.zeros(len(materials), np.float32),
        glow_texels=kept(pack_one, NO_PICTURE),
        stored=light.stored, turn=as_rotation(stand.turn), place=as_triple(stand.place),
    )  # fmt: skip


def place_unlit(mesh: Mesh, stand: Stand, number: int) -> LitBody:
    """A mesh in its place without light, to find what is seen; `number` as in `Hits.mesh`."""
    dark = BakedLight(np.ones(len(mesh.faces), int), np.zeros(len(mesh.faces), int), np.zeros((3, 5), np.float32))
    lit = light_mesh(mesh, paint_of(mesh), dark, stand)
    return LitBody(Shape.of(mesh), lit, is_moved=stand != AT_ORIGIN, number=number)


def with_lamps(body: LitBody, mesh: Mesh) -> LitBody:
    """The same body with the light that its materials give off; its baked light stays."""
    return replace(body, lit=body.lit._replace(**kept(_prepare_glow, mesh)._asdict()))


def surroundings_of(scene: Scene) -> LitBody:
    """The fixed surroundings of the object; kept for the next renderer in the same sky, their light on disk."""

    def light(mesh: Mesh) -> BakedLight:
        colour = paint_of(mesh).mean_colour

        def bake() -> dict[str, np.ndarray]:
            made = bake_surroundings(Shape.of(mesh), colour, scene)
            return BakedLight(made.grid.steps, made.grid.first, made.stored)._asdict()

        inputs = [hash_triangles(mesh), colour, scene.key, scene.environment]
        return BakedLight(**keep_arrays("surroundings", inputs, bake))

    return _keep_surroundings(scene, light)


def light_surroundings(scene: Scene) -> BakedLight:
    """Light on what stands around the object, worked out where it is not kept; ready to be sent."""
    lit = surroundings_of(scene).lit
    return BakedLight(lit.faces["steps"].copy(), lit.faces["first"].copy(), lit.stored)


def keep_light(scene: Scene, light: BakedLight) -> None:
    """Let renderers take light that another process worked out with `light_surroundings`, where none is kept yet."""
    _keep_surroundings(scene, lambda _: light)


def _keep_surroundings(scene: Scene, light: Callable[[Mesh], BakedLight]) -> LitBody:
    def make(mesh: Mesh, *_: object) -> LitBody:
        return LitBody(
            Shape.of(mesh), light_mesh(mesh, paint_of(mesh), light(mesh), AT_ORIGIN), is_moved=False, number=1
        )

    return kept(make, scene.surroundings, scene.environment, scene.key)
