"""Workspace: the folder that a user works in, and the package's own data behind it."""

from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copytree
from typing import Literal

from toolkit.core.config import FileRecord
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import make_folder, read_toml, real_path, write_text
from toolkit.core.places import MARKER, is_workspace
from toolkit.core.text import is_file_name, is_folder_name

PACKAGE_DATA = Path(__file__).parents[1] / "data"
WRAP_RECORD = "wrap.json"


@dataclass(frozen=True)
class Workspace:
    """A folder with `rig/`, `print/`, `captures/` and `eval/`; missing files come from the package's data.

    Attributes:
        root: the folder.
        patch_set: sub-folder of `print/patches` to work with, such as `rig18`; None for `print/patches` itself.
        board: file of the board in the photographs; None for the board that was printed last.
    """

    root: Path
    patch_set: str | None = None
    board: Path | None = None

    @property
    def plan_file(self) -> Path:
        """File of the capture plan."""
        return self.root / "rig" / "plan.json"

    @property
    def objects_dir(self) -> Path:
        """Specs of the user's own objects."""
        return self.root / "rig" / "objects"

    @property
    def classifiers_dir(self) -> Path:
        """The user's own classifiers, and their records."""
        return self.root / "rig" / "classifiers"

    @property
    def worlds_dir(self) -> Path:
        """The user's own worlds, and the previews of all."""
        return self.root / "rig" / "worlds"

    @property
    def print_dir(self) -> Path:
        """Printed pages; a patch set has its own folder."""
        return self.root / "print" / (self.patch_set or "")

    @property
    def patches_dir(self) -> Path:
        """Trained patches and their records."""
        return self.root / "print" / "patches" / (self.patch_set or "")

    @property
    def textures_dir(self) -> Path:
        """Trained textures, their records, and objects with them."""
        return self.root / "rig" / "textures"

    @property
    def wraps_dir(self) -> Path:
        """Plans of flat pieces for objects, a folder each."""
        return self.root / "print" / "wraps"

    @property
    def captures_dir(self) -> Path:
        """Images, by source."""
        return self.root / "captures"

    def source_dir(self, source: str) -> Path:
        """Return `captures/SOURCE`; a `FieldError` if no folder can have this name."""
        if not is_folder_name(source):
            raise FieldError(f"{{source}} '{source}': expected the name of one folder below captures/", {})
        return self.captures_dir / source

    @property
    def eval_dir(self) -> Path:
        """Results, by run."""
        return self.root / "eval"

    def object_specs(self) -> dict[str, Path]:
        """Return the spec file of every object by name; a file of the workspace replaces the package's."""
        return _named_files("objects", "*.toml", self.objects_dir)

    def patches(self) -> dict[str, Path]:
        """Return the PNG of every patch by name; a file of the workspace replaces the package's."""
        return _named_files(Path("patches", self.patch_set or ""), "*.png", self.patches_dir)

    def textures(self) -> dict[str, Path]:
        """Return the PNG of every texture by name; a file of the workspace replaces the package's."""
        found = _named_files("textures", "*.png", self.textures_dir)
        return {name: file for name, file in found.items() if is_file_name(name)}  # others mask their paint

    def wraps(self) -> dict[str, Path]:
        """Return the folder of every wrap by name; a folder of the workspace replaces the package's."""
        places = (PACKAGE_DATA / "wraps", self.wraps_dir)
        found = [file.parent for place in places for file in sorted(place.glob(f"*/{WRAP_RECORD}"))]
        return {folder.name: folder for folder in found if is_file_name(folder.name)}

    def with_patches(self, patch_set: str | None) -> "Workspace":
        """Return the workspace with the patches in a sub-folder of `print/patches`, or with None in the folder itself.

        Raises:
            ToolkitError: no such sub-folder holds a patch, here or in the package's data.
        """
        if patch_set is None:
            return replace(self, patch_set=None)
        known = self.patch_sets()
        if patch_set in known:
            return replace(self, patch_set=patch_set)
        if known:
            raise one_of("set of patches", patch_set, known)
        raise ToolkitError(
            f"no set of patches called '{patch_set}' in {self.root / 'print' / 'patches'}: "
            "make a set with 'toolkit train-patch --model MODEL --out print/patches/NAME'"
        )

    def patch_sets(self) -> list[str]:
        """Return the names of the sub-folders of `print/patches` with patches, also the package's own."""
        places = (PACKAGE_DATA / "patches", self.root / "print" / "patches")
        found = {file.parent.name for place in places for file in place.glob("*/*.png")}
        return sorted(name for name in found if is_file_name(name) and name != "previews")

    def object_spec(self, name: str) -> Path:
        """Return the spec of an object; an unknown name is a `ToolkitError`."""
        return _find_named("object", name, self.object_specs())

    def patch(self, name: str) -> Path:
        """Return the PNG of a patch; an unknown name is a `ToolkitError`."""
        return _find_named("patch", name, self.patches())

    def texture(self, name: str) -> Path:
        """Return the PNG of a texture; an unknown name is a `ToolkitError`."""
        return _find_named("texture", name, self.textures())

    def wrap(self, name: str) -> Path:
        """Return the folder of a wrap; an unknown name is a `ToolkitError`."""
        known = self.wraps()
        if not known:
            raise ToolkitError(f"no wrap called '{name}': there is none yet: run 'toolkit wrap --object NAME'")
        return _find_named("wrap", name, known)


