"""Worlds by name: the built-in ones, or a user's file."""

from functools import lru_cache
from pathlib import Path
from pkgutil import resolve_name

from toolkit.core.console import notice
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.workspace import Workspace
from toolkit.objects.load import SUFFIXES
from toolkit.worlds.own import load_kit, load_mesh_world
from toolkit.worlds.world import World

WORLDS = {
    "city": "toolkit.content.city:build_city",
    "grass": "toolkit.content.countryside:build_grass",
    "apron": "toolkit.content.airfield:build_apron",
    "harbour": "toolkit.content.harbour:build_harbour",
}
"""Name -> the function that builds it from a seed, looked up when it is first asked for."""


@lru_cache(maxsize=2)
def build_world(name: str, seed: int = 0) -> World:
    """One of `WORLDS`; the last ones are kept.

    Raises:
        ToolkitError: there is no such world.
    """
    if name not in WORLDS:
        raise one_of("world", name, list(WORLDS))
    world: World = resolve_name(WORLDS[name])(seed)
    return world


def load_world(path: Path, scale: float = 1.0, seed: int = 0) -> World:
    """A user's own world: a mesh file, or a TOML that lays out the pieces of a kit.

    Args:
        path: GLB, glTF, OBJ, PLY, STL or OFF; or a TOML, see `toolkit.worlds.own`.
        scale: from the mesh's units to metres; a TOML states its own.
        seed: of the spots that are looked for.

    Raises:
        ToolkitError: the file cannot be used as a world; the message says why and what to do.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return load_mesh_world(path, scale, seed)
    if scale != 1.0:
        raise ToolkitError(f"{path}: a kit's scale stands in its file, found another one: correct 'scale' there")
    return load_kit(path, seed)


def list_own_worlds(space: Workspace) -> dict[str, Path]:
    """A workspace's own worlds by name: `rig/worlds/NAME.toml`, or a mesh; of two files with one name the TOML."""
    files = [file for suffix in (*SUFFIXES, ".toml") for file in sorted(space.worlds_dir.glob(f"*{suffix}"))]
    return {file.stem: file for file in files if file.is_file()}


def open_world(space: Workspace, world: str, seed: int = 0, scale: float = 1.0) -> World:
    """A world by its name, built in or the workspace's own, or by the path of a file.

    Args:
        space: whose worlds are known; its own win.
        world: name or path.
        seed: of a built-in world, or of the free spots of another.
        scale: from a mesh file's units to metres.

    Raises:
        ToolkitError: there is no such world, or its file cannot be used as one.
    """
    own = list_own_worlds(space)
    file = own.get(world) or Path(world)
    if world in own or file.suffix.lower() in (*SUFFIXES, ".toml"):
        return load_world(file if file.is_file() else space.root / file, scale, seed)
    if scale != 1.0:
        raise FieldError(f"the world {world} is in metres: a scale is for a mesh of your own", {"scale": scale})
    if world == "studio":
        raise ToolkitError("the studio is a table top, no world: see it with 'toolkit plan' and 'toolkit capture-sim'")
    if world not in WORLDS:
        raise one_of("world", world, [*WORLDS, *own])
    if world == "city":
        notice("building the city: some seconds")
    return build_world(world, seed)
