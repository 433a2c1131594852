"""A wrap: flat pieces that cover an object, what is on them, and pages to cut them from."""

import sys
from pathlib import Path

import trimesh

import toolkit as tk

NAME = "pot"
STEPS = 30  # 300 is the default: about six minutes on two cores

lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out"))
network = tk.load_classifier("rig18")
# a tapered pot 18 cm high, in metres with y up, as glTF has it. Yours comes from a file
profile = [(0, 0), (0.05, 0), (0.07, 0.06), (0.06, 0.13), (0.03, 0.18), (0, 0.18)]
turned = trimesh.transformations.rotation_matrix(-1.5707963, (1, 0, 0))
mesh_file = lab.root / f"{NAME}.glb"
trimesh.creation.revolve(profile, sections=48).apply_transform(turned).export(mesh_file)
added = tk.add_object(lab, mesh_file, tk.ObjectRequest(class_name="coffeepot", length_mm=180, replace=True))

wrap = tk.plan_wrap(added.item, tk.WrapConfig(pieces=4, material="vinyl", views=16))
print(f"{len(wrap.pieces)} pieces cover {wrap.record.covered:.0%} of what cameras see")
for piece in wrap.record.pieces:
    print(f"  piece {piece.number}: {piece.width_mm:.0f} × {piece.height_mm:.0f} mm, stretched by {piece.stretch:.1%}")
tk.write_wrap(lab.wraps_dir / NAME, wrap)

# how many of them are needed? They are ranked, and those that add nothing are dropped
trained = tk.train_wrap(lab, NAME, network, pieces="1..4", steps=STEPS, batch=6, reuse=6, per_studio=12, workers=0)
for line in trained.lines():
    print(line)

printed = tk.print_wrap(lab, NAME, wanted=tk.WrapSettings(cut="svg"))
print(printed.describe())
print(f"made {printed.file} and {', '.join(printed.cut_files)}")
print("next: cut the pieces out, stick them on in the order of page 1, and photograph: docs/tasks/wrap.md")
