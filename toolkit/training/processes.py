"""Training by the processes that torchrun started: each takes its share of a batch, and their gradients are averaged.

The number of this process is ambient, as progress is. A single process is the first, and nothing is shared. The
first process reads and renders, then the others follow with the same command, and find what it has made. It
alone says something and writes.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from datetime import timedelta
from io import StringIO
from time import sleep
from typing import TypeVar

from toolkit.core.errors import FieldError, ToolkitError
from toolkit.core.lazy import np, torch

MEETING_S = 300.0
"""How long processes wait for each other at the start."""
LONGEST_STEP = timedelta(hours=12)
"""And later: while the first process reads its data, or judges what it has trained."""
POLL_S = 0.2
LAUNCHED = "TORCHELASTIC_RUN_ID"
"""Torchrun's mark in the environment."""
FOLLOW, END = "follow", "end"
Found = TypeVar("Found")
Batch = TypeVar("Batch", "torch.Tensor", "np.ndarray")


class EndedElsewhere(ToolkitError):
    """Another process has ended the training, and says why."""


@dataclass(frozen=True)
class Processes:
    """The processes that train together, and the number of this process.

    Attributes:
        rank: its number, from 0.
        count: of all.
    """

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:
        """Whether it reads, writes and speaks for all."""
        return self.rank == 0

    def part(self, items: int) -> slice:
        """Which items of a batch are this process's: as many as everyone's.

        Raises:
            FieldError: they cannot be divided.
        """
        if items % self.count:
            raise FieldError(f"expected a multiple of {self.count}, the processes that share it", {"batch": items})
        size = items // self.count
        return slice(self.rank * size, (self.rank + 1) * size)

    def share(self, batch: "Batch") -> "Batch":
        """This process's part of a batch."""
        return batch if self.count == 1 else batch[self.part(len(batch))]

    def average(self, tensors: "Sequence[torch.Tensor]") -> None:
        """Put the mean over all processes into tensors of the same type and device."""
        if self.count == 1:
            return
        # a single message for all tensors: many small messages cost more than their bytes
        joined = torch.cat([tensor.reshape(-1) for tensor in tensors])
        with _explained():
            torch.distributed.all_reduce(joined)
        joined /= self.count
        for tensor, mean in zip(tensors, joined.split([tensor.numel() for tensor in tensors]), strict=True):
            tensor.copy_(mean.view(tensor.shape))

    def average_figures(self, figures: dict[str, float]) -> dict[str, float]:
        """The mean of each over all processes."""
        if self.count == 1:
            return figures
        values = torch.tensor(list(figures.values()), dtype=torch.float64)
        self.average([values])
        return dict(zip(figures, values.tolist(), strict=True))

    def add(self, tensor: "torch.Tensor") -> "torch.Tensor":
        """The sum over all processes."""
        if self.count == 1:
            return tensor
        joined = tensor.detach().clone()
        with _explained():
            torch.distributed.all_reduce(joined)
        return joined

    def ask_first(self, find: "Callable[[], Found]") -> "Found":
        """Let the first process find something alone, and return it in all."""
        if self.count == 1:
            return find()
        told: list[Found | None] = [None]
        if self.is_first:
            with _be(ALONE):
                # alone: what it calls may share nothing, as the others do not take part
                told = [find()]
        with _explained():
            torch.distributed.broadcast_object_list(told, src=0)
            torch.distributed.all_reduce(torch.zeros(1))  # the first may end after this: nobody is left without it
        return told[0]  # type: ignore[return-value]

    def act_first(self, act: Callable[[], None]) -> None:
        """Do something in the first process, alone, where the others need not wait for it."""
        if self.is_first:
            with _be(ALONE):
                act()

    def copy_first(self, tensors: "Sequence[torch.Tensor]") -> None:
        """Put the first process's values into tensors."""
        if self.count == 1:
            return
        with torch.no_grad():
            for tensor in tensors:
                told = tensor.detach().contiguous()
                with _explained():
                    torch.distributed.broadcast(told, src=0)
                tensor.copy_(told)

    def check(self, batch: int, device: "torch.device") -> None:
        """Refuse a training that they cannot share.

        Args:
            batch: items of a step; 0: nothing of it can be shared.
            device: where it is trained.

        Raises:
            ToolkitError: it cannot be shared, or so many processes have no GPU each.
        """
        if not batch:
            raise ToolkitError("this training cannot be shared by processes: start it without torchrun")
        # the batch must be divisible by the number of processes
        self.part(batch)
        if device.type == "cuda":
            here, devices = int(os.environ["LOCAL_WORLD_SIZE"]), torch.cuda.device_count()
            if here > devices:
                raise FieldError(
                    f"{here} processes on a machine with {devices} GPU: start as many as it has, or take cpu",
                    {"device": "cuda"},
                )


