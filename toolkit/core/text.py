"""Text from anywhere: safe to print, and valid names of files and folders."""

import json
import os
import re
import shlex
import unicodedata
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator

FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
FOLDER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""A hundred characters: with suffixes below the 255 bytes of a file system."""
LONGEST = 2000
MOST_LABEL = 1000
"""Letters of a class; ImageNet's longest label has 131."""


def quote(word: str | Path) -> str:
    """Return a word as it is typed in a shell, in quotes if needed."""
    text = str(word)
    if os.name == "nt":
        return f'"{text}"' if re.search(r"[\s&()^]", text) else text
    return shlex.quote(text)


def is_file_name(name: str) -> bool:
    """Whether this can be the name of a file without suffix: an object, a patch, a texture."""
    return FILE.fullmatch(name) is not None


def is_folder_name(name: str) -> bool:
    """Whether this can be the name of a folder, with dots inside: a source, a variant, a run."""
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
"""Name of a class."""
LabelOrIndex = Annotated[str | int, AfterValidator(_check_label)]
FolderName = Annotated[str, AfterValidator(_check_folder)]


def escape(text: str) -> str:
    """Return text as a line, with escapes for control codes, line ends, marks of direction and half surrogates."""
    if text.isprintable():
        return text
    return "".join(sign if _is_shown(sign) else sign.encode("unicode_escape").decode() for sign in text)


def shorten(text: str, most: int = LONGEST) -> str:
    """Return text, without its middle if it is longer than `most`."""
    if len(text) <= most:
        return text
    half = (most - 5) // 2
    return f"{text[:half]} ... {text[-half:]}"


def to_json(content: Any) -> str:
    """Return indented JSON for a terminal, with escapes as in `escape`."""
    text = json.dumps(content, indent=2, ensure_ascii=False)
    return "".join(sign if sign == "\n" or _is_shown(sign) else json.dumps(sign)[1:-1] for sign in text)


def _is_shown(sign: str) -> bool:
    return sign.isprintable() or unicodedata.category(sign) == "Zs"


def count_of(count: int, noun: str) -> str:
    """Return a number with its noun: `1 pair`, `2 pairs`."""
    return f"{count} {noun}{'s' if count != 1 else ''}"


def join_words(words: Iterable[str], last: str = "and") -> str:
    """Return words as a list in a sentence: `a`, `a and b`, `a, b and c`."""
    listed = list(words)
    return f" {last} ".join(filter(None, (", ".join(listed[:-1]), *listed[-1:])))


def list_some(names: Sequence[str], most: int) -> str:
    """Return the first names and the number of others: `a, b and 3 more`."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def kept_before(count: int) -> str:
    """Return `, 3 kept from before`, or nothing."""
    return f", {count} kept from before" if count else ""


def name_letter(number: int) -> str:
    """Return A … Z, AA, AB …, as in a spreadsheet; `number` counts from 0."""
    name = ""
    number += 1
    while number:
        number, rest = divmod(number - 1, 26)
        name = chr(ord("A") + rest) + name
    return name
