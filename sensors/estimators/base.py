"""The interface of estimators, a base class for them, and their registry.

Estimators follow the conventions of scikit-learn:

- ``__init__`` only stores parameters. ``get_params`` and ``set_params`` access them by name, so that
  `sklearn.base.clone` works.
- ``fit`` validates the parameters, discards everything learned, and learns. ``partial_fit`` learns from
  further observations. ``fit`` and ``partial_fit`` return the estimator.
- Names of learned attributes end in ``_``.

An estimator with a parameter ``fields`` works with any fields; other estimators work only with the fields of
the benchmark. Packages register estimators in the entry point group ``wbf_mission.estimators``.

>>> "adaptive-disk" in estimator_names()
True
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from geo.imports import entry_points, load_entry
from geo.texts import unknown
from sensors.errors import EstimatorError
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel

if TYPE_CHECKING:
    from geo.farm import Farm
    from geo.grid import FarmGrid

ENTRY_POINT_GROUP = "wbf_mission.estimators"
DEFAULTS_GROUP = "wbf_mission.default_estimators"
_HANDED_ON = ("fields", "random_state")

LEARNING = "training the estimator"
"""Description of the work that `BaseEstimator.prepare` reports."""

Progress = Callable[[str, float, float], None]
Step = Callable[[float], None]
"""Progress callback, which takes the finished fraction, 0..1; not called if there is nothing to learn."""
Views = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Value and uncertainty of an estimate."""
RandomState = np.random.Generator | np.random.SeedSequence | int | None


def no_step(_part: float) -> None:
    """Ignore progress; this is the default `Step` callback."""


@runtime_checkable
class Estimator(Protocol):
    """Turns observations into an information model of the whole farm."""

    def fit(self, grid: FarmGrid, observations: Observations | None = None) -> Self:
        """Start over on the farm `grid`, and learn from the observations, if any."""
        ...

    def partial_fit(self, observations: Observations) -> Self:
        """Learn from further observations, made after all earlier observations."""
        ...

    def predict(self) -> InformationModel:
        """Return the current estimate.

        The estimator may return read-only views of its own arrays and change them later. The arrays are valid
        until the next ``fit`` or ``partial_fit``; make an `InformationModel.copy` to keep them. If an
        estimator reports changed tiles in `InformationModel.changed`, scores and views need not process the
        whole farm.
        """
        ...


_OUTSIDE = 1e-4  # Rounding may move values beyond 0 or 1 by this much


def model_fault(
    estimator: object, model: object, fields: tuple[str, ...], shape: tuple[int, int]
) -> str | None:
    """Return, in one line, the first fault of a model that ``predict`` returned; None without fault.

    `fields` and `shape` are the names of the run's fields, and the width and height of the farm in cells.
    """
    if not isinstance(model, InformationModel):
        what = _KINDS.get(type(model), f"a {type(model).__name__}")
        return f"predict returned {what}, not an InformationModel"
    if model.fields != fields:
        found, expected = ", ".join(model.fields), ", ".join(fields)
        return f"predict returned the fields {found}; the fields of the run are {expected}, in this order"
    if model.shape != shape:
        return f"predict returned maps of shape {model.shape}; the farm's grid has the shape {shape}"
    low, high = float(model.value.min()), float(model.value.max())
    if not (np.isfinite(low) and np.isfinite(high)):
        return "predict returned a value that is not finite in every cell"
    if not getattr(estimator, "unbounded", False) and (low < -_OUTSIDE or high > 1.0 + _OUTSIDE):
        worst = low if low < -_OUTSIDE else high
        return f"predict returned the value {worst:.4g}; values are 0 to 1 (numpy.clip them)"
    least = float(model.uncertainty.min())
    if not least >= 0.0:
        return f"predict returned an uncertainty that is negative in some cell or not finite ({least:.4g})"
    return None


_KINDS = {type(None): "None", np.ndarray: "an array"}


