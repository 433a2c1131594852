"""`toolkit plan --shot-list`: from a workspace to `print/shot_list.pdf` and `rig/shots.json`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from toolkit.core.console import progress
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import write_bytes
from toolkit.core.workspace import Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.printing.page import Paper, parse_paper
from toolkit.printing.shot_list.document import build_shot_list
from toolkit.printing.shot_list.session import prepare_session
from toolkit.printing.wearers import is_same_size, read_page, say_sizes
from toolkit.rig.board import read_board
from toolkit.rig.plan import CapturePlan, check_poses
from toolkit.rig.requests import Order, ShotListConfig
from toolkit.rig.shot_order import (
    ShotList,
    ShotStep,
    hash_poses,
    list_shots,
    measure_travel_mm,
    order_shots,
    read_shots,
    write_shots,
)
from toolkit.rig.variants import VARIANTS, Paint, Print, find_booster

NARROWEST_MM, LOWEST_MM = 180.0, 250.0


@dataclass(frozen=True)
class WrittenShotList:
    """What was made.

    Attributes:
        pdf_file, shots_file: the pages to take along, and the order for `toolkit import` and `toolkit studio`.
        pages, shots: how many.
        objects: in the order of shooting.
        travel_m: how far the camera moves, in metres.
        without_patch: objects with nothing to stick on, and why.
        replaced: there was a list of other shots, or in another order, before.
        notes: pages that are of another size or another patch than the object's spec asks for.
    """

    pdf_file: str
    shots_file: str
    pages: int
    shots: int
    objects: list[str]
    travel_m: float
    without_patch: dict[str, str]
    replaced: bool
    notes: tuple[str, ...] = ()


def write_shot_list(
    workspace: Workspace, plan: CapturePlan, objects: Sequence[str], config: ShotListConfig, seed: int = 0
) -> WrittenShotList:
    """Order the shots of some objects, draw them, and write both files, the PDF first.

    Args:
        workspace: whose objects and patches are meant.
        plan: camera and poses.
        objects: in the order of shooting.
        config: variants, order and paper, which is taken upright; variants that need a patch are left out of an object
            that has none.
        seed: of the order.

    Raises:
        ToolkitError: an object or variant is unknown, a patch's files do not match, a pose cannot be shot, nothing is
            left to shoot, or the paper is too small.
    """
    for variant in config.variants:
        if variant not in VARIANTS:
            raise one_of("variant", variant, list(VARIANTS))
    paper, order = parse_paper(config.paper), config.order
    _check_paper(paper)
    items: dict[str, TableObject] = {}
    with progress("reading the objects", len(set(objects))) as bar:
        for name in dict.fromkeys(objects):
            items[name] = load_object(workspace.object_spec(name))
            bar.advance(note=name)
    boosters: dict[str, dict[str, Print | Paint | None]] = {}
    missing: dict[str, str] = {}
    for name, item in items.items():
        boosters[name] = _find_boosters(workspace, item, config.variants, missing)
    steps = order_shots(plan, list(items), {name: tuple(boosters[name]) for name in items}, seed, order)
    for name, item in items.items():
        check_poses(item, plan.camera, plan.objects[name])
    content, pages = _draw(
        workspace, plan, items, boosters, steps, missing=missing, paper=paper, seed=seed, order=order
    )
    pdf_file = write_bytes(workspace.print_dir / "shot_list.pdf", content)
    shots_file = workspace.root / "rig" / "shots.json"
    shots = list_shots(plan, steps, seed, order)
    replaced = _is_other(shots_file, shots)
    write_shots(shots_file, shots)
    travel_m = round(measure_travel_mm(plan, steps) / 1000, 2)
    return WrittenShotList(
        str(pdf_file),
        str(shots_file),
        pages,
        len(steps),
        list(items),
        travel_m=travel_m,
        without_patch=missing,
        replaced=replaced,
        notes=tuple(note for name in items if (note := _find_page(workspace, name, boosters[name])[1])),
    )


def _draw(
    workspace: Workspace, plan: CapturePlan, items: dict[str, TableObject],
    boosters: dict[str, dict[str, Print | Paint | None]], steps: list[ShotStep], missing: dict[str, str], paper: Paper,
    seed: int, order: Order,
) -> tuple[bytes, int]:  # fmt: skip
    """The PDF and its number of pages."""
    board, sessions = read_board(workspace), []
    with progress("drawing the shot list", len(steps) + 2 * len(items)) as bar:
        for name, item in items.items():
            own = [step for step in steps if step.object == name]
            sessions.append(
                prepare_session(
                    item,
                    plan.camera,
                    plan.objects[name],
                    own,
                    boosters[name],
                    poses_sha256=hash_poses(plan, name),
                    bar=bar,
                    board=board,
                    patch_pdf=_find_page(workspace, name, boosters[name])[0],
                    note=missing.get(name),
                )
            )
        content, pages = build_shot_list(sessions, paper, seed, order, bar)
    return content, pages


def _find_boosters(
    workspace: Workspace, item: TableObject, variants: Sequence[str], missing: dict[str, str]
) -> dict[str, Print | Paint | None]:
    """What is stuck on in each variant; an object without a patch is left with `unpatched`, and `missing` says why."""
    found: dict[str, Print | Paint | None] = {}
    for variant in dict.fromkeys(variants):
        try:
            found[variant] = find_booster(workspace, item, variant)
        except ToolkitError as error:
            # a patch that is there and broken must be put right, not left out
            if item.name in workspace.patches() or "unpatched" not in variants:
                raise
            missing[item.name] = str(error)
    return found


def _find_page(
    workspace: Workspace, name: str, boosters: dict[str, Print | Paint | None]
) -> tuple[str | None, str | None]:
    """The page of an object's patch, relative to the workspace; else what is wrong with the one that is there."""
    patch = boosters.get("patched")
    wrong: str | None = None
    if not isinstance(patch, Print):
        return None, None
    for file in (workspace.print_dir / f"{name}.pdf", workspace.print_dir / f"{patch.name}.pdf"):
        stated, shown = read_page(file), str(file.relative_to(workspace.root))
        if stated is None:
            continue
        sizes_mm, sha256 = stated
        if sha256 == patch.sha256 and is_same_size(sizes_mm, patch.sizes_mm):
            return shown, None
        what = say_sizes(sizes_mm) if sha256 == patch.sha256 else "of another patch"
        wrong = wrong or (
            f"{shown} is {what}, the rig mounts {patch.name} on {name} at {say_sizes(patch.sizes_mm)}: print it anew "
            f"with 'toolkit print --object {name}'"
        )
    return None, wrong


def _check_paper(paper: Paper) -> None:
    upright = paper.turn("portrait")
    if upright.width_mm < NARROWEST_MM or upright.height_mm < LOWEST_MM:
        raise FieldError(
            f"expected at least {NARROWEST_MM:.0f} × {LOWEST_MM:.0f} mm for a shot list: choose a4 or letter",
            {"paper": paper.name},
        )


def _is_other(file: Path, shots: ShotList) -> bool:
    """Whether another list lies there; one that is broken counts as another."""
    try:
        return file.is_file() and read_shots(file).steps != shots.steps
    except ToolkitError:
        return True
