"""Photographs for the benchmark, from a folder with one folder per class: split_photographs.py FOLDER OUT [others].

Every second class with at least five photographs is evaluated: its first two go to OUT/train, the others to OUT/val.
The photographs of all other classes go to OUT/train, where they serve as backgrounds. With `others` the classes that
would be passed over are evaluated: on them recipes are chosen.
"""

import shutil
import sys
from pathlib import Path

LEAST, TO_TRAIN = 5, 2


def split_photographs(folder: Path, out: Path, first: int = 0) -> list[str]:
    """Copy the photographs; the names of the classes that are evaluated."""
    photographs = {one.name: sorted(one.iterdir()) for one in sorted(folder.iterdir()) if one.is_dir()}
    evaluated = [name for name, files in photographs.items() if len(files) >= LEAST][first::2]
    for name, files in photographs.items():
        for k, file in enumerate(files):
            part = "val" if name in evaluated and k >= TO_TRAIN else "train"
            target = out / part / name / file.name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)
    return evaluated


if __name__ == "__main__":
    source, target, *which = sys.argv[1:]
    names = split_photographs(Path(source), Path(target), first=int(which == ["others"]))
    sys.stdout.write(" ".join(names) + "\n")
