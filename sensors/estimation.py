"""Estimates and scores a run while the observations arrive."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.errors import PACKAGES, WbfMissionError, told_error
from geo.system import free_unused_memory
from sensors.errors import EstimatorError
from sensors.estimators import Estimator, advance_estimator, prepare_estimator
from sensors.estimators.base import model_fault
from sensors.fields import FieldSet
from sensors.lazy_fields import LARGE_FROM_CELLS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import RunningScore, Score


@dataclass(slots=True)
class ScoreHistory:
    """Scores of a run. Each list has an entry for each scored time; times are seconds since the run began."""

    times_s: list[float] = field(default_factory=list)
    observations: list[int] = field(default_factory=list)
    entries: list[Score] = field(default_factory=list)
    days: list[int] = field(default_factory=list)

    @property
    def scores(self) -> list[float]:
        """The score of the Waterberry Farms paper at each scored time."""
        return [entry.score for entry in self.entries]

    @property
    def field_losses(self) -> NDArray[np.float64]:
        """Each field's mean loss per cell at each scored time, float64[times, n]."""
        losses = [entry.field_loss for entry in self.entries]
        return np.array(losses, dtype=np.float64) if losses else np.empty((0, 0))

    @property
    def score(self) -> float | None:
        """The paper's score of the run, the mean over the scored times; None before the first scored time."""
        return float(np.mean(self.scores)) if self.entries else None

    def of_day(self, day: int) -> ScoreHistory:
        """Return the scores of one day."""
        at = [k for k, scored in enumerate(self.days) if scored == day]
        columns = (self.times_s, self.observations, self.entries, self.days)
        return ScoreHistory(*([column[k] for k in at] for column in columns))  # type: ignore[arg-type]


