"""Which patches a call of `toolkit print` means, each from its file to its PDF, and what there is to say of it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from toolkit.core.console import progress
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import read_json, write_bytes
from toolkit.core.workspace import Workspace
from toolkit.imaging.printer import PrintScores, score_print
from toolkit.objects.records import PatchRecord, read_patch
from toolkit.objects.spec import read_spec
from toolkit.printing.document import build_pdf
from toolkit.printing.layout import effective_percent
from toolkit.printing.settings import PrintSettings


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
        raise FieldError(f"no patch named: give {{classes}}, {{everything}} or {{files}} (known: {names})", {})
    if (classes or everything) and not known:
        raise ToolkitError(f"no patches in {workspace.patches_dir}: make one with 'toolkit train-patch --class NAME'")
    chosen = [path for name in classes for path in _find_class(known, name)]
    chosen += [known[name] for name in sorted(known)] if everything else []
    for file in files:
        if not file.is_file():
            raise FieldError("no such file: expected a patch's PNG, its record beside it", {"files": file})
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


@dataclass(frozen=True)
class PrintedPatch:
    """A PDF that was written.

    Attributes:
        file: the PDF.
        name, class_name, patch_sha256, n_px: of the patch.
        size_mm: side of the patch on paper.
        cut_mm: side of the sheet that is cut out, with its white margin.
        scale_percent: of the patch's size at `dpi`.
        paper, orientation: of every page.
        copies, pages: how many.
        tiles: rows and columns of pages that one copy takes, [1, 1] where it fits on a page.
        recorded_mm: the side that the patch's record states.
        colour_strip: whether the strip of known colours is beside the patch.
        total_variation, non_printability: see `toolkit.imaging.printer.PrintScores`.
    """

    file: str
    name: str
    class_name: str
    patch_sha256: str
    n_px: int
    size_mm: float
    cut_mm: float
    scale_percent: float
    dpi: float
    paper: str
    orientation: str
    copies: int
    pages: int
    tiles: tuple[int, int]
    recorded_mm: float
    colour_strip: bool
    total_variation: float
    non_printability: float

    def describe(self) -> str:
        """One line: what was made, how large, on how many pages."""
        pages = f"{self.pages} page{'s' if self.pages > 1 else ''} of {self.paper} {self.orientation}"
        copies = "" if self.copies == 1 else f", {self.copies} copies"
        rows, columns = self.tiles
        tiles = "" if rows * columns == 1 else f" (a map and {rows} × {columns} tiles a copy)"
        return f"{shorten(self.file)}: {self.size_mm:.1f} × {self.size_mm:.1f} mm{copies}, {pages}{tiles}"

    def describe_scores(self) -> str:
        """One line: how the patch will come out of the printer."""
        return PrintScores(self.total_variation, self.non_printability).describe(self.name)


def shorten(file: str) -> str:
    """Relative to the current folder where it is inside."""
    here = Path.cwd()
    path = Path(file).resolve()
    return str(path.relative_to(here)) if path.is_relative_to(here) else file


def print_patch(png_file: Path, pdf_file: Path, settings: PrintSettings | None = None) -> PrintedPatch:
    """Read a patch, lay it out true to size and write its PDF, whole or not at all.

    Args:
        png_file: the patch, its record beside it.
        pdf_file: the page or pages.
        settings: paper, scale and the rest, in millimetres; by default A4 at 250 % of 72 dpi.

    Raises:
        ToolkitError: the patch has no record or not its own, its size makes no sense, or the PDF cannot be written.
    """
    patch, settings = read_patch(png_file), settings or PrintSettings()
    document = build_pdf(patch, settings)
    write_bytes(pdf_file, document.content)
    record, plan = patch.record, document.plan
    return PrintedPatch(
        file=str(pdf_file),
        name=png_file.stem,
        class_name=record.class_name,
        patch_sha256=record.png_sha256,
        n_px=record.n_px,
        size_mm=round(plan.side_mm, 3),
        cut_mm=round(plan.cut_mm, 3),
        scale_percent=round(effective_percent(record.n_px, plan.side_mm, settings.dpi), 3),
        dpi=settings.dpi,
        paper=plan.frame.paper.name,
        orientation=plan.frame.paper.orientation,
        copies=settings.copies,
        pages=len(plan.pages),
        tiles=plan.tiles,
        recorded_mm=record.size_mm,
        colour_strip=plan.has_strip,
        **{key: round(score, 4) for key, score in asdict(score_print(patch.pixels)).items()},
    )


def print_patches(
    files: Sequence[Path], out: Path, settings: PrintSettings | None = None, go_on: bool = False
) -> tuple[list[PrintedPatch], list[dict[str, str]]]:
    """Print each patch, by default on A4 at 250 %.

    Args:
        files: PNG files, each with its record beside it.
        out: folder for the PDFs; for one patch it may be a PDF.
        settings: of every page.
        go_on: list a patch that cannot be printed and print the others, instead of ending with its error.

    Returns:
        What was printed, and `patch` and `reason` of each that could not be.

    Raises:
        ToolkitError: two patches would share a PDF, or a patch cannot be printed.
    """
    settings = settings or PrintSettings()
    printed: list[PrintedPatch] = []
    failed: list[dict[str, str]] = []
    targets = _name_targets(files, out)
    with progress("Printing", len(targets), quiet=len(targets) == 1) as ticker:
        for png_file, pdf_file in targets:
            try:
                printed.append(print_patch(png_file, pdf_file, settings))
            except ToolkitError as error:
                if not go_on or len(targets) == 1:
                    raise
                failed.append({"patch": str(png_file), "reason": str(error)})
            ticker.advance(note=pdf_file.name)
    return printed, failed


def _name_targets(files: Sequence[Path], out: Path) -> list[tuple[Path, Path]]:
    """(patch, PDF) pairs; two patches may not share a PDF."""
    if out.suffix.lower() == ".pdf":
        if len(files) > 1:
            raise FieldError(f"one file for {len(files)} patches: name a folder", {"out": out})
        return [(files[0], out)]
    targets = [(file, out / f"{file.stem}.pdf") for file in files]
    names = [pdf_file.name for _, pdf_file in targets]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise FieldError(
            f"two patches would be written to {out / twice[0]}: print them by calls with different {{out}}", {}
        )
    return targets


def print_all(workspace: Workspace, settings: PrintSettings | None = None) -> list[PrintedPatch]:
    """Print every known patch into the workspace's `print/`; by default on A4 at 250 %.

    Raises:
        ToolkitError: there is no patch, or one of them cannot be printed.
    """
    return print_patches(select_patches(workspace, everything=True), workspace.print_dir, settings)[0]


def compare_with_rig(workspace: Workspace, printed: PrintedPatch) -> str | None:
    """What to do where the rig mounts the patch at another size than was printed; None where both agree.

    Only the object that bears the patch's name is looked at; one whose spec is broken is said to be.
    """
    specs = workspace.object_specs()
    if printed.name not in specs:
        return None
    try:
        mounted_mm = read_spec(specs[printed.name]).patch.size_mm or printed.recorded_mm
    except ToolkitError as error:
        return f"not compared with the rig: {error}"
    if abs(mounted_mm - printed.size_mm) < 0.05:
        return None
    return (
        f"the rig mounts {printed.name} at {mounted_mm:.1f} mm: print with size_mm {mounted_mm:.1f}, or set "
        f"size_mm = {printed.size_mm:.1f} under [patch] in rig/objects/{printed.name}.toml"
    )
