"""Which patches a call of `toolkit print` means."""

from collections.abc import Sequence
from pathlib import Path

from toolkit.errors import ToolkitError, one_of
from toolkit.files import read_json
from toolkit.patches import PatchRecord
from toolkit.workspace import Workspace


def select_patches(
    workspace: Workspace, classes: Sequence[str] = (), everything: bool = False, files: Sequence[Path] = ()
) -> list[Path]:
    """PNG files of the patches that are named, each once, in the order they are named.

    Args:
        workspace: where patches are looked for; the package's own count too.
        classes: file names without suffix, or else the classes that patches were trained for (all patches of it).
        everything: take every known patch.
        files: PNG files anywhere, each with its record beside it.

    Raises:
        ToolkitError: nothing is named, a class has no patch, or there is no patch at all.
    """
    known = workspace.patches()
    if not (classes or everything or files):
        names = ", ".join(sorted(known)) or "none"
        raise ToolkitError(f"no patch named: give --class NAME, --all or --patch-file FILE (known: {names})")
    if (classes or everything) and not known:
        raise ToolkitError(f"no patches in {workspace.patches_dir}: make one with 'toolkit train-patch --class NAME'")
    chosen = [path for name in classes for path in _find_class(known, name)]
    chosen += [known[name] for name in sorted(known)] if everything else []
    for file in files:
        if not file.is_file():
            raise ToolkitError(f"--patch-file {file}: no such file: give a patch's PNG, its record beside it")
        chosen.append(file)
    return list(dict.fromkeys(chosen))


def _find_class(known: dict[str, Path], wanted: str) -> list[Path]:
    """A patch by its file's name, else every patch trained for that class, capitals ignored."""
    if wanted in known:
        return [known[wanted]]
    trained_for, broken = _read_classes(known)
    found = [known[name] for name, class_name in trained_for.items() if class_name.casefold() == wanted.casefold()]
    if not found:
        error = one_of("patch or class", wanted, sorted({*known, *trained_for.values()}))
        raise ToolkitError("; ".join([str(error), *broken]))
    return found


def _read_classes(known: dict[str, Path]) -> tuple[dict[str, str], list[str]]:
    """Class by patch name, and why the other records cannot be read."""
    classes, broken = {}, []
    for name, png_file in known.items():
        try:
            classes[name] = read_json(png_file.with_suffix(".json"), PatchRecord).class_name
        except ToolkitError as error:
            broken.append(str(error))
    return classes, broken
