"""Copy trained wraps of a workspace into the package, in fewer bytes: `ship_wraps.py WORKSPACE NAME...`.

Places on the pieces go in float32, which is exact to a fifty-thousandth of a millimetre on an A3 sheet; the record
goes on one line; the pictures are copied as they are.
"""

import json
import sys
from pathlib import Path

import numpy as np

from toolkit.core.files import sha256_bytes, write_bytes, write_text
from toolkit.core.workspace import PACKAGE_DATA, Workspace
from toolkit.objects.load import TableObject, load_object
from toolkit.objects.records import pack_arrays, unpack_arrays
from toolkit.rooms.wraps.wrap import MAP_FILE, RECORD_FILE, check_wrap, piece_name, read_wrap

ARRAYS = ["faces", "flat_mm", "piece"]


def ship_wrap(folder: Path, target: Path, item: TableObject) -> int:
    """Copy one wrap's folder; returns the bytes that it takes."""
    wrap = read_wrap(folder)
    check_wrap(wrap, item)
    record = wrap.record
    faces, flat_mm, piece = unpack_arrays((folder / MAP_FILE).read_bytes(), folder / MAP_FILE, ARRAYS, "map of pieces")
    table = pack_arrays({"faces": faces, "flat_mm": flat_mm.astype(np.float32), "piece": piece})
    write_bytes(target / MAP_FILE, table)
    for one in record.pieces:
        write_bytes(target / piece_name(one.number), (folder / piece_name(one.number)).read_bytes())
    shipped = record.model_copy(
        update={"map_sha256": sha256_bytes(table), "mesh_sha256": item.shape_sha256}
    ).model_dump(mode="json")
    write_text(target / RECORD_FILE, json.dumps(shipped, separators=(",", ":"), ensure_ascii=False) + "\n")
    read_wrap(target)
    return sum(file.stat().st_size for file in target.iterdir())


if __name__ == "__main__":
    space = Workspace(Path(sys.argv[1]))
    for name in sys.argv[2:]:
        size = ship_wrap(space.wraps_dir / name, PACKAGE_DATA / "wraps" / name, load_object(space.object_spec(name)))
        print(name, size)  # noqa: T201
