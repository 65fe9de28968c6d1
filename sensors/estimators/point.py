"""The point estimator: an observed cell is known, nothing else is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.base import BaseEstimator, check_default_values
from sensors.fields import DEFAULT_VALUES, FIELDS
from sensors.scoring.information import InformationModel

if TYPE_CHECKING:
    from geo.grid import FarmGrid
    from sensors.observations import Observations


class PointEstimator(BaseEstimator):
    """The last observation of each cell, with uncertainty 0; the default and uncertainty 1 elsewhere.

    Parameters
    ----------
    default_values : tuple of three floats
        The value of each field in cells that were not observed.
    """

    cells_: list[NDArray[np.intp]]
    values_: list[NDArray[np.float32]]

    def __init__(self, default_values: tuple[float, float, float] = DEFAULT_VALUES) -> None:
        self.default_values = default_values

    def _start(self, grid: FarmGrid) -> None:  # noqa: ARG002
        check_default_values(self.default_values)
        self.cells_ = [np.empty(0, np.intp) for _ in FIELDS]
        self.values_ = [np.empty(0, np.float32) for _ in FIELDS]

    def _learn(self, observations: Observations) -> None:
        cells = observations.x.astype(np.intp) * self.grid_.shape[1] + observations.y
        for k, sensed in enumerate(observations.sensed.T):
            # Newest first, because np.unique keeps the first of equals.
            newest = np.concatenate([cells[sensed][::-1], self.cells_[k]])
            values = np.concatenate([observations.values[sensed, k][::-1], self.values_[k]])
            self.cells_[k], first = np.unique(newest, return_index=True)
            self.values_[k] = values[first]

    def _estimate(self) -> InformationModel:
        model = InformationModel.uniform(self.grid_.shape, value=self.default_values, uncertainty=1.0)
        for k in range(len(FIELDS)):
            model.value[k].reshape(-1)[self.cells_[k]] = self.values_[k]
            model.uncertainty[k].reshape(-1)[self.cells_[k]] = 0.0
        return model
