"""The adaptive disk estimator: every observation stands for a disk around it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sensors.errors import EstimatorError
from sensors.estimators.base import BaseEstimator, check_default_values
from sensors.estimators.disks import DiskMap, Stamp, centred_disk
from sensors.estimators.growing import GrowingArray
from sensors.fields import DEFAULT_VALUES, FIELDS
from sensors.information import InformationModel

if TYPE_CHECKING:
    from geo.grid import FarmGrid
    from sensors.observations import Observations

_CHUNK_CELLS = 1 << 18


class AdaptiveDiskEstimator(BaseEstimator):
    """The paper's adaptive disk: the value of the latest observation whose disk covers the cell.

    The radius shrinks as observations come in, so that all disks together always have about twice the farm's
    area (`sensors.estimators.disks.adaptive_radius`); a field's disks are those of the observations that
    sensed it. The uncertainty is 0 in a disk and 1 elsewhere.

    Parameters
    ----------
    default_values : tuple of three floats
        The value of each field where no disk reaches; healthy, healthy and dry.
    radius : int, optional
        A fixed radius in cells in place of the adaptive one.

    Attributes
    ----------
    maps_ : list of DiskMap
        One per field; fields that were always sensed together share one.
    values_ : list of GrowingArray
        The sensed values of each field in order.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> from sensors.observations import Observations
    >>> seen = Observations([5], [5], [0.0], [6], [[0.5, 1.0, 0.25]])
    >>> model = AdaptiveDiskEstimator(radius=1).fit(get_farm("miniberry-10").grid(), seen).predict()
    >>> model.of("tylcv")[4:7, 4:7].tolist()
    [[1.0, 0.5, 1.0], [0.5, 0.5, 0.5], [1.0, 0.5, 1.0]]
    """

    maps_: list[DiskMap]
    values_: list[GrowingArray]

    def __init__(
        self, default_values: tuple[float, float, float] = DEFAULT_VALUES, radius: int | None = None
    ) -> None:
        self.default_values = default_values
        self.radius = radius

    @staticmethod
    def _stamp(radius: int) -> Stamp:
        return centred_disk(radius)

    def _start(self, grid: FarmGrid) -> None:
        check_default_values(self.default_values)
        if self.radius is not None and not (
            isinstance(self.radius, int) and 1 <= self.radius <= max(grid.shape)
        ):
            msg = f"radius {self.radius!r}: give a whole number of cells from 1 to {max(grid.shape)}, or None"
            raise EstimatorError(msg)
        self.maps_ = [DiskMap(grid.shape, self._stamp, self.radius)] * len(FIELDS)
        self.values_ = [GrowingArray((), np.float32) for _ in FIELDS]

    def _learn(self, observations: Observations) -> None:
        sensed = observations.sensed
        for disks in list(dict.fromkeys(self.maps_)):
            sharing = [k for k in range(len(FIELDS)) if self.maps_[k] is disks]
            # Fields whose sensed sets part ways here need a map of their own from now on.
            groups: dict[bytes, list[int]] = {}
            for k in sharing:
                groups.setdefault(sensed[:, k].tobytes(), []).append(k)
            owners = [disks, *(disks.copy() for _ in range(len(groups) - 1))]
            for own, members in zip(owners, groups.values(), strict=True):
                mask = sensed[:, members[0]]
                own.append(observations.x[mask], observations.y[mask])
                for k in members:
                    self.maps_[k] = own
        for k in range(len(FIELDS)):
            self.values_[k].append(observations.values[sensed[:, k], k])

    def _estimate(self) -> InformationModel:
        width, height = self.grid_.shape
        value = np.empty((len(FIELDS), width, height), np.float32)
        uncertainty = np.empty_like(value)
        # The default is the last entry of each table, where the index -1 of uncovered cells finds it.
        pairs = zip(self.values_, self.default_values, strict=True)
        tables = [np.append(values.array, np.float32(default)) for values, default in pairs]
        owners = [disks.owner() for disks in self.maps_]
        step = max(1, _CHUNK_CELLS // height)
        for start in range(0, width, step):
            part = slice(start, start + step)
            for k, table in enumerate(tables):
                if k == 0 or owners[k] is not owners[k - 1]:
                    index = owners[k][part].astype(np.intp)
                    uncovered = index < 0
                np.take(table, index, out=value[k, part], mode="wrap")
                uncertainty[k, part] = uncovered
        return InformationModel(value, uncertainty)