ALONE = Processes()
_current = ALONE
_meeting: "_Meeting | None" = None


def current() -> Processes:
    """Return the processes that train, with this process among them."""
    return _current


@contextmanager
def _be(processes: Processes) -> Iterator[None]:
    global _current
    before, _current = _current, processes
    try:
        yield
    finally:
        _current = before


class _Meeting:
    """The first process's messages to the others: follow to its next training, or end."""

    def __init__(self, store: "torch.distributed.Store") -> None:
        self._store, self._number = store, 0

    def tell(self, word: str) -> None:
        """Say what comes next; the first process does."""
        # numbered: a word that is not yet heard is not written over
        self._store.set(f"next {self._number}", word)
        self._number += 1

    def listen(self) -> None:
        """Wait for it; the others do.

        Raises:
            SystemExit: the first process has ended.
        """
        key = f"next {self._number}"
        self._number += 1
        with _explained():
            while not self._store.check([key]):
                sleep(POLL_S)
            if self._store.get(key).decode() == END:
                raise SystemExit(0)


def lead() -> None:
    """Let the others follow to the training that begins now; called by the first process."""
    if _meeting is not None and _current.count > 1:
        _meeting.tell(FOLLOW)


def follow() -> None:
    """Wait until the first process begins another training; called by the others, which end where it does not."""
    if _meeting is not None and not _current.is_first:
        _meeting.listen()


@contextmanager
def joined() -> Iterator[None]:
    """Within, this process belongs to those that torchrun started; without several processes nothing changes.

    Raises:
        ToolkitError: they do not find each other.
    """
    global _meeting
    if LAUNCHED not in os.environ or int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield
        return
    processes, _meeting = _meet()
    try:
        with _be(processes):
            if processes.is_first:
                yield
            else:
                from toolkit.core.console import quietly

                # the others work in silence: only the first process prints and writes
                with quietly(), redirect_stdout(StringIO()):
                    follow()
                    yield
    except EndedElsewhere as error:
        raise error if processes.is_first else SystemExit(1) from None
    except KeyboardInterrupt:
        raise KeyboardInterrupt if processes.is_first else SystemExit(1) from None
    finally:
        if processes.is_first:
            # the store may be gone with a process that died
            with suppress(RuntimeError):
                _meeting.tell(END)
        _meeting = None


def _meet() -> tuple[Processes, _Meeting]:
    from torch import distributed

    where = ":".join(os.environ.get(name, "?") for name in ("MASTER_ADDR", "MASTER_PORT"))
    has_gpu = torch.cuda.is_available()
    if has_gpu:
        # a separate device for each process, by its number on this machine
        torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")) % torch.cuda.device_count())
    try:
        found, rank, count = next(distributed.rendezvous("env://", timeout=timedelta(seconds=MEETING_S)))
        # our own keys beside torch's
        store = distributed.PrefixStore("toolkit", found)
        # figures travel on the CPU also where gradients are on GPUs
        backend = "cpu:gloo,cuda:nccl" if has_gpu else "gloo"
        distributed.init_process_group(backend, store=store, rank=rank, world_size=count, timeout=LONGEST_STEP)
    except (RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise ToolkitError(
            f"the processes cannot connect at {where} ({reason}): start all of them by torchrun"
        ) from None
    return Processes(rank, count), _Meeting(store)


@contextmanager
def _explained() -> Iterator[None]:
    """Torch's word for a process that is gone becomes ours."""
    try:
        yield
    except RuntimeError as error:
        reason = str(error).splitlines()[0]
        raise EndedElsewhere(f"another process of this training has ended: see what it says ({reason})") from None
