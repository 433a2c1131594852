"""Choose the patches that `toolkit print` prints, write their PDFs and describe them."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from toolkit.core.console import progress
from toolkit.core.errors import FieldError, ToolkitError, one_of
from toolkit.core.files import read_json, real_path, write_bytes
from toolkit.core.text import count_of
from toolkit.core.workspace import Workspace
from toolkit.imaging.printer import PrintScores, score_print
from toolkit.objects.find_patch import find_patch_file
from toolkit.objects.load import load_object
from toolkit.objects.records import PatchRecord, read_patch
from toolkit.objects.spec import BASE_DPI, Margin, ObjectSpec, Side, read_spec
from toolkit.printing import PrintSettings
from toolkit.printing.document import Wearer, build_pdf, effective_percent, is_same_size, say_sizes
from toolkit.rig.fit import describe_misfits


def select_patches(
    workspace: Workspace, classes: Sequence[str] = (), everything: bool = False, files: Sequence[Path] = ()
) -> list[Path]:
    """List the PNG files of the named patches, each once, in the order of their names.

    Args:
        workspace: searched for patches, with those of the package.
        classes: file names without suffix, or else the classes that patches were trained for (all patches of it).
        everything: take every known patch.
        files: PNG files anywhere, each with its record beside it.

    Raises:
        ToolkitError: nothing is named, a class has no patch, or there is no patch at all.
    """
    # the package's own patches are among the known
    known = workspace.patches()
    if not (classes or everything or files):
        names = ", ".join(sorted(known)) or "none"
        raise FieldError(
            f"no patch named: give {{objects}}, {{classes}}, {{everything}} or {{files}} (known: {names})", {}
        )
    # files may still be printed in a workspace without patches
    if (classes or everything) and not known:
        raise ToolkitError(f"no patches in {workspace.patches_dir}: make one with 'toolkit train-patch --class NAME'")
    # a class may have several patches; a patch that is named twice is printed once
    chosen = [path for name in classes for path in _find_class(known, name)]
    chosen += [known[name] for name in sorted(known)] if everything else []
    for file in files:
        if not file.is_file():
            raise FieldError("no such file: expected a patch's PNG, its record beside it", {"files": file})
        chosen.append(file)
    return list(dict.fromkeys(chosen))


def _find_class(known: dict[str, Path], wanted: str) -> list[Path]:
    """Find a patch by its file's name, else every patch trained for that class, in any case."""
    # a broken record must not hide the patches that can be read
    if wanted in known:
        return [known[wanted]]
    trained_for, broken = {}, []
    for name, png_file in known.items():
        try:
            trained_for[name] = read_json(png_file.with_suffix(".json"), PatchRecord).class_name
        except ToolkitError as error:
            broken.append(str(error))
    found = [known[name] for name, class_name in trained_for.items() if class_name.casefold() == wanted.casefold()]
    # the message also says which records could not be read, since any of them may be meant
    if not found:
        unknown = one_of("patch or class", wanted, sorted({*known, *trained_for.values()}))
        raise ToolkitError("; ".join([str(unknown), *broken]))
    return found


def find_wearers(workspace: Workspace, png_file: Path) -> tuple[list[Wearer], list[str]]:
    """Return the objects that wear a patch, its namesake first, then your own; and why specs could not be read."""
    specs, broken = workspace.object_specs(), []
    wearers: list[Wearer] = []
    # a patch bears the name of the object that it was trained for
    for name in sorted(specs, key=lambda name: (name != png_file.stem, specs[name].parent != workspace.objects_dir)):
        try:
            spec = read_spec(specs[name])
            found = png_file if name == png_file.stem else find_patch_file(workspace, spec)
            # a link and its target are the same patch
            if found is not None and real_path(found) == real_path(png_file):
                wearers.append(as_wearer(spec, png_file))
        except ToolkitError as error:
            broken.append(f"not compared with the rig: {error}")
    return wearers, broken


def as_wearer(spec: ObjectSpec, png_file: Path) -> Wearer:
    """Return an object with a patch; raises as `read_patch`."""
    sides = tuple(mount.at for mount in spec.mounts)
    return Wearer(spec.name, sides, spec.sizes_mm(read_patch(png_file).size_mm))


