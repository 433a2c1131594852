"""An object of your own: a mesh is added to the workspace, planned, photographed in the rig, and shown to a network."""

import sys
from pathlib import Path

import numpy as np
import torch
import trimesh
from PIL import Image

import toolkit as tk

lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out"))


def build_dumbbell() -> trimesh.Scene:
    """A dumbbell in metres, lying along x, y up and z to the front, as glTF has it. Yours comes from a file."""
    across = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))
    pieces = []
    for middle_m, length_m, radius_m, colour in (
        (0, 0.2, 0.013, 185),
        (-0.09, 0.05, 0.045, 35),
        (0.09, 0.05, 0.045, 35),
    ):
        piece = trimesh.creation.cylinder(radius_m, length_m, sections=48, transform=across)
        piece.apply_translation((middle_m, 0.045, 0))
        piece.visual.face_colors = (colour, colour, colour, 255)
        pieces.append(piece)
    return trimesh.Scene(pieces)


mesh_file = lab.root / "dumbbell.glb"
build_dumbbell().export(mesh_file)
added = tk.add_object(lab, mesh_file, tk.ObjectRequest(class_name="dumbbell", length_mm=230, replace=True))
size_mm = " × ".join(f"{side:.0f}" for side in added.item.mesh.size_mm)
print(f"{added.item.name}: {size_mm} mm, {len(added.item.mesh.faces)} triangles, described in {added.spec_file}")

camera = tk.Camera.from_fov(320, 240)
plan = tk.plan_objects(lab, ["dumbbell"], tk.Pattern(count=12), camera)
poses = plan.objects["dumbbell"]
pictures = tk.render(added.item, poses, camera)

network = tk.load_classifier("rig18")
batch = torch.stack([network.preprocess(picture) for picture in pictures])
probabilities = tk.predict(batch, network).softmax(dim=1)
for pose, row in zip(poses, probabilities, strict=True):
    guess = int(row.argmax())
    where = f"azimuth {pose.azimuth_deg:3.0f}°, elevation {pose.elevation_deg:2.0f}°"
    print(f"{where}: {network.labels[guess]} {row[guess]:.0%}")

sheet = Image.new("RGB", (4 * 320, 3 * 240))
for k, picture in enumerate(pictures):
    sheet.paste(Image.fromarray(picture), (k % 4 * 320, k // 4 * 240))
sheet.save(lab.root / "dumbbell.png")
print(f"made {lab.root / 'dumbbell.png'} and {lab.plan_file}")
print("next: tk.train_patch(lab, 'dumbbell', network, ['rig:dumbbell']) makes a patch for it, as in 01_road.py")