class BaseEstimator(ABC):
    """Base class of estimators: stores the farm, validates observations, and accesses parameters by name.

    A subclass stores its parameters in ``__init__`` and has three methods: ``_start`` validates the
    parameters and starts over on a new farm, ``_learn`` learns from at least one validated observation, and
    ``_estimate`` returns the model. Before `fit`, the other public methods raise EstimatorError.
    """

    incremental: ClassVar[bool] = False
    """Whether learning a few further observations is fast on a farm of any size."""
    states_deviation: ClassVar[bool] = False
    """Whether the model's uncertainty is the standard deviation of the true values. If not, reports count
    observed cells instead."""
    knows_only_seen: ClassVar[bool] = False
    """Whether the estimator estimates observed cells only; maps then omit all other cells."""
    unbounded: ClassVar[bool] = False
    """Whether values may be below 0 or above 1, as extrapolations of a Gaussian process may."""

    fields: FieldSet = PAPER_FIELDS
    grid_: FarmGrid
    n_observations_: int
    latest_day_: int | None
    """Latest day that was observed or advanced to; None before any such day."""

    def fit(self, grid: FarmGrid, observations: Observations | None = None) -> Self:
        """Start over on the farm `grid`, and learn from the observations, if any.

        Parameters
        ----------
        grid : FarmGrid
            The farm's cells.
        observations : Observations, optional
            Observations in the order of their times.

        Raises
        ------
        EstimatorError
            If a parameter is out of range, or the farm is too large for the method.
        ObservationError
            If an observation lies outside the farm, or has other fields.
        """
        if observations is not None:
            observations.check_fields(self.fields.names)
            observations.check_inside(grid.shape)
        self._start(grid)
        self.grid_ = grid
        self.n_observations_ = 0
        self.latest_day_ = None
        return self if observations is None else self.partial_fit(observations)

    def partial_fit(self, observations: Observations) -> Self:
        """Learn from further observations, which were made after all earlier observations.

        If an observation lies outside the farm or has other fields, raise ObservationError and learn none of
        the observations.
        """
        self._check_fitted("partial_fit")
        observations.check_fields(self.fields.names)
        observations.check_inside(self.grid_.shape)
        if len(observations):
            self._learn(observations)
            self.n_observations_ += len(observations)
            self._reach(int(observations.day.max()))
        return self

    def advance(self, day: int) -> Self:
        """Switch to a later day, before any observation of this day.

        An estimator with a model of time carries its estimate forward to the day; another estimator keeps its
        estimate. Raise EstimatorError if the estimator has already reached a later day.
        """
        self._check_fitted("advance")
        if self.latest_day_ is not None and day < self.latest_day_:
            msg = f"{type(self).__name__}.advance: day {day} is over; give day {self.latest_day_} or later"
            raise EstimatorError(msg)
        self._reach(day)
        return self

    def _reach(self, day: int) -> None:
        self.latest_day_ = day if self.latest_day_ is None else max(day, self.latest_day_)

    def prepare(self, days: Sequence[int], progress: Progress | None = None) -> Self:  # noqa: ARG002
        """Train in advance for estimates on some days. Most estimators need no training.

        An estimator that needs training and was not prepared trains at the first `predict`. ``progress(what,
        done, total)`` is not called if there is nothing to learn.
        """
        self._check_fitted("prepare")
        return self

    def predict(self) -> InformationModel:
        """Return the present estimate; the arrays are valid until the next `fit` or `partial_fit`."""
        self._check_fitted("predict")
        return self._estimate()

    def memory_bytes(self, shape: tuple[int, int], n_observations: int) -> int:  # noqa: ARG002
        """Return the bytes that `fit` and `predict` need on a farm of this shape, including the model."""
        width, height = shape
        return 2 * len(self.fields) * 4 * width * height

    @classmethod
    def _param_names(cls) -> tuple[str, ...]:
        return tuple(inspect.signature(cls).parameters)

    def get_params(self, deep: bool = True) -> dict[str, Any]:  # noqa: ARG002 (scikit-learn's signature)
        """Return the parameters of ``__init__`` by name. `deep` has no effect: no parameter is nested."""
        return {name: getattr(self, name) for name in self._param_names()}

    def set_params(self, **params: Any) -> Self:
        """Change parameters by name. The next `fit` validates and applies the new values.

        If a name is unknown, raise EstimatorError and change no parameter.
        """
        known = self._param_names()
        wrong = sorted(set(params) - set(known))
        if wrong:
            raise EstimatorError(f"{type(self).__name__}: {unknown('parameter', wrong[0], known)}")
        for name, value in params.items():
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        params = ", ".join(f"{name}={value!r}" for name, value in self.get_params().items())
        return f"{type(self).__name__}({params})"

    def _check_fitted(self, what: str) -> None:
        if not hasattr(self, "grid_"):
            raise EstimatorError(f"{type(self).__name__}.{what} was called before fit: call fit(grid) first")

    def _require(self, who: str, **fitting: bool) -> None:
        """Raise EstimatorError for the first parameter whose condition in `fitting` is false."""
        for name, fits in fitting.items():
            if not fits:
                raise EstimatorError(f"{who}: {name} cannot be {getattr(self, name)!r}")

    @abstractmethod
    def _start(self, grid: FarmGrid) -> None: ...

    @abstractmethod
    def _learn(self, observations: Observations) -> None: ...

    @abstractmethod
    def _estimate(self) -> InformationModel: ...


