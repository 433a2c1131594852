"""Text from anywhere, made fit to be shown."""

import json
import unicodedata
from typing import Any

LONGEST = 2000


def escape(text: str) -> str:
    """Text in one line, with what a terminal would obey or hide written as an escape.

    That is control codes, line ends, marks that turn the direction of writing, and half pairs of surrogates.
    """
    if text.isprintable():
        return text
    return "".join(sign if _is_shown(sign) else sign.encode("unicode_escape").decode() for sign in text)


def shorten(text: str, most: int = LONGEST) -> str:
    """Text with its middle left out where it is longer than `most`."""
    if len(text) <= most:
        return text
    half = (most - 5) // 2
    return f"{text[:half]} ... {text[-half:]}"


def to_json(content: Any) -> str:
    """Indented JSON that a terminal can show: letters as they are, and escapes for what `escape` escapes."""
    text = json.dumps(content, indent=2, ensure_ascii=False)
    return "".join(sign if sign == "\n" or _is_shown(sign) else json.dumps(sign)[1:-1] for sign in text)


def _is_shown(sign: str) -> bool:
    return sign.isprintable() or unicodedata.category(sign) == "Zs"


def kept_before(count: int) -> str:
    """`, 3 kept from before`, or nothing."""
    return f", {count} kept from before" if count else ""
