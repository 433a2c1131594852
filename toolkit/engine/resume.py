"""The one loop over units of work: what is missing is done, kept as it comes, and given up where nothing works."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby, islice
from typing import Generic, TypeVar

from toolkit.core.console import Ticker, progress
from toolkit.core.errors import ToolkitError
from toolkit.core.records import Record, RecordLog
from toolkit.engine.units import Engine, Result, Unit, Value

Key = TypeVar("Key", bound=Hashable)
Item = TypeVar("Item")

GIVE_UP_AFTER = 3
"""Where the first units all fail for one reason, the fault lies in the run, not in a unit: so many are tried."""


class RecordCache(Generic[Key, Value, Record]):
    """Finished work, in memory and in a log that runs may share.

    Attributes:
        known: what the last record of each key says.
    """

    def __init__(
        self, log: RecordLog[Record], entries: Callable[[Record], Iterable[tuple[Key, Value]]], wanted: Collection[Key]
    ) -> None:
        """Read from the log the entries, (key, value), that are wanted; raises as `RecordLog.read`."""
        self._log, self._entries = log, entries
        self.known = {key: value for record in log.read() for key, value in entries(record) if key in wanted}

    def find_missing(self, wanted: Mapping[Key, Item]) -> dict[Key, Item]:
        """What has no record yet, in order."""
        return {key: item for key, item in wanted.items() if key not in self.known}

    def add(self, *records: Record) -> None:
        """Append to the log; raises as `RecordLog.append`."""
        self._log.append(*records)
        self.known |= {key: value for record in records for key, value in self._entries(record)}


@dataclass(frozen=True)
class Ran:
    """What a run did.

    Attributes:
        made, kept: what was done now, and what was there before, as `weigh` counts it.
        failed: (name, reason) of units that failed; the next run tries them again.
    """

    made: int
    kept: int
    failed: tuple[tuple[str, str], ...]


def run_resumable(
    title: str, wanted: Mapping[Key, Item], missing: Mapping[Key, Item], units: Iterable[Unit[Result]],
    keep: Callable[[Key, Item, Result], None], engine: Engine, weigh: Callable[[Item], int] = lambda item: 1,
) -> Ran:  # fmt: skip
    """Do what is missing.

    A result is kept before the next one is taken, so a run that was stopped goes on where it was, on any engine. A
    unit fails alone: the others are done.

    Args:
        title: of the progress bar.
        wanted: all items of the run, by what tells their results from all others, such as a hash of the inputs.
        missing: those that are to be done now.
        units: of the missing ones; only read where there are some, and no faster than the engine takes them.
        keep: puts an item's result on disk.
        engine: does the units.
        weigh: how much an item counts on the progress bar.

    Raises:
        ToolkitError: the first units all failed for one reason, nothing could be done, or the disk is full.
    """
    todo, total = sum(map(weigh, missing.values())), sum(map(weigh, wanted.values()))
    failed: list[tuple[str, str]] = []
    made = 0
    with progress(title, total, done=total - todo) as bar:
        for outcome in engine.run(_tell(units, bar) if missing else ()):
            if outcome.result is None:
                failed.append((outcome.unit.name, outcome.reason))
                # one reason for all: a unit of its own kind may fail, and the run goes on
                if not made and len(failed) == GIVE_UP_AFTER and len({reason for _, reason in failed}) == 1:
                    raise ToolkitError(outcome.reason)
                continue
            item = missing[outcome.key]
            keep(outcome.key, item, outcome.result)
            # after `keep`: what the bar counts is on disk
            made += weigh(item)
            bar.advance(weigh(item), note=outcome.unit.name)
    if failed and not made and todo == total:
        raise ToolkitError(failed[0][1])
    return Ran(made, total - todo, tuple(failed))


def _tell(units: Iterable[Unit[Result]], bar: Ticker) -> Iterator[Unit[Result]]:
    """The units, each named on the bar as it is begun."""
    bar.advance(0, note="preparing")
    for unit in units:
        bar.advance(0, note=unit.name)
        yield unit


def cut_groups(
    items: Mapping[Key, Item], group: Callable[[Item], Hashable], size: int
) -> Iterator[tuple[tuple[Key, ...], list[Item]]]:
    """Keys and items of units: at most `size` that follow each other and are of one group."""
    for _, own in groupby(items.items(), key=lambda pair: group(pair[1])):
        while some := list(islice(own, size)):
            yield tuple(key for key, _ in some), [item for _, item in some]
