"""A patch for one class: trained on renders of the object with the paper on it, shown on the object, and printed."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import toolkit as tk

STEPS = 20  # 600 is the default: about six minutes on two cores, seconds on a GPU

lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out"))
network = tk.load_classifier("rig18")  # several networks in a list make a patch that all of them see

# Every setting of the recipe can be given by name; recipe="paper" is Algorithm 1 as published.
trained = tk.train_patch(
    lab, "racer", network, data=["rig:racer"], size_px=60, name="quick",
    steps=STEPS, batch=8, mounted_views=24, images=10, camera=False,
)  # fmt: skip
record = trained.patch.record
print(f"{record.name}: {record.n_px} px for '{record.class_name}', loss {record.final['loss']:.2f}")
for answer in trained.on_object:
    print(
        f"{answer.network} on the object, views it never saw: {answer.patched} with it, {answer.bare} with grey paper"
    )

item = tk.load_object(lab.object_spec("racer"))
camera = tk.Camera.from_fov(320, 240)
poses = tk.plan_poses(item, camera, tk.Pattern(name="ring", count=4, elevation_deg=(35, 35)))
bare, patched = tk.render(item, poses, camera), tk.render(item, poses, camera, trained.patch)
sheet = lab.root / "racer-quick.png"
Image.fromarray(np.vstack([np.hstack(list(bare)), np.hstack(list(patched))])).save(sheet)

page = tk.print_patch(trained.files.png, lab.print_dir / "racer-quick.pdf", tk.PrintSettings(size_mm=60, copies=2))
print(page.describe())
print(page.describe_scores())
print(f"made {trained.files.png}, its record {record.name}.json, {sheet} and {page.file}")
print('next: print the page at 100 % ("actual size") and measure its check bars: 100 mm')
