"""`toolkit studio`: a local web page to photograph with, over the same functions as the command line."""

from importlib.util import find_spec

from toolkit.core.errors import ToolkitError
from toolkit.core.text import join_words


def require_extra() -> None:
    """Raise `ToolkitError` if the studio's extra is missing. Call it before a module of this folder is imported."""
    missing = [name for name in ("fastapi", "uvicorn") if find_spec(name) is None]
    if missing:
        raise ToolkitError(
            f"toolkit studio needs {join_words(missing)}, which the extra 'studio' brings: pip install '.[studio]' "
            "in toolkit's folder"
        )
