"""Open3D, loaded where it is used, without what the kit has no use for."""

import sys
from types import ModuleType
from typing import Any

UNUSED = {"open3d.ml": (), "open3d.visualization.draw_plotly": ("draw_plotly", "draw_plotly_server")}
"""Modules, with the names that others take from them: data sets to learn from, and a viewer for notebooks.

They bring scikit-learn, pandas and Dash: two thirds of what the import takes of a core, and half of its memory.
"""


def load_open3d() -> Any:
    """The module, as `import open3d` gives it, but for `UNUSED`; those can still be imported by their names."""
    stand_ins = {} if "open3d" in sys.modules else {name: ModuleType(name) for name in UNUSED}
    for name, module in stand_ins.items():
        vars(module).update(dict.fromkeys(UNUSED[name]))
    sys.modules.update(stand_ins)
    try:
        import open3d
    finally:
        for name in stand_ins:
            sys.modules.pop(name, None)
    return open3d
