"""Features of a glTF that are not read: a note for each, found in the file's lists."""

from collections.abc import Iterator
from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.objects.gltf.compressed import BASISU, DRACO
from toolkit.objects.gltf.document import MESHOPT, Document, extension, rows
from toolkit.objects.gltf.geometry import FAN, MORPHED, STRIP, TRIANGLES, is_read
from toolkit.objects.gltf.materials import SPECULAR, read_look
from toolkit.objects.gltf.nodes import INSTANCES
from toolkit.objects.gltf.pictures import SOURCES, TRANSFORM

READ = frozenset((
    "KHR_mesh_quantization", TRANSFORM, SPECULAR, BASISU, DRACO, *MESHOPT, *SOURCES, INSTANCES, "KHR_node_visibility",
))  # fmt: skip
"""Extensions whose meaning is read."""
OPTIONAL = frozenset((
    "KHR_materials_unlit", "KHR_materials_variants", "KHR_lights_punctual", "KHR_animation_pointer", "KHR_xmp_json_ld",
))  # fmt: skip
"""Extensions that may be left out, with a note, even where a file requires them: its shape and colours stay."""
REASONS = {
    "KHR_materials_unlit": "lamps light the object like any other",
    "KHR_materials_variants": "the default material is taken",
    "KHR_lights_punctual": "the rig has its own lamps",
    "animations": "the default pose is taken",
    "cameras": "the rig has its own cameras",
    "normalTexture": "the surface is as smooth as its triangles",
    "occlusionTexture": "shadows are worked out from the triangles",
    "emissiveTexture": "the object gives no light",
    "emissiveFactor": "the object gives no light",
}
STATED = frozenset((
    "accessors", "asset", "buffers", "bufferViews", "extensions", "extensionsRequired", "extensionsUsed", "extras",
    "images", "materials", "meshes", "nodes", "samplers", "scene", "scenes", "skins", "textures",
))  # fmt: skip
MATERIAL = frozenset((
    "name", "extensions", "extras", "pbrMetallicRoughness", "alphaMode", "alphaCutoff", "doubleSided",
    "emissiveFactor",
))  # fmt: skip
PBR = {
    "pbrMetallicRoughness": (
        "baseColorFactor", "baseColorTexture", "metallicFactor", "roughnessFactor", "metallicRoughnessTexture",
    ),
    SPECULAR: ("diffuseFactor", "diffuseTexture", "glossinessFactor", "specularGlossinessTexture", "specularFactor"),
}  # fmt: skip
SLOT = ("index", "texCoord", "extensions", "extras")
MODES = {0: "points", 1: "lines", 2: "loops of lines", 3: "strips of lines"}


def check_required(document: Document) -> None:
    """Raise a `ToolkitError` that names the extensions that a file requires and the kit does not read."""
    lacking = sorted(set(_texts(document.tree.get("extensionsRequired"))) - READ - OPTIONAL)
    if lacking:
        names = ", ".join(name[:60] for name in lacking[:5])
        raise ToolkitError(
            f"{document.path}: requires the glTF extension{'s'[: len(lacking) > 1]} {names}, which toolkit does not "
            "read: export the mesh again without, or open it in Blender and export it as plain glTF 2.0"
        )


def list_leftovers(document: Document) -> list[str]:
    """List the features of the file that are not read, a sentence each."""
    return list(dict.fromkeys(_find(document)))


def _find(document: Document) -> Iterator[str]:
    tree = document.tree
    # those that the file states, and those that it uses in spite of that
    met = set(_texts(tree.get("extensionsUsed"))) | _extensions_met(tree)
    yield from (_left_out(name) for name in sorted(met - READ))
    yield from (_left_out(name) for name in sorted(set(tree) - STATED))
    scenes = document.rows("scenes")
    if len(scenes) > 1:
        yield f"scene {tree.get('scene', 0)} of {len(scenes)} is read, the others are left out"
    for material in document.rows("materials"):
        yield from _find_in_material(material)
    for mesh in document.rows("meshes"):
        for primitive in rows(mesh, "primitives"):
            yield from _find_in_primitive(primitive)


def _find_in_material(material: dict[str, Any]) -> Iterator[str]:
    name = str(material.get("name") or "material")
    yield from (_left_out(key) for key in sorted(set(material) - MATERIAL))
    emission = material.get("emissiveFactor")
    if isinstance(emission, list) and any(emission) and "emissiveTexture" not in material:
        yield _left_out("emissiveFactor")
    # half transparent surfaces are more than the rig can draw
    mode = material.get("alphaMode", "OPAQUE")
    if mode not in ("OPAQUE", "MASK"):
        yield f"alphaMode {mode} of '{name}' is left out: it is drawn opaque"
    # fields of each way to shade, and of the textures in their slots
    for kind, known in PBR.items():
        slots = extension(material, kind) if kind == SPECULAR else material.get(kind)
        if not isinstance(slots, dict):
            continue
        yield from (_left_out(f"{kind}.{key}") for key in sorted(set(slots) - {*known, "extensions", "extras"}))
        for key in known:
            if isinstance(slots.get(key), dict):
                yield from (_left_out(f"{key}.{other}") for other in sorted(set(slots[key]) - set(SLOT)))
    # gloss pictures count as their mean, as the rig has a roughness for each material
    look = read_look(material)
    if look.gloss is not None:
        what = "specularGlossinessTexture" if look.is_specular else "metallicRoughnessTexture"
        yield f"{what} of '{name}' counts as its mean over the surface"
    if look.is_specular and (extension(material, SPECULAR) or {}).get("specularFactor", [1]) != [0.04] * 3:
        yield f"the specular colour of '{name}' is left out: it is no metal"


def _find_in_primitive(primitive: dict[str, Any]) -> Iterator[str]:
    mode = primitive.get("mode", TRIANGLES)
    if mode not in (TRIANGLES, STRIP, FAN):
        yield (
            f"{MODES.get(mode, f'mode {mode}')} are left out: they have no surface"
            if mode in MODES
            else _left_out(f"drawing mode {mode}")
        )
        return
    named = primitive.get("attributes")
    named = named if isinstance(named, dict) else {}
    # normals and tangents are computed again from the faces
    yield from (_left_out(name) for name in sorted(named) if not is_read(name) and name not in ("NORMAL", "TANGENT"))
    for target in rows(primitive, "targets"):
        changed = [name for name in sorted(target) if name not in ("NORMAL", "TANGENT")]
        yield from (_left_out(f"{name} of a morph target") for name in changed if not name.startswith(MORPHED))


def _left_out(name: str) -> str:
    why = REASONS.get(name)
    verb = "are" if name in ("animations", "cameras") else "is"
    return f"{name[:80]} {verb} left out" + (f": {why}" if why else "")


def _texts(found: Any) -> list[str]:
    return [text for text in found if isinstance(text, str)] if isinstance(found, list) else []


def _extensions_met(tree: dict[str, Any]) -> set[str]:
    """Find the names of extensions anywhere in the JSON."""
    met: set[str] = set()
    # a stack in place of recursion, as a file may nest to any depth
    waiting: list[Any] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict):
            found = node.get("extensions")
            if isinstance(found, dict):
                met.update(found)
            waiting += [value for key, value in node.items() if key != "extras" and isinstance(value, dict | list)]
        elif node and isinstance(node[0], dict | list):  # lists of numbers hold none
            waiting += node
    return met
