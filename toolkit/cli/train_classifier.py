"""`toolkit train-classifier`."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options

if TYPE_CHECKING:
    from toolkit.models.find import HeldOut
    from toolkit.training.classifier import TrainedClassifier


def train_classifier(
    data: Annotated[
        list[str],
        typer.Option(
            help="everyday: renders of procedural objects; rig: renders of the workspace's objects; cifar10:FOLDER; or "
            "a folder with one folder per class, in train/ and val/ or test/ where there are such. May be repeated."
        ),
    ],
    name: Annotated[str, typer.Option(help="File name of the classifier, for --model NAME afterwards.")],
    arch: Annotated[str, typer.Option(help="Any torchvision classification network; cifar_resnet18, cifar_resnet50 or "
                                "cifar_resnet8 for small images.")] = "resnet18",
    init: Annotated[Path | None, typer.Option(help="Weights to start from: .pth or .safetensors of --arch.")] = None,
    image_px: Annotated[
        int, typer.Option("--image-px", help="Side of what the network sees; 32 for CIFAR.")
    ] = 128,
    keep_labels: Annotated[
        bool, typer.Option("--keep-labels", help="Keep all classes of --init; the folders are called by WordNet id or "
                           "label.")
    ] = False,
    patches: Annotated[
        str | None, typer.Option(help="Every image carries its class's patch of this set, as in corrupt-eval.")
    ] = None,
    corrupt: Annotated[
        list[str] | None, typer.Option(help="Corrupt some training images: NAME, a family, common or all, with "
                                       ":SEVERITY or :FIRST-LAST. Several may be given.")
    ] = None,
    corrupt_share: Annotated[float, typer.Option(help="Which share of them.")] = 0.5,
    download: Annotated[bool, typer.Option("--download", help="Fetch CIFAR-10 where it is not there.")] = False,
    per_class: Annotated[int, typer.Option(help="Renders of each class, or of each object of the rig.")] = 480,
    views: Annotated[int, typer.Option(help="Renders of each object in its studio.")] = 12,
    held_out: Annotated[float, typer.Option(help="Share of the images to test with; a val/ or test/ wins.")] = 0.1,
    epochs: Annotated[int, typer.Option(help="Passes over the images.")] = 24,
    batch: Annotated[int, typer.Option(help="Images per step.")] = 64,
    lr: Annotated[float, typer.Option(help="Highest learning rate; 0.001 suits --init.")] = 0.1,
    weight_decay: Annotated[float, typer.Option(help="Of the weights.")] = 5e-4,
    label_smoothing: Annotated[float, typer.Option(help="Share of each target spread over all classes.")] = 0.1,
    workers: Annotated[
        int | None, typer.Option(help="Processes that render. Default: one per core.", min=1, show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the classifier; default: rig/classifiers.")] = None,
    keep_data: Annotated[
        bool, typer.Option("--keep-data", help="Keep the rendered images, for another training under this name.")
    ] = False,
    restart: Annotated[bool, typer.Option("--restart", help="Begin anew, forget an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:  # fmt: skip
    """Train a classifier of your own classes, from renders or images; an interrupted run goes on where it stopped."""
    from toolkit.benchmark.training_boost import read_training_boost
    from toolkit.core.console import errors
    from toolkit.core.workspace import open_workspace
    from toolkit.corruptions.request import parse_corruptions
    from toolkit.training.augment import PHOTOGRAPHS, SMALL_IMAGES, Corrupting
    from toolkit.training.classifier import RunOptions
    from toolkit.training.classifier import train_classifier as run
    from toolkit.training.classifier_config import SMALL_PX, ClassifierRequest, Recipe

    space = open_workspace(workspace)
    recipe = Recipe(
        epochs, batch, lr, weight_decay=weight_decay, label_smoothing=label_smoothing, seed=seed,
        augmentation=SMALL_IMAGES if image_px < SMALL_PX else PHOTOGRAPHS,
        corrupting=Corrupting(parse_corruptions(corrupt), corrupt_share) if corrupt else None,
    )  # fmt: skip
    request = ClassifierRequest(
        name, tuple(data), arch, init, image_px, per_class, views, held_out, recipe, keep_labels,
        None if patches is None else read_training_boost(space, patches),
    )  # fmt: skip

    def say(line: str) -> None:
        if not quiet:
            errors.print(line, markup=False, soft_wrap=True)

    trained = run(
        request,
        space,
        RunOptions(out, device, workers or os.cpu_count() or 1, download, restart, keep_data, quiet),
        say,
    )
    _report(trained, out, as_json)
    if trained.skipped:
        raise typer.Exit(1)


def _report(trained: "TrainedClassifier", out: Path | None, as_json: bool) -> None:
    from toolkit.core.console import console, list_skipped

    list_skipped(trained.skipped)
    record = trained.record
    if as_json:
        result = {
            "classifier": str(trained.file),
            "was_finished": trained.was_finished,
            "resumed_from": trained.resumed_from,
            "skipped": [{"path": path, "reason": reason} for path, reason in trained.skipped],
            "record": record.model_dump(mode="json"),
        }
        typer.echo(json.dumps(result, indent=2, ensure_ascii=False))
        return

    def tell(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    if trained.was_finished:
        tell(f"{trained.file} was trained with these inputs before: nothing to do; --restart trains it again")
    else:
        size_mb = trained.file.stat().st_size / 1e6
        tell(f"{trained.file}: {record.arch}, {len(record.labels)} classes, {size_mb:.1f} MB")
    for line in describe_held_out(record.held_out):
        tell(line)
    model = f"--model {record.name}" if out is None else f"--weights {trained.file}"
    tell(
        f"next: toolkit eval captures/ {model}, and for patches of its own "
        f"toolkit train-patch {model} --class CLASS --data rig --out print/patches/{record.name}"
    )


def describe_held_out(held_out: "HeldOut") -> list[str]:
    """Accuracy with its interval, the weakest classes and the commonest mistakes."""
    if not held_out.n:
        return ["held-out images: none, so its accuracy is not known"]
    low, high = held_out.ci95
    lines = [
        f"held-out images: {held_out.correct} of {held_out.n} right ({held_out.correct / held_out.n:.1%}, 95 % "
        f"interval {low:.1%} to {high:.1%}); {held_out.what}"
    ]
    shares = sorted((one.correct / one.n, label) for label, one in held_out.per_class.items() if one.n)
    if shares[0][0] < 1:
        lines.append("weakest classes: " + ", ".join(f"{label} {share:.0%}" for share, label in shares[:5]))
        lines.append(
            "commonest mistakes: "
            + ", ".join(f"{true} taken for {answer} ({count})" for true, answer, count in held_out.confusions[:5])
        )
    return lines
