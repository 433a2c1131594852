"""The notebook of the road, made from its example and executed: python docs/scripts/notebook.py [NOTEBOOK].

Each `# %% title` of the example is a heading and a cell; some are followed by a cell that looks at what was made.
IPython runs the cells without a kernel; it and nbformat come with Open3D.
"""

import os
import re
import sys
from base64 import b64encode
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from IPython.core.displayhook import CapturingDisplayHook
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from toolkit.core.console import quietly
from toolkit.core.files import write_text

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE, NOTEBOOK = ROOT / "examples" / "01_road.py", ROOT / "examples" / "road.ipynb"
MARK = re.compile(r"^# %% (.+)$", re.MULTILINE)
FOLDER = 'Path(sys.argv[1] if len(sys.argv) > 1 else "example-out")'
"""A notebook has no command line."""

LOOKS = {
    "Train a patch": """\
from PIL import Image

Image.fromarray(trained.patch.pixels).resize((300, 300), Image.Resampling.NEAREST)""",
    "Plan 18 poses": """\
import numpy as np


def read_row(variant: str) -> np.ndarray:
    files = [shots.source_dir / NAME / variant / f"pose_{pose:02d}.jpg" for pose in (1, 4, 8, 12)]
    return np.hstack([np.asarray(Image.open(file)) for file in files])


Image.fromarray(np.vstack([read_row("unpatched"), read_row("patched")]))""",
    "Ask the network": """\
table = tk.predictions_table(result).astype({"true_prob": float})
table.pivot_table("true_prob", "pose_id", "variant")[["unpatched", "grey-patch", "patched"]].round(2)""",
}
"""Files shown after the cells whose titles begin so."""


def read_cells(example: Path) -> list[nbformat.NotebookNode]:
    """Headings and code of an example, with the looks."""
    first, *rest = MARK.split(example.read_text(encoding="utf-8"))
    docstring, code = re.match(r'"""(.+?)"""\n+(.*)', first, re.DOTALL).groups()
    cells = [
        new_markdown_cell(f"# The road\n\n{docstring}\n\nMade from `{example.name}` by `docs/scripts/notebook.py`."),
        new_code_cell(code.replace("import sys\nfrom pathlib import Path\n\n", "").strip()),
    ]
    for title, code in zip(rest[::2], rest[1::2], strict=True):
        cells += [new_markdown_cell(f"## {title}"), new_code_cell(code.replace(FOLDER, '"example-out"').strip())]
        cells += [new_code_cell(look) for start, look in LOOKS.items() if title.startswith(start)]
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    return cells


def execute(cells: list[nbformat.NotebookNode], folder: Path) -> None:
    """Run the code in a folder and put its output and pictures into the cells.

    Raises:
        RuntimeError: a cell fails.
    """
    shell, before = InteractiveShell.instance(), Path.cwd()
    os.chdir(folder)
    try:
        for count, cell in enumerate((cell for cell in cells if cell.cell_type == "code"), 1):
            shown: list[dict[str, dict[str, object]]] = []
            shell.display_trap.hook = CapturingDisplayHook(shell, shown)
            with capture_output() as said, quietly():
                done = shell.run_cell(cell.source)
            if not done.success:
                raise RuntimeError(f"cell {count} fails: {done.error_before_exec or done.error_in_exec}")
            cell.execution_count = count
            text = said.stdout.replace(f"{folder}/", "")
            cell.outputs = [new_output("stream", name="stdout", text=text)] if text else []
            cell.outputs += [new_output("display_data", data=choose_formats(one["data"])) for one in shown]
    finally:
        os.chdir(before)


def choose_formats(data: dict[str, object]) -> dict[str, object]:
    """As a notebook holds them; of a picture the JPEG alone, as a render is large as PNG."""
    kept = {kind: one for kind, one in data.items() if kind != "image/png" or "image/jpeg" not in data}
    return {kind: b64encode(one).decode() if isinstance(one, bytes) else one for kind, one in kept.items()}


def main(notebook: str | None = None) -> None:
    """Write the notebook; by default `examples/road.ipynb`."""
    cells = read_cells(EXAMPLE)
    with TemporaryDirectory() as folder:
        execute(cells, Path(folder).resolve())
    book = new_notebook(cells=cells, metadata={"language_info": {"name": "python"}})
    nbformat.validate(book)
    write_text(Path(notebook or NOTEBOOK), nbformat.writes(book) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
