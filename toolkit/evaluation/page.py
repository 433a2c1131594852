"""Parts that reports share: a self-contained HTML page, embedded pictures, colours and axes of figures."""

import base64
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolkit import __version__
from toolkit.captures.capture import UNPATCHED
from toolkit.core import tables
from toolkit.core.files import write_text
from toolkit.core.statistics import wilson_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# a palette for colour-blind readers (Okabe and Ito 2008)
BLUE: str = "#0072b2"
ORANGE: str = "#d55e00"
GREEN: str = "#009e73"
PINK: str = "#cc79a7"
AMBER: str = "#e69f00"
SKY: str = "#56b4e9"
COLOURS = (BLUE, ORANGE, GREEN, PINK, AMBER, SKY)
UNPATCHED_COLOUR: str = "#6b6f76"
LEFT_OUT_COLOUR: str = "#d9dce1"
RIGHT, FIFTH, WRONG = GREEN, AMBER, ORANGE
"""Frame of an image whose true class is the first prediction, among five, and not among five."""


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


def colour_of(variants: Sequence[str], variant: str) -> str:
    """Return grey for `unpatched`, and the other colours in turn."""
    if variant == UNPATCHED:
        return UNPATCHED_COLOUR
    others = [name for name in dict.fromkeys(variants) if name != UNPATCHED]
    return COLOURS[others.index(variant) % len(COLOURS)]


def style_panel(panel: "Axes", low: float = 0, high: float = 104) -> None:
    """Scale the y axis in per cent, with a faint grid and no frame above and on the right."""
    panel.set_ylim(low, high)
    panel.set_yticks(range(0, 101, 20))
    panel.grid(axis="y", alpha=0.3)
    panel.spines[["top", "right"]].set_visible(False)
