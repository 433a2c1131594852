"""`toolkit models`: which networks are at hand."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from toolkit.cli import options
from toolkit.cli.output import remark, say, show_json, show_table

if TYPE_CHECKING:
    from toolkit.evaluation.survey import SurveyedModel


def list_models(
    model: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this one, or one that is not in the list; repeat for more."),
    ] = None,
    data: Annotated[
        str | None,
        typer.Option(
            metavar="FOLDER",
            help="Also count what each gets right: a folder with one folder per class, or cifar10:FOLDER.",
        ),
    ] = None,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    quiet: options.Quiet = False,
    as_json: options.Json = False,
) -> None:
    """List the networks whose weights are on this machine: classes, speed here, licence, whether they can train."""
    from toolkit.core.workspace import open_workspace
    from toolkit.evaluation import survey

    folder = open_workspace(workspace).classifiers_dir
    rows = survey.survey_models(model or survey.list_models(folder), device, folder, data)
    if as_json:
        show_json([asdict(one) for one in rows])
    else:
        _show(rows, data is not None)
    if any(one.classes is None for one in rows):
        raise typer.Exit(1)


def _show(rows: "list[SurveyedModel]", with_data: bool) -> None:
    titles = ["--model", "kind", "classes", "px", "per s", "trains", "licence"]
    cells = []
    for one in rows:
        row = [
            one.model, one.kind, one.classes or "", one.image_px or "",
            f"{one.images_per_s:.0f}" if one.images_per_s else "",
            "no" if not one.can_train else f"{one.trained_images_per_s:.0f}/s" if one.trained_images_per_s else "yes",
            one.licence or "not said",
        ]  # fmt: skip
        if with_data:
            low, high = one.ci95 or (0.0, 0.0)
            row.insert(4, f"{100 * one.accuracy:.1f} % ({100 * low:.0f}–{100 * high:.0f}) of {one.n}"
                       if one.accuracy is not None else "")  # fmt: skip
        cells.append(row)
    if with_data:
        titles.insert(4, "right")
    show_table(titles, cells)
    for one in rows:
        if one.why_not:
            remark(f"{one.model}: {one.why_not}")
    say("others: torchvision's by name, timm:NAME, onnx:FILE, FILE.pt2, python:MODULE:FUNCTION")
