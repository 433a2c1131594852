"""The table of renderers. Commands know the renderers in it alone; nothing heavy is loaded for it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

from toolkit.core.errors import ToolkitError, one_of
from toolkit.core.text import count_of
from toolkit.rig.graphics import APT, find_graphics, graphics_trouble

if TYPE_CHECKING:
    from toolkit.objects.mesh import Mesh
    from toolkit.rig.lighting import BakeDetail
    from toolkit.rig.renderer import Renderer
    from toolkit.rig.scene import Scene, Stand

GRAPHICS = find_graphics()
"""What Filament draws through, with the Open3D that is installed."""


@dataclass(frozen=True)
class RendererKind:
    """A renderer, as commands and pages know it."""

    # (mesh, scene, detail, stand) -> the renderer; its file is imported when it is called
    make: Callable[["Mesh", "Scene", "BakeDetail", "Stand"], "Renderer"]
    draws_worlds: bool = False  # it draws skies and surroundings as well as studios
    # raised when its pictures change, so that captures are shot again; None: that of the rig says it all
    version: int | None = None
    need: str | None = None  # what it needs of the machine, a word or two; None: nothing but the package
    working: str = ""  # what `toolkit doctor` says if it can start here; by default the library
    # returns its library with the version, and the line that makes it faster here; either may be empty
    describe: Callable[[], tuple[str, str]] = lambda: ("", "")
    cpu_s_per_megapixel: float | None = None  # CPU seconds of a picture; None: hardly any
    # returns why it cannot start here in a few words; None if it can
    find_trouble: Callable[[], str | None] = lambda: None
    fix: str = ""  # the command that brings it what it needs


def _make_raycast(mesh: "Mesh", scene: "Scene", detail: "BakeDetail", stand: "Stand") -> "Renderer":
    from toolkit.rig.lighting import FULL_DETAIL
    from toolkit.rig.raycast import RaycastRenderer

    # light of less detail is worked out in less time than it takes to keep
    return RaycastRenderer(mesh, scene, detail, stand, keep_light=detail == FULL_DETAIL)


def _make_filament(mesh: "Mesh", scene: "Scene", detail: "BakeDetail", stand: "Stand") -> "Renderer":
    from toolkit.rig.filament import FilamentRenderer

    return FilamentRenderer(mesh, scene, stand)


def _make_mitsuba(mesh: "Mesh", scene: "Scene", detail: "BakeDetail", stand: "Stand") -> "Renderer":
    from toolkit.rig.mitsuba import MitsubaRenderer

    return MitsubaRenderer(mesh, scene, stand)


def _find_mitsuba_trouble() -> str | None:
    from toolkit.rig.mitsuba import mitsuba_trouble

    return mitsuba_trouble()


def _describe_mitsuba() -> tuple[str, str]:
    from toolkit.rig.mitsuba import describe_mitsuba

    return describe_mitsuba()


RENDERERS: dict[str, RendererKind] = {
    "raycast": RendererKind(_make_raycast, draws_worlds=True),
    "filament": RendererKind(
        _make_filament, version=2, describe=lambda: (f"filament (open3d {version('open3d')})", ""), need=GRAPHICS.name,
        working=GRAPHICS.found, find_trouble=graphics_trouble, fix=f"{APT} {GRAPHICS.packages}",
    ),
    "mitsuba": RendererKind(
        _make_mitsuba, draws_worlds=True, version=2, describe=_describe_mitsuba, cpu_s_per_megapixel=20.0,
        need="Mitsuba", find_trouble=_find_mitsuba_trouble,
        fix='pip install ".[mitsuba]"',
    ),
}  # fmt: skip
RAYCAST = "raycast"
"""The default, in which boosters are trained."""
IN_WORLDS = tuple(name for name, kind in RENDERERS.items() if kind.draws_worlds)


def check_renderer(name: str) -> str:
    """Return the name of a renderer; raises a `ToolkitError` if there is none of that name."""
    if name not in RENDERERS:
        raise one_of("renderer", name, list(RENDERERS))
    return name


def check_starts(name: str) -> str:
    """Return the name of a renderer that starts on this machine.

    Raises:
        ToolkitError: there is none of that name, or it cannot start.
    """
    kind = RENDERERS[check_renderer(name)]
    if (trouble := kind.find_trouble()) is not None:
        raise ToolkitError(
            f"the renderer {name} cannot start: {trouble}: run '{kind.fix}', or use the renderer {RAYCAST}"
        )
    return name


def describe_cost(name: str, pixels: Sequence[int]) -> str:
    """What pictures of so many pixels each cost, in words; empty if a renderer takes hardly any time."""
    each = RENDERERS[check_renderer(name)].cpu_s_per_megapixel
    if each is None or not pixels:
        return ""
    library, faster = RENDERERS[name].describe()
    if not library:  # it does not start, which is told where it is made
        return ""
    minutes = max(1, round(each * sum(pixels) / 6e7))
    slow = f", and six times that before you run '{faster}'" if faster else ""
    return f"{count_of(len(pixels), 'image')} by {library}: about {count_of(minutes, 'minute')} of one core{slow}"


def check_world_renderer(name: str) -> str:
    """Return the name of a renderer that draws worlds.

    Raises:
        ToolkitError: there is none of that name, or it draws studios alone.
    """
    if not RENDERERS[check_renderer(name)].draws_worlds:
        raise ToolkitError(f"the renderer {name} draws studios alone: use {' or '.join(IN_WORLDS)} in a world")
    return name


def make_renderer(
    name: str, mesh: "Mesh", scene: "Scene", detail: "BakeDetail | None" = None, stand: "Stand | None" = None
) -> "Renderer":
    """Build a scene for rendering.

    Args:
        mesh: the object in its own frame, boosters attached.
        detail: how finely light is baked, full by default; of use to the ray caster alone.
        stand: where in the scene it stands, by default at the origin.

    Raises:
        ToolkitError: an unknown name, or a renderer that cannot start here or does not draw worlds.
    """
    from toolkit.rig.lighting import FULL_DETAIL
    from toolkit.rig.scene import AT_ORIGIN

    # a scene without a table is a world, which not every renderer draws
    kind = RENDERERS[check_starts(name if scene.table is not None else check_world_renderer(name))]
    return kind.make(mesh, scene, detail or FULL_DETAIL, stand or AT_ORIGIN)
