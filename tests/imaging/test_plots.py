"""Figures look the same in every folder, whatever `matplotlibrc` lies there."""

import ast
import subprocess
import sys
from pathlib import Path

import toolkit
from toolkit.imaging.plots import encode_figure, make_figure, with_default_style

ROOT = Path(toolkit.__file__).parent
PLANTED = "text.usetex: true\nfont.size: 30\nsavefig.facecolor: red\n"
CALL = """
import sys
from pathlib import Path
from matplotlib import rcParams
sys.path.insert(0, sys.argv[1])
from test_plots import draw
assert rcParams["text.usetex"]
Path("figure.png").write_bytes(draw("right %"))
assert rcParams["text.usetex"]
"""


@with_default_style
def draw(title: str) -> bytes:
    figure = make_figure(3, 2)
    panel = figure.subplots()
    panel.plot([0, 1], [1, 3], label=title)
    panel.set_title(title)
    panel.legend()
    return encode_figure(figure)


def test_a_planted_matplotlibrc_changes_no_figure_and_starts_no_latex(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text(PLANTED)
    subprocess.run([sys.executable, "-c", CALL, str(Path(__file__).parent)], cwd=tmp_path, check=True, timeout=60)
    assert (tmp_path / "figure.png").read_bytes() == draw("right %")


def list_calls(node: ast.AST) -> set[str]:
    return {one.func.id for one in ast.walk(node) if isinstance(one, ast.Call) and isinstance(one.func, ast.Name)}


def test_all_that_make_figures_have_the_default_style() -> None:
    found = 0
    for file in ROOT.rglob("*.py"):
        text = file.read_text()
        if file.name == "plots.py":
            continue
        assert not any(word in text for word in ("pyplot", "FigureCanvas", "savefig")), file
        nodes = ast.walk(ast.parse(text)) if "make_figure(" in text else ()
        for node in (one for one in nodes if isinstance(one, ast.FunctionDef)):
            if "make_figure" in list_calls(node):
                found += 1
                assert "with_default_style" in [ast.unparse(one) for one in node.decorator_list], (file, node.name)
    assert found > 8
