"""The whole road: train a patch, print it, plan the poses, shoot without and with it, and say whether it helped."""

import sys
from pathlib import Path

import toolkit as tk

NAME = "coffeepot"  # or racer, warplane, eggnog; 02_own_object.py adds an object of your own
STEPS = 30  # enough to see that it works; 600 make the best patch
FAR = 0.32  # of the frame that the object fills: there the network often misses the unmodified object

# %% A workspace, and the network that shall see the object
lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out"))
network = tk.load_classifier("rig18")  # comes with the kit; resnet18, timm:NAME or weights of your own work as well

# %% Train a patch on renders of the object with the paper on it
trained = tk.train_patch(
    lab, NAME, network, steps=STEPS, batch=8, mounted_views=24, mounted_fill=(0.2, 0.45), images=10
)

# %% Print it, true to the millimetre
page = tk.print_patch(trained.files.png, lab.print_dir / f"{NAME}.pdf")

# %% Plan 18 poses, and shoot the object without a patch, with it, and with grey paper as a control
plan = tk.plan_objects(lab, [NAME], tk.Pattern(count=18, fill=FAR), tk.Camera.from_fov(320, 240))
shots = tk.shoot_plan(lab, plan, [NAME], ["unpatched", "patched", "grey-patch"])

# %% Ask the network, and compare pose by pose
result = tk.evaluate_captures(lab.captures_dir, lab, network)
print(tk.predictions_table(result).groupby("variant")[["correct_top1", "true_prob"]].mean().round(2))
for headline in result.headlines:
    print(f"{headline.verdict}: {headline.sentence}")

# %% What was made
print(f"made {trained.files.png}, {page.file}, {shots.shot} images in {shots.source_dir} and {result.report_file}")
print("next: open the report; print the page, tape it on, photograph it from the planned poses into captures/real")
