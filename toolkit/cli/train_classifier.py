"""`toolkit train-classifier`."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import show_json
from toolkit.training.classifier_config import ClassifierConfig

if TYPE_CHECKING:
    from toolkit.models.find import HeldOut
    from toolkit.training.classifier import TrainedClassifier


@from_config(config=ClassifierConfig)
def train_classifier(
    config: ClassifierConfig,
    patches: Annotated[
        str | None,
        typer.Option(metavar="SET", help="Every image has the patch of its class from this set, as in corrupt-eval."),
    ] = None,
    download: Annotated[bool, typer.Option("--download", help="Fetch CIFAR-10 where it is not there.")] = False,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", help="Processes that render. Default: one per core.", min=1, show_default=False),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for the classifier. Default: rig/classifiers.")
    ] = None,
    keep_data: Annotated[
        bool, typer.Option("--keep-data", help="Keep the rendered images, for another training under this name.")
    ] = False,
    restart: Annotated[bool, typer.Option("--restart", help="Begin again; discard an unfinished run.")] = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Train a classifier of your own classes, from renders or images; an interrupted run goes on where it stopped."""
    from toolkit.core.workspace import open_workspace
    from toolkit.experiments.corruptions.training_boost import read_training_boost
    from toolkit.training.classifier import train_classifier as run

    space = open_workspace(workspace)
    pictures = None if patches is None else read_training_boost(space, patches)
    trained = run(
        config.with_overrides(seed=seed), space, pictures, out=out, device=device,
        workers=workers or os.cpu_count() or 1, download=download, restart=restart, keep_data=keep_data,
    )  # fmt: skip
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
        show_json(result)
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
    if (hit := held_out.under_attack) is not None:
        low, high = hit.ci95
        lines.append(
            f"under attack ({hit.norm} {hit.eps:.4g}, {hit.steps} steps): {hit.correct} of {hit.n} right "
            f"({hit.accuracy:.1%}, {low:.1%} to {high:.1%})"
        )
    shares = sorted((one.correct / one.n, label) for label, one in held_out.per_class.items() if one.n)
    if shares[0][0] < 1:
        lines.append("weakest classes: " + ", ".join(f"{label} {share:.0%}" for share, label in shares[:5]))
        lines.append(
            "commonest mistakes: "
            + ", ".join(f"{true} taken for {answer} ({count})" for true, answer, count in held_out.confusions[:5])
        )
    return lines
