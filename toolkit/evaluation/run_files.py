"""Folder of a run: no result overwrites another, and files that were changed afterwards are detected."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from toolkit.core.errors import ToolkitError
from toolkit.core.files import load_json, sha256_bytes, sha256_file, sha256_json, write_json, write_text
from toolkit.core.work import INPUTS

SUMMARY = "summary.json"
PREDICTIONS, DETECTIONS, CELLS, EPISODES = "predictions.csv", "detections.csv", "cells.csv", "episodes.csv"
TABLES: Mapping[str, str] = {
    f"{name.removesuffix('.csv')}_sha256": name for name in (PREDICTIONS, DETECTIONS, CELLS, EPISODES)
}
"""Field of the summary -> table whose hash it holds."""
CONTENT = "content_sha256"
"""Hash of all other fields of a summary."""
IsFree = Callable[[Path], bool]


def find_run_dir(wanted: Path, is_free: IsFree, overwrite: bool = False) -> Path:
    """Return `wanted`, or the first of RUN-2, RUN-3 … that is free: without a result, or with the same result."""
    number, folder = 1, wanted
    while not overwrite and not is_free(folder):
        number += 1
        folder = wanted.with_name(f"{wanted.name}-{number}")
    return folder


def lacks_other_table(name: str, text: str) -> IsFree:
    """Return a test whether a folder has no such table, or a table with the same text."""
    content = text.encode()
    return lambda folder: not (folder / name).is_file() or (folder / name).read_bytes() == content


def lacks_other_inputs(key: str) -> IsFree:
    """Return a test whether a folder holds no finished run, or a run of the same inputs, by its key."""

    def is_free(folder: Path) -> bool:
        if not (folder / SUMMARY).is_file():
            return True
        content = load_json(folder / SUMMARY)
        return isinstance(content, dict) and content.get(INPUTS) == key

    return is_free


def explain_run_dir(wanted: Path, found: Path) -> tuple[str, ...]:
    """Return a note if a run has another name than it was asked to have."""
    return () if found == wanted else (f"{wanted} holds another result, and stays as it is",)


def write_run(run_dir: Path, summary: Mapping[str, Any], tables: Mapping[str, str]) -> dict[str, Any]:
    """Write the tables of a run, then its `summary.json` with their hashes and its own; return the summary.

    Raises:
        ToolkitError: the folder cannot be written.
    """
    for name, text in tables.items():
        write_text(run_dir / name, text)
    hashes = {field: sha256_bytes(tables[name].encode()) for field, name in TABLES.items() if name in tables}
    content = {**summary, **hashes}
    content[CONTENT] = hash_summary(content)
    write_json(run_dir / SUMMARY, content)
    return content


def hash_summary(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of all other fields of a summary, in any order and layout."""
    return sha256_json({key: value for key, value in content.items() if key != CONTENT})


def check_run(folder: Path, content: Mapping[str, Any]) -> None:
    """Raise a `ToolkitError` if a table or the summary was changed after the run; older runs hold no hashes."""
    remedy = "undo the change, or make the run again"
    for field, name in TABLES.items():
        file = folder / name
        if content.get(field) is not None and file.is_file() and sha256_file(file) != content[field]:
            raise ToolkitError(f"{file} was changed after {SUMMARY} was counted from it: {remedy}")
    if content.get(CONTENT) is not None and hash_summary(content) != content[CONTENT]:
        raise ToolkitError(f"{folder / SUMMARY} was changed after the run: {remedy}")
