"""Small glTFs, one for each feature that changes a picture, for another reader to draw."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
from gltf_builder import CARD, CARD_FACES, CARD_UV, Gltf, base_colour

CLAMP, MIRROR, NEAREST = 33071, 33648, 9728
COLOURS = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 0.2], [0.1, 1, 1]], "<f4")


def write_features(folder: Path) -> list[Path]:
    """One file a feature, in a folder that is there."""
    return [gltf.write(folder, f"{name}.glb") for name, gltf in _make()]


def _picture() -> np.ndarray:
    """Blobs of colour without an axis of symmetry, (32, 64, 3) uint8."""
    rng = np.random.default_rng(7)
    return rng.integers(20, 236, (4, 8, 3), dtype=np.uint8).repeat(8, axis=0).repeat(8, axis=1)


def _card(sampler: dict | None = None, uv: np.ndarray = CARD_UV, more: dict | None = None, **slot: object) -> Gltf:
    gltf = Gltf()
    look = base_colour(gltf.picture(_picture(), sampler=sampler), **slot)
    gltf.card(gltf.material(**look), np.asarray(uv, "<f4"), **(more or {}))
    return gltf


def _make() -> Iterator[tuple[str, Gltf]]:
    wide = CARD_UV * [2.4, 3] - [0.7, 1.1]
    for s, t in ((CLAMP, CLAMP), (MIRROR, CLAMP), (MIRROR, MIRROR)):
        yield f"wrap-{s}-{t}", _card({"wrapS": s, "wrapT": t}, wide)
    yield "nearest", _card({"magFilter": NEAREST, "minFilter": NEAREST})
    for moved in ({"rotation": 0.6}, {"rotation": -2, "scale": [2, 0.5], "offset": [0.3, 0.1]}, {"texCoord": 1}):
        more = {"TEXCOORD_1": (CARD_UV * 0.7).astype("<f4")}
        name = "-".join(["transform", *moved])
        gltf = _card(more=more, extensions={"KHR_texture_transform": moved})
        gltf.use("KHR_texture_transform", required=True)
        yield name, gltf
    yield "colours-and-picture", _card(more={"COLOR_0": COLOURS})

    gltf = _card()
    gltf.tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.2, 0.9, 0.5, 1]
    yield "factor-and-picture", gltf

    gltf = Gltf()
    gltf.card(gltf.material(), COLOR_0=gltf.accessor((COLOURS * 65535).astype("<u2"), stride=8, normalized=True))
    yield "colours-u16", gltf

    y, x = np.mgrid[:64, :64]
    pixels = np.dstack([np.full((64, 64, 3), (200, 120, 40), np.uint8), 255 * (np.hypot(x - 31, y - 25) > 12)])
    for cutoff in (0.2, 0.8):
        gltf = Gltf()
        gltf.card(gltf.material(**base_colour(gltf.picture(pixels)), alphaMode="MASK", alphaCutoff=cutoff))
        yield f"mask-{cutoff}", gltf

    gltf = _card()
    target = np.zeros((4, 3), "<f4")
    target[2, 2], target[3, 1] = 1, 0.5
    gltf.tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": gltf.accessor(target)}]
    gltf.tree["nodes"][0] |= {"weights": [0.7], "rotation": [0, 0.3826834, 0, 0.9238795], "scale": [1, 2, -1]}
    yield "morph-in-a-mirror", gltf

    gltf = Gltf()
    joints, weights = np.zeros((4, 4), "<u1"), np.zeros((4, 4), "<u1")
    joints[:, 1], weights[:, 0], weights[:, 1] = 1, [255, 255, 55, 155], [0, 0, 200, 100]
    joint, bent = gltf.node(), gltf.node(translation=[0.4, 0.2, 0.5], rotation=[0.2588190, 0, 0, 0.9659258])
    gltf.tree["skins"] = [{"joints": [joint, bent]}]
    attributes = {
        "POSITION": CARD, "TEXCOORD_0": CARD_UV, "JOINTS_0": joints,
        "WEIGHTS_0": gltf.accessor(weights, normalized=True),
    }  # fmt: skip
    material = gltf.material(**base_colour(gltf.picture(_picture())))
    gltf.node(mesh=gltf.mesh(attributes, CARD_FACES, material), skin=0)
    yield "skin", gltf

    gltf = _card()
    gltf.use("EXT_mesh_gpu_instancing", required=True)
    places, turns = [[0, 0, 0], [1.2, 0.1, 0.3]], [[0, 0, 0, 1], [0, 0.5, 0, 0.8660254]]
    instances = {"TRANSLATION": np.array(places, "<f4"), "ROTATION": np.array(turns, "<f4")}
    numbers = {name: gltf.accessor(values) for name, values in instances.items()}
    gltf.tree["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": numbers}}
    yield "instances", gltf

    try:
        import alktx2
    except ImportError:
        return
    gltf = Gltf()
    gltf.use("KHR_texture_basisu", required=True)
    import io

    from PIL import Image

    png = io.BytesIO()
    Image.fromarray(_picture()).save(png, "PNG")
    content = alktx2.encode_bytes_to_ktx2(png.getvalue(), mime="image/png", codec="uastc")
    texture = gltf.image(bytes(content), "image/ktx2")
    gltf.tree["textures"][texture] = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    gltf.card(gltf.material(**base_colour(texture)))
    yield "basisu", gltf
