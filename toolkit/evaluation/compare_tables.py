"""Compare two tables of predictions by any program as two runs: labels are matched only if that is certain."""

import re
import unicodedata
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from toolkit.captures.capture import Capture
from toolkit.captures.read import POOLED
from toolkit.core.child import without_collector
from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.files import inside, load_json
from toolkit.core.foreign_tables import ForeignTable, read_foreign_table
from toolkit.core.statistics import mcnemar_p
from toolkit.evaluation.compare import RunComparison
from toolkit.evaluation.metrics import Comparison, Pair
from toolkit.evaluation.prediction import Prediction
from toolkit.evaluation.run_files import SUMMARY, TABLES, check_run
from toolkit.evaluation.summaries import Run
from toolkit.models.labels import plain_name

IMAGE = ("image", "path", "file", "filename", "file_name", "image_path", "image_id", "name", "id")
RIGHT = ("correct", "correct_top1", "is_correct", "right")
TRUTH = ("true_index", "true_label", "true", "label", "target", "ground_truth", "gt", "y_true")
GUESS = ("top1_index", "top1_label", "predicted", "prediction", "pred", "y_pred")
CLUSTER = ("cluster", "group", "scene", "object")
"""Column names of other programs, in any case; the first that exists counts."""
YES = ("1", "true", "yes", "y", "right", "wahr", "vrai", "verdadero", "vero", "waar")
NO = ("0", "false", "no", "n", "wrong", "falsch", "faux", "falso", "onwaar")
"""Also as spreadsheets in other languages write them."""
WHOLE_NUMBER = re.compile(r"(-?)0*(\d+)(?:\.0*)?", re.ASCII)
SUSPICIOUS = 0.001
"""Exact p below which labels that agree better after a shift by 1 are refused, not counted as mistakes."""
ADD_CORRECT = "write both in the same way, or add a column 'correct' with 1 or 0"


@dataclass(frozen=True)
class Answer:
    """A line of a table; texts are empty without their column.

    Attributes:
        truth, guess: true and predicted label, as written in the table.
        is_right: whether the answer is correct, by its column or its labels.
    """

    truth: str
    guess: str
    is_right: bool
    cluster: str = ""


@dataclass(frozen=True)
class AnswerTable:
    """A table of answers.

    Attributes:
        answers: answers by image name.
        cluster_by: the column of the clusters; empty if there is none.
        is_judged: whether a column states which answers are correct; else labels are compared.
    """

    file: Path
    answers: dict[str, Answer]
    cluster_by: str = ""
    is_judged: bool = True
    notes: tuple[str, ...] = ()

    @property
    def truths(self) -> set[str]:
        """All true labels, see `spell`."""
        return {spell(answer.truth) for answer in self.answers.values() if answer.truth}

    @property
    def guesses(self) -> set[str]:
        """All predicted labels, see `spell`."""
        return {spell(answer.guess) for answer in self.answers.values() if answer.guess}


