"""Text from anywhere: made fit to be shown, and what of it may be the name of a file or folder."""

import json
import os
import re
import shlex
import unicodedata
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator

FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
FOLDER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""A hundred characters: with what is added to them, below the 255 bytes that a file system takes."""
LONGEST = 2000
MOST_LABEL = 1000
"""Letters of a class; ImageNet's longest label has 131, with all its synonyms."""


def quote(word: str | Path) -> str:
    """A path or another word as it is typed in a command: in quotes if it holds blanks or what a shell reads."""
    text = str(word)
    if os.name == "nt":
        return f'"{text}"' if re.search(r"[\s&()^]", text) else text
    return shlex.quote(text)


def is_file_name(name: str) -> bool:
    """Whether a file may be called this, without its suffix: an object, a patch, a texture."""
    return FILE.fullmatch(name) is not None


def is_folder_name(name: str) -> bool:
    """Whether a folder may be called this: a source, a variant, a run. Dots may stand within."""
    return FOLDER.fullmatch(name) is not None


def _check_file(name: str) -> str:
    if not is_file_name(name):
        raise ValueError("expected a name of letters, digits, - and _, at most 100")
    return name


def _check_label(label: Any) -> Any:
    if isinstance(label, str) and len(label) > MOST_LABEL:
        raise ValueError(f"expected a class of at most {MOST_LABEL} letters")
    return label


def _check_folder(name: str) -> str:
    if not is_folder_name(name):
        raise ValueError("expected a name of letters, digits, '.', - and _, at most 100, with no dot in front")
    return name


FileName = Annotated[str, AfterValidator(_check_file)]
Label = Annotated[str, AfterValidator(_check_label)]
"""What a network or a person calls a class."""
LabelOrIndex = Annotated[str | int, AfterValidator(_check_label)]
FolderName = Annotated[str, AfterValidator(_check_folder)]


def escape(text: str) -> str:
    """Return text as a single line, with what a terminal would obey or hide written as an escape.

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


def count_of(count: int, noun: str) -> str:
    """`1 pair`, `2 pairs`: a number with its noun, which takes an s."""
    return f"{count} {noun}{'s' if count != 1 else ''}"


def list_some(names: Sequence[str], most: int) -> str:
    """`a, b and 3 more`: the first names, at most so many, and how many are left."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def kept_before(count: int) -> str:
    """`, 3 kept from before`, or nothing."""
    return f", {count} kept from before" if count else ""


def name_letter(number: int) -> str:
    """A … Z, AA, AB …, as columns are named in a spreadsheet; `number` counts from 0."""
    name = ""
    number += 1
    while number:
        number, rest = divmod(number - 1, 26)
        name = chr(ord("A") + rest) + name
    return name
