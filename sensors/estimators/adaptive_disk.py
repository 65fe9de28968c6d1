"""The estimator adaptive-disk, in which each observation sets the value of a disk of cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from sensors.errors import EstimatorError
from sensors.estimators.base import BaseEstimator, check_default_values, published_views
from sensors.estimators.days import carried
from sensors.estimators.disks import Disk, DiskMap, centred_disk
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import GrowingArray
from sensors.scoring.information import InformationModel, tile_shape

if TYPE_CHECKING:
    from geo.grid import FarmGrid
    from sensors.observations import Observations


_NOTHING = np.empty(0, np.float32), np.empty(0, np.float32)


class AdaptiveDiskEstimator(BaseEstimator):
    """The paper's adaptive disk. A cell has the value of the latest observation whose disk covers the cell.

    The radius shrinks as observations arrive, so that all disks together have about twice the farm's area
    (`sensors.estimators.disks.adaptive_radius`). A field's disks are the disks of the observations that
    sensed the field. The uncertainty is 0 inside disks and 1 elsewhere.

    The model is changed in place. While the radius is constant, an update writes only the cells of the new
    disks. When the radius shrinks, an update writes all cells of old and new disks. Readings beyond 0..1 can
    only be noise and are clipped.

    Readings of earlier days are carried forward by the field's dynamics (`sensors.estimators.days`). The
    uncertainty of a carried reading is its variance as a fraction of the variance without a reading.

    Parameters
    ----------
    default_values : sequence of float, optional
        Value of each field outside all disks; by default the field's default (healthy, healthy and dry).
    radius : int, optional
        Fixed radius in cells; None selects the adaptive radius.
    fields : FieldSet
        The observed fields.

    Attributes
    ----------
    maps_ : list of DiskMap
        Disks of each field. Fields that were always sensed together share one map.
    values_ : list of GrowingArray
        Sensed values of each field in order.
    revision_ : int
        Number of the last model; -1 before the first model.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> from sensors.observations import Observations
    >>> seen = Observations([5], [5], [0.0], [6], [[0.5, 1.0, 0.25]])
    >>> model = AdaptiveDiskEstimator(radius=1).fit(get_farm("miniberry-10").grid(), seen).predict()
    >>> model.of("tylcv")[4:7, 4:7].tolist()
    [[1.0, 0.5, 1.0], [0.5, 0.5, 0.5], [1.0, 0.5, 1.0]]
    """

    incremental = True
    _carries: ClassVar[bool] = True

    maps_: list[DiskMap]
    values_: list[GrowingArray]
    revision_: int

    def __init__(
        self,
        default_values: Sequence[float] | None = None,
        radius: int | None = None,
        fields: FieldSet = PAPER_FIELDS,
    ) -> None:
        self.default_values = default_values
        self.radius = radius
        self.fields = fields

    @staticmethod
    def _stamp(radius: int) -> Disk:
        return centred_disk(radius)

    @staticmethod
    def _possible(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.minimum(np.maximum(values, np.float32(0.0)), np.float32(1.0))

    def _start(self, grid: FarmGrid) -> None:
        self._defaults = np.array(check_default_values(self.default_values, self.fields), np.float32)
        if self.radius is not None and not (
            isinstance(self.radius, int) and 1 <= self.radius <= max(grid.shape)
        ):
            msg = f"radius {self.radius!r}: give a whole number of cells from 1 to {max(grid.shape)}, or None"
            raise EstimatorError(msg)
        self.maps_ = [DiskMap(grid.shape, self._stamp, self.radius)] * len(self.fields)
        self.values_ = [GrowingArray((), np.float32) for _ in self.fields]
        self._days = [GrowingArray((), np.int32) for _ in self.fields]
        self._carried_to: int | None = None
        self._carried: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = [_NOTHING] * len(self.fields)
        self.revision_ = -1

    def _learn(self, observations: Observations) -> None:
        sensed = observations.sensed
        for disks in list(dict.fromkeys(self.maps_)):
            sharing = [k for k in range(len(self.fields)) if self.maps_[k] is disks]
            # Fields that different observations have sensed can no longer share a map.
            groups: dict[bytes, list[int]] = {}
            for k in sharing:
                groups.setdefault(sensed[:, k].tobytes(), []).append(k)
            owners = [disks, *(disks.copy() for _ in range(len(groups) - 1))]
            for own, members in zip(owners, groups.values(), strict=True):
                mask = sensed[:, members[0]]
                own.append(observations.x[mask], observations.y[mask])
                for k in members:
                    self.maps_[k] = own
        readings = self._possible(observations.values)
        for k in range(len(self.fields)):
            self.values_[k].append(readings[sensed[:, k], k])
            self._days[k].append(observations.day[sensed[:, k]])

    def _carry_forward(self, day: int) -> None:
        """Carry readings of earlier days forward to `day`."""
        self._carried_to = day
        for k, field in enumerate(self.fields):
            values, days = self.values_[k].array, self._days[k].array
            if not (days < day).any():
                continue
            value, doubt = carried(field, self.grid_, values, days, day)
            self._carried[k] = value.astype(np.float32), doubt.astype(np.float32)
            # Carried readings differ between fields, so fields can no longer share a map.
            self.maps_[k] = self.maps_[k].copy()
            self.maps_[k].repaint()

    def _readings(self, k: int, start: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return values and uncertainties of field `k`'s disks from disk number `start` on."""
        value, doubt = self._carried[k]
        fresh = self.values_[k].array[max(start, len(value)) :]
        known = np.concatenate([value[start:], fresh])
        return known, np.concatenate([doubt[start:], np.zeros(len(fresh), np.float32)])

    def _estimate(self) -> InformationModel:
        if self._carries and self.latest_day_ is not None and self.latest_day_ != self._carried_to:
            self._carry_forward(self.latest_day_)
        everything = self.revision_ < 0
        if everything:
            self._value = np.empty((len(self.fields), *self.grid_.shape), np.float32)
            self._uncertainty = np.empty((1, *self.grid_.shape), np.float32)
            self._published = self._value, self._uncertainty
        changed = np.zeros(tile_shape(self.grid_.shape), np.bool_)
        maps = list(dict.fromkeys(self.maps_))
        if len(maps) > 1 and len(self._uncertainty) == 1:
            self._uncertainty = np.repeat(self._uncertainty, len(self.fields), axis=0)
        from sensors.estimators.painting import Strokes, paint  # The import is here because it is slow

        for disks in maps:
            painting = disks.outstanding()
            fields = [k for k in range(len(self.fields)) if self.maps_[k] is disks]
            readings = [self._readings(k, painting.start) for k in fields]
            planes = fields if len(self._uncertainty) > 1 else [0]
            strokes = Strokes(
                np.ones_like(painting.tiles) if everything else painting.tiles,
                painting.reset or everything,
                np.ascontiguousarray(painting.x),
                np.ascontiguousarray(painting.y),
                painting.disk.first,
                painting.disk.low,
                painting.disk.high,
                np.stack([value for value, _ in readings]),
                np.stack([doubt for _, doubt in readings[: len(planes)]]),
                self._defaults[fields],
                np.array(fields),
                np.array(planes),
            )
            paint(strokes, self._value, self._uncertainty, changed)
        self.revision_ += 1
        # The arrays are new after a fit, in a copy, and when fields no longer share a map. Fields that share
        # a map also share a plane of uncertainty.
        self._published = published_views(self._published, (self._value, self._uncertainty))
        return InformationModel(
            *self._published, None if everything else changed, self.revision_, self.fields.names
        )
