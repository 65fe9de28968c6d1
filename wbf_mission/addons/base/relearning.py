"""Recomputes the estimates of a run: a new estimator learns the run's observations in order."""

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
    """Return an estimator that is fitted to the farm, without observations.

    This is `estimator` if it is given. Otherwise it is the estimator named in the run's scenario, or a copy
    of the scenario's estimator object.
    """
    if estimator is None:
        choice = record.scenario.estimate.estimator
        if choice.made is not None:
            estimator = copy.deepcopy(choice.made)
        else:
            estimator = estimator_of(choice, record.scenario.seed, record.fields)
    with attribute_errors_to(estimator):
        estimator.fit(record.farm.grid())
    days = [flight.day for flight in record.flights] + [day.day for day in record.days]
    prepare_days(estimator, min(days), max(days) - min(days) + 1, progress)
    return estimator


def estimates_again(
    record: RunRecord, estimator: Estimator, moments: Iterable[tuple[int, int, bool]]
) -> Iterator[InformationModel | None]:
    """Yield the estimates of a fresh estimator at `moments`; the arrays are not copies.

    A moment is a day, the number of known observations, and whether the estimate is wanted. The estimate of a
    moment is None if it is not wanted, or equal to the previous estimate.
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
            # Estimates are not stored, because they are large on large farms.
            yield checked_prediction(estimator)
        else:
            yield None


def kept_truths(record: RunRecord) -> dict[int, NDArray[np.float32]]:
    """Return the recorded truths by day, float32[n, W, H]; for large farms only the last day has a truth."""
    truths = {one.day: one.truth for one in record.days}
    if record.days and truths[record.days[-1].day] is None:
        truths[record.days[-1].day] = record.truth
    return {day: truth for day, truth in truths.items() if truth is not None}
