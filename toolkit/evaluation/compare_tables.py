"""Two tables of predictions by any program, compared as two runs are: labels are matched only where that is certain."""

import re
import unicodedata
from collections.abc import Iterable, Sequence
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
"""Names of columns, in any case, that other programs write; the first that is there is taken."""
YES = ("1", "true", "yes", "y", "right", "wahr", "vrai", "verdadero", "vero", "waar")
NO = ("0", "false", "no", "n", "wrong", "falsch", "faux", "falso", "onwaar")
"""In words also as spreadsheets write them in other languages."""
WHOLE_NUMBER = re.compile(r"(-?)0*(\d+)(?:\.0*)?", re.ASCII)
SUSPICIOUS = 0.001
"""Exact p below which labels that agree better when one counts from 1 are not taken to be mere mistakes."""
ADD_CORRECT = "write both in the same way, or add a column 'correct' with 1 or 0"


@dataclass(frozen=True)
class Answer:
    """One line of a table; texts are empty without their column.

    Attributes:
        truth, guess: as they stand in the table.
        is_right: what its column says, or its labels.
        cluster: what it shares with other images.
    """

    truth: str
    guess: str
    is_right: bool
    cluster: str = ""


@dataclass(frozen=True)
class AnswerTable:
    """What a table says of each image.

    Attributes:
        file: of the table.
        answers: by the image's name.
        cluster_by: the column that says what images share; empty without one.
        is_judged: whether a column says what is right; else its labels do.
        notes: how its labels were read.
    """

    file: Path
    answers: dict[str, Answer]
    cluster_by: str = ""
    is_judged: bool = True
    notes: tuple[str, ...] = ()

    @property
    def truths(self) -> set[str]:
        """Every true label, see `spell`."""
        return {spell(answer.truth) for answer in self.answers.values() if answer.truth}

    @property
    def guesses(self) -> set[str]:
        """Every predicted label, see `spell`."""
        return {spell(answer.guess) for answer in self.answers.values() if answer.guess}


def compare_tables(first: Path, second: Path, images: Path | None = None, cluster: str | None = None) -> RunComparison:
    """Compare two tables line by line. An image is the same if it has the same name in both.

    Labels are compared without regard to case, blanks, `-` and `_`. What else may differ in spelling is refused.

    Args:
        first, second: with a column that names the image, and one that says whether the answer is right, or two with
            the true and the predicted label. Their heads may be those of `IMAGE`, `RIGHT`, `TRUTH` and `GUESS`.
        images: folder that the names are relative to, for the pictures of what flipped; None: each table's own.
        cluster: column, of the first table, of what images share; None: one of `CLUSTER`, else the images' folders.

    Raises:
        ToolkitError: a file cannot be read, lacks a column, names an image twice, or says neither right nor wrong; its
            truth is written in another way than its predictions; the tables share no image, or give one another truth.
    """
    # clusters are read from the first table alone: an image shares with others what it shares, in either
    one, other = _read_table(Path(first), cluster), _read_table(Path(second), None)
    names = [name for name in one.answers if name in other.answers]
    if not names:
        raise ToolkitError(f"{first} and {second} share no image: expected the same names in both")
    for table, rival in ((one, other), (other, one)):
        _check_vocabulary(table, rival)
    notes = (*one.notes, *other.notes, *_compare_truths(one, other, names))
    folders = [images or table.file.parent for table in (one, other)]
    pairs = tuple(
        Pair(
            *(_predict(table.answers[name], folder, name) for table, folder in zip((one, other), folders, strict=True))
        )
        for name in names
    )
    clusters, by = _find_clusters(one, names)
    stems = [table.file.stem for table in (one, other)]
    labels = stems if stems[0] != stems[1] else [str(first), str(second)]
    runs = [Run(label, table.file.parent, "eval", ()) for label, table in zip(labels, (one, other), strict=True)]
    left = (len(one.answers) - len(pairs), len(other.answers) - len(pairs))
    row = Comparison(POOLED, POOLED, POOLED, POOLED, pairs)
    return RunComparison(
        runs[0], runs[1], pairs, (row,), left, clusters, cluster_by=by, notes=tuple(dict.fromkeys(notes))
    )


def spell(label: str) -> str:
    """A label as it is compared: a whole number without decimals, else in lower case, one blank for ` `, - and _."""
    number = WHOLE_NUMBER.fullmatch(label)
    return number[1] + number[2] if number else " ".join(plain_name(unicodedata.normalize("NFC", label)).split())


def _predict(said: Answer, folder: Path, name: str) -> Prediction:
    capture = Capture("table", POOLED, POOLED, None, _locate(folder, name), name)
    # rank 2 stands for any wrong answer: tables of other programs have no ranks
    return Prediction(capture, 0, "", top1_label=said.guess or None, true_rank=1 if said.is_right else 2)


