"""Parts that reports share: a self-contained HTML page that opens from disk without an internet connection."""

import base64
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from toolkit import __version__
from toolkit.core import tables
from toolkit.core.files import write_text
from toolkit.core.statistics import wilson_interval


def write_page(
    path: Path, package: str, template: str, context: Mapping[str, Any], **filters: Callable[[str], str]
) -> Path:
    """Write a page from a template; all texts are escaped.

    Args:
        package: package of the template; templates that it extends or includes may be in `toolkit.evaluation`.
        template: name of the template, which extends `page.html.j2`.
        filters: filters besides those of numbers and `embed`.

    Raises:
        ToolkitError: the file cannot be written.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    loader = ChoiceLoader([PackageLoader(name, package_path="") for name in (package, "toolkit.evaluation")])
    # a name that a template misspells is an error, not an empty place
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "percent": tables.format_percent, "interval": tables.format_interval, "points": tables.format_points,
        "points_interval": tables.format_points_interval, "p_value": tables.format_p, "rank": tables.format_rank,
        "kappa": tables.format_kappa, "embed": embed_picture, **filters,
    }  # fmt: skip
    environment.globals |= {"wilson": wilson_interval, "version": __version__}
    return write_text(path, environment.get_template(template).render(context))


def embed_picture(content: bytes, kind: str = "png") -> str:
    """Return a picture as a `data:` URI; `kind` is `png`, `jpeg` or `webp`."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"
