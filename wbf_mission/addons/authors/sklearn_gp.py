"""The paper's Gaussian process, computed by scikit-learn, which fits the kernel anew for every estimate."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from sensors.errors import EstimatorError
from sensors.estimators.base import BaseEstimator, RandomState
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import GrowingArray
from sensors.scoring.information import InformationModel

if TYPE_CHECKING:
    from geo.grid import FarmGrid
    from sensors.observations import Observations

LENGTH, LENGTH_BOUNDS = 2.0, (1.0, 10.0)
NOISE, NOISE_BOUNDS = 0.5, (1e-5, 1e5)
_CHUNK_CELLS = 2000


class SklearnGaussianProcessEstimator(BaseEstimator):
    """The paper's Gaussian process, for comparison: slow, prior mean 0, fitted again for every estimate.

    Each field has ``RBF([2, 2], bounds 1..10) + WhiteKernel(0.5, bounds 1e-5..1e5)`` in
    `sklearn.gaussian_process.GaussianProcessRegressor` with ``alpha=1e-10`` and random restarts.
    The uncertainty is the standard deviation of an observation, noise included. Use ``gp`` for anything else.

    Parameters
    ----------
    n_restarts : int
        Number of restarts of the kernel's fit.
    max_points : int
        Maximum number of observations; the time of a fit grows with its cube.
    max_entries : int
        Maximum number of covariances between observations and cells in one estimate.
    random_state : Generator, SeedSequence, int or None
        Start points of the restarts; with None they differ each time.
    fields : FieldSet
        Observed fields.
    """

    seed_: int

    states_deviation = True
    unbounded = True

    def __init__(
        self,
        n_restarts: int = 5,
        max_points: int = 2000,
        max_entries: int = 200_000_000,
        random_state: RandomState = None,
        fields: FieldSet = PAPER_FIELDS,
    ) -> None:
        self.n_restarts = n_restarts
        self.max_points = max_points
        self.max_entries = max_entries
        self.random_state = random_state
        self.fields = fields

    def _start(self, grid: FarmGrid) -> None:  # noqa: ARG002
        for name, least in (("n_restarts", 0), ("max_points", 1), ("max_entries", 1)):
            if getattr(self, name) < least:
                msg = f"gp-sklearn: {name} cannot be {getattr(self, name)!r}, expected at least {least}"
                raise EstimatorError(msg)
        self.seed_ = int(np.random.default_rng(self.random_state).integers(2**31))
        self._cells = [GrowingArray((2,), np.int32) for _ in self.fields]
        self._values = [GrowingArray((), np.float64) for _ in self.fields]

    def _learn(self, observations: Observations) -> None:
        cells = np.stack([observations.x, observations.y], axis=1)
        for k, sensed in enumerate(observations.sensed.T):
            self._cells[k].append(cells[sensed])
            self._values[k].append(observations.values[sensed, k])

    def _estimate(self) -> InformationModel:
        self._check_size()
        prior = float(np.sqrt(1.0 + NOISE))
        model = InformationModel.uniform(
            self.grid_.shape, value=(0.0,) * len(self.fields), uncertainty=prior, fields=self.fields.names
        )
        for k in range(len(self.fields)):
            if len(self._values[k]):
                self._estimate_field(k, model)
        return model

    def _estimate_field(self, k: int, model: InformationModel) -> None:
        regressor = self._fit_regressor(k)
        height = self.grid_.shape[1]
        value, uncertainty = model.value[k].reshape(-1), model.uncertainty[k].reshape(-1)
        for start in range(0, len(value), _CHUNK_CELLS):
            cells = np.arange(start, min(start + _CHUNK_CELLS, len(value)))
            positions = np.stack([cells // height, cells % height], axis=1)
            value[cells], uncertainty[cells] = regressor.predict(positions, return_std=True)

    def _fit_regressor(self, k: int) -> Any:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF, WhiteKernel

        kernel = RBF([LENGTH, LENGTH], LENGTH_BOUNDS) + WhiteKernel(NOISE, NOISE_BOUNDS)
        regressor = GaussianProcessRegressor(
            kernel, alpha=1e-10, n_restarts_optimizer=self.n_restarts, random_state=self.seed_
        )
        with warnings.catch_warnings():
            # A lengthscale at its bound is expected with the paper's bounds.
            warnings.simplefilter("ignore", ConvergenceWarning)
            return regressor.fit(self._cells[k].array, self._values[k].array)

    def _check_size(self) -> None:
        points = max(len(values) for values in self._values)
        width, height = self.grid_.shape
        if points > self.max_points or points * width * height > self.max_entries:
            raise EstimatorError(
                f"gp-sklearn: {points} observations on {width} x {height} cells need"
                f" {points * width * height / 1e6:.0f} million covariances, but the limits are max_points"
                f" {self.max_points} and max_entries {self.max_entries / 1e6:.0f} million;"
                " use the estimator 'gp' or 'adaptive-disk'"
            )
