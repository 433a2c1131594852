"""One patch from its file to its PDF, and what there is to say of it."""

from dataclasses import asdict, dataclass
from pathlib import Path

from toolkit.errors import ToolkitError
from toolkit.files import write_bytes
from toolkit.objects.spec import read_spec
from toolkit.patches import read_patch
from toolkit.print_scores import PrintScores, score_print
from toolkit.printing.document import build_pdf
from toolkit.printing.select import select_patches
from toolkit.printing.settings import PrintSettings, effective_percent
from toolkit.workspace import Workspace


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
        total_variation, non_printability: see `toolkit.print_scores.PrintScores`.
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


def print_patch(png_file: Path, pdf_file: Path, settings: PrintSettings) -> PrintedPatch:
    """Read a patch, lay it out and write its PDF, whole or not at all.

    Raises:
        ToolkitError: the patch has no record or not its own, its size makes no sense, or the PDF cannot be written.
    """
    patch = read_patch(png_file)
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


def print_all(workspace: Workspace, settings: PrintSettings | None = None) -> list[PrintedPatch]:
    """Print every known patch into the workspace's `print/`; by default on A4 at 250 %.

    Raises:
        ToolkitError: there is no patch, or one of them cannot be printed.
    """
    files = select_patches(workspace, everything=True)
    chosen = settings or PrintSettings()
    return [print_patch(file, workspace.print_dir / f"{file.stem}.pdf", chosen) for file in files]


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
        f"the rig mounts {printed.name} at {mounted_mm:.1f} mm: print with --size-mm {mounted_mm:.1f}, or set "
        f"size_mm = {printed.size_mm:.1f} under [patch] in rig/objects/{printed.name}.toml"
    )
