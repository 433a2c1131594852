"""What `toolkit capture-sim` does: the plan or the photographs of a folder, shot in the virtual rig, and corrupted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from toolkit.core.config import Config, Flag
from toolkit.core.errors import FieldError
from toolkit.core.text import count_of, kept_before, quote
from toolkit.core.workspace import Workspace
from toolkit.engine import EngineConfig
from toolkit.objects.spec import Margin
from toolkit.rig.renderers import RAYCAST, RENDERERS, check_starts

if TYPE_CHECKING:
    from toolkit.captures.corrupted_copy import CorruptedSource, Corruption
    from toolkit.captures.shoot import ShootResult, ShootSettings
    from toolkit.rig.plan import CapturePlan


class SimulateConfig(Config):
    """How captures are shot in the virtual rig."""

    backdrop: Annotated[str | None, Flag(metavar="NAME")] = Field(
        None, description="Table top: oak, walnut, white, concrete, linen, slate, birch. Default: by seed."
    )
    light: Annotated[str | None, Flag(metavar="studio|side|warm|dim|lamp|sky")] = Field(
        None, description="Of the rig. Default: studio, with {rehearse} side."
    )
    renderer: Annotated[str, Flag(metavar="|".join(RENDERERS))] = Field(RAYCAST, description="What draws the images.")
    also_renderers: Annotated[tuple[str, ...], Flag("--also-renderer", metavar="NAME|all")] = Field(
        (),
        description="Shoot the same images again with this renderer, into SOURCE-RENDERER, for 'toolkit eval' to "
        "compare; may be repeated. all: with every other one that starts here.",
    )
    board: Annotated[str | None, Flag(metavar="NAME")] = Field(
        None,
        description="Board under the object: printed (the one that was printed last), none, one of rig/boards, or a "
        "TOML file. Default: none; with {like} the one that the photographs show.",
    )
    rehearse: Annotated[bool, Flag("--rehearse")] = Field(
        False,
        description="Simulate print, tape, hand and phone: inks, shine, slightly wrong poses, blur, noise, wrong white "
        "balance, JPEG 90.",
    )
    print_profile: Annotated[Path | None, Flag(metavar="FILE")] = Field(
        None,
        description="Show sheets and pieces in the colours of your printer, as 'toolkit print-profile' measured it. "
        "Default: the file's colours; with {rehearse} a random printer's.",
    )
    perfect: Annotated[bool, Flag("--perfect")] = Field(
        False, description="Place the pieces of a wrap without the error of a hand."
    )
    margin: Annotated[Margin | None, Flag(metavar="white|bleed")] = Field(
        None,
        description="Show this paper around a patch: white, or bleed, which continues the print. Default: as the patch "
        "was trained.",
    )
    image_format: Annotated[str, Flag("--format", metavar="jpg|png")] = Field("jpg", description="Of the images.")
    source: Annotated[str | None, Flag(metavar="NAME")] = Field(
        None,
        description="Folder below captures/. Default: sim, or sim-PATCHES, sim-board, sim-rehearsed, sim-printed, "
        "sim-RENDERER, sim-like-NAME with these options.",
    )
    like: Annotated[Path | None, Flag(metavar="FOLDER")] = Field(
        None,
        description="Shoot again what these photographs show, from where each was taken, such as captures/real.",
    )
    max_px: Annotated[int | None, Field(ge=32), Flag()] = Field(
        None, description="Longer side of the images with {like}. Default: 1280."
    )
    keep: Annotated[bool, Flag("--keep")] = Field(
        False,
        description="Do not shoot other variants again if they were made with another spec, booster, scene or plan. "
        "Leave them out of results instead.",
    )


@dataclass(frozen=True)
class Simulated:
    """What was shot.

    Attributes:
        shot: the images.
        left_out: (path, reason) of photographs that could not be shot again; None where the plan was shot.
        corrupted: copies of the images.
        others: the same images by other renderers.
        remarks: on variants that were shot again or left out, as they no longer went with the others.
    """

    shot: "ShootResult"
    left_out: tuple[tuple[str, str], ...] | None
    corrupted: "tuple[CorruptedSource, ...]" = ()
    others: "tuple[ShootResult, ...]" = ()
    remarks: tuple[str, ...] = ()

    @property
    def skipped(self) -> list[tuple[str, str]]:
        """(what, reason) of all that could not be made."""
        corrupted = [(f"{copy.source_dir.name}/{path}", why) for copy in self.corrupted for path, why in copy.failed]
        failed = [reason for shot in (self.shot, *self.others) for reason in shot.failed]
        return [*(self.left_out or ()), *failed, *corrupted]

    @property
    def all_remarks(self) -> list[str]:
        """Lines on what was shot again, and on images that no longer count."""
        shot, wanted = self.shot, "this plan" if self.left_out is None else "these photographs"
        if not shot.stale:
            return list(self.remarks)
        count = "1 image is" if len(shot.stale) == 1 else f"{len(shot.stale)} images are"
        return [
            *self.remarks,
            f"{count} not of {wanted}: still in {shot.source_dir} (first: {shot.stale[0]}), left out of results",
        ]

    def as_json(self) -> dict[str, Any]:
        """All of it for a script."""
        shot = self.shot
        content: dict[str, Any] = {"folder": str(shot.source_dir), "shot": shot.shot, "kept": shot.kept}
        copies = [{"folder": str(copy.source_dir), "made": copy.made, "kept": copy.kept} for copy in self.corrupted]
        content |= {"corrupted": copies} if copies else {}
        others = [{"folder": str(one.source_dir), "shot": one.shot, "kept": one.kept} for one in self.others]
        content |= {"others": others} if others else {}
        return content if self.left_out is None else content | {"skipped": len(self.left_out)}

    def lines(self) -> Iterator[str]:
        """What was made, and what comes next."""
        count, shot = len(self.left_out or ()), self.shot
        left_out = f", {count_of(count, 'photograph')} left out" if count else ""
        yield f"shot {count_of(shot.shot, 'image')}{kept_before(shot.kept)}{left_out}: {shot.source_dir}"
        for other in self.others:
            yield f"shot {count_of(other.shot, 'image')}{kept_before(other.kept)}: {other.source_dir}"
        for copy in self.corrupted:
            yield f"corrupted {copy.made} of them{kept_before(copy.kept)}: {copy.source_dir}"
        yield f"next: toolkit eval {quote(shot.source_dir.parent)}"


def simulate_captures(
    space: Workspace, config: SimulateConfig, objects: Sequence[str] = (), variants: Sequence[str] = (),
    corrupt: Sequence[str] = (), *, seed: int = 0, engine: EngineConfig | None = None,
) -> Simulated:  # fmt: skip
    """Shoot what is not there yet, and corrupt it.

    Args:
        space: whose objects and patches are meant, and whose `captures/` is written to.
        config: how.
        objects, variants: only these; by default all of the plan or the photographs, with and without their patch.
        corrupt: corruptions such as `fog:3`, each of which makes a copy of the images.
        seed: of all draws.
        engine: where images are shot; by default in this process.

    Raises:
        ToolkitError: as `shoot_plan` and `shoot_like`, or settings that do not go together.
    """
    # here, as help needs the config above alone; and without corruptions torch need not be loaded
    from toolkit.captures.like import MAX_PX, board_shown, shoot_like
    from toolkit.rig import PAIR

    corruptions: Sequence[Corruption] = ()
    if corrupt:
        from toolkit.corruptions.catalogue import parse_corruptions

        corruptions = parse_corruptions(list(corrupt))
    # a path from the current folder, or from the workspace
    folder = config.like and (config.like if config.like.is_dir() else space.root / config.like)
    if folder and config.also_renderers:
        raise FieldError("goes with the plan: leave {like} out", {"also_renderers": config.also_renderers[0]})
    # the board that the photographs show is in the renders too, unless a choice was made
    board = board_shown(folder) if folder and config.board is None else config.board
    settings = _make_settings(space, config, board, seed)
    from toolkit.rig.applied.tag import name_variant  # brings the renderer's parts, as above

    variants, engine = [name_variant(variant) for variant in variants], engine or EngineConfig()
    if folder:
        found = shoot_like(
            space, folder, settings, config.source, objects, variants, max_px=config.max_px or MAX_PX, engine=engine
        )
        made = Simulated(found.shoot, found.skipped)
    else:
        made = _shoot_plan(space, config, settings, objects, variants or PAIR, engine)
    if not corruptions:
        return made
    from toolkit.captures.corrupted_copy import corrupt_source

    copies = [copy for shot in (made.shot, *made.others) for copy in corrupt_source(shot.source_dir, corruptions)]
    return replace(made, corrupted=tuple(copies))


def _make_settings(space: Workspace, config: SimulateConfig, board: str | None, seed: int) -> "ShootSettings":
    from toolkit.captures.shoot import ShootSettings, make_rehearsal, read_printer
    from toolkit.rig.board_file import read_board, with_board

    return ShootSettings(
        seed, config.backdrop, config.light or ("side" if config.rehearse else "studio"), config.renderer,
        config.image_format, rehearsal=make_rehearsal(config.print_profile) if config.rehearse else None,
        perfect=config.perfect, margin=config.margin,
        printer=None if config.rehearse or config.print_profile is None else read_printer(config.print_profile),
        board=None if board in (None, "none") else read_board(with_board(space, board)),
    )  # fmt: skip


def _choose_others(config: SimulateConfig) -> tuple[list[str], list[str]]:
    """The other renderers that shoot the same images, and a line for each that cannot start here.

    Raises:
        ToolkitError: an unknown renderer, or one that was named and cannot start.
    """
    wanted = [check_starts(name) for name in config.also_renderers if name != "all"]
    troubles: dict[str, str | None] = {}
    if "all" in config.also_renderers:
        troubles = {name: RENDERERS[name].find_trouble() for name in RENDERERS if name != config.renderer}
        wanted += [name for name, trouble in troubles.items() if trouble is None]
    lines = [f"not shot by {name}: {why}; '{RENDERERS[name].fix}' brings it" for name, why in troubles.items() if why]
    return [name for name in dict.fromkeys(wanted) if name != config.renderer], lines


def _shoot_plan(
    space: Workspace, config: SimulateConfig, settings: "ShootSettings", objects: Sequence[str],
    variants: Sequence[str], engine: EngineConfig,
) -> Simulated:  # fmt: skip
    from toolkit.captures.manifest import MANIFEST
    from toolkit.rig.plan import list_misfits, open_plan
    from toolkit.rig.variants import ON_PAPER

    if config.max_px is not None:
        raise FieldError(
            "goes with {like}: the size of the plan's images is set by 'toolkit plan --resolution'",
            {"max_px": config.max_px},
        )
    # all of the plan, if no object is named
    plan = open_plan(space, list(objects) or None)
    # also where no photograph lies there yet
    if config.source == "real":
        raise FieldError("captures/real is for photographs: name another folder, such as sim-2", {"source": "real"})
    names = list(objects) or list(plan.objects)
    # where images lie already there may be none left to shoot, and the compiler takes its time to load
    if config.renderer == RAYCAST and not any(space.captures_dir.glob(f"*/{MANIFEST}")):
        from toolkit.rig.raycast import begin_compiling

        begin_compiling()
    if set(variants) & set(ON_PAPER):
        from toolkit.core.console import errors

        for line in list_misfits(space, names, plan):
            errors.print(f"note: {line}", markup=False, soft_wrap=True)
    # a folder for each kind of shot: an evaluation then takes them for sources of their own
    words = [
        "sim",
        space.patch_set,
        "board" if config.board not in (None, "none") else None,
        "rehearsed" if config.rehearse else None,
        None if settings.printer is None else "printed",
    ]
    others, remarks = _choose_others(config)
    found = []
    for renderer in (config.renderer, *others):
        if config.source:
            # under a name that was asked for, the others alone have the renderer's name behind it
            parts = [config.source, renderer if renderer != config.renderer else None]
        else:
            parts = [*words, renderer if renderer != RAYCAST else None]
        source = "-".join(filter(None, parts))
        shot, more = _shoot_source(
            space, plan, names, variants, replace(settings, renderer=renderer), source, config.keep, engine
        )
        found.append(shot)
        remarks += more
    return Simulated(found[0], None, others=tuple(found[1:]), remarks=tuple(remarks))


def _shoot_source(
    space: Workspace, plan: "CapturePlan", names: Sequence[str], variants: Sequence[str], settings: "ShootSettings",
    source: str, keep: bool, engine: EngineConfig,
) -> "tuple[ShootResult, list[str]]":  # fmt: skip
    from toolkit.captures.shoot import leave_out, shoot_plan
    from toolkit.captures.stale import find_stale

    source_dir = space.source_dir(source)
    # looked for before anything is shot, as shooting changes the manifest
    stale = find_stale(space, plan, names, variants, settings, source_dir)
    remarks = []
    with engine.open() as workers:
        shot = shoot_plan(space, plan, names, variants, settings, source, engine=workers)
        for outdated in stale:
            # what is stale is shot again, or left out where old images shall be kept
            is_shot = outdated.can_shoot and not keep
            if is_shot:
                more = shoot_plan(space, plan, [outdated.object], [outdated.variant], settings, source, engine=workers)
                shot = shot.joined(more)
            else:
                leave_out(
                    source_dir, dict.fromkeys(outdated.paths, f"{outdated.reason} than the images that were shot since")
                )
            done = "shot again too" if is_shot else "left out of results"
            if outdated.paths:
                remarks.append(
                    f"{outdated.object}/{outdated.variant}: {done}, {outdated.reason} when it was shot before"
                )
    return shot, remarks
