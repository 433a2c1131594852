"""Captures as a torch Dataset and predictions as a pandas table: for training, features and statistics of your own."""

import sys
from pathlib import Path

from torch.utils.data import DataLoader

import toolkit as tk

NAME = "coffeepot"
lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out")).with_patches("rig18")
network = tk.load_classifier("rig18")
plan = tk.plan_objects(lab, [NAME], tk.Pattern(count=12, fill=0.4), tk.Camera.from_fov(320, 240))
tk.shoot_plan(lab, plan, [NAME], ["unpatched", "patched"], source="far")  # photographs of yours are read alike

# (image, target, info): images as the network wants them, (3, s, s) in [0, 1]; info says what is known of each.
dataset = tk.load_captures(lab, network, sources=["far"])
right: dict[str, list[bool]] = {}
for images, targets, info in DataLoader(dataset, batch_size=8, num_workers=2):
    foggy = tk.corrupt(images, "fog", 1, [tk.image_seed(0, path) for path in info["path"]])
    for what, batch in (("clear", images), ("fog", foggy)):
        guesses = tk.predict(batch, network).argmax(dim=1)
        for variant, is_right in zip(info["variant"], (guesses == targets).tolist(), strict=True):
            right.setdefault(f"{variant}, {what}", []).append(is_right)
for what, answers in right.items():
    print(f"{what}: right on {sum(answers)} of {len(answers)}")

# The same, evaluated and written to eval/far; one row for each image.
result = tk.evaluate_captures(lab.captures_dir, lab, network, tk.EvalConfig(sources=("far",), run="far"))
table = tk.predictions_table(result)
azimuths = {pose.id: pose.azimuth_deg for pose in plan.objects[NAME]}
table["azimuth_deg"] = table.pose_id.map(azimuths)
print(table.pivot_table("true_prob", "azimuth_deg", "variant").astype(float).round(2))
wrong = table[~table.correct_top1]
print("taken for:", wrong.top1_label.value_counts().to_dict())

file = lab.root / "predictions.csv"
table.to_csv(file, index=False)
print(f"made {file} with {len(table)} rows, and {result.report_file}")
print("next: fine-tune on `dataset`, or join the table with what you know of your photographs")
