"""What a file or folder may be called: one pattern for each, asked wherever a name is read or typed."""

import re
from typing import Annotated

from pydantic import AfterValidator

FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
FOLDER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""A hundred characters: with what is added to them, below the 255 bytes that a file system takes."""


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


def _check_folder(name: str) -> str:
    if not is_folder_name(name):
        raise ValueError("expected a name of letters, digits, '.', - and _, at most 100, with no dot in front")
    return name


FileName = Annotated[str, AfterValidator(_check_file)]
FolderName = Annotated[str, AfterValidator(_check_folder)]
