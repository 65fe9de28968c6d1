"""Generates environments in memory, or day by day into a folder; an interrupted folder can be resumed."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, TypeVar

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from geo.seeds import root_seed, stream
from geo.system import NotEnoughMemoryError, require_memory
from sensors.dynamics.continuous import Course
from sensors.dynamics.epidemic import MAX_DAYS, simulate_outbreak
from sensors.dynamics.infection import FRONT_BYTES_A_CELL
from sensors.environment.environment import Environment, Provenance
from sensors.environment.storage import load_environment, stored_environment, unfinished_store
from sensors.environment.store import EnvironmentStore, Header
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS, Field, FieldSet

if TYPE_CHECKING:
    from geo.grid import FarmGrid

T = TypeVar("T")
Progress = Callable[[int, int], None]

# Environments of smaller farms are generated faster than threads start.
_THREADS_FROM_CELLS = 1_000_000
_POLL_S = 0.05
_OUTBREAKS_AT_ONCE = 2


class StoppedError(Exception):
    """Exception that ends a thread after the generation was stopped."""


class _Steps:
    """Progress counter; any thread counts finished pieces, and the caller's thread reports the count."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self._done, self._reported, self._total, self._progress = 0, 0, total, progress
        self._lock = threading.Lock()
        self._caller = threading.get_ident()
        self.stopped = threading.Event()

    def __call__(self, pieces: int = 1) -> None:
        if self.stopped.is_set():
            raise StoppedError
        with self._lock:
            self._done += pieces
        if threading.get_ident() == self._caller:
            self.report()

    def report(self) -> None:
        """Call the caller's progress function if more pieces are finished than at the last report."""
        done = self._done
        if self._progress is not None and done > self._reported:
            self._reported = done
            self._progress(done, self._total)

    def wait(self, future: Future[T]) -> T:
        """Report progress while waiting for a future, and return the future's result."""
        while not future.done():
            wait([future], timeout=_POLL_S)
            self.report()
        return future.result()


@dataclass(frozen=True, slots=True)
class Task:
    """The inputs from which an environment is generated; equal tasks give equal environments."""

    grid: FarmGrid
    days: tuple[int, ...]
    """The days to keep, ascending."""
    seed: SeedSequence
    fields: FieldSet
    farm_name: str = ""

    @property
    def shape(self) -> tuple[int, int]:
        """Width and height of the farm in cells."""
        return int(self.grid.shape[0]), int(self.grid.shape[1])

    def header(self) -> Header:
        """Return the header for the store of the environment."""
        return Header.of(self.shape, self.days, self.fields, self.provenance())

    def provenance(self) -> Provenance:
        """Return the provenance of the environment."""
        return Provenance.of(self.grid, self.seed, self.farm_name)


def make_task(
    grid: FarmGrid,
    *,
    days: int = 15,
    seed: SeedSequence | int,
    fields: FieldSet = PAPER_FIELDS,
    keep_days: Iterable[int] | None = None,
    farm_name: str = "",
) -> Task:
    """Return a task after checking it; parameters as in `generate_environment`."""
    return Task(grid, kept_days(days, keep_days), root_seed(seed), fields, farm_name)


def kept_days(days: int, keep_days: Iterable[int] | None) -> tuple[int, ...]:
    """Check the days to keep, and return them in ascending order; None stands for all days, 0..days."""
    if not 0 <= days <= MAX_DAYS:
        raise EnvironmentDataError(f"environment: day {days} is not in 0..{MAX_DAYS}; give an earlier day")
    kept = tuple(range(days + 1)) if keep_days is None else tuple(sorted({int(day) for day in keep_days}))
    if not kept:
        raise EnvironmentDataError("environment: keep_days is empty; keep at least one day")
    if kept[0] < 0 or kept[-1] > days:
        raise EnvironmentDataError(f"environment: keep_days {kept[0]}..{kept[-1]} are not in 0..{days}")
    return kept


