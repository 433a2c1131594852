"""`toolkit runs`, `verify`, `compare`, `report` and `export`: results of runs, and files for other programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import say, show_json, show_result, warn
from toolkit.core.errors import FieldError, one_of
from toolkit.core.workspace import open_workspace

MESHES = "An object's mesh"
TABLE_SUFFIXES = (".csv", ".tsv", ".txt")
WHERE = "Only these rows: object=racer, weather=fog, run=resnet*, p<0.05, top1>=0.5; may be repeated."
CLUSTER = "For CSV files: the column that groups images, such as a scene."
RunNames = Annotated[list[str] | None, typer.Argument(help="Runs: names below eval/, or their folders.")]
Captures = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Folder of the images; default: captures/, or the sweep's folder.")
]


def list_runs(
    where: Annotated[list[str] | None, typer.Option(metavar="FIELD=VALUE", help=WHERE)] = None,
    everything: Annotated[bool, typer.Option("--all", help="Also each object, place and corruption.")] = False,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """List the results of every run as a table: evaluations, worlds, sweeps, corruption benchmarks and landings."""
    from toolkit.core.console import console, list_skipped
    from toolkit.evaluation.summaries import build_runs_table, find_runs, parse_where, pick_rows

    # conditions are read before the runs, which may be many
    wanted = [parse_where(text) for text in where or ()]
    runs, refused = find_runs(open_workspace(workspace))
    rows = pick_rows([row for run in runs for row in run.rows], wanted, everything)
    list_skipped(refused)
    if as_json:
        show_json([row.as_json() for row in rows])
    elif rows:
        console.print(build_runs_table(rows))
    else:
        say("no row matches --where" if runs else "no runs yet: make one with 'toolkit eval'")
    if refused:
        raise typer.Exit(1)


@from_config()
def verify(
    run: Annotated[str, typer.Argument(help="Name of a run below eval/, or its folder.")],
    *,
    network: options.NamedNetwork,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Compute a result of 'toolkit eval' again from its images and weights, and report whether it is the same."""
    from toolkit.evaluation.tables import list_lines
    from toolkit.evaluation.verify import read_asked, verify_run
    from toolkit.models.load import load_classifier

    space = open_workspace(workspace)
    # the run names its network, so that the option can be left out
    name = read_asked(space, run)[1]["model"]["name"]
    # by default the network of the run
    if network.model is None and network.weights is None:
        network = network._replace(model=str(name))
    done = verify_run(space, run, load_classifier(*network, space.classifiers_dir))
    if as_json:
        show_json(done.as_json())
    else:
        for line in list_lines("differ", done.differing):
            warn(line)
        say(done.describe())
    if not done.is_same:
        raise typer.Exit(1)


