"""Train a texture on images of the ray caster and of Mitsuba, and judge both by all renderers.

python docs/scripts/algorithm_2.py PHOTOGRAPHS [STEPS]: photographs stand behind the object. Interrupted runs resume.
Needs the extra mitsuba; 100 steps take some 25 minutes of one core. Writes docs/results/algorithm-2.csv, rows of
docs/results/renderers.csv, and the pages.
"""

import resource
import subprocess
import sys
from pathlib import Path

from findings import write_pages
from tables import DOCS, TABLES, Row, read_summaries, write_renderer_tables, write_table

from toolkit.core.files import load_json, write_json
from toolkit.core.workspace import Workspace, make_workspace
from toolkit.objects.records import read_texture

OBJECT, BATCH, RUN = "racer", 8, "algorithm-2"
HOME = DOCS.parent / "renderers"
TOOLKIT = Path(sys.executable).with_name("toolkit")


def main(photographs: str, steps: str = "100") -> None:
    """Train, shoot, judge, and write the tables."""
    rows = []
    for renderer in ("raycast", "mitsuba"):
        space = make_workspace(HOME / f"{RUN}-{renderer}")
        train(space, renderer, photographs, steps)
        run(space, "plan", "--object", OBJECT, "--resolution", "264", "264")
        run(
            space, "capture-sim", "--object", OBJECT, "--variant", "unpatched", "--variant", "textured",
            "--also-renderer", "all", "--format", "png",
        )  # fmt: skip
        run(space, "eval", str(space.captures_dir), "--run", f"{RUN}-{renderer}", "--replace")
        write_renderer_tables(read_summaries(space))
        rows.append(describe(space, renderer))
    write_table(TABLES / f"{RUN}.csv", rows)
    write_pages()


def train(space: Workspace, renderer: str, photographs: str, steps: str) -> None:
    """Train with the paper's gradient over photographs; CPU time adds up over interrupted runs."""
    cost = space.root / "cost.json"
    before = load_json(cost)["cpu_s"] if cost.is_file() else 0.0
    begun = count_cpu_s()
    try:
        run(
            space, "train-texture", "--object", OBJECT, "--gradient", "linear", "--background-folder", photographs,
            "--background-share", "1", "--steps", steps, "--batch", str(BATCH), "--renderer", renderer,
        )  # fmt: skip
    finally:
        write_json(cost, {"cpu_s": before + count_cpu_s() - begun})


def run(space: Workspace, *words: str) -> None:
    """Run a command in a workspace."""
    subprocess.run([TOOLKIT, *words, "--workspace", space.root], check=True)


def count_cpu_s() -> float:
    """CPU seconds of all commands so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def describe(space: Workspace, renderer: str) -> Row:
    """A row of the table: how long it was trained, how, and its cost."""
    settings = read_texture(space.textures_dir / f"{OBJECT}.png").record.settings
    cpu_s = load_json(space.root / "cost.json")["cpu_s"]
    library = settings.get("renderer", {"library": renderer})["library"]
    return {
        "run": f"{RUN}-{renderer}", "trained_on": library, "object": OBJECT, "steps": settings["steps"],
        "batch": settings["batch"], "cpu_s_per_step": cpu_s / settings["steps"],
    }  # fmt: skip


if __name__ == "__main__":
    main(*sys.argv[1:])