def compare_tables(first: Path, second: Path, images: Path | None = None, cluster: str | None = None) -> RunComparison:
    """Compare two tables line by line. Two images are the same if they have the same name.

    Labels are compared without case, blanks, `-` and `_`. Other differences in spelling are refused.

    Args:
        first, second: tables with a column `IMAGE`, and either a column `RIGHT` or columns `TRUTH` and `GUESS`.
        images: folder that image names are relative to, for pictures of the flips; by default each table's folder.
        cluster: cluster column of the first table; by default a column `CLUSTER`, else the images' folders.

    Raises:
        ToolkitError: a file cannot be read, lacks a column, names an image twice, or a cell is neither right nor wrong;
            truth and predictions are written differently; the tables share no image, or differ in the truth.
    """
    # clusters of the first table hold for both
    table_a, table_b = _read_table(Path(first), cluster), _read_table(Path(second), None)
    names = [name for name in table_a.answers if name in table_b.answers]
    if not names:
        raise ToolkitError(f"{first} and {second} share no image: expected the same names in both")
    for table, rival in ((table_a, table_b), (table_b, table_a)):
        _check_vocabulary(table, rival)
    notes = (*table_a.notes, *table_b.notes, *_compare_truths(table_a, table_b, names))
    # pair the images by name
    folders = [images or table.file.parent for table in (table_a, table_b)]
    pairs = tuple(
        Pair(_predict(table_a.answers[name], folders[0], name), _predict(table_b.answers[name], folders[1], name))
        for name in names
    )
    # folders are clusters unless there is a column; a single folder, or a folder for each image, clusters nothing
    clusters, by = tuple(str(PurePosixPath(name.replace("\\", "/")).parent) for name in names), "the images' folders"
    if table_a.cluster_by:
        clusters, by = tuple(table_a.answers[name].cluster for name in names), f"column '{table_a.cluster_by}'"
    elif not 1 < len(set(clusters)) < len(clusters):
        clusters, by = (), ""
    # names of the two tables
    stems = [table.file.stem for table in (table_a, table_b)]
    labels = stems if stems[0] != stems[1] else [str(first), str(second)]
    runs = [Run(label, table.file.parent, "eval", ()) for label, table in zip(labels, (table_a, table_b), strict=True)]
    left = (len(table_a.answers) - len(pairs), len(table_b.answers) - len(pairs))
    row = Comparison(POOLED, POOLED, POOLED, POOLED, pairs)
    return RunComparison(
        runs[0], runs[1], pairs, (row,), left, clusters, cluster_by=by, notes=tuple(dict.fromkeys(notes))
    )


def spell(label: str) -> str:
    """Return a label as it is compared: a whole number without decimals, else in lower case, - and _ as blanks."""
    number = WHOLE_NUMBER.fullmatch(label)
    return number[1] + number[2] if number else " ".join(plain_name(unicodedata.normalize("NFC", label)).split())


def _predict(said: Answer, folder: Path, name: str) -> Prediction:
    file = folder
    with suppress(ToolkitError):  # a name that leads out of the folder has no image
        file = inside(folder, name)
    capture = Capture("table", POOLED, POOLED, None, file, name)
    # rank 2 stands for any wrong answer: tables of other programs have no ranks
    return Prediction(capture, 0, "", top1_label=said.guess or None, true_rank=1 if said.is_right else 2)


def _read_table(file: Path, cluster: str | None) -> AnswerTable:
    summary, content = file.parent / SUMMARY, None
    if file.name in TABLES.values() and summary.is_file():
        with suppress(ToolkitError):  # of another program
            content = load_json(summary)
    # refuse a table of a run of ours that was changed since its summary was counted
    if isinstance(content, dict):
        check_run(file.parent, content)
    table = read_foreign_table(file)
    with without_collector():
        return _read_lines(table, cluster)


def _read_lines(table: ForeignTable, cluster: str | None) -> AnswerTable:
    file = table.file
    # columns
    name_at, right_at = table.find(IMAGE), table.find(RIGHT)
    if name_at is None:
        found = _some(table.heads)
        raise ToolkitError(f"{file}: no column of image names: expected one of {_some(IMAGE)}; found {found}")
    truth_at, guess_at = _choose_labels(table, by_name=right_at is not None)
    if right_at is None and (truth_at is None or guess_at is None):
        raise ToolkitError(
            f"{file}: expected a column {_some(RIGHT)}, or columns of the truth ({_some(TRUTH)}) and the prediction "
            f"({_some(GUESS)}); found {_some(table.heads)}"
        )
    if cluster is not None and cluster.lower() not in table.heads:
        raise FieldError(f"{file} has no such column: expected one of {_some(table.heads, 12)}", {"cluster": cluster})
    cluster_at = table.find(CLUSTER if cluster is None else (cluster.lower(),))
    # an image's line by its name: the order of lines does not count
    answers: dict[str, Answer] = {}
    # lines
    for number, cells in table.lines:
        if len(cells) < len(table.heads):
            raise ToolkitError(f"{file}, line {number}: {len(cells)} cells: expected {len(table.heads)}")
        name = unicodedata.normalize("NFC", cells[name_at])
        if name in answers:
            raise ToolkitError(f"{file}, line {number}: image '{name}' appears twice: expected each image once")
        truth, guess = (("" if at is None else table.plain(cells[at])) for at in (truth_at, guess_at))
        if right_at is None and not truth:
            raise ToolkitError(f"{file}, line {number}: image '{name}' has no true label: add it")
        is_right = right_at is not None and _read_right(table, number, cells[right_at])
        answers[name] = Answer(truth, guess, is_right, "" if cluster_at is None else cells[cluster_at])
    by = "" if cluster_at is None else table.heads[cluster_at]
    read = AnswerTable(file, answers, by)
    # without a column of correct answers the labels must be compared
    return read if right_at is not None else _match_labels(read)


