"""The folder of a run: no result is written over another one, and a file that was changed afterwards is found."""

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
"""Field of the summary -> the table whose hash it holds."""
CONTENT = "content_sha256"
"""Hash of all other fields of a summary."""
IsFree = Callable[[Path], bool]


def find_run_dir(wanted: Path, is_free: IsFree, overwrite: bool = False) -> Path:
    """`wanted`, or the first of RUN-2, RUN-3 … that may be written to: it holds no result, or this one."""
    number, folder = 1, wanted
    while not overwrite and not is_free(folder):
        number += 1
        folder = wanted.with_name(f"{wanted.name}-{number}")
    return folder


def lacks_other_table(name: str, text: str) -> IsFree:
    """Whether a folder has no such table, or one of this very content."""
    content = text.encode()
    return lambda folder: not (folder / name).is_file() or (folder / name).read_bytes() == content


def lacks_other_inputs(key: str) -> IsFree:
    """Whether a folder holds no finished run, or one that was asked to do the same, by its key."""
    return lambda folder: not (folder / SUMMARY).is_file() or _read_key(folder / SUMMARY) == key


def _read_key(summary: Path) -> object:
    content = load_json(summary)
    return content.get(INPUTS) if isinstance(content, dict) else None


def explain_run_dir(wanted: Path, found: Path) -> tuple[str, ...]:
    """A note where a run could not be called as it was meant to be."""
    return () if found == wanted else (f"{wanted} holds another result, and stays as it is",)


def write_run(run_dir: Path, summary: Mapping[str, Any], tables: Mapping[str, str]) -> dict[str, Any]:
    """Write the tables of a run and last its `summary.json`, which holds their hashes and its own.

    Args:
        run_dir: from `find_run_dir`.
        summary: all else that the summary holds.
        tables: text of each file by its name.

    Returns:
        The summary as it was written.

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
    """SHA-256 of all fields of a summary but this hash, however they are laid out in the file."""
    fields = {key: value for key, value in content.items() if key != CONTENT}
    return sha256_json(fields)


def check_run(folder: Path, content: Mapping[str, Any]) -> None:
    """Refuse a run of which a file was changed after it was written; older runs hold no hashes, and pass.

    Raises:
        ToolkitError: a table is not the one that was counted, or the summary is not the one that was written.
    """
    remedy = "undo the change, or make the run again"
    for field, name in TABLES.items():
        file = folder / name
        if content.get(field) is not None and file.is_file() and sha256_file(file) != content[field]:
            raise ToolkitError(f"{file} was changed after {SUMMARY} was counted from it: {remedy}")
    if content.get(CONTENT) is not None and hash_summary(content) != content[CONTENT]:
        raise ToolkitError(f"{folder / SUMMARY} was changed after the run: {remedy}")
