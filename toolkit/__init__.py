"""Boost physical objects for a neural network, and measure whether it worked: `import toolkit as tk`.

What is worth importing is listed once, in `__init__.pyi`, in the order of the road: a workspace, objects and networks,
training, the page, the pose plan, pictures, evaluation. A name is loaded when it is first used, so that the import
itself costs nothing. Its docstring says shapes, units and errors. The packages behind it are open too, but
their insides may move.
"""

__version__ = "0.1.0"


def _read_names() -> dict[str, str]:
    """Each name of the front door, and the module that it comes from."""
    with open(f"{__file__.removesuffix('c')}i", encoding="utf-8") as stub:  # noqa: PTH123 - pathlib would take longer
        imports = [line.split() for line in stub if line.startswith("from ")]
    return {words[-1]: words[1] for words in imports}


_HOMES = _read_names()
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> object:
    """Load a name of the list when it is first asked for (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'toolkit' has no attribute '{name}'")
    from importlib import import_module

    globals()[name] = value = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