def choose_wearer(workspace: Workspace, png_file: Path) -> Wearer | None:
    """Return the object for the page of a patch, if none is named; None if none has it.

    Raises:
        FieldError: several objects wear it in different sizes.
    """
    wearers, _ = find_wearers(workspace, png_file)
    if not all(is_same_size(wearer.sizes_mm, wearers[0].sizes_mm) for wearer in wearers):
        sizes = ", ".join(f"{wearer.object} {say_sizes(wearer.sizes_mm)}" for wearer in wearers)
        raise FieldError(f"the patch '{png_file.stem}' is worn in different sizes ({sizes}): give {{size_mm}}", {})
    return wearers[0] if wearers else None


@dataclass(frozen=True)
class PrintedSheet:
    """A sheet of an object that has several: side of the object, sides of patch and cut sheet, pages, tiles."""

    at: Side
    size_mm: float
    cut_mm: float
    pages: int
    tiles: tuple[int, int]


@dataclass(frozen=True)
class PrintedPatch:
    """A PDF that was written.

    If the object has several sheets, `pages` counts those of all; sizes, scale, paper and tiles are the first sheet's.

    Attributes:
        file: the PDF.
        name, class_name, patch_sha256, n_px: identity of the patch.
        size_mm, cut_mm: sides of the patch and of the sheet with its margin.
        scale_percent: scale of the patch's size at `dpi`.
        paper, orientation, copies, pages: the pages.
        tiles: rows and columns of pages of a copy, [1, 1] if it fits on a page.
        recorded_mm: side in the patch's record.
        object: object that it was printed for, if any.
        colour_strip: whether the colour strip is beside the patch.
        sheets: sheets of an object that has several.
        margin: `white`, or `bleed` if the patch goes on over the margin.
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
    object: str | None = None
    sheets: tuple[PrintedSheet, ...] = ()
    margin: Margin = "white"

    @property
    def sizes_mm(self) -> tuple[float, ...]:
        """Side of the patch on each sheet."""
        return tuple(sheet.size_mm for sheet in self.sheets) or (self.size_mm,)

    def as_json(self) -> dict[str, Any]:
        """Return all fields; `sheets` only of an object that has several, `margin` only if it is printed."""
        usual = {"sheets": (), "margin": "white"}
        return {name: value for name, value in asdict(self).items() if usual.get(name) != value}

    def describe(self) -> str:
        """Return the file, size and number of pages in a line."""
        pages = f"{count_of(self.pages, 'page')} of {self.paper} {self.orientation}"
        copies = "" if self.copies == 1 else f", {self.copies} copies"
        rows, columns = self.tiles
        tiles = "" if rows * columns == 1 else f" (a map and {rows} × {columns} tiles a copy)"
        target = f" for {self.object}" if self.object not in (None, Path(self.file).stem) else ""
        size = f"{self.size_mm:.1f} × {self.size_mm:.1f} mm"
        if self.sheets:
            each = (f"{number} on its {sheet.at} {sheet.size_mm:.1f} mm" for number, sheet in enumerate(self.sheets, 1))
            size = f"{len(self.sheets)} sheets, {', '.join(each)}"
        margin = "" if self.margin == "white" else ", printed over the margin (use clear tape)"
        return f"{shorten(self.file)}{target}: {size}{margin}{copies}, {pages}{tiles}"

    def describe_scores(self) -> str:
        """Say in a line how the patch will come out of the printer."""
        return PrintScores(self.total_variation, self.non_printability).describe(self.name)


def name_pdf(out: Path, name: str) -> Path:
    """Return `out` if it is a PDF, else the file of that name in it."""
    return out if out.suffix.lower() == ".pdf" else out / name


def shorten(file: str) -> str:
    """Return a path relative to the current folder if it is inside."""
    here = Path.cwd()
    path = real_path(Path(file))
    return str(path.relative_to(here)) if path.is_relative_to(here) else file


def print_patch(
    png_file: Path, pdf_file: Path, settings: PrintSettings | None = None, wearer: Wearer | None = None
) -> PrintedPatch:
    """Read a patch, lay it out true to size and write its PDF, whole or not at all.

    Args:
        png_file: the patch, its record beside it.
        pdf_file: the page or pages.
        settings: paper, scale and the rest, in millimetres; by default A4.
        wearer: object from `find_wearers`; it decides the size if `settings` do not. None: 250 % of 72 dpi.

    Raises:
        ToolkitError: the patch has no record or another's, its size is out of range, or the PDF cannot be written.

    Example:
        >>> png_file = tk.make_workspace(Path("space")).patches()["racer"]
        >>> print(tk.print_patch(png_file, Path("racer.pdf"), tk.PrintSettings(size_mm=60.0)).describe())
        racer.pdf: 60.0 × 60.0 mm, 1 page of a4 portrait
    """
    # the record is compared with the picture here, so that a mixed-up pair is never printed
    patch, settings = read_patch(png_file), settings or PrintSettings()
    # nothing is written before the whole document is made
    document = build_pdf(patch, settings, wearer)
    write_bytes(pdf_file, document.content)
    # what the commands report, and a later comparison with the rig needs
    record, plan, plans = patch.record, document.plan, document.plans
    sheets = [
        PrintedSheet(at, round(page_plan.side_mm, 3), round(page_plan.cut_mm, 3), len(page_plan.pages), page_plan.tiles)
        for at, page_plan in zip(wearer.sides if wearer else ("top",), plans, strict=True)
    ]
    return PrintedPatch(
        file=str(pdf_file), name=png_file.stem, class_name=record.class_name, patch_sha256=record.png_sha256,
        n_px=record.n_px, size_mm=round(plan.side_mm, 3), cut_mm=round(plan.cut_mm, 3),
        scale_percent=round(effective_percent(record.n_px, plan.side_mm, settings.dpi or BASE_DPI), 3),
        dpi=settings.dpi or BASE_DPI, paper=plan.frame.paper.name, orientation=plan.frame.paper.orientation,
        copies=settings.copies, pages=sum(len(plan.pages) for plan in plans), tiles=plan.tiles,
        recorded_mm=record.size_mm, colour_strip=any(plan.has_strip for plan in plans),
        object=wearer.object if wearer else None, sheets=tuple(sheets) if len(sheets) > 1 else (), margin=plan.margin,
        **{key: round(score, 4) for key, score in asdict(score_print(patch.pixels)).items()},
    )  # fmt: skip


def print_patches(
    files: Sequence[Path], out: Path, settings: PrintSettings | None = None, go_on: bool = False,
    workspace: Workspace | None = None,
) -> tuple[list[PrintedPatch], list[dict[str, str]]]:  # fmt: skip
    """Print each patch for each object that has it, into `OBJECT.pdf`, or into `PATCH.pdf` if no object has it.

    Args:
        files: PNG files, each with its record beside it.
        out: folder for the PDFs; for a single page it may be a PDF.
        settings: settings of every page, by default A4; a size in them replaces the specs'.
        go_on: list a patch that cannot be printed and print the others, instead of ending with its error.
        workspace: its objects have them; None: the default size is 250 % of 72 dpi.

    Returns:
        The printed patches, and `patch` and `reason` of each that could not be printed.

    Raises:
        ToolkitError: two patches would share a PDF, or a patch cannot be printed.
    """
    settings = settings or PrintSettings()
    printed: list[PrintedPatch] = []
    failed: list[dict[str, str]] = []
    worn: list[tuple[Path, Wearer | None]] = []
    # a patch on several objects is printed for each, in the size of its spec
    for file in files:
        wearers = find_wearers(workspace, file)[0] if workspace is not None else []
        worn += [(file, wearer) for wearer in wearers] or [(file, None)]
    # names are settled before the first page, so that a clash leaves nothing half done
    targets = _name_targets(worn, out)
    with progress("Printing", len(targets), quiet=len(targets) == 1) as ticker:
        for png_file, wearer, pdf_file in targets:
            try:
                printed.append(print_patch(png_file, pdf_file, settings, wearer))
            except ToolkitError as error:
                # an error of the only page is the command's own
                if not go_on or len(targets) == 1:
                    raise
                failed.append({"patch": str(png_file), "reason": str(error)})
            ticker.advance(note=pdf_file.name)
    return printed, failed


def print_chosen(
    workspace: Workspace, out: Path, settings: PrintSettings | None = None, *, objects: Sequence[str] = (),
    classes: Sequence[str] = (), everything: bool = False, files: Sequence[Path] = (),
) -> tuple[list[PrintedPatch], list[dict[str, str]], list[str]]:  # fmt: skip
    """Print the patches of objects in the sizes of their specs, and the patches that `select_patches` finds.

    Returns:
        As `print_patches`, and notes on sizes that differ from the rig's.

    Raises:
        ToolkitError: nothing is chosen, an object is unknown or has no patch, or as `print_patches`.
    """
    # objects come first, in the size that their specs state
    worn = []
    for name in dict.fromkeys(objects):
        spec = read_spec(workspace.object_spec(name))
        png_file = find_patch_file(workspace, spec)
        if png_file is None:
            raise ToolkitError(
                f"no patch for object '{name}': train it with 'toolkit train-patch --object {name}', or name a patch"
            )
        worn.append((png_file, as_wearer(spec, png_file)))
    printed = [
        print_patch(png_file, pdf_file, settings, wearer) for png_file, wearer, pdf_file in _name_targets(worn, out)
    ]
    # without an object, patches by class or file, for each object that has them
    more: list[PrintedPatch] = []
    failed: list[dict[str, str]] = []
    if classes or everything or files or not objects:
        chosen = select_patches(workspace, classes, everything, files)
        more, failed = print_patches(chosen, out, settings, go_on=everything, workspace=workspace)
    # a size that was asked for by object is the spec's or the user's: there is nothing to compare
    notes = list(dict.fromkeys(note for sheet in more for note in compare_with_rig(workspace, sheet)))
    printed += more
    return printed, failed, notes + check_fits(workspace, printed)


def _name_targets(worn: Sequence[tuple[Path, Wearer | None]], out: Path) -> list[tuple[Path, Wearer | None, Path]]:
    """Return each patch, its object, and its PDF; no two may share it."""
    # a single file can hold a single patch
    if out.suffix.lower() == ".pdf" and len(worn) > 1:
        pages = ", ".join(wearer.object if wearer else file.stem for file, wearer in worn)
        raise FieldError(f"one file for {len(worn)} pages ({pages}): name a folder, or one object", {"out": out})
    if out.suffix.lower() == ".pdf":
        return [(*pair, out) for pair in worn]
    targets = [(file, wearer, out / f"{wearer.object if wearer else file.stem}.pdf") for file, wearer in worn]
    # patches of the same name may lie in different folders
    names = [pdf_file.name for *_, pdf_file in targets]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise FieldError(
            f"two patches would be written to {out / twice[0]}: print them by calls with different {{out}}", {}
        )
    return targets


def print_all(workspace: Workspace) -> list[PrintedPatch]:
    """Print every known patch into the workspace's `print/`, see `print_patches`.

    Raises:
        ToolkitError: there is no patch, or one of them cannot be printed.
    """
    files = select_patches(workspace, everything=True)
    return print_patches(files, workspace.print_dir, workspace=workspace)[0]


def compare_with_rig(workspace: Workspace, printed: PrintedPatch) -> list[str]:
    """Say what to do if the object has the patch in another size than was printed, and name broken specs."""
    # a patch that the workspace does not know cannot be on any of its objects
    png_file = workspace.patches().get(printed.name)
    if png_file is None:
        return []
    wearers, broken = find_wearers(workspace, png_file)
    notes = []
    for wearer in wearers:
        # only objects that this page was printed for, and only where the size differs
        if printed.object not in (None, wearer.object) or is_same_size(wearer.sizes_mm, printed.sizes_mm):
            continue
        sheet = "sheet" if len(wearer.sizes_mm) == 1 else "sheets"
        notes.append(
            f"the rig mounts {printed.name} on {wearer.object} at {say_sizes(wearer.sizes_mm)}, and photographs are "
            f"judged by that: print the {sheet} of {wearer.object}, or set size_mm = {printed.size_mm:.1f} under "
            f"[patch] in rig/objects/{wearer.object}.toml"
        )
    return notes + broken


def check_fits(workspace: Workspace, printed: Sequence[PrintedPatch]) -> list[str]:
    """Name the sheets that do not lie flat on their objects at the printed size, and where they would."""
    notes = []
    for sheet in printed:
        if sheet.object is not None and read_spec(workspace.object_spec(sheet.object)).mesh:
            notes += describe_misfits(load_object(workspace.object_spec(sheet.object)), sheet.sizes_mm)
    return notes
