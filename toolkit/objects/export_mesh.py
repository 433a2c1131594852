"""Meshes for other programs: GLB in metres, OBJ and 3MF in millimetres, an HTML viewer, and a check for 3D printing."""

from dataclasses import dataclass, replace
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING, Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np
from PIL import Image

from toolkit.core.text import join_words
from toolkit.objects.mesh import Mesh, cross_products, group_places, group_rows, load_open3d, make_ray_scene
from toolkit.objects.records import encode_png

if TYPE_CHECKING:
    from trimesh import Scene


SAMPLES = 20_000
THIN_MM = 1.0
"""Thinnest wall of services for colour printing in gypsum, resin or nylon."""
EDGE_DEG = 45.0
"""Sides at a larger angle are an edge of the object, not the two sides of a wall."""
STEP_MM = 1e-3
"""A ray starts this far below the surface, so that it does not hit its own triangle."""


def join_places(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Join vertices at the same place: (n, 3) float32 places, (k, 3) int32 faces of them, (k,) rows of `faces`.

    Triangles with two corners at the same place are left out.
    """
    first, place = group_places(mesh.vertices)
    joined = place[mesh.faces]
    kept = np.flatnonzero((joined != np.roll(joined, 1, axis=1)).all(axis=1))
    return mesh.vertices[first], joined[kept].astype(np.int32), kept


@dataclass(frozen=True)
class Soundness:
    """Fitness of a surface for 3D printing.

    Attributes:
        open_edges: edges of a single triangle, at a border of the surface.
        tangled_edges: edges of more than two triangles, or of two in the same direction.
        thinnest_mm: 0.1 % quantile of the walls' thickness; None for a surface without an inside.
        thin_share: share of the surface whose wall is under `THIN_MM`.
    """

    open_edges: int
    tangled_edges: int
    thinnest_mm: float | None
    thin_share: float

    def describe(self) -> str:
        """Describe it in a line."""
        parts = [(self.open_edges, "open"), (self.tangled_edges, "tangled")]
        counted = join_words(f"{count:,} {word} edges" for count, word in parts if count)
        closed = f"not watertight ({counted}): let the printer's program repair it" if counted else "watertight"
        if self.thinnest_mm is None:
            return f"{closed}; no walls to measure"
        thin = f", {100 * self.thin_share:.2g} % of them under {THIN_MM:g} mm" if self.thin_share else ""
        return f"{closed}; walls from {self.thinnest_mm:.2g} mm{thin}"


def examine_solid(mesh: Mesh) -> Soundness:
    """Count the edges that are not closed, and measure the walls of a mesh in millimetres.

    A wall's thickness at a place is the length of a ray straight inwards, to where it leaves the object and all parts
    that overlap. Rays are cast from `SAMPLES` places spread by area.
    """
    faces = join_places(mesh)[1]
    # edges from the lower vertex number to the higher, so that both faces' edges are equal
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    first, index = group_rows([low, high])
    count = np.bincount(index, minlength=len(first))
    # two triangles that face the same way run along their edge in opposite directions: the sum is 0
    balance = np.bincount(index, np.where(edges[:, 0] == low, 1, -1), minlength=len(first))
    # one face at an edge: open; more than two, or two in the same direction: tangled
    open_edges = int((count == 1).sum())
    tangled = int(((count > 2) | ((count == 2) & (balance != 0))).sum())
    walls = _measure_walls(mesh, np.random.default_rng(0))
    if not len(walls):
        return Soundness(open_edges, tangled, None, 0.0)
    # the thinnest thousandth is left to rays that graze an edge
    return Soundness(open_edges, tangled, float(np.quantile(walls, 0.001)), float((walls < THIN_MM).mean()))


def _measure_walls(mesh: Mesh, rng: np.random.Generator) -> np.ndarray:
    """Return wall thicknesses in mm below places drawn by area, but those inside other parts or without an exit."""
    o3d = load_open3d()
    cross = cross_products(mesh.vertices[mesh.faces])
    length = np.linalg.norm(cross, axis=1)
    normal = cross / np.maximum(length, 1e-20)[:, None]
    face = rng.choice(len(length), SAMPLES, p=length / length.sum())
    # uniform over a triangle: Osada et al. 2002, equation 1
    root, along = np.sqrt(rng.random((SAMPLES, 1))), rng.random((SAMPLES, 1))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[face]].astype(np.float64), 1, 0)
    start = (1 - root) * a + root * (1 - along) * b + root * along * c
    rays = np.concatenate([start - STEP_MM * normal[face], -normal[face]], axis=1).astype(np.float32)
    found = make_ray_scene(mesh).list_intersections(o3d.core.Tensor(rays))
    ray, way, met = (found[key].numpy() for key in ("ray_ids", "t_hit", "primitive_ids"))
    order = np.lexsort([way, ray])
    ray, way, met = ray[order].astype(np.int64), way[order], met[order].astype(np.int64)
    # inside a single part at the start; each surface on the way leaves a part (+1) or enters another (-1)
    facing = np.einsum("ij,ij->i", normal[met], -normal[face[ray]])
    leaves = np.where(facing > 0, 1, -1)
    # such a ray leaves once more than it enters; others start in two parts, or leave by a hole
    net = np.bincount(ray, leaves, SAMPLES)
    sound = net[ray] == 1
    ray, way, facing, leaves = ray[sound], way[sound], facing[sound], leaves[sound]
    total = np.cumsum(leaves)
    starts = np.flatnonzero(np.diff(ray, prepend=-1))
    before = np.repeat(total[starts] - leaves[starts], np.diff(starts, append=len(ray)))
    out = np.flatnonzero(total - before == 1)
    last = out[np.unique(ray[out], return_index=True)[1]]
    is_wall = facing[last] > np.cos(np.radians(EDGE_DEG))
    return way[last][is_wall] + STEP_MM


MM_PER_M = 1000.0
T_GLTF_WORLD = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)
"""Front +x -> +z, left +y -> +x, up +z -> +y: axes of glTF, and of USD with y up."""
SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}
"""The rig's look-up of textures: linear between texels and between levels of detail, and repeating."""


def to_glb(mesh: Mesh, name: str, units_per_m: float = MM_PER_M, lamps: bool = False) -> bytes:
    """Write a binary glTF with a primitive for each material; a shared picture is embedded once.

    Faces are drawn from both sides, as in the rig.

    Args:
        mesh: an object, in millimetres, or a world.
        name: name of the scene.
        units_per_m: units of the mesh's vertices; 1 for metres.
        lamps: whether the emission of materials is written, as emissive textures.
    """
    scene, looks = _make_scene(mesh, name, units_per_m, lamps)

    def share_sheets(tree: dict[str, Any]) -> None:
        tree["samplers"] = [SAMPLER]
        for texture in tree["textures"]:
            # as in the rig, textures repeat and are blended
            texture["sampler"] = 0
        # materials that share a picture name the same texture
        written: dict[int, dict[str, int]] = {}
        for look in tree["materials"]:
            look["name"], sheet = looks[look["name"]]
            own = look["pbrMetallicRoughness"].get("baseColorTexture")
            look["pbrMetallicRoughness"]["baseColorTexture"] = written.setdefault(sheet, own)
            look["alphaMode"] = "OPAQUE"

    return scene.export(file_type="glb", include_normals=True, tree_postprocessor=share_sheets)


def _make_scene(
    mesh: Mesh, name: str, units_per_m: float, lamps: bool = False
) -> "tuple[Scene, dict[str, tuple[str, int]]]":
    """Make a piece for each material, y up and front to +z, and by its name that of its material and its sheet."""
    import trimesh

    scene = trimesh.Scene(base_frame=name)
    sheets: dict[int, int] = {}
    looks: dict[str, tuple[str, int]] = {}  # name and sheet by a name that is unique: trimesh makes one of equal looks
    for index, material in enumerate(mesh.materials):
        faces = mesh.faces[mesh.face_material == index]
        if not len(faces):
            continue
        # each piece keeps the vertices that its faces use
        used, inverse = np.unique(faces, return_inverse=True)
        known = id(material.texture) in sheets
        unique = f"{material.name}-{index}"  # of two nodes with the same name, trimesh keeps the last
        looks[unique] = material.name, sheets.setdefault(id(material.texture), len(sheets))
        emission = {}
        if lamps and material.emission is not None and material.emission.any():
            emission = {"emissiveTexture": Image.fromarray(material.emission), "emissiveFactor": (1.0, 1.0, 1.0)}
        look = trimesh.visual.material.PBRMaterial(
            name=unique, baseColorTexture=None if known else Image.fromarray(material.texture),
            metallicFactor=float(material.metallic), roughnessFactor=float(material.roughness), doubleSided=True,
            **emission,
        )  # fmt: skip
        piece = trimesh.Trimesh(
            vertices=mesh.vertices[used] @ T_GLTF_WORLD.T / units_per_m, faces=inverse.reshape(-1, 3),
            vertex_normals=unit_normals(mesh.normals[used]) @ T_GLTF_WORLD.T,
            visual=trimesh.visual.TextureVisuals(uv=mesh.uv[used], material=look), process=False,
        )  # fmt: skip
        scene.add_geometry(piece, node_name=unique, geom_name=unique)
    return scene, looks


def unit_normals(normals: np.ndarray) -> np.ndarray:
    """Scale normals to length 1; those of faces without area point up."""
    length = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    return np.where(length > 1e-6, normals / np.maximum(length, 1e-6), [0.0, 0.0, 1.0])


def to_obj(mesh: Mesh, name: str) -> dict[str, bytes]:
    """A Wavefront OBJ in millimetres, y up and front to +z, its MTL and its pictures, by file name."""
    from trimesh.exchange.obj import export_obj
    from trimesh.visual.material import SimpleMaterial

    scene, looks = _make_scene(mesh, name, 1.0)
    sheets: dict[int, SimpleMaterial] = {}
    for piece, (_, sheet) in zip(scene.geometry.values(), looks.values(), strict=True):
        if sheet not in sheets:  # its first piece holds the picture
            picture = piece.visual.material.baseColorTexture
            sheets[sheet] = SimpleMaterial(image=picture, name=f"{name}-{sheet + 1}", diffuse=[255, 255, 255, 255])
        piece.visual.material = sheets[sheet]
    text, files = export_obj(scene, include_texture=True, return_texture=True, mtl_name=f"{name}.mtl")
    return {f"{name}.obj": text.encode(), **files}


TEXTURE_PART = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dtexture"
"""The relationship of a picture in a package (3MF materials and properties 1.2, chapter 3.1)."""


def to_3mf(mesh: Mesh, name: str) -> bytes:
    """Write a 3MF package for colour 3D printers: an object in millimetres, z up, a texture group for each picture.

    Vertices are joined as in `join_places`, so that a closed surface is closed in the file. The object stands in the
    corner of the bed. The same mesh gives the same bytes.

    Source: 3MF core specification 1.3; materials and properties extension 1.2.
    """
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    places, joined, kept = join_places(mesh)
    # materials that share a picture share its texture group, stored once
    picture_of = [id(material.texture) for material in mesh.materials]
    properties = np.zeros((len(joined), 4), np.uint32)  # the group, and a place of the picture for each corner
    for number, known in enumerate(dict.fromkeys(picture_of), start=1):
        materials = [i for i, picture_id in enumerate(picture_of) if picture_id == known]
        rows = np.flatnonzero(np.isin(mesh.face_material[kept], materials))
        if not len(rows):
            # pictures are stored apart from the mesh, as parts of the package
            continue
        picture = mesh.materials[picture_of.index(known)].texture
        part = model.AddAttachment(f"/3D/Textures/{number}.png", TEXTURE_PART)
        part.ReadFromBuffer(encode_png(picture))
        texture = model.AddTexture2DFromAttachment(part)
        texture.SetContentType(lib3mf.TextureType.PNG)
        texture.SetTileStyleUV(lib3mf.TextureTileStyle.Wrap, lib3mf.TextureTileStyle.Wrap)
        group = model.AddTexture2DGroup(texture)
        used, corner = np.unique(mesh.faces[kept][rows], return_inverse=True)
        ids = np.array([group.AddTex2Coord(lib3mf.Tex2Coord(u, v)) for u, v in mesh.uv[used].tolist()], np.uint32)
        properties[rows, 0], properties[rows, 1:] = group.GetResourceID(), ids[corner.reshape(-1, 3)]
    solid = model.AddMeshObject()
    solid.SetName(name)
    solid.SetGeometry(
        (lib3mf.Position * len(places)).from_buffer_copy(places - places.min(axis=0)),
        (lib3mf.Triangle * len(joined)).from_buffer_copy(joined.astype(np.uint32)),
    )
    solid.SetAllTriangleProperties((lib3mf.TriangleProperties * len(joined)).from_buffer_copy(properties))
    solid.SetObjectLevelProperty(*properties[0, :2].tolist())
    item = model.AddBuildItem(solid, wrapper.GetIdentityTransform())
    # the library would draw these identifiers at random
    for owner, role in ((model, "build"), (solid, "object"), (item, "item")):
        set_uuid = owner.SetBuildUUID if owner is model else owner.SetUUID
        set_uuid(str(uuid5(NAMESPACE_URL, f"toolkit:{name}:{role}")))
    return bytes(model.QueryWriter("3mf").WriteToBuffer())


MOST_TRIANGLES = 400_000
"""Largest number of triangles of a page that a phone opens."""
LIGHTS = (
    "scene.background=new THREE.Color(0xe9ebee);scene.add(new THREE.HemisphereLight(0xffffff,0x9a948c,0.55));"
    "tracklight.intensity*=0.25;"
    "renderer.outputEncoding=THREE.sRGBEncoding;addEventListener('pointerdown',()=>{turning=false});"
)
CAPTION = """<p style="position:fixed;left:0;right:0;bottom:0;margin:0;padding:10px 14px;
font:15px/1.4 system-ui,sans-serif;background:#fffc;color:#1b1f24">{words}</p>"""


def make_turntable(mesh: Mesh, title: str, words: str) -> str | None:
    """Return a page with a turning mesh that can be dragged, in trimesh's viewer; None for a mesh too large for it.

    `title` is the page's, `words` stand below the picture.
    """
    if len(mesh.faces) > MOST_TRIANGLES:
        return None
    import trimesh
    from trimesh.viewer.notebook import scene_to_html

    # metal reflects its surroundings, and here are none
    dull = tuple(replace(material, metallic=0.0, roughness=max(material.roughness, 0.6)) for material in mesh.materials)
    scene = trimesh.load_scene(BytesIO(to_glb(replace(mesh, materials=dull), title)), file_type="glb")
    page = scene_to_html(scene)
    # trimesh's page has no hooks: its own script is changed in five places, for light, field of view and turning
    for old, new in (
        ("loader=new THREE.GLTFLoader();", f"{LIGHTS}loader=new THREE.GLTFLoader();"),
        ("camera=gltf.cameras[0];", "camera=gltf.cameras[0];upright=camera.fov;"),
        (
            "camera.updateProjectionMatrix();",
            "camera.fov=Math.min(110,1.6*upright*Math.max(1,1/camera.aspect));camera.updateProjectionMatrix();",
        ),
        ("scene.add(gltf.scene);", "turned=gltf.scene;scene.add(turned);"),
        ("controls.update();}", "controls.update();if(turning&&turned){turned.rotation.y+=0.008;render();}}"),
        (
            "init();</script>",
            f"var turning=true,turned=null,upright=60;init();</script>{CAPTION.format(words=escape(words))}",
        ),
    ):
        page = page.replace(old, new, 1)
    # the title is written into the page, whatever the viewer puts there
    start, end = page.find("<title>"), page.find("</title>")
    return f"{page[:start]}<title>{escape(title)}{page[end:]}" if 0 <= start < end else page