class RunEstimate:
    """Computes the estimate and the scores of a run in a separate thread during the flight.

    The estimator learns the observations between two scored times together, in the order in which they were
    added. The results depend neither on the speed of the threads nor on the parts in which observations
    arrive. If the estimator fails, a later call raises the error. The caller ends the thread with `close`.

    The estimate is scored every `every` observations of a flight and at the flight's end; on later days, also
    before the first observation. If a flight is cancelled, `hold` scores the present estimate as often as the
    flight would have been scored. Before it learns, the thread calls `ready`, which may wait.

    Attributes
    ----------
    history : ScoreHistory
        The scores, complete after `end_flight`.
    model : InformationModel or None
        The estimate that was scored last, valid after `end_flight`. The model's arrays may belong to the
        estimator, which changes them when it learns.
    """

    def __init__(
        self,
        estimator: Estimator,
        score: RunningScore,
        every: int = 1,
        day: int = 0,
        ready: Callable[[], None] = lambda: None,
    ) -> None:
        self.history = ScoreHistory()
        self.model: InformationModel | None = None
        self.estimate_s = 0.0
        self.score_s = 0.0
        self.estimator = estimator
        self._score = score
        self.every = max(1, every)
        self.day = day
        self._ready = ready
        # This callback gets the time and the model at each scored time.
        self.on_score: Callable[[float, InformationModel], None] = lambda _time_s, _model: None
        self._seen = 0
        self._seen_before = 0
        self._held: list[Observations] = []
        self._given = 0
        self._worker = ThreadPoolExecutor(1, "estimate")
        self._waiting: deque[Future[Any]] = deque()

    def add(self, parts: Sequence[Observations], offset_s: float = 0.0) -> None:
        """Add observations; the estimator learns all observations up to a scored time together."""
        while self._waiting and self._waiting[0].done():
            self._waiting.popleft().result()
        for part in parts:
            start = 0
            while start < len(part):
                due = self.every - (self._given - self._seen_before) % self.every
                whole = start == 0 and len(part) <= due
                self._held.append(part if whole else part[start : start + due])
                start += due
                self._given += len(self._held[-1])
                if len(self._held[-1]) == due:
                    self._submit(offset_s + float(self._held[-1].time_s[-1]))

    def current(self) -> InformationModel:
        """Wait until all observations are learned; return the estimate, with arrays of the estimator."""
        self._wait()
        return self._predict()

    def snapshot(self) -> Future[InformationModel]:
        """Return a future for a copy of the estimate that includes all observations already added.

        The thread of the estimate makes the copy, so the caller's thread shares no arrays with the estimator.
        """
        self._submit()
        before = tuple(self._waiting)

        def take() -> InformationModel:
            for done in before:
                done.result()
            with attribute_errors_to(self.estimator):
                return self._predict().copy()

        self._waiting.append(taken := self._worker.submit(take))
        return taken

    def begin_day(self, day: int, truth: NDArray[np.float32], time_s: float) -> None:
        """Advance to a later day, whose truth is `truth`, and score the estimate before any observation."""
        self._wait()
        self.day = day
        self._score.advance(truth)
        with attribute_errors_to(self.estimator):
            advance_estimator(self.estimator, day)
        self._evaluate(time_s)

    def end_flight(self, time_s: float) -> None:
        """Wait until all observations are learned, then score the estimate unless that was done."""
        self._wait()
        history = self.history
        if self._seen and (history.observations[-1:], history.days[-1:]) != ([self._seen], [self.day]):
            self._evaluate(time_s)
        self._seen_before = self._seen

    def hold(self, times: int, time_s: float) -> None:
        """Record the score of the present estimate `times` times, in place of a cancelled flight's scores."""
        self._wait()
        self._evaluate(time_s)
        history, again = self.history, times - 1
        history.entries += again * history.entries[-1:]
        history.times_s += again * [time_s]
        history.observations += again * [self._seen]
        history.days += again * [self.day]

    def _submit(self, score_at_s: float | None = None) -> None:
        """Let the thread learn the waiting observations, and score the estimate if `score_at_s` is given."""
        if self._held:
            held = Observations.concatenate(self._held, self._held[0].fields)
            self._held = []
            self._waiting.append(self._worker.submit(self._learn, held, score_at_s))

    def _wait(self) -> None:
        self._submit()
        while self._waiting:
            self._waiting.popleft().result()

    def close(self) -> None:
        """End the thread and discard observations that it has not learned yet."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _learn(self, observations: Observations, score_at_s: float | None) -> None:
        self._ready()
        begin = time.perf_counter()
        with attribute_errors_to(self.estimator):
            self.estimator.partial_fit(observations)
        self.estimate_s += time.perf_counter() - begin
        self._seen += len(observations)
        if score_at_s is not None:
            self._evaluate(score_at_s)

    def _predict(self) -> InformationModel:
        begin = time.perf_counter()
        model = checked_prediction(self.estimator, self._score.fields, self._score.shape)
        self.estimate_s += time.perf_counter() - begin
        return model

    def _evaluate(self, time_s: float) -> None:
        self.model = self._predict()
        begin = time.perf_counter()
        self.history.entries.append(self._score.add(self.model))
        self.history.times_s.append(time_s)
        self.history.observations.append(self._seen)
        self.history.days.append(self.day)
        self.score_s += time.perf_counter() - begin
        if self.model.value[0].size >= LARGE_FROM_CELLS:
            free_unused_memory()
        self.on_score(time_s, self.model)


@contextmanager
def attribute_errors_to(estimator: Estimator) -> Iterator[None]:
    """Turn an estimator's unexpected error into an EstimatorError with the estimator's name."""
    try:
        yield
    except (WbfMissionError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        raise EstimatorError(f"estimator {type(estimator).__name__} failed: {told_error(error)}") from error


def checked_prediction(
    estimator: Estimator, fields: tuple[str, ...], shape: tuple[int, int]
) -> InformationModel:
    """Return an estimator's prediction of these fields on a farm of `shape`, width and height in cells.

    The prediction is checked if the estimator comes from outside this project.
    """
    with attribute_errors_to(estimator):
        model = estimator.predict()
    if type(estimator).__module__.partition(".")[0] not in PACKAGES:
        fault = model_fault(estimator, model, fields, shape)
        if fault is not None:
            raise EstimatorError(f"estimator {type(estimator).__name__}: {fault}")
    return model


@dataclass(slots=True)
class Evidence:
    """The observations of all flights of a run, and the run's estimate."""

    farm: Farm
    fields: FieldSet
    estimate: RunEstimate | None = None
    _parts: list[Observations] = field(default_factory=list, init=False)
    _count: int = field(default=0, init=False)

    def __len__(self) -> int:
        return self._count

    def add(self, *parts: Observations, offset_s: float) -> None:
        """Add observations; their times count from `offset_s` seconds after the run began."""
        filled = [part for part in parts if len(part)]
        if not filled:
            return
        self._parts += filled
        self._count += sum(map(len, filled))
        if self.estimate is not None:
            self.estimate.add(filled, offset_s)

    @property
    def parts(self) -> tuple[Observations, ...]:
        """All observations, in the parts and in the order in which they arrived."""
        return tuple(part for part in self._parts if len(part))

    def observations(self) -> Observations:
        """Join all observations in the order of arrival."""
        if len(self._parts) != 1:
            self._parts = [Observations.concatenate(self._parts, self.fields.names)]
        return self._parts[0]

    def model(self) -> InformationModel:
        """Return the estimate after all observations, or the fields' defaults if no estimator runs."""
        if self.estimate is not None:
            return self.estimate.current()
        return InformationModel.unknown(self.farm.grid().shape, self.fields)

    def snapshot(self) -> Callable[[], InformationModel]:
        """Return a function that returns the present estimate, even if called later or in another thread."""
        return self.model if self.estimate is None else self.estimate.snapshot().result


def prepare_days(
    estimator: Estimator, first: int, days: int, progress: Callable[[str, float, float], None]
) -> None:
    """Train an estimator for all days of a run."""
    with attribute_errors_to(estimator):
        prepare_estimator(estimator, range(first, first + days), progress)