def _locate(folder: Path, name: str) -> Path:
    """Where an image lies; the folder itself, which is no image, for a name that leads out of it."""
    try:
        return inside(folder, name)
    except ToolkitError:
        return folder


def _find_clusters(table: AnswerTable, names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """What each image shares with others, and what says so; empty where nothing does."""
    if table.cluster_by:
        return tuple(table.answers[name].cluster for name in names), f"column '{table.cluster_by}'"
    folders = tuple(str(PurePosixPath(name.replace("\\", "/")).parent) for name in names)
    # one folder tells no objects apart, and folders of one image join nothing
    return (folders, "the images' folders") if 1 < len(set(folders)) < len(folders) else ((), "")


def _read_table(file: Path, cluster: str | None) -> AnswerTable:
    _check_own(file)
    table = read_foreign_table(file)
    with without_collector():
        return _read_lines(table, cluster)


def _check_own(file: Path) -> None:
    """Refuse a table of one of our runs that is not the one that its summary was counted from."""
    summary = file.parent / SUMMARY
    if file.name not in TABLES.values() or not summary.is_file():
        return
    try:
        content = load_json(summary)
    except ToolkitError:  # another program's
        return
    if isinstance(content, dict):
        check_run(file.parent, content)


def _read_lines(table: ForeignTable, cluster: str | None) -> AnswerTable:
    file = table.file
    name_at, right_at = table.find(IMAGE), table.find(RIGHT)
    if name_at is None:
        found = _some(table.heads)
        raise ToolkitError(f"{file}: no column that names the image: expected one of {_some(IMAGE)}; found {found}")
    truth_at, guess_at = _choose_labels(table, by_name=right_at is not None)
    if right_at is None and (truth_at is None or guess_at is None):
        raise ToolkitError(
            f"{file}: expected a column {_some(RIGHT)}, or one of the truth ({_some(TRUTH)}) and one of the prediction "
            f"({_some(GUESS)}); found {_some(table.heads)}"
        )
    if cluster is not None and cluster.lower() not in table.heads:
        raise FieldError(f"{file} has no such column: expected one of {_some(table.heads, 12)}", {"cluster": cluster})
    cluster_at = table.find(CLUSTER if cluster is None else (cluster.lower(),))
    answers: dict[str, Answer] = {}
    for number, cells in table.lines:
        if len(cells) < len(table.heads):
            raise ToolkitError(f"{file}, line {number}: {len(cells)} cells: expected {len(table.heads)}")
        name = unicodedata.normalize("NFC", cells[name_at])
        if name in answers:
            raise ToolkitError(f"{file}, line {number}: image '{name}' appears twice: expected each once")
        truth, guess = (("" if at is None else table.plain(cells[at])) for at in (truth_at, guess_at))
        if right_at is None and not truth:
            raise ToolkitError(f"{file}, line {number}: image '{name}' has no true label: expected one in each line")
        is_right = right_at is not None and _read_right(table, number, cells[right_at])
        answers[name] = Answer(truth, guess, is_right, "" if cluster_at is None else cells[cluster_at])
    by = "" if cluster_at is None else table.heads[cluster_at]
    read = AnswerTable(file, answers, by)
    return read if right_at is not None else _match_labels(read)


def _choose_labels(table: ForeignTable, by_name: bool) -> tuple[int | None, int | None]:
    """The columns of truth and prediction: the first two that are both numbers or both names, else the first.

    With `by_name` names come first: they mean the same in two lists of labels, numbers do not. Else they come as they
    stand in `TRUTH`: two classes may share a name.
    """
    pairs = [(truth, guess) for truth in _list_columns(table, TRUTH) for guess in _list_columns(table, GUESS)]
    for truth, guess in sorted(pairs, key=lambda pair: by_name and _is_numeric(table, pair[0])):
        if _is_numeric(table, truth) == _is_numeric(table, guess):
            return truth, guess
    return pairs[0] if pairs else (table.find(TRUTH), table.find(GUESS))


def _list_columns(table: ForeignTable, names: Iterable[str]) -> list[int]:
    return [at for name in names if (at := table.find([name])) is not None]


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
    """The table with what is right by its labels.

    Raises:
        ToolkitError: two spellings of one label may be two labels, or labels agree only if one counts from 1.
    """
    is_exact = _has_two_spellings(table)
    key = (lambda label: label) if is_exact else spell
    matched = {
        name: replace(answer, is_right=key(answer.truth) == key(answer.guess)) for name, answer in table.answers.items()
    }
    _check_counting(table.file, matched)
    is_respelled = any(one.is_right and one.truth != one.guess for one in matched.values())
    notes = (f"{table.file.name}: labels are compared without regard to case, blanks, - and _",) if is_respelled else ()
    return replace(table, answers=matched, is_judged=False, notes=notes)


def _has_two_spellings(table: AnswerTable) -> bool:
    """Whether labels are told apart by case, blanks, - or _, as ImageNet's dog 'Cardigan' and jacket 'cardigan' are."""
    spellings: dict[str, tuple[set[str], set[str]]] = {}
    for answer in table.answers.values():
        for column, label in enumerate((answer.truth, answer.guess)):
            spellings.setdefault(spell(label), (set(), set()))[column].add(label)
    mixed = [both for both in spellings.values() if both[0] and max(map(len, both)) > 1]
    for truths, guesses in mixed:
        # certain only where both columns have the same spellings
        if truths != guesses:
            label, another, *_ = sorted(truths | guesses)
            raise ToolkitError(
                f"{table.file}: '{label}' and '{another}' stand in one column, and may be one label or two: "
                f"{ADD_CORRECT}"
            )
    return bool(mixed)


def _check_counting(file: Path, answers: dict[str, Answer]) -> None:
    """Refuse labels that agree much better where one of the columns counts from 1 and the other from 0."""
    numbers = [(spell(answer.truth), spell(answer.guess), answer.is_right) for answer in answers.values()]
    whole = [(int(truth), int(guess), is_right) for truth, guess, is_right in numbers if _are_whole(truth, guess)]
    if not whole or len(whole) < len(numbers):
        return
    for step in (1, -1):
        moved = [(is_right, truth == guess + step) for truth, guess, is_right in whole]
        gained, lost = sum(b and not a for a, b in moved), sum(a and not b for a, b in moved)
        if gained > lost and 2 * gained > len(whole) and mcnemar_p(gained, lost) < SUSPICIOUS:
            truth, guess = next((truth, guess) for truth, guess, _ in whole if truth == guess + step)
            raise ToolkitError(
                f"{file}: one column may count from 0 and the other from 1: the truth is '{truth}' where the "
                f"prediction is '{guess}' in {gained} of {len(whole)} lines: {ADD_CORRECT}"
            )


def _are_whole(*labels: str) -> bool:
    return all(label.removeprefix("-").isdecimal() and label.isascii() for label in labels)


def _check_vocabulary(table: AnswerTable, rival: AnswerTable) -> None:
    """Refuse a table in which no true label is ever predicted, unless the other one shows that its words are meant."""
    truths, guesses = table.truths, table.guesses
    if table.is_judged or not truths or not guesses or truths & guesses:
        return
    # a network may be wrong of every image: then its labels are those of the other's answers
    if truths & rival.guesses and guesses & (rival.truths | rival.guesses):
        return
    one = next(answer for answer in table.answers.values() if answer.truth and answer.guess)
    raise ToolkitError(
        f"{table.file}: no true label is ever predicted: the truth is written '{one.truth}', the prediction "
        f"'{one.guess}': {ADD_CORRECT}"
    )


def _compare_truths(first: AnswerTable, second: AnswerTable, names: Sequence[str]) -> list[str]:
    """A note where both tables have the same truths in other words.

    Raises:
        ToolkitError: the truth of an image differs.
    """
    both = [(name, first.answers[name].truth, second.answers[name].truth) for name in names]
    known = [(name, one, other) for name, one, other in both if one and other]
    apart = [(name, one, other) for name, one, other in known if spell(one) != spell(other)]
    if not apart:
        return []
    words = {(spell(one), spell(other)) for _, one, other in known}
    is_one_to_one = len({one for one, _ in words}) == len({other for _, other in words}) == len(words) > 1
    if is_one_to_one and _is_renumbered(words):
        one, other = apart[0][1:]
        return [
            f"the tables write labels in two ways, one to one: '{one}' in {first.file.name} is '{other}' in "
            f"{second.file.name}"
        ]
    name, one, other = apart[0]
    raise ToolkitError(
        f"the truth of '{name}' is '{one}' in {first.file} and '{other}' in {second.file} ({len(apart)} of "
        f"{len(known)} images differ): compare tables with the same true labels"
    )


def _is_renumbered(words: set[tuple[str, str]]) -> bool:
    """Whether one side writes numbers and the other names, or both numbers of which one side's count from 1."""
    kinds = {(_are_whole(one), _are_whole(other)) for one, other in words}
    if kinds == {(True, True)}:
        return {int(other) - int(one) for one, other in words} in ({1}, {-1})
    return kinds in ({(True, False)}, {(False, True)})


def _some(names: Sequence[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + ("…" if len(names) > most else "")
