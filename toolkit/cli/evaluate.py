"""`toolkit eval` and `toolkit corrupt`: classify captures, and corrupt images."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_table, warn
from toolkit.core.text import count_of, kept_before, list_some
from toolkit.core.workspace import Workspace, open_workspace
from toolkit.corruptions.catalogue import SEVERITIES, find_note, parse_corruptions
from toolkit.evaluation import EvalConfig

if TYPE_CHECKING:
    from toolkit.evaluation.evaluate import Evaluation

SHOWN_FAILURES = 20
CORRUPTIONS = (
    "Corruption, or noise, blur, weather, digital, extra, common (15), all; fog:3 or noise:1-3 for some severities; "
    "may be repeated."
)
SEVERITY = "Severity if --corrupt names none: 1 (slight) to 5 (severe); may be repeated. Default: all five."


@from_config(config=EvalConfig)
def evaluate(
    *,
    captures: Annotated[
        Path | None,
        typer.Argument(help="Folder of images, SOURCE/OBJECT/VARIANT/FILE, or one source; default: captures/."),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"{options.NETWORK}, or a detector. Default: resnet18, or the network of the record of --weights.",
        ),
    ] = None,
    weights: options.WeightsFile = None,
    config: EvalConfig,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    verbose: options.Verbose = False,
    as_json: options.Json = False,
) -> None:
    """Classify every image of a capture folder, and write table, summary and report to eval/RUN.

    With a detector (torchvision:NAME, onnx:FILE), find the object in every image instead.

    With --corrupt, also classify each image with ImageNet-C's fog, blur or noise, in sources such as sim-fog-3.
    """
    from toolkit.captures.read import find_captured
    from toolkit.models.find import may_be_detector

    # the current folder counts as a workspace for reading
    space = open_workspace(workspace)
    folder = captures or space.captures_dir
    find_captured(folder)  # before a network is loaded
    if may_be_detector(model):
        from toolkit.models.load_detector import is_detector

        if is_detector(model):
            _detect(folder, space, options.NamedNetwork(model, weights, device), config, as_json)
            return
    from toolkit.evaluation.evaluate import evaluate_captures
    from toolkit.models.load import load_classifier

    # classify
    classifier = load_classifier(model, weights, device, folder=space.classifiers_dir)
    done = evaluate_captures(folder, space, classifier, config)
    if as_json:
        show_json(done.summary)
    else:
        show_evaluation(done)
    # also where files contradict their manifest: a script must notice
    if done.failed or (done.origin and done.origin.faults):
        raise typer.Exit(1)


def _detect(
    captures: Path, space: Workspace, named: options.NamedNetwork, config: EvalConfig, as_json: bool
) -> None:  # fmt: skip
    """Find the object in every image with a detector, and print the results."""
    from toolkit.core.console import is_verbose
    from toolkit.core.tables import format_interval, format_percent
    from toolkit.evaluation.detect import describe_pairs, evaluate_detector
    from toolkit.evaluation.tables import MAX_OUTCOMES, MAX_ROWS, list_lines, list_origin, pick_rows
    from toolkit.models.load_detector import load_detector

    detector = load_detector(str(named.model), named.weights, named.device)
    done = evaluate_detector(captures, space, detector, config)
    # for scripts, nothing but JSON is on standard output
    if as_json:
        show_json(done.summary)
    else:
        say(f"detector: {detector.name} ({detector.arch}, weights {detector.weights.name})")
        for line in describe_pairs(done):
            say(line)
        rows = [
            (
                group.source, group.object, group.variant, group.n, format_percent(group.found),
                format_interval(group.found_ci95), format_percent(group.recall50),
                *("" if ap is None else f"{ap:.2f}" for ap in (group.ap50, group.ap50_95)),
            )
            for group in pick_rows(done.groups, MAX_ROWS if is_verbose() else MAX_OUTCOMES)
        ]  # fmt: skip
        show_table(("source", "object", "variant", "n", "found, %", "95 %", "recall, %", "AP50", "AP50:95"), rows)
        for line in list_origin(done.origin):
            say(line)
        for line in list_lines("left out", done.left_out):
            warn(line)
        for note in done.notes:
            remark(note)
        say(f"report: {done.run_dir / 'report.html'}")
    # the results are printed first: they count in spite of what was left out
    if done.left_out:
        raise typer.Exit(1)


def show_evaluation(done: "Evaluation") -> None:
    """Print the verdicts, the files that could not be used, notes, and the path of the report."""
    from toolkit.core.console import console
    from toolkit.evaluation.tables import list_lines, list_unpaired, print_tables

    print_tables(console, done, done.summary["model"]["name"])
    faults = list_lines("set aside", done.origin.faults if done.origin else [])
    for line in (*faults, *list_lines("could not be read", done.failed), *list_unpaired(done.unpaired, done.no_pairs)):
        warn(line)
    for note in done.notes:
        remark(note)
    say(f"report: {done.report_file}")


def corrupt(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Folder of images, in any layout, or an image.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to write to; for an image also a .png or .jpg.")],
    names: Annotated[list[str], typer.Option("--corrupt", metavar="NAME[:SEVERITY]", help=CORRUPTIONS)],
    severities: Annotated[
        list[int] | None, typer.Option("--severity", metavar="N", min=1, max=5, help=SEVERITY)
    ] = None,
    image_px: Annotated[
        int | None, typer.Option(metavar="N", help="First resize and crop to N×N pixels (published: 224).")
    ] = None,
    image_format: Annotated[
        str, typer.Option("--format", metavar="png|jpg", help="jpg: quality 85, as ImageNet-C was saved.")
    ] = "png",
    seed: options.Seed = 0,
    device: options.Device = "auto",
    as_json: options.Json = False,
) -> None:
    """Corrupt images as ImageNet-C and CIFAR-10-C do: 15 corruptions and 4 more, at 5 severities.

    A single corruption at a single severity mirrors IN in OUT; several are written to OUT/NAME/SEVERITY.
    """
    from toolkit.captures.read import find_faults
    from toolkit.corruptions.folder import corrupt_images
    from toolkit.models.network import choose_device

    # images that contradict their manifest are skipped
    chosen = parse_corruptions(names, severities or SEVERITIES)
    result = corrupt_images(
        source, out, chosen, seed=seed, size_px=image_px, image_format=image_format, device=choose_device(device),
        skip=find_faults(source),
    )  # fmt: skip
    if as_json:
        show_json({"out": str(out)} | result.as_json())
    else:
        # corruptions that differ from the published definitions are named
        note = find_note(list(dict.fromkeys(name for name, _ in chosen)))
        for line in (*result.describe_scale(), *([note] if note else [])):
            remark(line)
        if result.left:
            left = list_some(result.left, SHOWN_FAILURES)
            remark(f"{out} holds images of earlier runs that no image of {source} makes now: {left}")
        for path, reason in result.failed[:SHOWN_FAILURES]:
            warn(f"failed: {path}: {reason}")
        if len(result.failed) > SHOWN_FAILURES:
            warn(f"failed: {len(result.failed) - SHOWN_FAILURES} more, --json lists them all")
        say(f"made {count_of(result.made, 'image')}{kept_before(result.kept)}: {out}")
    # the other images are made, but a script must notice
    if result.failed:
        raise typer.Exit(1)
