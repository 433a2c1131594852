"""Measure the best that a sheet could do: sheet_limits.py CSV WORKSPACE OBJECT...

Before a network, ResNet-18, in random views of each object with its sheet, as `train-patch` draws them, but without
printer, camera and change of light. *each*: a picture of its own for every view, which no real sheet has; *one*: one
picture for all of them, judged in the views that it was made for. Both after few steps: more would find more.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from tables import Row, write_table

from toolkit.boosters.mounted import MountedViews, grey_paper, render_mounted_views, show_mounted, stack_views
from toolkit.boosters.pixels import Target, judge_photos
from toolkit.core.statistics import wilson_interval
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.models.load import load_classifier
from toolkit.objects.load import load_object
from toolkit.objects.records import printed_size_mm

VIEWS, STEPS, LR, PATCH_PX, BATCH = 8, 15, 0.2, 100, 4
SEEN = 0.02
"""A pixel belongs to the sheet where black and white differ by more."""


def show(patch: torch.Tensor, views: MountedViews, which: np.ndarray, side: int) -> torch.Tensor:
    """The middle of some views with a patch on the sheet."""
    start = (views.batch.still.shape[1] - side) // 2
    return show_mounted(patch, views, which, np.full((len(which), 2), start), side)


def find_best(views: MountedViews, which: np.ndarray, target: Target, side: int) -> torch.Tensor:
    """The picture that descent by signs finds for these views, a batch of them at a time."""
    patch = grey_paper(torch.empty(3, PATCH_PX, PATCH_PX)).requires_grad_(True)
    rng = np.random.default_rng(0)
    for step in range(STEPS):
        some = rng.choice(which, min(BATCH, len(which)), replace=False)
        loss, _ = judge_photos(show(patch, views, some, side), [target])
        (gradient,) = torch.autograd.grad(loss, patch)
        with torch.no_grad():
            patch.sub_(LR * (1 + np.cos(np.pi * step / STEPS)) / 2 * gradient.sign()).clamp_(0, 1)
    return patch.detach()


def measure(space: Workspace, name: str, target: Target) -> Row:
    """A row of one object."""
    side, item = target.classifier.preprocessing.crop_px, load_object(space.object_spec(name))
    sizes_mm = item.spec.sizes_mm(printed_size_mm(PATCH_PX))
    rendered = render_mounted_views(item, sizes_mm, PATCH_PX, VIEWS, seed=0, image_px=side)
    views, every = stack_views(rendered, sizes_mm, "cpu"), np.arange(VIEWS)
    grey = grey_paper(torch.empty(3, PATCH_PX, PATCH_PX))
    with torch.no_grad():
        black, white = (show(torch.full_like(grey, value), views, every, side) for value in (0.0, 1.0))
    shares = ((white - black).mean(1) > SEEN).float().mean((1, 2)).numpy()
    pictures = {"grey": grey, "one": find_best(views, every, target, side)}
    hits = {how: target.count_hits(show(patch, views, every, side)) for how, patch in pictures.items()}
    hits["each"] = sum(
        target.count_hits(show(find_best(views, one, target, side), views, one, side)) for one in every[:, None]
    )
    row: Row = {
        "object": name, "class": target.label, "size_mm": min(sizes_mm), "n": VIEWS,
        "share": float(shares.mean()), "least_share": float(shares.min()), "most_share": float(shares.max()),
    }  # fmt: skip
    for how, count in hits.items():
        low, high = wilson_interval(count, VIEWS)
        row |= {how: count, f"{how}_low": low, f"{how}_high": high}
    return row


def main(table: str, folder: str, *names: str) -> None:
    """Write the table."""
    space, network = open_workspace(Path(folder)), load_classifier("resnet18", device="cpu")
    rows = []
    for name in names:
        spec = load_object(space.object_spec(name)).spec
        rows.append(measure(space, name, Target(network, network.class_index(spec.class_name))))
        print(rows[-1], flush=True)  # noqa: T201
    write_table(Path(table), rows)


if __name__ == "__main__":
    main(*sys.argv[1:])
