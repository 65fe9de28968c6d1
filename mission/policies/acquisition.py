"""Acquisition functions: the value of seeing a cell, from what is believed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo.grid import FarmGrid
from geo.linear_algebra import exp, log
from mission.errors import PlanningError
from mission.policies.observation import PolicyObservation
from sensors.fields import Field
from sensors.scoring.information import InformationModel

ValueMap: TypeAlias = NDArray[np.float32]

_CLASS_VALUES = (1.0, 0.5, 0.0)
_COLUMNS_A_PART = 32


class Acquisition(Protocol):
    """Tells what seeing each cell is worth."""

    def __call__(self, observation: PolicyObservation, /) -> ValueMap:
        """Return the values of the cells, float32[W, H]: not negative, zero where nothing is scored."""


def expected_loss(observation: PolicyObservation) -> ValueMap:
    """Return the loss that the score is expected to charge for each cell of the present estimate.

    It is what an observation of the cell saves: the sum over the fields of their weights and the loss
    expected under the estimator's class probabilities. Without these, the cost of a squared error, the mean
    of both sides, times the variance that the estimator states.
    """
    known = observation.model.expected_loss
    if known is not None:
        return _weighted(observation, lambda k, _field: known[k])
    return _weighted(observation, lambda k, field: _loss_of_field(observation, k, field))


def variance(observation: PolicyObservation) -> ValueMap:
    """Return the variance that the estimator states, weighted by field."""
    return _weighted(observation, lambda k, _field: observation.model.uncertainty[k] ** 2)


def entropy(observation: PolicyObservation) -> ValueMap:
    """Return the entropy of the classes (nats) of each disease, weighted by field.

    Fields without class probabilities count by the entropy of a normal distribution, relative to a standard
    deviation of a hundredth and not below zero.
    """

    def of_field(k: int, field: Field) -> NDArray[np.floating]:
        classes = _classes(observation.model, field.name)
        if classes is None:
            deviation = np.maximum(observation.model.uncertainty[k], np.float32(0.01))
            return np.asarray(log(deviation / np.float32(0.01)))
        return np.asarray(-np.sum(classes * log(np.maximum(classes, 1e-12)), axis=0))

    return _weighted(observation, of_field)


def probability_of_sick(observation: PolicyObservation) -> ValueMap:
    """Return the probability that a plant that is not known is sick, weighted by disease.

    Without class probabilities, how far the estimate is below healthy. Cells without doubt are worth nothing.
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
    """An acquisition, and beside it something for every scored plant far from all that was observed.

    An estimator may be too sure of land that nobody came near, and a whole outbreak that is missed costs more
    than anything else. A plant at a distance of d cells from the nearest observation of this day is worth
    ``caution * (1 - exp(-(d / reach)^4))`` more, times the weight of the field.

    Parameters
    ----------
    caution : float
        In units of loss; 0 for none.
    reach : float
        Cells.
    """

    acquisition: Acquisition
    caution: float
    reach: float = 3.0

    def __call__(self, observation: PolicyObservation, /) -> ValueMap:
        """Return the acquisition value of each cell."""
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
        return values + _weighted(
            observation, lambda _k, field: far if field.kind == "disease" else 0.0 * far
        )


@dataclass(frozen=True, slots=True)
class WithCorrelationLength:
    """An acquisition by which a reading of a smooth field saves the loss of all that it tells of.

    Who flies over a continuous field with the correlation length l learns what lies beside the track, too: a
    squared exponential process has only ``1 - exp(-d^2 / l^2)`` of its variance left at a distance d from it.
    So a step along the track saves the loss of a swath that is ``sqrt(pi) l`` wide, not of its own cell. For
    diseases the shares of a cell's neighbours say that.

    Parameters
    ----------
    strip : float
        How wide a strip the searches of routes take a track to see, cells
        (`mission.policies.planning_grid.strip_width`).
    beyond : int
        Farms with no side longer than this many cells are left as they are: on small ones the first rows tell
        the field, and flights end alike either way.
    """

    acquisition: Acquisition
    strip: float
    beyond: int

    def __call__(self, observation: PolicyObservation, /) -> ValueMap:
        """Return the acquisition value of each cell."""
        lengths, widest = observation.model.correlation_length, max(observation.model.shape)
        if lengths is None or widest <= self.beyond:
            return self.acquisition(observation)
        field = tuple(
            weight if one.kind == "disease" else weight * self._swath(cells, widest)
            for one, weight, cells in zip(observation.fields, observation.weights.field, lengths, strict=True)
        )
        return self.acquisition(replace(observation, weights=replace(observation.weights, field=field)))

    def _swath(self, length: float, widest: int) -> float:
        return max(1.0, min(math.sqrt(math.pi) * length, widest) / self.strip)


@dataclass(frozen=True, slots=True)
class Balanced:
    """An acquisition by weights of which none is much smaller than the largest.

    With the score's own weights a disease that counts little is looked for last, maybe too late.

    Parameters
    ----------
    least_weight : float
        A disease that counts at all counts at least this part of the weightiest one; 0: by its weight.
    """

    acquisition: Acquisition
    least_weight: float

    def __call__(self, observation: PolicyObservation, /) -> ValueMap:
        """Return the acquisition value of each cell."""
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
    """Return an acquisition by its name (`ACQUISITIONS`), or the callable that was given."""
    if callable(acquisition):
        return acquisition
    if acquisition not in ACQUISITIONS:
        msg = f"no acquisition is named {acquisition!r}; there are {', '.join(ACQUISITIONS)}"
        raise PlanningError(msg)
    return ACQUISITIONS[acquisition]


def _weighted(
    observation: PolicyObservation, of_field: Callable[[int, Field], NDArray[np.floating]]
) -> ValueMap:
    """Sum maps of the fields over the cells where they are scored, by the fields' weights."""
    total = np.zeros(observation.model.shape, np.float32)
    grid = observation.farm.grid()
    for k, field in enumerate(observation.fields):
        weight = observation.weights.field[k]
        if weight > 0.0:
            mask, values = scored_cells(field, grid), of_field(k, field)
            # Part by part: what lies between stays in the processor's cache.
            for start in range(0, len(total), _COLUMNS_A_PART):
                part = slice(start, start + _COLUMNS_A_PART)
                total[part] += mask[part] * (np.float32(weight) * values[part])
    return total


@lru_cache(maxsize=16)
def scored_cells(field: Field, grid: FarmGrid) -> NDArray[np.bool_]:
    """Return where a field is scored, bool[W, H]; not to be changed."""
    return field.mask(grid)


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