def _choose_labels(table: ForeignTable, by_name: bool) -> tuple[int | None, int | None]:
    """Return the columns of truth and prediction: the first two that are both numbers or both names, else the first.

    With `by_name` names come first: unlike numbers, they mean the same in two lists of labels. Otherwise the order is
    that of `TRUTH`: two classes may share a name.
    """
    # every pair of columns that may state truth and answer
    truths, guesses = ([at for name in names if (at := table.find([name])) is not None] for names in (TRUTH, GUESS))
    pairs = [(truth, guess) for truth in truths for guess in guesses]
    for truth, guess in sorted(pairs, key=lambda pair: by_name and _is_numeric(table, pair[0])):
        if _is_numeric(table, truth) == _is_numeric(table, guess):
            return truth, guess
    return pairs[0] if pairs else (table.find(TRUTH), table.find(GUESS))


def _is_numeric(table: ForeignTable, at: int) -> bool:
    return all(table.number(cells[at]) is not None for _, cells in table.lines[:1000] if len(cells) > at and cells[at])


def _read_right(table: ForeignTable, number: int, cell: str) -> bool:
    value, amount = cell.lower(), table.number(cell)
    if amount in (0.0, 1.0):
        return amount == 1.0
    if value not in YES + NO:
        raise ToolkitError(f"{table.file}, line {number}: expected 1 or 0, or true or false, found '{cell[:40]}'")
    return value in YES


def _match_labels(table: AnswerTable) -> AnswerTable:
    """Return the table with correct answers found by comparing labels; a `ToolkitError` if that is not certain."""
    is_exact = _has_two_spellings(table)
    key = (lambda label: label) if is_exact else spell
    matched = {
        name: replace(answer, is_right=key(answer.truth) == key(answer.guess)) for name, answer in table.answers.items()
    }
    _check_counting(table.file, matched)
    is_respelled = any(answer.is_right and answer.truth != answer.guess for answer in matched.values())
    notes = (f"{table.file.name}: labels are compared without regard to case, blanks, - and _",) if is_respelled else ()
    return replace(table, answers=matched, is_judged=False, notes=notes)


def _has_two_spellings(table: AnswerTable) -> bool:
    """Whether labels differ only in case, blanks, - or _, as ImageNet's dog 'Cardigan' and jacket 'cardigan' do."""
    # spellings of each label, in the truths and in the predictions
    spellings: dict[str, tuple[set[str], set[str]]] = {}
    for answer in table.answers.values():
        for column, label in enumerate((answer.truth, answer.guess)):
            spellings.setdefault(spell(label), (set(), set()))[column].add(label)
    mixed = [both for both in spellings.values() if both[0] and max(map(len, both)) > 1]
    for truths, guesses in mixed:
        # certain only if both columns have the same spellings
        if truths != guesses:
            label, another, *_ = sorted(truths | guesses)
            raise ToolkitError(
                f"{table.file}: '{label}' and '{another}' may be the same label or two labels: {ADD_CORRECT}"
            )
    return bool(mixed)


