"""The part of `toolkit plan` that makes the shot list."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from toolkit.workspace import Workspace


ShotList = Annotated[
    bool, typer.Option("--shot-list", help="Also make print/shot_list.pdf, to photograph by, and rig/shots.json.")
]
ListPaper = Annotated[str, typer.Option("--paper", help="Of the shot list: a4, letter, or larger.")]
ListVariants = Annotated[
    list[str] | None,
    typer.Option("--variant", help="On the shot list; repeat for more. Default: unpatched and patched."),
]
ListOrder = Annotated[
    str,
    typer.Option(
        "--order",
        help="Of the shot list: aba (half of the unpatched shots before the patched ones, half after), blocks "
        "(one variant after the other) or alternate (all variants at each place).",
    ),
]


def make_list(
    space: "Workspace", objects: Sequence[str] | None, paper: str, variants: Sequence[str] | None, order: str,
    seed: int, quiet: bool, as_json: bool,
) -> None:  # fmt: skip
    """Write both files of the shot list and say what was made; without objects, those of the plan."""
    from toolkit.captures.shot_order import parse_order
    from toolkit.captures.variants import PAIR
    from toolkit.console import console, errors
    from toolkit.printing.paper import parse_paper
    from toolkit.printing.shot_list.job import write_shot_list
    from toolkit.rig.plan import open_plan

    sheet, chosen = parse_paper(paper), parse_order(order)
    made = open_plan(space, list(objects or []))
    names = list(dict.fromkeys(objects or made.objects))
    result = write_shot_list(space, made, names, sheet, variants or PAIR, seed, chosen, quiet or as_json)
    for name, reason in result.without_patch.items():
        errors.print(f"{name}: unpatched only: {reason}", style="yellow", markup=False, soft_wrap=True)
    if as_json:
        typer.echo(json.dumps(asdict(result), indent=2, ensure_ascii=False))
        return
    if result.replaced:
        console.print("note: rig/shots.json held other shots, or another order, before", soft_wrap=True)
    console.print(
        f"{result.shots} shots of {', '.join(result.objects)}; the camera moves {result.travel_m:.1f} m in all",
        markup=False,
        soft_wrap=True,
    )
    console.print(
        f"wrote {result.pdf_file} ({result.pages} pages) and {result.shots_file}; next: print it, shoot in its order, "
        "then toolkit import PHOTOS/",
        markup=False,
        soft_wrap=True,
    )
