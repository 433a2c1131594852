"""`toolkit corrupt-eval`: does a patch help where the weather, the camera or the transmission is bad?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options

if TYPE_CHECKING:
    from toolkit.models.network import Classifier

SHOWN_NAMES = 5


def corrupt_eval(
    data: Annotated[
        str,
        typer.Option(
            help="Folder with one folder per class (its val/ or test/, where there is one), or cifar10:FOLDER."
        ),
    ],
    patches: Annotated[
        list[str] | None,
        typer.Option(
            "--patches", help="Patch set below print/patches, repeatable; SET@MODEL is answered by another classifier."
        ),
    ] = None,
    corruptions: Annotated[
        list[str] | None,
        typer.Option(
            "--corruption",
            help="NAME[:SEVERITY], a family, common (15) or all (19); fog:3, noise:1-3. Repeatable. Default: common.",
        ),
    ] = None,
    classes: Annotated[
        list[str] | None,
        typer.Option("--class", help="Label, index or WordNet id. Default: all with images and patches."),
    ] = None,
    per_class: Annotated[
        int | None, typer.Option("--per-class", min=1, help="At most so many images of each class, drawn by the seed.")
    ] = None,
    model: Annotated[str | None, typer.Option("--model", help="The classifier. Default: resnet18.")] = None,
    weights: options.WeightsFile = None,
    rotation: options.Rotation = 45.0,
    scale: options.Scale = (0.9, 1.1),
    translate: options.Translate = 0.3,
    run: Annotated[str | None, typer.Option(help="Of the results folder. Default: the data's and the model's.")] = None,
    download: options.Download = False,
    seed: options.Seed = 0,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """Corrupt a data set with and without patches, and ask a classifier: ImageNet-C's benchmark, or CIFAR-10-C's.

    Results go to eval/corruptions/RUN. An answer is computed once, whatever run asks for it.
    """
    from toolkit.benchmark.run import benchmark_corruptions
    from toolkit.boosters.place_patches import Placement
    from toolkit.core.console import quietly
    from toolkit.core.workspace import open_workspace
    from toolkit.corruptions.request import parse_corruptions
    from toolkit.models.load import load_classifier

    chosen, placement = corruptions or ["common"], Placement(rotation, scale, translate)
    parse_corruptions(chosen)  # refuses before weights are read
    place = open_workspace(workspace)

    def load(name: str | None, file: Path | None = None) -> "Classifier":
        return load_classifier(name, file, device, quiet, place.classifiers_dir)

    with quietly(quiet or as_json):
        done = benchmark_corruptions(
            place, load(model, weights), data, patches or (), chosen, classes=classes or (), per_class=per_class,
            placement=placement, seed=seed, run=run, download=download, load=load,
        )  # fmt: skip
    failed = done.result.benchmark.failed
    if as_json:
        typer.echo(done.files.summary.read_text(encoding="utf-8"))
    else:
        _report(done.result, done.files, done.without_images)
    if failed or any(done.without_images.values()):
        raise typer.Exit(1)


def _report(result, files, without_images: dict[str, list[str]]) -> None:
    from toolkit.benchmark.summary import read_summary
    from toolkit.benchmark.text import build_table, say_benchmark
    from toolkit.core.console import console, errors, list_skipped

    list_skipped(result.benchmark.failed)
    for name, labels in without_images.items():
        if labels:
            more = f" and {len(labels) - SHOWN_NAMES} more" if len(labels) > SHOWN_NAMES else ""
            line = f"skipped {len(labels)} patches of {name}: no images of {', '.join(labels[:SHOWN_NAMES])}{more}"
            errors.print(f"{line}; --class names those that are meant", style="yellow", markup=False, soft_wrap=True)
    for note in result.benchmark.notes:
        errors.print(f"note: {note}", markup=False, soft_wrap=True)
    summary = read_summary(files.summary)
    console.print(build_table(summary))
    lines = say_benchmark(summary)
    kept = f", {result.kept} kept from before" if result.kept else ""
    lines += [f"{result.computed} answers{kept}; table, figures and report: {files.report}"]
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)
