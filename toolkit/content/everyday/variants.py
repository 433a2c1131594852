"""The four shipped objects in other proportions and other colours, never as they are."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from toolkit.content.everyday.paints import chance, draw, pick_colour
from toolkit.content.everyday.shapes import LENGTH_MM
from toolkit.objects.load import build_mesh
from toolkit.objects.mesh import Mesh, place_on_table

ATLAS_PX = 512
"""Side that the shipped atlas is reduced to."""
HUE_TURN_DEG = {"racer": (30, 180), "warplane": (30, 180), "coffeepot": (30, 180), "eggnog": (12, 50)}
"""By how much the hues of a shipped object turn; a drink stays one that a person would drink."""


def vary_shipped(name: str, rng: np.random.Generator) -> Mesh:
    """A shipped object stretched by 0.8-1.25 per axis, its hues turned or its paint mixed with another colour."""
    mesh = _small_shipped(name)
    stretch = np.exp(rng.uniform(np.log(0.8), np.log(1.25), 3)).astype(np.float32)
    normals = mesh.normals / stretch
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    repainted = _repaint(mesh.materials[0].texture, HUE_TURN_DEG[name], rng)
    materials = tuple(
        replace(
            material, texture=repainted, roughness=float(np.clip(material.roughness * draw(rng, 0.7, 1.5), 0.05, 0.95))
        )
        for material in mesh.materials
    )
    changed = replace(mesh, vertices=mesh.vertices * stretch, normals=normals, materials=materials)
    return place_on_table(changed, LENGTH_MM)


def _repaint(texture: np.ndarray, turn_deg: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """Turn all hues within `turn_deg` either way, at times mix in a colour, and change lightness and contrast."""
    # what is grey stays grey: a rotation about the grey axis of RGB
    turn = np.radians(draw(rng, *turn_deg)) * (1 if chance(rng, 0.5) else -1)
    axis = np.full(3, 1 / np.sqrt(3))
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    matrix = np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross
    shift = np.zeros(3)
    if chance(rng, 0.5):
        share = draw(rng, 0.15, 0.5)
        matrix, shift = matrix * (1 - share), share * np.array(pick_colour(rng, "bright", "ceramic", "car"))
    gain = draw(rng, 0.75, 1.2)
    return cv2.transform(texture, np.c_[matrix * gain, shift * gain + draw(rng, -12, 24)])


@lru_cache(maxsize=4)
def _small_shipped(name: str) -> Mesh:
    mesh = build_mesh(name)
    texture = cv2.resize(mesh.materials[0].texture, (ATLAS_PX, ATLAS_PX), interpolation=cv2.INTER_AREA)
    return replace(mesh, materials=tuple(replace(material, texture=texture) for material in mesh.materials))
