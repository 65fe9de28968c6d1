"""The estimator point, which estimates only the observed cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.base import BaseEstimator, check_default_values
from sensors.estimators.days import carried
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.scoring.information import InformationModel

if TYPE_CHECKING:
    from geo.grid import FarmGrid
    from sensors.observations import Observations


class PointEstimator(BaseEstimator):
    """Estimates an observed cell by its last reading, and any other cell by the default.

    The uncertainty is 0 in observed cells and 1 elsewhere. Readings of earlier days are carried forward by
    the field's dynamics (`sensors.estimators.days`); the uncertainty of a carried reading is its variance as
    a fraction of the variance without a reading. Readings beyond 0..1 can only be noise and are clipped.

    Parameters
    ----------
    default_values : sequence of float, optional
        Value of each field in unobserved cells; by default the field's default.
    fields : FieldSet
        The observed fields.
    """

    knows_only_seen = True

    cells_: list[NDArray[np.intp]]
    values_: list[NDArray[np.float32]]
    days_: list[NDArray[np.int32]]

    def __init__(
        self, default_values: Sequence[float] | None = None, fields: FieldSet = PAPER_FIELDS
    ) -> None:
        self.default_values = default_values
        self.fields = fields

    def _start(self, grid: FarmGrid) -> None:  # noqa: ARG002
        self._defaults = check_default_values(self.default_values, self.fields)
        self.cells_ = [np.empty(0, np.intp) for _ in self.fields]
        self.values_ = [np.empty(0, np.float32) for _ in self.fields]
        self.days_ = [np.empty(0, np.int32) for _ in self.fields]

    def _learn(self, observations: Observations) -> None:
        readings = np.minimum(np.maximum(observations.values, 0.0), 1.0)
        cells = observations.x.astype(np.intp) * self.grid_.shape[1] + observations.y
        for k, sensed in enumerate(observations.sensed.T):
            # The newest readings come first, because np.unique returns the first index of equal cells.
            newest = np.concatenate([cells[sensed][::-1], self.cells_[k]])
            values = np.concatenate([readings[sensed, k][::-1], self.values_[k]])
            days = np.concatenate([observations.day[sensed][::-1], self.days_[k]])
            self.cells_[k], first = np.unique(newest, return_index=True)
            self.values_[k], self.days_[k] = values[first], days[first]

    def _estimate(self) -> InformationModel:
        model = InformationModel.uniform(
            self.grid_.shape, value=self._defaults, uncertainty=1.0, fields=self.fields.names
        )
        for k, field in enumerate(self.fields):
            if self.latest_day_ is not None:
                value, doubt = carried(field, self.grid_, self.values_[k], self.days_[k], self.latest_day_)
                model.value[k].reshape(-1)[self.cells_[k]] = value
                model.uncertainty[k].reshape(-1)[self.cells_[k]] = doubt
        return model
