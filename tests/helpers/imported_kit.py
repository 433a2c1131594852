"""What processes of `forked` have imported before they begin: the kit, and what it imports where it is used."""

import gc
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import toolkit

LATER = ("matplotlib.pyplot", "matplotlib.backends.backend_agg", "scipy.optimize", "scipy.stats")  # open3d has threads
MODULES = [module.name for module in walk_packages(toolkit.__path__, "toolkit.") if "__main__" not in module.name]

for name in (*MODULES, *LATER):
    with suppress(ImportError):  # of an extra that is not installed
        import_module(name)

gc.collect()
gc.freeze()  # memory that the forked processes share
assert len(list(Path("/proc/self/task").glob("*"))) < 2, "a process with threads cannot be forked"