def _check_counting(file: Path, answers: dict[str, Answer]) -> None:
    """Refuse labels that agree much better if one column counts from 1 and the other from 0."""
    numbers = [(spell(answer.truth), spell(answer.guess), answer.is_right) for answer in answers.values()]
    # only if every label is a whole number
    whole = [(int(truth), int(guess), is_right) for truth, guess, is_right in numbers if _are_whole(truth, guess)]
    if not whole or len(whole) < len(numbers):
        return
    # a paired test of the labels as they are against shifted labels
    for step in (1, -1):
        moved = [(is_right, truth == guess + step) for truth, guess, is_right in whole]
        gained, lost = sum(b and not a for a, b in moved), sum(a and not b for a, b in moved)
        if gained > lost and 2 * gained > len(whole) and mcnemar_p(gained, lost) < SUSPICIOUS:
            truth, guess = next((truth, guess) for truth, guess, _ in whole if truth == guess + step)
            raise ToolkitError(
                f"{file}: one column may count from 0 and the other from 1: the truth is '{truth}' and the prediction "
                f"'{guess}', and so in {gained} of {len(whole)} lines: {ADD_CORRECT}"
            )


def _are_whole(*labels: str) -> bool:
    return all(label.removeprefix("-").isdecimal() and label.isascii() for label in labels)


def _check_vocabulary(table: AnswerTable, rival: AnswerTable) -> None:
    """Refuse a table in which no true label is ever predicted, unless the other table uses the same words."""
    truths, guesses = table.truths, table.guesses
    if table.is_judged or not truths or not guesses or truths & guesses:
        return
    # a network may be wrong on every image: then the other table's predictions have its labels
    if truths & rival.guesses and guesses & (rival.truths | rival.guesses):
        return
    answer = next(answer for answer in table.answers.values() if answer.truth and answer.guess)
    raise ToolkitError(
        f"{table.file}: no true label is ever predicted: the truth is written '{answer.truth}', the prediction "
        f"'{answer.guess}': {ADD_CORRECT}"
    )


def _compare_truths(first: AnswerTable, second: AnswerTable, names: Sequence[str]) -> list[str]:
    """Return a note if the tables write the same truths in two ways; a `ToolkitError` if the truth differs."""
    both = [(name, first.answers[name].truth, second.answers[name].truth) for name in names]
    # only images for which both tables state the truth
    known = [(name, truth, other_truth) for name, truth, other_truth in both if truth and other_truth]
    apart = [(name, truth, other_truth) for name, truth, other_truth in known if spell(truth) != spell(other_truth)]
    if not apart:
        return []
    # a one-to-one renaming of labels is no contradiction
    words = {(spell(truth), spell(other_truth)) for _, truth, other_truth in known}
    is_one_to_one = (
        len({truth for truth, _ in words}) == len({other_truth for _, other_truth in words}) == len(words) > 1
    )
    if is_one_to_one and _is_renumbered(words):
        truth, other_truth = apart[0][1:]
        return [
            f"the tables write the same labels in two ways: '{truth}' in {first.file.name} is '{other_truth}' in "
            f"{second.file.name}"
        ]
    name, truth, other_truth = apart[0]
    raise ToolkitError(
        f"the truth of '{name}' is '{truth}' in {first.file} and '{other_truth}' in {second.file} ({len(apart)} of "
        f"{len(known)} images differ): compare tables with the same true labels"
    )


def _is_renumbered(words: set[tuple[str, str]]) -> bool:
    """Whether labels are numbers against names, or numbers that count from 0 against numbers that count from 1."""
    kinds = {(_are_whole(truth), _are_whole(other)) for truth, other in words}
    if kinds == {(True, True)}:
        return {int(other) - int(truth) for truth, other in words} in ({1}, {-1})
    return kinds in ({(True, False)}, {(False, True)})


def _some(names: Sequence[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + ("…" if len(names) > most else "")
