"""Repeats the estimates of a run: a fresh estimator learns its observations in their order."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from sensors.estimation import attribute_errors_to, checked_prediction, prepare_days
from sensors.estimators import Estimator, advance_estimator
from wbf_mission.progress import Progress
from wbf_mission.run.estimation import estimator_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sensors.scoring.information import InformationModel
    from wbf_mission.run.record import RunRecord


def fresh_estimator(record: RunRecord, progress: Progress, estimator: Estimator | None = None) -> Estimator:
    """Return an estimator fitted to the farm, without observations.

    It is the given one, else that of the run's scenario, or a copy of the object in the scenario.
    """
    if estimator is None:
        choice = record.scenario.estimate.estimator
        if choice.made is not None:
            estimator = copy.deepcopy(choice.made)
        else:
            estimator = estimator_of(choice, record.scenario.seed, record.fields)
    with attribute_errors_to(estimator):
        estimator.fit(record.farm.grid())
    days = [one.day for one in record.flights] + [one.day for one in record.days]
    prepare_days(estimator, min(days), max(days) - min(days) + 1, progress)
    return estimator


def estimates_again(
    record: RunRecord, estimator: Estimator, moments: Iterable[tuple[int, int, bool]]
) -> Iterator[InformationModel | None]:
    """Yield the estimates of a fresh estimator at moments, in its own arrays.

    A moment is a day, the number of observations known then, and whether the estimate is wanted. None stands
    for an estimate that is not wanted, or equal to that of the moment before.
    """
    day, seen, is_known = None, 0, False
    for of_day, known, is_wanted in moments:
        with attribute_errors_to(estimator):
            if of_day != day:
                day, is_known = of_day, False
                advance_estimator(estimator, day)
            if known > seen:
                estimator.partial_fit(record.observations[seen:known])
                seen, is_known = known, False
        if is_wanted and not is_known:
            is_known = True
            # Not kept here: those of large farms are large.
            yield checked_prediction(estimator)
        else:
            yield None


def kept_truths(record: RunRecord) -> dict[int, NDArray[np.float32]]:
    """Return the truth, float32[n, W, H], of the days of which a record holds it: of large farms the last."""
    truths = {one.day: one.truth for one in record.days}
    if record.days and truths[record.days[-1].day] is None:
        truths[record.days[-1].day] = record.truth
    return {day: truth for day, truth in truths.items() if truth is not None}
