"""Acquisition functions: the value of observing each cell, computed from the estimate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo.grid import FarmGrid
from geo.linear_algebra import exp, log
from geo.texts import unknown
from mission.errors import PlanningError
from mission.policies.observation import PolicyObservation
from mission.policies.route_search import add_runs
from sensors.fields import Field
from sensors.scoring.information import InformationModel

ValueMap: TypeAlias = NDArray[np.float32]
AcquisitionValues: TypeAlias = "ValueMap | SummedMap"

_CLASS_VALUES = (1.0, 0.5, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class CountedCells:
    """Cells that count in a sum, as a mask and as runs of neighbouring cells along y."""

    mask: NDArray[np.bool_]  # bool[W, H]
    runs: NDArray[np.int32]  # Column, first cell and end of each run, int32[n, 3]
    first: NDArray[np.intp]  # Index of the first run of each column, and the number of runs, intp[W + 1]

    @classmethod
    def of(cls, mask: NDArray[np.bool_]) -> CountedCells:
        """Return the cells in a mask."""
        edges = np.diff(mask.view(np.int8), axis=1, prepend=np.int8(0), append=np.int8(0))
        columns, begin = np.nonzero(edges > 0)
        runs = np.column_stack((columns, begin, np.nonzero(edges < 0)[1])).astype(np.int32)
        return cls(mask, runs, np.searchsorted(columns, np.arange(len(mask) + 1)))


@dataclass(frozen=True, slots=True, eq=False)
class SummedMap:
    """A weighted sum of maps; the sum in a cell is computed when the cell is read.

    The whole sum is not stored, because on a large farm it takes longer to allocate memory than to add.

    Parameters
    ----------
    parts : tuple of (float32, CountedCells, float[W, H])
        Weight, counted cells and values of each map.
    shape : tuple of int
        Shape of the maps.

    Examples
    --------
    >>> cells, values = CountedCells.of(np.array([[True, False]])), np.array([[0.5, 0.25]], np.float32)
    >>> SummedMap(((np.float32(2.0), cells, values),), (1, 2))[:].tolist()
    [[1.0, 0.0]]
    """

    parts: tuple[tuple[np.float32, CountedCells, NDArray[np.floating]], ...]
    shape: tuple[int, int]

    def __getitem__(self, cells: Any) -> NDArray[np.float32]:
        """Return the sum in the cells that `cells` selects, which is an index as for an array."""
        first = np.broadcast_to(np.float32(0.0), self.shape)[cells]
        total = np.zeros(first.shape, np.float32)
        for weight, counted, values in self.parts:
            mask = counted.mask[cells]
            if mask.any():
                total += mask * (weight * values[cells])
        return total

    def add_columns(self, first: int, total: NDArray[np.float32]) -> None:
        """Add the sum to `total`, float32[columns, H], whose first column is column `first` of the map."""
        end = min(first + len(total), self.shape[0])
        for weight, counted, values in self.parts:
            runs = counted.runs[counted.first[first] : counted.first[end]]
            add_runs(weight, runs, values, first, total)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[:].astype(dtype or np.float32, copy=False)


class Acquisition(Protocol):
    """An acquisition function: maps an observation to the value of observing each cell."""

    def __call__(self, observation: PolicyObservation, /) -> AcquisitionValues:
        """Return the value of observing each cell, float32[W, H]: at least 0, and 0 in unscored cells.

        The result is an array, or a `SummedMap`, whose values are computed only in the cells that are read.
        """


def expected_loss(observation: PolicyObservation) -> AcquisitionValues:
    """Return, for each cell, the expected loss of the current estimate; an observation would save this loss.

    The loss is summed over the fields with their weights. For a field with class probabilities, the expected
    loss is the expectation of the score's loss. For other fields, the expected loss is the variance of the
    estimate times the mean of the two weights of squared errors (above and below the truth).
    """
    known = observation.model.expected_loss
    if known is not None:
        return _weighted(observation, lambda k, _field: known[k])
    return _weighted(observation, lambda k, field: _loss_of_field(observation, k, field))


def variance(observation: PolicyObservation) -> AcquisitionValues:
    """Return the variance of the estimate in each cell, summed over the fields with their weights."""
    return _weighted(observation, lambda k, _field: observation.model.uncertainty[k] ** 2)


def entropy(observation: PolicyObservation) -> AcquisitionValues:
    """Return the entropy of the class probabilities (nats) in each cell, summed over the weighted fields.

    A field without class probabilities gets the entropy of a normal distribution minus the entropy at a
    standard deviation of 0.01, at least zero.
    """

    def of_field(k: int, field: Field) -> NDArray[np.floating]:
        classes = _classes(observation.model, field.name)
        if classes is None:
            deviation = np.maximum(observation.model.uncertainty[k], np.float32(0.01))
            return np.asarray(log(deviation / np.float32(0.01)))
        return np.asarray(-np.sum(classes * log(np.maximum(classes, 1e-12)), axis=0))

    return _weighted(observation, of_field)


def probability_of_sick(observation: PolicyObservation) -> AcquisitionValues:
    """Return the probability that an unobserved plant is sick, summed over the diseases with their weights.

    Without class probabilities, the probability is 1 minus the estimated health. Cells without uncertainty
    have the value 0.
    """

    def of_field(k: int, field: Field) -> NDArray[np.floating]:
        if field.kind != "disease":
            return np.zeros(observation.model.shape, np.float32)
        classes = _classes(observation.model, field.name)
        sick = 1.0 - observation.model.value[k] if classes is None else 1.0 - classes[0]
        return np.where(observation.model.uncertainty[k] > 1e-6, np.clip(sick, 0.0, 1.0), 0.0)

    return _weighted(observation, of_field)


@dataclass(frozen=True, slots=True)
class WithCoverage:
    """An acquisition with a bonus for plants far from all observations.

    An estimator may be overconfident about unobserved land, and a missed outbreak costs most. A plant d
    cells from the nearest observation of the same day gets a bonus of
    ``caution * (1 - exp(-(d / reach)^4))``, times the weight of the disease.

    Parameters
    ----------
    caution : float
        Greatest bonus, in units of loss; 0: no bonus.
    reach : float
        Distance scale of the bonus, in cells.
    """

    acquisition: Acquisition
    caution: float
    reach: float = 3.0

    def __call__(self, observation: PolicyObservation, /) -> AcquisitionValues:
        """Return the acquisition value of each cell, with the bonus for plants far from all observations."""
        values = self.acquisition(observation)
        if self.caution <= 0.0:
            return values
        from scipy import ndimage

        seen = observation.observations
        today = seen[seen.day == observation.day]
        unseen = np.ones(observation.model.shape, np.bool_)
        unseen[today.x, today.y] = False
        if unseen.all():
            far = np.ones(unseen.shape, np.float32)
        else:
            distance = ndimage.distance_transform_edt(unseen).astype(np.float32)
            far = 1.0 - exp(-np.square(np.square(distance / np.float32(self.reach))))
        far *= np.float32(self.caution)
        bonus = _weighted(observation, lambda _k, field: far if field.kind == "disease" else 0.0 * far)
        return values[:] + bonus[:]


@dataclass(frozen=True, slots=True)
class WithCorrelationLength:
    """An acquisition that gives larger weights to fields with a longer correlation length.

    Observations of a field with correlation length l also reduce the variance beside the track: a squared
    exponential process keeps only ``1 - exp(-d^2 / l^2)`` of its variance at a distance d. A step along the
    track therefore saves the loss of a swath ``sqrt(pi) l`` wide, not only the loss of the step's cell.
    Diseases keep their weights, because the route search itself adds the value of the cells beside the track.

    Parameters
    ----------
    strip : float
        Width (cells) of the strip whose value a track removes in route searches
        (`mission.policies.planning_grid.strip_width`).
    beyond : int
        Weights change only on farms with a side longer than this, in cells: on smaller farms the first rows
        already determine the field.
    """

    acquisition: Acquisition
    strip: float
    beyond: int

    def __call__(self, observation: PolicyObservation, /) -> AcquisitionValues:
        """Return the acquisition value of each cell, with the changed weights of smooth fields."""
        lengths, widest = observation.model.correlation_length, max(observation.model.shape)
        if lengths is None or widest <= self.beyond:
            return self.acquisition(observation)
        swaths = [max(1.0, min(math.sqrt(math.pi) * length, widest) / self.strip) for length in lengths]
        field = tuple(
            weight if sensed.kind == "disease" else weight * swath
            for sensed, weight, swath in zip(
                observation.fields, observation.weights.field, swaths, strict=True
            )
        )
        return self.acquisition(replace(observation, weights=replace(observation.weights, field=field)))


@dataclass(frozen=True, slots=True)
class Balanced:
    """An acquisition with a lower bound on the weights of diseases.

    With the score's weights, a policy would look for a disease of small weight last, perhaps too late.

    Parameters
    ----------
    least_weight : float
        Least weight of a disease, relative to the largest weight; 0: no change. Diseases of weight 0 keep
        the weight 0.
    """

    acquisition: Acquisition
    least_weight: float

    def __call__(self, observation: PolicyObservation, /) -> AcquisitionValues:
        """Return the acquisition value of each cell, with the changed weights of diseases."""
        weights = observation.weights.field
        least = self.least_weight * max(weights)
        balanced = tuple(
            max(weight, least) if weight > 0.0 and field.kind == "disease" else weight
            for weight, field in zip(weights, observation.fields, strict=True)
        )
        if balanced == tuple(weights):
            return self.acquisition(observation)
        return self.acquisition(replace(observation, weights=replace(observation.weights, field=balanced)))


ACQUISITIONS: dict[str, Acquisition] = {
    "expected-loss": expected_loss,
    "variance": variance,
    "entropy": entropy,
    "probability-of-sick": probability_of_sick,
}


def make_acquisition(acquisition: str | Acquisition) -> Acquisition:
    """Return the acquisition function with this name in `ACQUISITIONS`; return a callable unchanged."""
    if callable(acquisition):
        return acquisition
    if acquisition not in ACQUISITIONS:
        raise PlanningError(unknown("acquisition", acquisition, ACQUISITIONS))
    return ACQUISITIONS[acquisition]


def _weighted(
    observation: PolicyObservation, of_field: Callable[[int, Field], NDArray[np.floating]]
) -> SummedMap:
    """Return the weighted sum of the fields' maps, each restricted to the field's scored cells."""
    grid = observation.farm.grid()
    return SummedMap(
        tuple(
            (np.float32(weight), _counted(field, grid), of_field(k, field))
            for k, (field, weight) in enumerate(
                zip(observation.fields, observation.weights.field, strict=True)
            )
            if weight > 0.0
        ),
        observation.model.shape,
    )


@lru_cache(maxsize=16)
def scored_cells(field: Field, grid: FarmGrid) -> NDArray[np.bool_]:
    """Return the scored cells of a field, bool[W, H]. The array is cached: do not modify it."""
    return field.mask(grid)


@lru_cache(maxsize=16)
def _counted(field: Field, grid: FarmGrid) -> CountedCells:
    return CountedCells.of(scored_cells(field, grid))


def _classes(model: InformationModel, name: str) -> NDArray[np.floating] | None:
    if model.probabilities is None or name not in model.probabilities:
        return None
    return model.probabilities[name]


def _loss_of_field(observation: PolicyObservation, k: int, field: Field) -> NDArray[np.floating]:
    above, below = observation.weights.too_healthy[k], observation.weights.too_sick[k]
    classes = _classes(observation.model, field.name)
    if classes is None:
        return np.asarray(0.5 * (above + below) * observation.model.uncertainty[k] ** 2)
    loss = np.zeros(observation.model.shape, np.float32)
    for share, truth in zip(classes, _CLASS_VALUES, strict=True):
        error = observation.model.value[k] - np.float32(truth)
        loss += share * np.where(error > 0.0, above, below) * error**2
    return loss
