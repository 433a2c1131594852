"""A patch in a training loop of your own: `apply_patch` is differentiable, so that any module and optimiser will do."""

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image

import toolkit as tk

STEPS, BATCH, CLASS = 40, 8, "dice"
PLACES = tk.AffineRanges(share=(0.35, 0.5), foreshortening=(0.7, 1.0))  # how large, how oblique


class LearnedPatch(torch.nn.Module):
    """(3, n, n) pixels in [0, 1] as the sigmoid of free parameters, laid on images at random places."""

    def __init__(self, n: int) -> None:
        """Begin with grey: sigmoid(0)."""
        super().__init__()
        self.logits = torch.nn.Parameter(torch.zeros(3, n, n))

    def forward(self, images: torch.Tensor, seed: int) -> torch.Tensor:
        """(b, 3, h, w) images in [0, 1] with the patch on them; another seed, other places."""
        return tk.apply_patch(images, torch.sigmoid(self.logits), seed, placement=PLACES)


lab = tk.make_workspace(Path(sys.argv[1] if len(sys.argv) > 1 else "example-out"))
network = tk.load_classifier("rig18")  # `logits` is any differentiable function of (b, 3, h, w) images in [0, 1]
target = network.class_index(CLASS)
side = network.preprocessing.crop_px
item, camera = tk.load_object(lab.object_spec("racer")), tk.Camera.from_fov(side, side)
pictures = tk.render(item, tk.plan_poses(item, camera, tk.Pattern(name="fibonacci", count=32)), camera)
photos = torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255
held_out, train = photos[::4], photos[torch.arange(len(photos)) % 4 != 0]

patch = LearnedPatch(24)
optimiser = torch.optim.Adam(patch.parameters(), lr=0.2)
for step in range(STEPS):
    chosen = np.random.default_rng([0, step]).choice(len(train), BATCH)
    shown = patch(train[chosen], seed=step)
    loss = torch.nn.functional.cross_entropy(network.logits(shown), torch.full((BATCH,), target))
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    if step % 10 == 0 or step == STEPS - 1:
        print(f"step {step}: loss {loss.item():.2f}")

with torch.no_grad():
    grey = tk.apply_patch(held_out, torch.full((3, 24, 24), 0.5), seed=10**6, placement=PLACES)
    shown = patch(held_out, seed=10**6)
    for what, images in (("no patch", held_out), ("grey patch", grey), ("learned patch", shown)):
        share = (network.logits(images).argmax(dim=1) == target).float().mean()
        print(f"held-out images predicted as '{CLASS}', {what}: {share:.0%}")
sheet = lab.root / "own-loop.png"
tiles = (torch.cat([grey[:6], shown[:6]]) * 255).byte().permute(0, 2, 3, 1).numpy()
Image.fromarray(np.vstack([np.hstack(list(tiles[:6])), np.hstack(list(tiles[6:]))])).save(sheet)
print(f"made {sheet}; next: images, network and loss of your own, and tk.corrupt or your augmentations after the patch")
