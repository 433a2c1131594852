"""Files that a mesh or its material library names, found in the mesh's folder, whatever system wrote the path."""

import unicodedata
from pathlib import Path

from toolkit.core.errors import ToolkitError
from toolkit.core.files import inside

MOST_TAILS = 8
"""So many last parts of a path are looked for; folders beside meshes are not nested deeper."""


def find_named(root: Path, name: str, beside: Path | None = None) -> Path | None:
    r"""Find the file in `root` or below that a mesh means by `name`, if any.

    The path is tried as written, then with `\` as `/`, then without its first parts, as exporters write absolute paths
    of another machine. Letter case is ignored if only a single file then matches.

    Args:
        root: the mesh's folder; nothing outside it is found.
        name: name in the file.
        beside: a folder below `root` that is searched first: the material library's.

    Raises:
        ToolkitError: the path leaves `root`, and no file in `root` has its last part as its name.
    """
    slashed = name.replace("\\", "/")
    # paths of another machine are tried from their end: fewer and fewer folders
    parts = [part for part in slashed.split("/") if part not in ("", ".", "..")]
    tails = ("/".join(parts[start:]) for start in range(max(0, len(parts) - MOST_TAILS), len(parts)))
    forms = dict.fromkeys((name, slashed, *tails))
    places = [(folder, form) for folder in dict.fromkeys((beside or root, root)) for form in forms if form]
    left: ToolkitError | None = None
    # as it is written, in each place
    for folder, form in places:
        try:
            real = inside(root, str((folder / form).relative_to(root)) if not Path(form).is_absolute() else form)
        except ToolkitError as error:
            left = left or error
            continue
        if real.is_file():
            return real if ".." in form else folder / form  # a linked file keeps its place
    # then regardless of case, if a single file matches
    for folder, form in places:
        found = _match_case(folder, form)
        if len(found) == 1 and inside(root, str(found[0].relative_to(root))).is_file():
            return found[0]
    if left is not None:
        raise left
    return None


def _match_case(folder: Path, name: str) -> list[Path]:
    """Find files below `folder` whose path is `name` but for letter case and the encoding of accents."""
    found = [folder]
    for part in Path(name).parts:
        if part in ("/", ".."):
            return []
        folders = [folder for folder in found if folder.is_dir()]
        found = [path for folder in folders for path in folder.iterdir() if _plain(path.name) == _plain(part)]
    return [path for path in found if path.is_file()]


def _plain(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
