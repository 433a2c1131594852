"""The whole road: train a patch, print it, plan the poses, shoot with and without it, and say whether it helped."""

import sys

import toolkit as tk

# A patch that helps takes some 600 steps and a real plan 18 poses: minutes. Less shows the road in seconds.
STEPS, POSES = 20, 6
NAME = "coffeepot"  # or racer, warplane, eggnog; 02_own_object.py adds one of yours

lab = tk.make_workspace(sys.argv[1] if len(sys.argv) > 1 else "example-out")
network = tk.load_classifier("rig18")  # bundled; "resnet18", "timm:..." and files of weights work as well
trained = tk.train_patch(lab, NAME, network, steps=STEPS, batch=8, mounted_views=16, images=16)
page = tk.print_patch(lab.patch(NAME), lab.print_dir / f"{NAME}.pdf")
plan = tk.plan_objects(lab, [NAME], tk.Pattern(count=POSES), tk.Camera.from_fov(320, 240))
shots = tk.shoot_plan(lab, plan, [NAME], variants=["unpatched", "patched", "grey-patch"])
result = tk.evaluate_captures(lab.captures_dir, lab, network)

table = tk.predictions_table(result)
print(table.groupby("variant")[["correct_top1", "true_prob"]].mean().round(2))
for headline in result.headlines:
    print(headline)
print(f"made {trained.files.png}, {page.file}, {shots.shot} images in {shots.source_dir}, {result.report_file}")
print("next: open the report; then train with STEPS = 600, print the page and photograph the real thing")