def _find_named(kind: str, name: str, known: dict[str, Path]) -> Path:
    if name not in known:
        raise one_of(kind, name, sorted(known))
    return known[name]


def _named_files(kind: str | Path, pattern: str, own: Path) -> dict[str, Path]:
    found = {path.stem: path for path in sorted((PACKAGE_DATA / kind).glob(pattern))}
    return found | {path.stem: path for path in sorted(own.glob(pattern))}


class WorkspaceFile(FileRecord):
    """`toolkit.toml`, which marks a folder as a workspace."""

    schema_version: Literal[1]


MARKER_TEXT = """\
# This file marks the folder as a workspace: 'toolkit' commands that run here or below read and write
# rig/, print/, captures/ and eval/ beside it.
schema_version = 1
"""


def open_workspace(folder: Path | str | None = None, *, is_needed: bool = False) -> Workspace:
    """Return the workspace of a command: `folder`, else the nearest from the current folder upwards.

    Without a workspace, the current folder: built-in objects, plan and patches need none.

    Args:
        folder: the workspace.
        is_needed: whether the command writes into `rig/`, `print/` or `captures/`, which only a workspace may have.

    Raises:
        ToolkitError: `folder` is no workspace (see `is_workspace`), there is none and it `is_needed`, or its
            `toolkit.toml` has a wrong field.
    """
    if folder is not None:
        root = real_path(Path(folder))
        if not is_workspace(root):
            raise ToolkitError(
                f"{folder} is not a workspace (it has no {MARKER}): make one with 'toolkit init {folder}'"
            )
    else:
        here = Path.cwd()
        # upwards, as git looks for its own folder
        found = next((up for up in (here, *here.parents) if is_workspace(up)), None)
        if found is None and is_needed:
            raise ToolkitError(
                "this folder is not in a workspace: change into one, or name one with --workspace; "
                "'toolkit init FOLDER' makes one"
            )
        root = found or here
    # read for its errors alone: it holds nothing but its version
    if (root / MARKER).is_file():
        read_toml(root / MARKER, WorkspaceFile)
    return Workspace(root)


SPEC_GUIDE = """\
# One file per object of your own: NAME.toml, with the mesh beside it (glb, gltf, obj + mtl, ply, stl, off).
# 'toolkit add MESH --class NAME' writes both; or copy this file to NAME.toml, and run: toolkit plan --object NAME
#
# class = "coffee mug"        # an ImageNet category, an index, or a label of your own classifier
# mesh = "mug.glb"
# length_mm = 120             # longest side
# world_length_m = 0.12       # of what it is a model of, for worlds outdoors; may be left out
# up = "y"                    # the mesh's axis that points up; glTF: y, without being told; OBJ files mostly have y
# front = "z"                 # and the one that points to the front; glTF: z
#
# [patch]
# at = "top"                  # top, front, back, left or right
# size_mm = 40                # side of the printed patch; default: the size in the patch's record
# offset_mm = [0, 0]          # from the middle of that side: right and up; for the top, forward and left
# rotation_deg = 0
"""


def make_workspace(folder: Path | str) -> Workspace:
    """Make the folders of a workspace, `toolkit.toml` and a guide to object specs; existing files stay as they are.

    Raises:
        ToolkitError: `folder` is a file, or cannot be written; a folder in it is a link; its `toolkit.toml` has a
            wrong field.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ToolkitError(f"{folder} is a file: name a folder to make a workspace of")
    space = Workspace(real_path(folder))
    for path in (space.objects_dir, space.textures_dir, space.patches_dir, space.captures_dir, space.eval_dir):
        make_folder(path)
    for file, text in ((space.objects_dir / "README.txt", SPEC_GUIDE), (space.root / MARKER, MARKER_TEXT)):
        if not file.exists():
            write_text(file, text)
    # opened, so that a broken file is told at once
    return open_workspace(space.root)


def copy_objects(workspace: Workspace, folder: Path) -> Workspace:
    """Make a workspace with only the objects of another; raises as `make_workspace`."""

    def list_linked(parent: str, names: list[str]) -> list[str]:
        # linked folders may lead out of the workspace, or in a circle
        return [name for name in names if (path := Path(parent, name)).is_symlink() and path.is_dir()]

    space = make_workspace(folder)
    if workspace.objects_dir.is_dir():
        copytree(workspace.objects_dir, space.objects_dir, ignore=list_linked, dirs_exist_ok=True)
    return space
