"""Bad weather and bad cameras: ImageNet-C's corruptions on a batch, and a benchmark of patches under them."""

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torchvision.utils import save_image

import toolkit as tk

lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out"))
network = tk.load_classifier("rig18")
side = network.preprocessing.crop_px
camera, pattern = tk.Camera.from_fov(side, side), tk.Pattern(name="fibonacci", count=4)

# A data set: a folder per class. With photographs of yours this part falls away.
data = lab.root / "photographs"
for name in ("coffeepot", "eggnog", "racer", "warplane"):
    item = tk.load_object(lab.object_spec(name))
    (data / name).mkdir(parents=True, exist_ok=True)
    for k, picture in enumerate(tk.render(item, tk.plan_poses(item, camera, pattern), camera)):
        Image.fromarray(picture).save(data / name / f"{k}.png")

# Each image of a batch has a seed, so that its corruption does not depend on its neighbours.
files = [data / name / "0.png" for name in ("coffeepot", "racer")]
clean = torch.stack([network.preprocess(np.asarray(Image.open(file))) for file in files])
seeds = [tk.image_seed(0, file.name) for file in files]
rows = [clean]
for name in ("fog", "motion_blur", "contrast", "jpeg_compression"):
    rows.append(tk.corrupt(clean, name, 3, seeds))
    guesses = tk.predict(rows[-1], network).argmax(dim=1)
    said = [f"{file.parent.name} is a {network.labels[k]}" for file, k in zip(files, guesses, strict=True)]
    print(f"{name}, severity 3: {', '.join(said)}")
sheet = lab.root / "corrupted.png"
save_image(torch.cat(rows), sheet, nrow=len(files))

# The benchmark: every image without and with the shipped patch of its class, clean and under each corruption.
severe = (("fog", 3), ("gaussian_noise", 3), ("contrast", 3))
config = tk.CorruptEvalConfig(patches=("rig18",), corruptions=severe)
config = config.with_overrides({"placement.scale": (0.35, 0.45)})  # they have 100 px, and the network sees 128
done = tk.evaluate_benchmark(lab, data, network, config)
for headline in done.headlines:
    print(headline)
print(f"made {sheet}, {done.files.cells} and {done.files.report}")
print("next: data of your own, patches=('qr-100',) from 'toolkit baseline', and no corruptions=: all fifteen")