def published_views(published: Views, own: Views) -> Views:
    """Return `published` if it has views of the arrays `own`, or else new read-only views of these arrays.

    Both views have the shape of the first array.
    """
    if all(view.base is array for view, array in zip(published, own, strict=True)):
        return published
    shape = own[0].shape
    return np.broadcast_to(own[0], shape), np.broadcast_to(own[1], shape)


def prepare_estimator(estimator: Estimator, days: Sequence[int], progress: Progress | None = None) -> None:
    """If an estimator has a method `prepare` (see `BaseEstimator.prepare`), call this method."""
    prepare = getattr(estimator, "prepare", None)
    if prepare is not None:
        prepare(days, progress)


def advance_estimator(estimator: Estimator, day: int) -> None:
    """If an estimator has a method `advance` (see `BaseEstimator.advance`), call this method."""
    advance = getattr(estimator, "advance", None)
    if advance is not None:
        advance(day)


def estimator_memory(estimator: Estimator, shape: tuple[int, int], n_observations: int) -> int:
    """Return the bytes that an estimator needs: the result of `memory_bytes`, or else its model's size."""
    own = getattr(estimator, "memory_bytes", None)
    width, height = shape
    return (
        int(own(shape, n_observations))
        if own is not None
        else 2 * len(estimator_fields(estimator)) * 4 * width * height
    )


def estimator_fields(estimator: Estimator) -> FieldSet:
    """Return an estimator's fields: its attribute `fields`, or else the benchmark's fields."""
    fields = getattr(estimator, "fields", PAPER_FIELDS)
    return fields if isinstance(fields, FieldSet) else PAPER_FIELDS


def check_default_values(default_values: Sequence[float] | None, fields: FieldSet) -> tuple[float, ...]:
    """Validate default values, one finite number per field; None stands for the fields' defaults."""
    if default_values is None:
        return fields.defaults
    values = np.asarray(default_values, np.float64)
    if values.shape != (len(fields),) or not np.isfinite(values).all():
        raise EstimatorError(
            f"default_values {default_values!r}: give one finite number for each of {', '.join(fields.names)}"
        )
    return tuple(values.tolist())


def require_paper_fields(name: str, fields: FieldSet) -> None:
    """Raise EstimatorError, which names the estimator, unless these are the benchmark's fields."""
    if fields.names != PAPER_FIELDS.names:
        raise EstimatorError(
            f"estimator {name!r} needs exactly the fields {', '.join(PAPER_FIELDS.names)}; this run has"
            f" {', '.join(fields.names)}: use 'adaptive-disk', 'gp' or 'point'"
        )


def estimator_names() -> tuple[str, ...]:
    """Return the names of all registered estimators, sorted."""
    return tuple(sorted(_registered()))


