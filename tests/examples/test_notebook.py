"""The notebook is that of the example, was run, and shows its pictures."""

import json
import sys
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "examples" / "road.ipynb"


@pytest.fixture(scope="module")
def notebook(tmp_path_factory):
    """The module that makes it, and what is in the file."""
    pytest.importorskip("IPython", reason="comes with Open3D's widgets")
    sys.path.insert(0, str(ROOT / "docs" / "scripts"))
    try:
        import notebook
    finally:
        sys.path.pop(0)
    return notebook, json.loads(NOTEBOOK.read_text(encoding="utf-8"))


def test_its_cells_are_the_examples(notebook):
    module, content = notebook
    made = [cell.source for cell in module.read_cells(module.EXAMPLE)]
    assert ["".join(cell["source"]) for cell in content["cells"]] == made, "run docs/scripts/notebook.py again"


def test_it_was_run_and_shows_pictures(notebook):
    _, content = notebook
    code = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} <= {"stream", "display_data"}  # no errors
    jpegs = [output["data"]["image/jpeg"] for output in outputs if "image/jpeg" in output.get("data", {})]
    sizes = [Image.open(BytesIO(b64decode("".join(jpeg)))).size for jpeg in jpegs]
    assert sizes == [(300, 300), (1280, 480)]
    assert any("text/html" in output.get("data", {}) for output in outputs)


def test_it_is_small_and_names_no_folder_of_ours():
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert len(text) < 1e6
    assert "/tmp/" not in text and "/home/" not in text and str(ROOT) not in text


def test_cells_run_and_their_output_is_kept(notebook, tmp_path):
    from nbformat.v4 import new_code_cell

    module, _ = notebook
    picture = (
        "from PIL import Image\nprint('made', __import__('pathlib').Path('x.png').resolve())\nImage.new('RGB', (8, 4))"
    )
    cells = [new_code_cell("side = 3"), new_code_cell(picture), new_code_cell("side + 1")]
    module.execute(cells, tmp_path.resolve())
    assert cells[0].outputs == []
    assert cells[1].outputs[0].text == "made x.png\n"
    assert set(cells[1].outputs[1].data) == {"text/plain", "image/jpeg"}
    assert cells[2].outputs[0].data == {"text/plain": "4"}
    with pytest.raises(RuntimeError, match="cell 1 fails: division by zero"):
        module.execute([new_code_cell("1 / 0")], tmp_path)
