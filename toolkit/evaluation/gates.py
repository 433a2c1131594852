"""Photographs that failed a gate when they were imported or checked: marked, and what the result is without them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from toolkit.captures.read import Capture, CaptureFolder
from toolkit.core.files import sha256_file
from toolkit.core.tables import format_test
from toolkit.evaluation.metrics import Comparison


def mark_failed_gates(folder: CaptureFolder) -> CaptureFolder:
    """The captures, each with the gates that its photograph failed, as `gates.jsonl` of its source has them.

    A line counts only for the very file that was judged; of several the last.
    """
    from toolkit.photos.gates.check_captures import CheckLine, open_gates_log

    logs: dict[Path, dict[str, CheckLine]] = {}
    captures: list[Capture] = []
    for one in folder.captures:
        source_dir = one.file.parents[one.path_in_source.count("/")]
        if source_dir not in logs:
            logs[source_dir] = {f"{line.path} {line.image_sha256}": line for line in open_gates_log(source_dir).read()}
        judged = {key.rpartition(" ")[0] for key in logs[source_dir]}
        if one.refused is None and one.path_in_source in judged and one.file.is_file():
            line = logs[source_dir].get(f"{one.path_in_source} {sha256_file(one.file)}")
            failed = [gate for gate in line.results if gate.failed] if line else []
            words = [f"{gate.name} {gate.value:.3g} {gate.unit}" for gate in failed]
            one = replace(one, failed_gates=tuple(words))
        captures.append(one)
    return replace(folder, captures=tuple(captures))


def describe_both(all_of_it: Sequence[Comparison], passed: Sequence[Comparison], n_failed: dict[str, int]) -> list[str]:
    """For each source with failed photographs, each pooled comparison with them and without them, one line each."""
    without = {(row.source, row.object, row.second): row for row in passed}
    lines = []
    for row in all_of_it:
        if row.object != "all" or not n_failed.get(row.source):
            continue
        other = without.get((row.source, row.object, row.second))
        rest = "no pair is left" if other is None else _describe(other)
        lines.append(
            f"{row.source}: {n_failed[row.source]} photograph{'s' if n_failed[row.source] > 1 else ''} failed a gate. "
            f"{row.second} with them: "
            f"{_describe(row)}; without them: {rest}"
        )
    return lines


def _describe(row: Comparison) -> str:
    found = row.outcomes
    shares = f"{found.n_first}/{found.n} right bare, {found.n_second}/{found.n} with it"
    return f"{shares}, {found.only_second} gained, {found.only_first} lost ({format_test(found.mcnemar_p)})"