def make_estimator(
    name: str | Estimator,
    *,
    fields: FieldSet = PAPER_FIELDS,
    random_state: RandomState = None,
    **params: Any,
) -> Estimator:
    """Return an estimator by its registered name. Modules of other estimators are not imported.

    Parameters
    ----------
    name : str or Estimator
        A name in `estimator_names`, or an estimator object, which takes no parameters here. The object is
        returned unchanged, or copied for other fields.
    fields : FieldSet
        Observed fields; passed on to an estimator whose parameter ``fields`` has its default.
    random_state : Generator, SeedSequence, int or None
        Random state; passed on to an estimator that has a parameter ``random_state``.
    **params
        Further parameters of the estimator's ``__init__``.

    Raises
    ------
    EstimatorError
        If the name or a parameter is unknown, the estimator cannot be loaded, or it does not support the
        fields.

    Examples
    --------
    >>> make_estimator("adaptive-disk", radius=3)
    AdaptiveDiskEstimator(default_values=None, radius=3, fields=FieldSet(tylcv, ccr, soil))
    """
    if not isinstance(name, str):
        return _given(name, fields, params)
    known = _registered()
    if name not in known:
        raise EstimatorError(unknown("estimator", name, sorted(known)))
    factory = load_entry(known[name], f"estimator {name!r}", EstimatorError)
    accepted = inspect.signature(factory).parameters
    anything = any(parameter.kind is parameter.VAR_KEYWORD for parameter in accepted.values())
    wrong = [] if anything else sorted(set(params) - set(accepted))
    if wrong:
        own = [parameter for parameter in accepted if parameter not in _HANDED_ON]
        raise EstimatorError(f"estimator {name}: {unknown('parameter', wrong[0], own)}")
    if "fields" in accepted:
        params["fields"] = fields
    else:
        require_paper_fields(name, fields)
    if "random_state" in accepted:
        params["random_state"] = random_state
    return factory(**params)


def _given(estimator: Estimator, fields: FieldSet, params: dict[str, Any]) -> Estimator:
    if not isinstance(estimator, Estimator):
        found = type(estimator).__name__
        raise EstimatorError(
            f"estimator of type {found}: give a registered name, or an object with fit, partial_fit, predict"
        )
    if params:
        msg = f"parameter {sorted(params)[0]!r}: an estimator object already has its parameters"
        raise EstimatorError(msg)
    own = estimator_fields(estimator).names
    takes = own != fields.names and "fields" in inspect.signature(type(estimator)).parameters
    if takes and own == PAPER_FIELDS.names and isinstance(estimator, BaseEstimator):  # It has its default
        return type(estimator)(**{**estimator.get_params(), "fields": fields})
    if own != fields.names:
        found = f"{type(estimator).__name__} is for the fields {', '.join(own)}"
        msg = f"{found}, but the run has {', '.join(fields.names)}; set the estimator's parameter fields"
        raise EstimatorError(msg)
    return estimator


def _registered() -> dict[str, EntryPoint]:
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=ENTRY_POINT_GROUP):
        if found.setdefault(point.name, point).value != point.value:
            msg = f"estimator {point.name!r} is registered twice: {found[point.name].value} and {point.value}"
            raise EstimatorError(msg)
    return found


def default_estimator(farm: Farm, fields: Sequence[str] = PAPER_FIELDS.names) -> str:
    """Return the name of the estimator with the least loss at an acceptable cost on a farm.

    Each entry point of the group ``wbf_mission.default_estimators`` is a function of the farm and the names
    of the fields. The first entry point, by name, that returns True gives the estimator's name; the default
    is ``gp``. ``docs/decisions/0013-default-estimator.md`` has the measurements.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> default_estimator(get_farm("waterberry"))
    'gp'
    """
    for entry in sorted(entry_points(DEFAULTS_GROUP), key=lambda entry: entry.name):
        if load_entry(entry, f"default estimator {entry.name!r}", EstimatorError)(farm, tuple(fields)):
            return entry.name
    return "gp"
