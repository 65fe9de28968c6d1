"""The estimator ``epidemic``: estimates with the least expected loss, learned from simulated outbreaks."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from sensors.dynamics.soil import SoilParameters
from sensors.errors import EstimatorError
from sensors.estimators.base import LEARNING, BaseEstimator, Progress, require_paper_fields
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import GrowingArray, Observations, read_only
from sensors.scoring.expected import loss_of_deviation
from sensors.scoring.information import InformationModel, LazyProbabilities
from sensors.scoring.score import PAPER_WEIGHTS, ScoreWeights
from wbf_mission.addons.epidemic.belief import DiseaseBelief
from wbf_mission.addons.epidemic.soil import SoilField
from wbf_mission.addons.epidemic.store import learn_all
from wbf_mission.addons.epidemic.training import TrainingTask

if TYPE_CHECKING:
    from geo.grid import FarmGrid

_Values = NDArray[np.float32]
_Basis = tuple[object, int, int]
"""State of the estimator when it made a model: fit, estimated day, and number of learned observations."""

_SOIL = PAPER_FIELDS.index("soil")
# Smaller deviations of readings from the smooth field are not noise, but the rough part of the prior.
_EXACT_SOIL = 0.015


class EpidemicEstimator(BaseEstimator):
    """Estimates the probabilities of healthy, infected and lost plants, and values of least expected loss.

    For each disease, a small network computes the class probabilities of a cell. The network's inputs are the
    observations and the crop within eight cells, and the observed fraction of the field. The network is
    trained on simulated outbreaks with other seeds (`wbf_mission.addons.epidemic.training`). The value
    minimises the expected loss of the score, which weights missed diseases more; it is an expectile, not the
    mean. The uncertainty is the standard deviation of the cell's true value. Land without the disease's crop
    has the value 1 and uncertainty 0. The soil is a smooth random field with the lengthscales of the weather
    model (`wbf_mission.addons.epidemic.soil`).

    The estimated day is the latest observed day. Readings of earlier days are carried forward: plants that
    were infected may be lost now, and plants that were healthy may be infected now.

    Training takes about half a minute for each disease, crop map and block of eight days. Trained networks
    are cached in a folder; the package includes the networks of the Miniberry farms.

    Parameters
    ----------
    fields : FieldSet
        The benchmark's fields, with the assumed dynamics.
    day : int
        Estimated day before the first observation.
    misreading_rate : float
        Probability that a reading shows a wrong class. The noise of readings is estimated.
    weights : ScoreWeights
        Weights of the score's errors.
    outbreaks, epochs : int
        Size of the training: number of simulated fields, and of passes over their samples.
    training_seed : int
        Seed of the training; equal seeds give equal networks.
    cache : path-like, optional
        Folder of trained networks. Default: ``wbf-mission/epidemic`` in XDG_CACHE_HOME or ~/.cache.

    Attributes
    ----------
    day_ : int
        The estimated day.

    Examples
    --------
    >>> import tempfile
    >>> from geo.farms import get_farm
    >>> from sensors.observations import Observations
    >>> seen = Observations([5], [7], [0.0], [6], [[0.5, 1.0, 0.25]])
    >>> estimator = EpidemicEstimator(outbreaks=50, epochs=2, cache=tempfile.mkdtemp())
    >>> model = estimator.fit(get_farm("miniberry-10").grid(), seen).predict()
    >>> float(model.value[0, 5, 7]), float(model.uncertainty[0, 5, 7]), bool(model.value[0, 5, 8] < 0.9)
    (0.5, 0.0, True)
    """

    states_deviation = True

    def __init__(
        self,
        fields: FieldSet = PAPER_FIELDS,
        day: int = 6,
        misreading_rate: float = 0.0,
        weights: ScoreWeights = PAPER_WEIGHTS,
        outbreaks: int = 1250,
        epochs: int = 6,
        training_seed: int = 0,
        cache: str | os.PathLike[str] | None = None,
    ) -> None:
        self.fields = fields
        self.day = day
        self.misreading_rate = misreading_rate
        self.weights = weights
        self.outbreaks = outbreaks
        self.epochs = epochs
        self.training_seed = training_seed
        self.cache = cache

    @property
    def day_(self) -> int:
        """The estimated day: the latest day that was observed or that `advance` set."""
        self._check_fitted("day_")
        return self.day if self.latest_day_ is None else self.latest_day_

    def prepare(self, days: Sequence[int], progress: Progress | None = None) -> Self:
        """Load or train the networks of some days; see `BaseEstimator.prepare`.

        On farms of at most 128 x 128 cells, blocks of eight days (0 to 7, 8 to 15, ...) share a network.
        Several networks are trained in parallel, on all cores.
        """
        super().prepare(days)

        def step(part: float) -> None:
            if progress is not None:
                progress(LEARNING, part, 1)

        learn_all([task for belief in self._beliefs for task in belief.wanted(days)], self.cache, step)
        return self

    def _start(self, grid: FarmGrid) -> None:
        self._check_parameters()
        fields = self.fields
        self._fit = object()
        self._cells = GrowingArray((2,), np.int32)
        self._days = GrowingArray((), np.int32)
        self._values = GrowingArray((len(fields),), np.float64)
        weather = fields["soil"].continuous
        if not isinstance(weather, SoilParameters):
            msg = f"epidemic: the dynamics {weather.kind!r} of the soil are not supported; use 'gp'"
            raise EstimatorError(msg)
        self._soil = SoilField(grid.shape, weather, self.training_seed)
        size = self.outbreaks, self.epochs, self.training_seed
        self._beliefs = [
            DiseaseBelief(
                TrainingTask(field.epidemic, field.hosts(grid), self.day, *size),
                too_healthy=self.weights.too_healthy[k],
                too_sick=self.weights.too_sick[k],
                misreading_rate=self.misreading_rate,
                cache=self.cache,
            )
            for k, field in enumerate(fields.diseases)
        ]

    def _learn(self, observations: Observations) -> None:
        self._cells.append(np.stack([observations.x, observations.y], axis=1))
        self._days.append(observations.day)
        self._values.append(observations.values)
        sensed = observations[observations.sensed[:, _SOIL]]
        if len(sensed):
            self._soil.learn(sensed.x, sensed.y, sensed.day, sensed.values[:, _SOIL].astype(np.float64))

    def _estimate(self) -> InformationModel:
        value = np.empty((len(self.fields), *self.grid_.shape), np.float32)
        uncertainty = np.empty_like(value)
        day = self.day_
        for k, belief in enumerate(self._beliefs):
            belief.update(day, self._cells.array, self._days.array, self._values.array[:, k])
            value[k], uncertainty[k] = belief.value, belief.uncertainty
        noise = self._soil.fill(day, value[_SOIL], uncertainty[_SOIL])
        if noise < _EXACT_SOIL:
            # Later readings of a cell replace earlier readings.
            readings = self._values.array[:, _SOIL]
            taken = (self._days.array == day) & np.isfinite(readings)
            value[_SOIL, *self._cells.array[taken].T] = np.clip(readings[taken], 0.0, 1.0)
        basis = self._basis
        names = tuple(field.name for field in self.fields.diseases)
        # 0 for a disease, because its network already gives the probabilities around a sick plant.
        lengths = (*(0.0 for _ in names), self._soil.correlation_length)
        probabilities: Mapping[str, _Values]
        loss_map: _Values | Callable[[], _Values]
        if all(belief.whole for belief in self._beliefs):
            # The arrays of probabilities and loss exist already, and never change.
            probabilities = {name: read_only(self._class_probabilities(name, basis)) for name in names}
            loss_map = read_only(self._expected_loss(uncertainty, basis))
        else:
            probabilities = LazyProbabilities(
                names, lambda disease, columns: self._class_probabilities(disease, basis)[:, columns]
            )
            loss_map = partial(self._expected_loss, uncertainty, basis)
        return InformationModel(
            *(value, uncertainty),
            probabilities=probabilities,
            loss_map=loss_map,
            correlation_length=lengths,
        )

    def _class_probabilities(self, disease: str, basis: _Basis) -> NDArray[np.float32]:
        """Return the class probabilities of the model made in state `basis`; EstimatorError if outdated."""
        self._check_present("probabilities", basis)
        return self._beliefs[self.fields.index(disease)].probabilities

    def _expected_loss(self, uncertainty: NDArray[np.float32], basis: _Basis) -> NDArray[np.float32]:
        """Return the expected loss of the model made in state `basis`; EstimatorError if it is outdated."""
        self._check_present("expected_loss", basis)
        loss = np.empty_like(uncertainty)
        for k, belief in enumerate(self._beliefs):
            loss[k] = belief.loss
        loss_of_deviation(uncertainty[_SOIL:], self.weights, loss[_SOIL:], first=_SOIL)
        return loss

    @property
    def _basis(self) -> _Basis:
        return self._fit, self.day_, self.n_observations_

    def _check_present(self, what: str, basis: _Basis) -> None:
        if basis != self._basis:
            raise EstimatorError(
                f"epidemic: the {what} of the model of day {basis[1]} with {basis[2]} observations can no"
                f" longer be computed: the estimator was fitted again, or went on to day {self.day_} with"
                f" {self.n_observations_} observations; call model.copy() before the estimator changes"
            )

    def _check_parameters(self) -> None:
        require_paper_fields("epidemic", self.fields)
        self._require(
            "epidemic",
            day=isinstance(self.day, int | np.integer) and self.day >= 0,
            misreading_rate=0.0 <= self.misreading_rate < 0.5,
            weights=all(
                cost > 0 for cost in (*self.weights.too_healthy[:_SOIL], *self.weights.too_sick[:_SOIL])
            ),
            outbreaks=self.outbreaks >= 1,
            epochs=self.epochs >= 1,
            training_seed=isinstance(self.training_seed, int) and self.training_seed >= 0,
        )
