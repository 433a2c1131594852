"""A texture: the whole surface of an object instead of a sheet on it, as a picture and as a GLB."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import toolkit as tk

NAME = "coffeepot"
STEPS = 40  # 300 is the default: about three minutes on two cores

lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out"))
network = tk.load_classifier("rig18")
trained = tk.train_texture(lab, NAME, network, size_px=64, steps=STEPS, batch=6, reuse=6, fill=(0.25, 0.5), workers=0)
for validation in trained.validations:
    for where, answer in (("clear views", validation.clear), ("the same in fog", validation.fog)):
        print(f"{answer.network} on {where}: {answer.patched} with the texture, {answer.bare} in its own paint")

item = tk.load_object(lab.object_spec(NAME))
camera = tk.Camera.from_fov(320, 240)
poses = tk.plan_poses(item, camera, tk.Pattern(name="ring", count=4, elevation_deg=(30, 30)))
own, textured = tk.render(item, poses, camera), tk.render(item, poses, camera, trained.texture)
sheet = lab.root / f"{NAME}-texture.png"
Image.fromarray(np.vstack([np.hstack(list(own)), np.hstack(list(textured))])).save(sheet)

print(f"made {trained.files.png}, {trained.glbs[NAME]} for Blender or a simulator, and {sheet}")
print("next: tk.shoot_plan(lab, plan, [NAME], ['unpatched', 'textured', 'grey-texture']) and tk.evaluate_captures")
