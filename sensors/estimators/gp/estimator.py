"""The estimator gp, a Gaussian process for each field: exact within the memory limit, local beyond it."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from geo.system import in_parallel, user_cache_folder
from sensors.errors import EstimatorError
from sensors.estimators.base import LEARNING, BaseEstimator, Progress, Step, Views, no_step, published_views
from sensors.estimators.days import transition
from sensors.estimators.gp.cell_posterior import GROWING, ExactPosterior
from sensors.estimators.gp.cell_posterior import MOST_CELLS as WINDOWED_CELLS
from sensors.estimators.gp.classes import ClassMap
from sensors.estimators.gp.field import FieldProcess
from sensors.estimators.gp.rbf import RbfKernel, fit_kernel
from sensors.fields import PAPER_FIELDS, Field, FieldSet
from sensors.scoring.expected import loss_of_deviation
from sensors.scoring.information import TILE_CELLS, InformationModel, LazyProbabilities, tile_shape
from sensors.scoring.score import ScoreWeights

if TYPE_CHECKING:
    from geo.grid import FarmGrid
    from sensors.observations import Observations

ZERO_MEAN = (0.0, 0.0, 0.0)
METHODS = ("auto", "exact", "local")
PRIOR_SOURCES = ("model", "observations")
STATES = ("classes", "mean")

_LOCAL_BYTES_A_CELL = 72
_Values = NDArray[np.float32]
_Floats = NDArray[np.float64]


class GaussianProcessEstimator(BaseEstimator):
    """A Gaussian process for each field, with the paper's kernel: squared exponential plus white noise.

    *Mean and kernel.* With ``learn_from="model"``, mean and kernel are learned from environments of the farm
    that are simulated up to the latest observed day (`sensors.estimators.gp.prior`). The first time, learning
    takes one or two seconds; later runs read the result from a cache folder. With
    ``learn_from="observations"``, the kernel is fitted by marginal likelihood when a field has 16, 32, 64,
    ..., 512, 2048, 8192, ... observations. Beyond 512, a fit uses eight evenly spread runs of 64 consecutive
    observations. If all observations are equal, for example if all plants are healthy, the kernel is the
    initial kernel. (The paper fixes the amplitude to 1 by ``amplitude_bounds=(1, 1)``.)

    *Posterior.* Exact posteriors (`ExactPosterior`) cost O(observations x cells) per observation. If exact
    posteriors exceed `memory_limit_mb`, the method depends on the lengthscale. For short lengthscales,
    windows of cells are stored per observation if they fit (`WindowedPosterior`), or else the farm is solved
    by tiles. A field whose lengthscale is long compared with the farm is modelled as a sum of sine functions
    (`sensors.estimators.gp.local`). Beyond the memory limit, `predict` returns the same arrays at each call.
    Repeated observations of a cell on a day count as independent. Soil readings close together have reduced
    weights, on all farms on later days, and on farms of more than 128 cells a side on all days.

    *Days.* Readings of earlier days are carried forward by the field's dynamics (`sensors.estimators.days`).
    For a disease, the remaining variance is additional noise, and a later day's reading of a cell replaces
    earlier readings of the cell. As showers are smooth, readings of the soil become outdated together. With
    kernels learned from observations, readings stay unchanged, and the additional noise is the mean squared
    change of cells that have readings on two days.

    *Classes.* Mean and standard deviation do not give the probability that a plant is sick. The relation of
    mean and probability is learned together with the kernel (`sensors.estimators.gp.classes`). A disease's
    value is the value of least expected loss, and its uncertainty is the standard deviation of the true
    value. A plant read today has the class of its reading, provided that all readings have the value of a
    class. Land without the crop is healthy.

    As in the paper, the uncertainty of other fields is the standard deviation of an observation, noise
    included. The noise is the deviation of a cell from the smooth latent function.

    Parameters
    ----------
    prior_mean : sequence of (float or None), optional
        Value of each field far from all observations; None selects the running mean of the observations. The
        default is the model's mean, or else healthy for diseases and the running mean for soil. The paper has
        ``(0, 0, 0)``. Given values are never changed.
    kernel : RbfKernel
        Initial kernel.
    optimise : bool
        Whether to learn mean and kernel; if False, `prior_mean` and `kernel` are used.
    length_bounds, noise_bounds, amplitude_bounds : tuple of two floats
        Bounds for the fit to observations: lengthscales (cells), variances of noise and latent function.
    clip : bool
        Whether to clip means to 0..1, the range of every field.
    states : {"classes", "mean"}
        Estimate of diseases that have a learned prior. ``"classes"`` uses class probabilities, as above.
        ``"mean"`` uses the process's mean and the standard deviation of an observation, as for other fields.
    method : {"auto", "exact", "local"}
        Kind of posterior. ``"auto"`` is exact within the memory limit and local beyond it.
    memory_limit_mb : float
        Memory limit for the rows of exact or windowed posteriors, MiB. Growing windows briefly need up to 2.5
        times as much.
    learn_from : {"model", "observations"}
        Source of mean and kernel. ``"observations"`` is only for unknown diseases and weather. Flights rarely
        meet a sick plant, so a kernel fitted to observations is overconfident about unobserved cells
        (``docs/decisions/0009-gaussian-process-at-scale.md``).
    fields : FieldSet
        The observed fields, with the assumed dynamics; by default the benchmark's fields.
    day : int
        Day that is assumed before the first observation.
    training_seed : int
        Seed of the simulated environments; equal seeds give equal priors.
    cache : path-like, optional
        Folder of learned priors; by default ``wbf-mission/gp`` in XDG_CACHE_HOME or ~/.cache.

    Attributes
    ----------
    kernels_ : list of RbfKernel
        The kernel of each field.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> from sensors.observations import Observations
    >>> seen = Observations([5], [5], [0.0], [6], [[0.5, 1.0, 0.25]])
    >>> model = GaussianProcessEstimator().fit(get_farm("miniberry-10").grid(), seen).predict()
    >>> [round(float(value), 3) for value in model.of("tylcv")[[5, 7, 9], 5]]
    [0.5, 0.316, 0.345]
    """

    states_deviation = True
    unbounded = True
    kernels_: list[RbfKernel]

    def __init__(
        self,
        prior_mean: Sequence[float | None] | None = None,
        kernel: RbfKernel = RbfKernel(),  # noqa: B008 (immutable)
        optimise: bool = True,
        length_bounds: tuple[float, float] = (1.0, 10.0),
        noise_bounds: tuple[float, float] = (1e-5, 1e5),
        amplitude_bounds: tuple[float, float] = (0.01, 1.0),
        clip: bool = True,
        method: str = "auto",
        memory_limit_mb: float = 256.0,
        learn_from: str = "model",
        fields: FieldSet = PAPER_FIELDS,
        day: int = 6,
        training_seed: int = 0,
        cache: str | os.PathLike[str] | None = None,
        states: str = "classes",
    ) -> None:
        self.prior_mean = prior_mean
        self.kernel = kernel
        self.optimise = optimise
        self.length_bounds = length_bounds
        self.noise_bounds = noise_bounds
        self.amplitude_bounds = amplitude_bounds
        self.clip = clip
        self.method = method
        self.memory_limit_mb = memory_limit_mb
        self.learn_from = learn_from
        self.fields = fields
        self.day = day
        self.training_seed = training_seed
        self.cache = cache
        self.states = states

    def memory_bytes(self, shape: tuple[int, int], n_observations: int) -> int:
        """Return the bytes that the estimator needs; see `BaseEstimator.memory_bytes`."""
        cells = shape[0] * shape[1]
        models = 2 * len(self.fields) * 4 * cells
        exact = len(self.fields) * ExactPosterior.bytes_needed(n_observations, shape)
        local = self.method == "local" or (self.method == "auto" and exact > self.memory_limit_mb * 2**20)
        if not local:
            return models + exact
        windows = GROWING * self._window_bytes * len(self.fields) if cells <= WINDOWED_CELLS else 0.0
        return _LOCAL_BYTES_A_CELL * cells + round(windows)

    def prepare(self, days: Sequence[int], progress: Progress | None = None) -> Self:
        """Learn the priors for some days in advance; see `BaseEstimator.prepare`."""
        super().prepare(days)
        if self.optimise and self.learn_from == "model":
            for number, day in enumerate(days):

                def step(part: float, before: int = number) -> None:
                    if progress is not None:
                        progress(LEARNING, before + part, len(days))

                self._take_priors(day, step)
        return self

    def _start(self, grid: FarmGrid) -> None:
        self._check_parameters()
        healthy = [1.0 if field.kind == "disease" else None for field in self.fields]
        means = healthy if self.prior_mean is None else tuple(self.prior_mean)
        self._fields = [
            FieldProcess(grid.shape, mean, before, self.kernel, is_patchy=field.kind == "continuous")
            for field, mean, before in zip(self.fields, means, self.fields.defaults, strict=True)
        ]
        self.kernels_ = [self.kernel] * len(self.fields)
        self._learned_day: int | None = None
        self._own: Views | None = None
        self._losses: NDArray[np.float32] | None = None
        self._stale = np.zeros((len(self.fields), *tile_shape(grid.shape)), np.bool_)
        self._revision = -1

    def _learn(self, observations: Observations) -> None:
        for k, (process, sensed) in enumerate(zip(self._fields, observations.sensed.T, strict=True)):
            values = observations.values[sensed, k]
            process.append(observations.x[sensed], observations.y[sensed], values, observations.day[sensed])

    def _estimate(self) -> InformationModel:
        if self.optimise:
            if self.learn_from == "model":
                self._take_priors(self.day if self.latest_day_ is None else self.latest_day_)
            else:
                fit = partial(
                    fit_kernel,
                    starts=(self.kernel,),
                    length_bounds=self.length_bounds,
                    noise_bounds=self.noise_bounds,
                    amplitude_bounds=self.amplitude_bounds,
                )
                for process in self._fields:
                    process.fit(fit)
        if self.latest_day_ is not None:
            for field, process in zip(self.fields, self._fields, strict=True):
                smooth = field.kind == "continuous" and self.learn_from == "model"
                process.carry_to(
                    self.latest_day_,
                    partial(self._carry, field, process, self.latest_day_),
                    partial(self._correlation, field) if smooth else None,
                )
        exact = not self._needs_local()
        for name, process in zip(self.fields.names, self._fields, strict=True):
            try:
                process.update(exact=exact, window_bytes=self._window_bytes)
            except np.linalg.LinAlgError:
                raise EstimatorError(
                    f"gp: the covariance of {name} is singular; use a kernel or noise_bounds with more noise"
                ) from None
            finally:
                if self.latest_day_ is not None:  # The functions hold the estimator, which would hold itself
                    process.carry_to(self.latest_day_, None)
        self.kernels_ = [process.used_kernel for process in self._fields]
        self._revision += 1
        if not exact:
            return self._local_model()
        value = np.empty((len(self.fields), *self.grid_.shape), np.float32)
        uncertainty = np.empty_like(value)
        for k, process in enumerate(self._fields):
            process.write_all(value[k], uncertainty[k], clip=self.clip)
        return self._model(value, uncertainty, None)

    def _local_model(self) -> InformationModel:
        shape = self.grid_.shape
        first = self._own is None
        if self._own is None:
            self._own = (
                np.empty((len(self.fields), *shape), np.float32),
                np.empty((len(self.fields), *shape), np.float32),
            )
            self._published = self._own
        changed = np.zeros((len(self.fields), *tile_shape(shape)), np.bool_)
        for k, process in enumerate(self._fields):
            changed[k] = process.write_changes(self._own[0][k], self._own[1][k], clip=self.clip)
        self._stale |= changed
        # The first call, and a copy of the estimator, need new views.
        self._published = published_views(self._published, self._own)
        return self._model(*self._published, None if first else changed, in_place=True)

    def _model(
        self,
        value: _Values,
        uncertainty: _Values,
        changed: NDArray[np.bool_] | None,
        *,
        in_place: bool = False,
    ) -> InformationModel:
        classes = {
            name: process.classes for name, process in zip(self.fields.names, self._fields, strict=True)
        }
        diseases, fields = tuple(name for name, one in classes.items() if one is not None), self.fields

        def probabilities(disease: str, columns: slice) -> _Values:
            k, class_map = fields.index(disease), classes[disease]
            assert class_map is not None
            return class_map.probabilities(value[k, columns], uncertainty[k, columns])

        return InformationModel(
            value,
            uncertainty,
            changed,
            self._revision,
            self.fields.names,
            probabilities=LazyProbabilities(diseases, probabilities) if diseases else None,
            loss_map=partial(self._loss_of, tuple(classes.values()), value, uncertainty, in_place=in_place),
            correlation_length=tuple(
                math.sqrt(kernel.length_x * kernel.length_y) for kernel in self.kernels_
            ),
        )

    def _loss_of(
        self, classes: tuple[ClassMap | None, ...], value: _Values, uncertainty: _Values, *, in_place: bool
    ) -> _Values:
        """Return each cell's expected loss. With `in_place`, update only stale strips of a shared array."""
        if in_place and self._losses is not None:
            losses, stale = self._losses, self._stale
        else:
            losses, stale = np.empty_like(value), np.ones_like(self._stale)
        weights = ScoreWeights.of(self.fields)

        def work(strips: Sequence[Sequence[int]]) -> None:
            for k, strip in strips:
                tiles = np.flatnonzero(stale[k, strip])
                columns = slice(strip * TILE_CELLS, (strip + 1) * TILE_CELLS)
                part = slice(k, k + 1), columns, slice(tiles[0] * TILE_CELLS, (tiles[-1] + 1) * TILE_CELLS)
                class_map = classes[k]
                if class_map is None:
                    loss_of_deviation(uncertainty[part], weights, losses[part], first=k)
                else:
                    class_map.expected_loss(value[part][0], uncertainty[part][0], losses[part][0])

        in_parallel(work, np.argwhere(stale.any(axis=2)).tolist())
        if in_place:
            self._losses = losses
            self._stale[:] = False
        return losses

    def _take_priors(self, day: int, step: Step = no_step) -> None:
        if day == self._learned_day:
            return
        from sensors.estimators.gp.prior import learn_priors

        folder = Path(self.cache) if self.cache else user_cache_folder("gp")
        priors = learn_priors(self.grid_, self.fields, day, self.training_seed, folder, step)
        for field, process, prior in zip(self.fields, self._fields, priors, strict=True):
            process.kernel = prior.kernel
            # A field without a model keeps the running mean of its readings as prior mean.
            if self.prior_mean is None and field.is_simulated:
                process.mean = prior.mean
                process.classes = None
                costs = field.cost_above, field.cost_below
                if prior.link is not None and self.states == "classes" and min(costs) > 0.0:
                    process.classes = ClassMap(prior.link, partial(field.hosts, self.grid_), *costs)
        self._learned_day = day

    def _carry(
        self, field: Field, process: FieldProcess, day: int, earlier: int, values: _Floats
    ) -> tuple[_Floats, _Floats]:
        """Return means and variances on `day`, given readings `values` of the day `earlier`."""
        if self.learn_from == "observations":
            return values, np.full(len(values), process.change_a_day * (day - earlier))
        return transition(field, self.grid_, earlier, day, self.training_seed)(values)

    def _correlation(self, field: Field, earlier: int, later: int) -> float:
        return transition(field, self.grid_, earlier, later, self.training_seed).correlation

    @property
    def _window_bytes(self) -> float:
        """Memory (bytes) that each field may use for windows of cells."""
        return self.memory_limit_mb * 2**20 / len(self.fields) if self.method == "auto" else 0.0

    def _needs_local(self) -> bool:
        needed = sum(ExactPosterior.bytes_needed(len(p), self.grid_.shape) for p in self._fields) / 2**20
        if self.method == "exact" and needed > self.memory_limit_mb:
            raise EstimatorError(
                f"gp: the exact method needs {needed:.0f} MiB for {self.n_observations_} observations on"
                f" {self.grid_.shape[0]} x {self.grid_.shape[1]} cells, memory_limit_mb is"
                f" {self.memory_limit_mb:g}; use method 'local' or 'auto', or the estimator 'adaptive-disk'"
            )
        return self.method == "local" or (self.method == "auto" and needed > self.memory_limit_mb)

    def _check_parameters(self) -> None:
        means = self.prior_mean
        self._require(
            "gp",
            prior_mean=means is None
            or (len(means) == len(self.fields) and all(mean is None or np.isfinite(mean) for mean in means)),
            kernel=isinstance(self.kernel, RbfKernel),
            length_bounds=_is_interval(self.length_bounds),
            noise_bounds=_is_interval(self.noise_bounds),
            amplitude_bounds=_is_interval(self.amplitude_bounds),
            method=self.method in METHODS,
            memory_limit_mb=self.memory_limit_mb > 0,
            learn_from=self.learn_from in PRIOR_SOURCES,
            states=self.states in STATES,
            day=isinstance(self.day, int | np.integer) and self.day >= 0,
            training_seed=isinstance(self.training_seed, int) and self.training_seed >= 0,
        )


def _is_interval(bounds: tuple[float, float]) -> bool:
    return len(bounds) == 2 and 0 < bounds[0] <= bounds[1] < float("inf")
