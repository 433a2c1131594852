"""Commands that make a workspace, list its objects and networks, check the machine and run a demo."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from toolkit.cli import options
from toolkit.cli.options import from_config
from toolkit.cli.output import remark, say, show_json, show_result, show_table
from toolkit.core.errors import FieldError
from toolkit.core.files import write_bytes
from toolkit.core.text import count_of, quote
from toolkit.core.workspace import Workspace, make_workspace, open_workspace
from toolkit.objects.spec import ObjectRequest, is_lost, read_spec

if TYPE_CHECKING:
    from toolkit.evaluation.survey import SurveyedModel
BUNDLED_FILL = 0.22
"""Share of the frame that objects fill in views for rig18, which is always correct in close-ups without a patch."""
BUNDLED_CONTROL = "grey-patch"
"""A control: far away, a plain sheet of paper may change a prediction."""
CHECK = (
    "Show detectors these photographs: write eval/check/NAME.png with their boxes, and report if another preprocessing "
    "finds more."
)


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to make a workspace of; made if missing.")],
    as_json: options.Json = False,
) -> None:
    """Make a workspace: toolkit.toml, which marks it, and rig/, print/, captures/ and eval/.

    Existing files stay as they are, so you can mark the workspace of an older version.
    """
    space = make_workspace(folder)
    if as_json:
        show_json({"workspace": str(space.root)})
        return
    say(f"made the workspace {space.root}")
    say(f"next: cd {quote(folder)} && toolkit plan && toolkit capture-sim && toolkit eval captures/")


def doctor(workspace: options.Workspace = None, as_json: options.Json = False) -> None:
    """Check this machine for everything that toolkit needs, and print the command that installs what is missing."""
    from toolkit.core.console import console
    from toolkit.training.machine import check_machine

    checks = check_machine(open_workspace(workspace).root)
    missing = [check for check in checks if check.state == "missing"]
    if as_json:
        show_json([asdict(check) for check in checks])
    else:
        # a sign besides the colour, which a log loses
        marks = {"ok": ("✓", "green"), "missing": ("✗", "red"), "note": ("•", "yellow")}
        for check in checks:
            mark, colour = marks[check.state]
            console.print(f"{mark} {check.name}: {check.found}", style=colour, markup=False, soft_wrap=True)
            if check.fix:
                say(f"    {check.fix}")
        say("ready; next: toolkit demo" if not missing else f"{len(missing)} to fix: see the lines above")
    raise typer.Exit(1 if missing else 0)


@from_config(request=ObjectRequest)
def add(
    mesh: Annotated[Path, typer.Argument(help="glb, gltf, obj, ply, stl or off; files that it names are copied too.")],
    *,
    request: ObjectRequest,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """Add an object from its mesh: copy the mesh into the workspace, write its spec, draw a preview.

    Up and front are y and z for glTF (by its specification) and obj, z and -y for ply, stl and off.
    """
    from toolkit.captures.suggest_places import add_and_place

    show_result(add_and_place(open_workspace(workspace, is_needed=True), mesh, request), as_json)


def list_objects(
    export: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write every object as a GLB into this folder.")
    ] = None,
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """List the objects, built in and your own; --export writes them as GLB."""
    from toolkit.objects.load import load_object

    space = open_workspace(workspace)
    rows = []
    for name, file in space.object_specs().items():
        spec = read_spec(file)
        row: dict[str, Any] = {
            "name": name, "class": spec.class_name, "mesh": spec.mesh, "size_mm": [], "triangles": 0, "patch_at": "",
        }  # fmt: skip
        rows.append(row)
        # an object without a mesh can be photographed, and not rendered
        if not spec.mesh or is_lost(spec.mesh):
            continue
        mesh, sides = load_object(file).mesh, [mount.at for mount in spec.mounts]
        row |= {
            "size_mm": [round(float(side), 1) for side in mesh.size_mm], "triangles": len(mesh.faces),
            "patch_at": sides[0] if len(sides) == 1 else sides,
        }  # fmt: skip
        if export is not None:
            from toolkit.objects.export_mesh import to_glb

            write_bytes(export / f"{name}.glb", to_glb(mesh, name))
    if as_json:
        show_json(rows)
        return
    # the table for people
    cells = []
    for row in rows:
        size = " × ".join(f"{side:g}" for side in row["size_mm"])
        at = row["patch_at"] if isinstance(row["patch_at"], str) else ", ".join(row["patch_at"])
        lost = f"{row['mesh']}: its room is not installed" if row["mesh"] else "none: photographs only"
        shown = row["mesh"] if row["size_mm"] else lost
        cells.append((row["name"], row["class"], shown, size, f"{row['triangles']:,}", at))
    show_table(("object", "class", "mesh", "size, mm (x × y × z)", "triangles", "patch"), cells)
    if export is not None:
        say(f"wrote {len(rows)} GLB files to {export}")
    say("your own: 'toolkit add MESH --class NAME', then 'toolkit plan --object NAME'")


def demo(
    folder: Annotated[Path, typer.Argument(help="Workspace to make, or to resume.")] = Path("demo"),
    seed: options.Seed = 0,
    device: options.Device = "auto",
) -> None:
    """Run every step in a new workspace: plan, print, shoot 144 images, evaluate, report.

    The demo uses a ResNet-18 of ImageNet if its weights are on this machine or can be downloaded. Otherwise it uses the
    bundled classifier rig18, the patches for it, views from far away and grey paper as a control: 216 images.
    """
    from toolkit.captures.shoot import ShootSettings, shoot_plan
    from toolkit.cli.rig import what_pairs_can_show
    from toolkit.core.console import console
    from toolkit.evaluation.evaluate import evaluate_captures
    from toolkit.evaluation.tables import print_tables
    from toolkit.models.find import BUNDLED
    from toolkit.models.load import load_best
    from toolkit.printing.print_patches import print_all
    from toolkit.rig import PAIR, Pattern
    from toolkit.rig.plan import open_plan

    space = make_workspace(folder)
    # the best network on this machine decides views and patches
    classifier, why = load_best(device)
    is_bundled = classifier.name == BUNDLED
    space = space.with_patches(BUNDLED if is_bundled else None)
    say(f"network: {classifier.describe()}: {why}")
    say(f"1/4  plan: camera poses ({space.plan_file})")
    plan = open_plan(space, pattern=Pattern(fill=BUNDLED_FILL) if is_bundled else None)
    if is_bundled:
        say(f"     from far away: from close up {BUNDLED} recognises these objects without a patch")
    say(f"     {what_pairs_can_show(max(map(len, plan.objects.values())))}")
    say(f"2/4  print: the patches as PDF pages, 250 % scale ({space.print_dir})")
    print_all(space)
    say("3/4  shoot: every object at every pose, without and with its patch" + is_bundled * ", and with grey paper")
    # rig18 needs the control: a plain sheet may change a prediction
    variants = (*PAIR, BUNDLED_CONTROL) if is_bundled else PAIR
    shot = shoot_plan(space, plan, list(plan.objects), variants, ShootSettings(seed=seed))
    say(f"     {count_of(shot.shot, 'image')} shot, {shot.kept} kept from before ({shot.source_dir})")
    say(f"4/4  evaluate: predictions of {classifier.name} for each image")
    result = evaluate_captures(space.captures_dir, space, classifier)
    print_tables(console, result)
    say(f"report: {result.report_file}")


def list_models(
    model: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this network, listed or not; repeat for more.")
    ] = None,
    data: Annotated[
        str | None, typer.Option(metavar="FOLDER", help=f"Also measure the accuracy on these images. {options.DATA}")
    ] = None,
    check: Annotated[Path | None, typer.Option("--check-on", metavar="FOLDER", help=CHECK)] = None,
    classes: Annotated[
        str | None,
        typer.Option(metavar="WORD", help="Print only the class names with this word: ImageNet's and your own."),
    ] = None,
    speed: Annotated[
        bool, typer.Option("--speed", help="Also measure images per second, in evaluation and in training.")
    ] = False,
    device: options.Device = "auto",
    workspace: options.Workspace = None,
    as_json: options.Json = False,
) -> None:
    """List the networks with weights on this machine: classes, licence, whether they can train boosters."""
    # other questions than the list come first
    if check is not None:
        _check_detectors(model or [], check, device, open_workspace(workspace), as_json)
        return
    folder = open_workspace(workspace).classifiers_dir
    if classes is not None:
        _show_classes(classes, folder, as_json)
        return
    from toolkit.evaluation import survey

    # a plain list does not depend on the device, and is kept
    if model or data or speed or device == "cuda":
        rows = survey.survey_models(model or survey.list_models(folder), device, folder, data, speed)
    else:
        rows = survey.survey_local(folder)
    if as_json:
        show_json([asdict(row) for row in rows])
    else:
        _show_models(rows, data is not None, speed)
    if any(row.classes is None for row in rows):
        raise typer.Exit(1)


def _show_classes(word: str, folder: Path, as_json: bool) -> None:
    from toolkit.models.find import search_classes

    found = search_classes(word, folder)
    if as_json:
        show_json(found)
    elif not found:
        raise FieldError("no class name contains this text of three letters or more", {"classes": word})
    else:
        for name in found:
            say(name)


def _check_detectors(models: list[str], photos: Path, device: str, space: Workspace, as_json: bool) -> None:
    """Run each detector on the photographs, and print which preprocessing finds more."""
    from toolkit.evaluation.check_detector import check_detector
    from toolkit.evaluation.evaluate import name_run
    from toolkit.models.load_detector import load_detector

    if not models:
        raise FieldError("name the detectors to check with {model}, such as onnx:yolo11n.onnx", {"check": photos})
    # a picture for each detector
    done = []
    for model in models:
        detector = load_detector(model, None, device)
        # named after the run, so that two detectors never write the same picture
        done.append(check_detector(model, detector, photos, space.eval_dir / "check" / f"{name_run(detector, ())}.png"))
    if as_json:
        show_json([asdict(checked) for checked in done])
    else:
        for checked in done:
            say(checked.describe())
    if any(checked.better for checked in done):
        raise typer.Exit(1)


def _show_models(rows: "list[SurveyedModel]", with_data: bool, with_speed: bool) -> None:
    # columns that were asked for
    asked = [*["correct"] * with_data, *["per s"] * with_speed]
    cells = []
    for model in rows:
        low, high = model.ci95 or (0.0, 0.0)
        accuracy = f"{100 * (model.accuracy or 0):.1f} % ({100 * low:.0f}–{100 * high:.0f}) of {model.n}"
        per_s, trained = model.images_per_s, model.trained_images_per_s
        cells.append([
            model.model, model.kind, model.classes or "", model.image_px or "",
            *[accuracy if model.n else ""] * with_data, *[f"{per_s:.0f}" if per_s else ""] * with_speed,
            "no" if not model.can_train else f"{trained:.0f}/s" if trained else "yes", model.licence or "not said",
        ])  # fmt: skip
    show_table(("--model", "kind", "classes", "px", *asked, "trains", "licence"), cells)
    # why a network cannot be used, below the table
    for model in rows:
        if model.why_not:
            remark(f"{model.model}: {model.why_not}")
    say("others: torchvision's by name, timm:NAME, onnx:FILE, FILE.pt2, hf:ORG/NAME, python:MODULE:FUNCTION")