def compare(
    first: Annotated[str, typer.Argument(help="Name of a run below eval/, its folder, or any CSV of predictions.")],
    second: Annotated[str, typer.Argument(help="The run, or the CSV, that is compared with it.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The page. Default: eval/comparisons/FIRST-vs-SECOND.html.")
    ] = None,
    captures: Captures = None,
    cluster: Annotated[str | None, typer.Option(metavar="COLUMN", help=CLUSTER)] = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Compare two runs, or two tables of predictions, image by image: exact test, changed images, and a page."""
    from toolkit.core.console import console
    from toolkit.evaluation.compare import build_comparison_table, compare_runs, write_comparison
    from toolkit.evaluation.compare_tables import compare_tables
    from toolkit.evaluation.summaries import open_run

    space = open_workspace(workspace)
    # tables of other programs, or runs of a workspace
    if all(Path(name).suffix.lower() in TABLE_SUFFIXES for name in (first, second)):
        found = compare_tables(Path(first), Path(second), captures, cluster)
    elif cluster is not None:
        raise FieldError("goes with CSV tables only: runs know their objects", {"cluster": cluster})
    else:
        found = compare_runs(space, open_run(space, first), open_run(space, second), captures)
    # names hold slashes where runs lie in folders
    name = "-vs-".join(run.name.strip("/").replace("/", "-") for run in (found.first, found.second))
    page = write_comparison(out or space.eval_dir / "comparisons" / f"{name}.html", found)
    if as_json:
        show_json(found.as_json() | {"page": str(page)})
        return
    # notes first: they may make the rest meaningless
    for note in found.notes:
        warn(note)
    console.print(build_comparison_table(found))
    say(f"{found.verdict}. {found.sentence}")
    say(found.cluster_sentence)
    # images of one run alone have no pair
    for words, count in zip(("first", "second"), found.unshared, strict=True):
        if count:
            warn(f"left out: {count} images that only the {words} run read")
    say(f"page: {page}")


def report(
    names: RunNames = None,
    everything: Annotated[bool, typer.Option("--all", help="Every run of the workspace.")] = False,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="The page. Default: eval/index.html.")] = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Write a page of many runs, which opens without an internet connection: filters, sorting, changed images."""
    from toolkit.core.console import list_skipped
    from toolkit.evaluation.compare import write_index
    from toolkit.evaluation.summaries import Run, find_runs, open_run

    # either names, or all
    if bool(names) == everything:
        raise FieldError("name runs, or give {everything}", {})
    space = open_workspace(workspace)
    refused: Sequence[tuple[str, str]] = ()
    runs: list[Run] = [open_run(space, name) for name in names or ()]
    if everything:
        runs, refused = find_runs(space)
    page = out or space.eval_dir / "index.html"
    # the page must be a file
    if not page.name or page.is_dir():
        raise FieldError("expected a file", {"out": page})
    # runs that cannot be read, and images that are missing
    skipped = [*refused, *write_index(page, space, runs)]
    list_skipped(skipped)
    if as_json:
        lost = [{"path": path, "reason": reason} for path, reason in skipped]
        show_json({"page": str(page), "runs": [run.name for run in runs], "skipped": lost})
    else:
        say(f"{len(runs)} runs: {page}")
    if skipped:
        raise typer.Exit(1)


TO = (
    "A table, or a folder: FiftyOne's, COCO's (of detectors), or images with labels as the Hugging Face Hub shows "
    "them. Default: parquet. With --object: glb, obj, 3mf or usdz."
)
PATH = "Default: eval/predictions.parquet or .csv, eval/fiftyone, eval/coco, eval/imagefolder; a mesh's folder: print/."


def _mesh_option(flag: str, words: str, **given: Any) -> Any:
    return typer.Option(flag, help=words, rich_help_panel=MESHES, **given)


def export(
    names: RunNames = None,
    to: Annotated[str | None, typer.Option(metavar="parquet|csv|fiftyone|coco|imagefolder", help=TO)] = None,
    out: Annotated[Path | None, typer.Option(metavar="PATH", help=PATH)] = None,
    captures: Captures = None,
    objects: Annotated[
        list[str] | None,
        _mesh_option("--object", "Write this object's mesh, not predictions; repeat for more.", metavar="NAME"),
    ] = None,
    as_3mf: Annotated[bool, _mesh_option("--3mf", "Write 3MF, for colour 3D printers, in millimetres.")] = False,
    as_obj: Annotated[bool, _mesh_option("--obj", "Write OBJ, in millimetres.")] = False,
    as_glb: Annotated[bool, _mesh_option("--glb", "Write GLB, in metres. Default without another format.")] = False,
    as_usdz: Annotated[bool, _mesh_option("--usdz", "Write USDZ, for phones and Omniverse, in metres, y up.")] = False,
    card: Annotated[
        bool, _mesh_option("--card", "Write a folder for each object, with the booster's files and a card, README.md.")
    ] = False,
    variant: Annotated[
        str,
        _mesh_option("--variant", "What is on the object: unpatched, patched, wrapped, textured.", metavar="NAME"),
    ] = "unpatched",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Write predictions of runs, by default of all that have any, or the mesh of an object, for other programs."""
    formats = {"glb": as_glb, "obj": as_obj, "3mf": as_3mf, "usdz": as_usdz}
    if objects:
        if names:
            raise FieldError("cannot be exported together with runs: use two commands", {"objects": objects[0]})
        if to is not None and to not in formats:
            raise one_of("format of a mesh", to, list(formats))
        from toolkit.rig.variants import export_objects

        # a format by its own option, or by `--to`
        chosen = [name for name, is_asked in formats.items() if is_asked or to == name] or ["glb"]
        show_result(export_objects(open_workspace(workspace), objects, chosen, variant, out, card), as_json)
        return
    # options that only meshes have
    asked = {"card": card, **{f"as_{name}": is_asked for name, is_asked in formats.items()}}
    for name, is_asked in asked.items():
        if is_asked:
            raise FieldError("goes with {objects}: add that, or leave it out", {name: True})
    if to in formats:
        raise FieldError("goes with {objects}: add that, or name a format of predictions", {"to": to})
    from toolkit.evaluation.export import export_predictions

    show_result(export_predictions(open_workspace(workspace), names or (), to or "parquet", out, captures), as_json)