def memory_needed(
    shape: tuple[int, int],
    days: int,
    *,
    fields: FieldSet = PAPER_FIELDS,
    on_disk: bool = False,
    threads: int | None = None,
) -> dict[str, int]:
    """Return an estimate of the peak memory that a generation needs, in bytes by purpose.

    Examples
    --------
    >>> sum(memory_needed((6000, 5000), 16, on_disk=True, threads=1).values()) / 1e9
    0.96
    """
    cells = shape[0] * shape[1]
    diseases, continuous = len(fields.diseases), len(fields.continuous)
    at_once = min(diseases, _OUTBREAKS_AT_ONCE if _thread_count(cells, threads) > 1 else 1)
    # Memory holds two days, filled in turn, and a day's compressed chunks before and after they are joined.
    levels = cells * (2 * 4 + 2 * 4) * min(continuous, 1) if on_disk else cells * 4 * days * continuous
    # A disease needs memory for onsets, host mask, front, and lists of the cells near infected cells.
    outbreaks = cells * (diseases + at_once * (1 + FRONT_BYTES_A_CELL + 4))
    return {"continuous fields": levels, "diseases": outbreaks}


def check_memory(task: Task, *, on_disk: bool, threads: int | None = None) -> None:
    """Raise NotEnoughMemoryError with advice if generating needs more memory than is available."""
    shape, days = task.shape, len(task.days)
    try:
        require_memory(
            f"environment: generating {days} days of {shape[0]} x {shape[1]} cells",
            memory_needed(shape, days, fields=task.fields, on_disk=on_disk, threads=threads),
        )
    except NotEnoughMemoryError as error:
        advice = "take a smaller farm" if on_disk else "keep fewer days, or generate into a folder"
        raise NotEnoughMemoryError(f"{error}; {advice}") from None


def _thread_count(cells: int, threads: int | None) -> int:
    if cells < _THREADS_FROM_CELLS:
        return 1
    if threads is None:
        from joblib import cpu_count

        return int(cpu_count())
    return max(1, threads)


def generate_environment(
    grid: FarmGrid,
    *,
    days: int = 15,
    seed: SeedSequence | int,
    fields: FieldSet = PAPER_FIELDS,
    progress: Progress | None = None,
    keep_days: Iterable[int] | None = None,
    farm_name: str = "",
    directory: str | os.PathLike[str] | None = None,
    threads: int | None = None,
) -> Environment:
    """Generate the environment of a farm.

    Each field has its own random stream (`geo.seeds`), so fields are independent, and a further field does
    not change the others. On every machine diseases are equal to the last bit; continuous fields may differ
    by a rounding error of float32. The state of a day does not depend on the number of later days, on the
    kept days or on the number of threads.

    Parameters
    ----------
    grid : FarmGrid
        Crop map, including the neighbours' land.
    days : int
        Number of steps, 0..126.
    fields : FieldSet
        The fields and their dynamics; by default the benchmark's fields.
    progress : callable, optional
        Called in the calling thread as ``progress(done, total)`` after each piece of work. If it raises an
        exception, the generation stops.
    keep_days : iterable of int, optional
        Days to keep; by default all of 0..days. A kept day takes four bytes per cell for each continuous
        field. A disease takes one byte per cell for all days together.
    farm_name : str
        Name of the farm for the provenance.
    directory : path-like, optional
        Folder to which each day is written when it is computed, so that days take no memory. The folder
        appears when it is complete. After an error or Ctrl-C, finished days are kept beside the folder, and
        the same call continues from them. If the folder already holds this environment, nothing is computed.
    threads : int, optional
        Number of threads for large farms; by default one thread per processor that this process may use.

    Raises
    ------
    EnvironmentDataError
        If days are out of range, or the folder cannot be written.
    geo.system.NotEnoughMemoryError
        If the generation needs more memory than is available.
    geo.seeds.SeedError
        If the seed is not a non-negative integer or ``SeedSequence``.

    Examples
    --------
    >>> from geo.grid import FarmGrid
    >>> crop = np.full((12, 12), 2, np.int8)
    >>> grid = FarmGrid((12, 12), 0.3048, crop, np.ones((12, 12), np.bool_))
    >>> environment = generate_environment(grid, days=6, seed=7)
    >>> environment.days, environment.values(6).shape
    ((0, 1, 2, 3, 4, 5, 6), (3, 12, 12))
    """
    task = make_task(grid, days=days, seed=seed, fields=fields, keep_days=keep_days, farm_name=farm_name)
    if directory is not None:
        return _generate_into(directory, task, progress, threads)
    check_memory(task, on_disk=False, threads=threads)
    with _Work(task, progress, threads) as work:
        outbreaks = {field.name: work.start_outbreak(field) for field in task.fields.diseases}
        levels: dict[str, dict[int, NDArray[np.float32]]] = {}
        for name, course in work.courses.items():
            days_of = levels[name] = {}
            earlier = None
            for day in task.days:
                days_of[day] = np.empty(task.shape, np.float32)
                course.compute(day, days_of[day], earlier, work.step)
                earlier = day, days_of[day]
        onset = {name: work.step.wait(outbreak) for name, outbreak in outbreaks.items()}
        work.step.report()
    return Environment.of_arrays(task.fields, task.days, onset, levels, task.provenance())


class _Work:
    """Threads and courses that compute a task's fields; leaving the ``with`` block waits for the threads."""

    def __init__(self, task: Task, progress: Progress | None, threads: int | None) -> None:
        self._task = task
        last = task.days[-1]
        self.courses: dict[str, Course] = {
            field.name: field.continuous.course(task.shape, last, stream(task.seed, field.name))
            for field in task.fields.continuous
        }
        blocks = sum(course.pieces for course in self.courses.values())
        self.step = _Steps(len(task.fields.diseases) * last + blocks * len(task.days), progress)
        self._threads = _thread_count(task.grid.crop.size, threads)
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Self:
        with self._stack:
            self._pool: Executor | None = None
            if self._threads > 1 and self._task.fields.diseases:
                self._pool = self._stack.enter_context(ThreadPoolExecutor(_OUTBREAKS_AT_ONCE))
            # The writer has to end before the outbreaks; the stack closes in reverse order.
            self._writer = self._stack.enter_context(ThreadPoolExecutor(1))
            self._stack = self._stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.step.stopped.set()
        self._stack.close()

    def start_outbreak(self, field: Field) -> Future[NDArray[np.int8]]:
        """Start to simulate a disease; without threads the simulation is finished on return."""
        if self._pool is not None:
            return self._pool.submit(self._outbreak, field)
        future: Future[NDArray[np.int8]] = Future()
        future.set_result(self._outbreak(field))
        return future

    def _outbreak(self, field: Field) -> NDArray[np.int8]:
        task = self._task
        rng = stream(task.seed, field.name)
        return simulate_outbreak(field.hosts(task.grid), field.epidemic, task.days[-1], rng, self.step)

    def start_writing(
        self, store: EnvironmentStore, name: str, day: int, level: NDArray[np.float32]
    ) -> Future[None]:
        """Start to write a day of a continuous field; without threads the day is written on return."""
        future = self._writer.submit(store.write_level, name, day, level)
        if self._threads <= 1:
            future.result()
        return future


def _generate_into(
    directory: str | os.PathLike[str], task: Task, progress: Progress | None, threads: int | None
) -> Environment:
    header = task.header()
    finished = stored_environment(directory, header)
    if finished is not None:
        return finished
    check_memory(task, on_disk=True, threads=threads)
    with unfinished_store(directory, header, resume=True) as store, _Work(task, progress, threads) as work:
        outbreaks: dict[str, Future[NDArray[np.int8]]] = {}

        def write_finished_outbreaks() -> None:
            for name in [name for name, outbreak in outbreaks.items() if outbreak.done()]:
                store.write_onset(name, outbreaks.pop(name).result())

        for field in task.fields.diseases:
            if store.saved_onset(field.name) is None:
                outbreaks[field.name] = work.start_outbreak(field)
                write_finished_outbreaks()
            else:
                work.step(task.days[-1])
        _write_levels(store, work, task, write_finished_outbreaks)
        for name, outbreak in outbreaks.items():
            store.write_onset(name, work.step.wait(outbreak))
        work.step.report()
    return load_environment(directory)


def _write_levels(store: EnvironmentStore, work: _Work, task: Task, before_day: Callable[[], None]) -> None:
    """Compute the days of the continuous fields; write each day while the next day is computed."""
    spare = [np.empty(task.shape, np.float32) for _ in range(2 if work.courses else 0)]
    writing: Future[None] | None = None
    for name, course in work.courses.items():
        earlier: tuple[int, NDArray[np.float32]] | None = None
        for day in task.days:
            before_day()
            saved = store.saved_level(name, day)
            if saved is not None:
                earlier = day, saved
                work.step(course.pieces)
                continue
            # The writer may still be using the other array.
            level = spare[0]
            course.compute(day, level, earlier, work.step)
            if writing is not None:
                work.step.wait(writing)
            writing = work.start_writing(store, name, day, level)
            earlier = day, level
            spare.reverse()
    if writing is not None:
        work.step.wait(writing)
