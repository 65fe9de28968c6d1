"""The information model, with the value and uncertainty of every cell of the farm.

Estimators report in which square tiles they changed a cell, and the score stores sums for each tile. Tile (i,
j) has the cells ``[64 i, 64 (i + 1)) x [64 j, 64 (j + 1))`` that are on the farm. A set of tiles is a boolean
array with an entry for each tile.

>>> tile_shape((6000, 5000))
(94, 79)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.texts import unknown
from sensors.errors import EstimatorError
from sensors.fields import PAPER_FIELDS, FieldSet

CLASSES = ("healthy", "infected", "lost")
"""Classes of plants, in the order that class probabilities have."""
HELD = 0.9
"""Fraction of the unobserved sick plants that the set `InformationModel.may_be_sick` should contain."""
_CERTAIN = 1e-6  # Rounding error of the probability of a plant whose class is certain

TILE_CELLS = 64
SQUARES, WORSE_SQUARES, ABSOLUTE, WORSE_ABSOLUTE = range(4)
SUMS = 4
"""Number of sums for each tile: squared and absolute errors, each over all and over overestimated cells."""


_STRIP_COLUMNS = 100  # With 5000 rows and three classes, a strip takes 6 MB


def column_strips(width: int, step: int = 1) -> Iterator[slice]:
    """Yield slices of columns that cover a farm; each slice but the last has a multiple of `step` columns.

    Examples
    --------
    >>> list(column_strips(240, 25))
    [slice(0, 100, None), slice(100, 200, None), slice(200, 240, None)]
    """
    columns = step * max(1, _STRIP_COLUMNS // step)
    for first in range(0, width, columns):
        yield slice(first, min(first + columns, width))


def tile_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Return the number of tiles along x and y for a farm of this shape (cells)."""
    width, height = shape
    return -(-width // TILE_CELLS), -(-height // TILE_CELLS)


def tiles_of_boxes(
    shape: tuple[int, int],
    x0: NDArray[np.integer],
    x1: NDArray[np.integer],
    y0: NDArray[np.integer],
    y1: NDArray[np.integer],
) -> NDArray[np.bool_]:
    """Return the tiles that at least one of the boxes ``[x0, x1) x [y0, y1)`` touches.

    Boxes are clipped to the farm; empty boxes touch no tile.

    Examples
    --------
    >>> box = [np.array([v]) for v in (60, 65, 0, 1)]
    >>> tiles_of_boxes((200, 100), *box).astype(int).tolist()
    [[1, 0], [1, 0], [0, 0], [0, 0]]
    """
    width, height = shape
    x0, x1 = np.clip(x0, 0, width), np.clip(x1, 0, width)
    y0, y1 = np.clip(y0, 0, height), np.clip(y1, 0, height)
    some = (x0 < x1) & (y0 < y1)
    if width <= TILE_CELLS and height <= TILE_CELLS:
        # Small farms are updated after each observation, and this line is faster than the sums below.
        return np.array([[bool(some.any())]])
    left, low = x0[some] // TILE_CELLS, y0[some] // TILE_CELLS
    right, high = (x1[some] - 1) // TILE_CELLS + 1, (y1[some] - 1) // TILE_CELLS + 1
    columns, rows = tile_shape(shape)
    # Corners of boxes count +1 or -1, so that cumulative sums along both axes count the boxes over each tile.
    count = np.zeros((columns + 1, rows + 1), np.int64)
    np.add.at(count, (left, low), 1)
    np.add.at(count, (right, high), 1)
    np.add.at(count, (left, high), -1)
    np.add.at(count, (right, low), -1)
    return count.cumsum(axis=0).cumsum(axis=1)[:columns, :rows] > 0


def least_sick(sick: NDArray[np.floating], counts: NDArray[np.integer] | None = None) -> float:
    """Return the lowest probability of being sick among the plants in `InformationModel.may_be_sick`.

    `counts` is the number of plants with each probability in `sick`, by default 1.

    Examples
    --------
    >>> least_sick(np.array([1.0, 0.6, 0.3, 0.06, 0.04, 0.0]))
    0.3
    """
    is_open = (sick > 0.0) & (sick < 1.0 - _CERTAIN)
    if not is_open.any():
        return 1.0 - _CERTAIN
    if counts is None:
        values, plants = np.unique(sick[is_open], return_counts=True)
    else:
        values, which = np.unique(sick[is_open], return_inverse=True)
        plants = np.bincount(which, counts[is_open]).astype(np.intp)
    held = np.cumsum(values[::-1] * plants[::-1], dtype=np.float64)
    return float(values[::-1][np.searchsorted(held, HELD * held[-1] * (1.0 - _CERTAIN))])


class LazyProbabilities(Mapping[str, NDArray[np.float32]]):
    """Class probabilities that are computed at each access and not kept, for large farms.

    `compute` takes a disease's name and a slice of the farm's columns, and returns float32[3, columns, H].
    """

    __slots__ = ("_compute", "_diseases")

    def __init__(
        self, diseases: tuple[str, ...], compute: Callable[[str, slice], NDArray[np.float32]]
    ) -> None:
        self._diseases = diseases
        self._compute = compute

    def __getitem__(self, disease: str) -> NDArray[np.float32]:
        """Compute the class probabilities of a disease."""
        return self.columns(disease, slice(None))

    def columns(self, disease: str, columns: slice) -> NDArray[np.float32]:
        """Compute the class probabilities of a disease in some columns, float32[3, columns, H]."""
        if disease not in self._diseases:
            raise KeyError(disease)
        return self._compute(disease, columns)

    def __contains__(self, disease: object) -> bool:
        # Without this method, `Mapping.__contains__` would compute the probabilities.
        return disease in self._diseases

    def __iter__(self) -> Iterator[str]:
        return iter(self._diseases)

    def __len__(self) -> int:
        return len(self._diseases)


@dataclass(frozen=True, slots=True, eq=False)
class InformationModel:
    """An estimate of the fields over the whole farm.

    Parameters
    ----------
    value : float32[n, W, H]
        Estimate of each field in each cell: 1 healthy, 0.5 infected, 0 lost; or 0 to 1 if continuous.
    uncertainty : float32[n, W, H]
        Uncertainty of each value. It is zero if the value is certain; its scale depends on the estimator.
    changed : bool[tiles along x, tiles along y], optional
        Tiles (see the module) in which values or uncertainties may differ from the estimator's preceding
        model; None if all tiles may differ. The array may have a first axis of fields in addition.
    revision : int, optional
        Number of models that the estimator returned between `fit` and this model. `changed` refers to the
        model of the preceding revision; a reader that skipped a revision must treat all tiles as changed.
    fields : tuple of str
        Names of the n fields; by default the benchmark's fields.
    probabilities : mapping of str to float32[3, W, H], optional
        Probabilities that plants are healthy, infected and lost (`CLASSES`), by name of the disease; None if
        the estimator gives no probabilities. On large farms each access may compute the probabilities. An
        access may take as long as an estimate, and works only until the estimator learns more observations.
    loss_map : float32[n, W, H] or callable, optional
        The array `expected_loss`, or a callable that returns this array at each access.
    correlation_length : tuple of float, optional
        Correlation length (cells) of each field in the estimator's model; None if there is none.

    Raises
    ------
    EstimatorError
        If an array has another shape or type, or there are probabilities of an unknown field.

    Examples
    --------
    >>> model = InformationModel.uniform((4, 5), value=(1, 1, 0), uncertainty=1)
    >>> model.shape, float(model.of("ccr").mean())
    ((4, 5), 1.0)
    """

    value: NDArray[np.float32]
    uncertainty: NDArray[np.float32]
    changed: NDArray[np.bool_] | None = None
    revision: int = 0
    fields: tuple[str, ...] = PAPER_FIELDS.names
    probabilities: Mapping[str, NDArray[np.float32]] | None = None
    loss_map: NDArray[np.float32] | Callable[[], NDArray[np.float32]] | None = None
    correlation_length: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        for name, array in (("value", self.value), ("uncertainty", self.uncertainty)):
            if array.ndim != 3 or array.shape[0] != len(self.fields) or array.dtype != np.float32:
                found = f"{array.dtype}{list(array.shape)}"
                msg = f"information model: {name} is {found}, expected float32[{len(self.fields)}, W, H]"
                cast = f"; write {name}.astype('float32')" if array.dtype != np.float32 else ""
                raise EstimatorError(msg + cast)
        if self.value.shape != self.uncertainty.shape:
            shapes = f"value {self.value.shape} and uncertainty {self.uncertainty.shape}"
            raise EstimatorError(f"information model: {shapes} differ in shape")
        wrong = sorted(set(self.probabilities or ()) - set(self.fields))
        if wrong:
            text = unknown("field", wrong[0], self.fields)
            raise EstimatorError(f"information model: probabilities: {text}")
        if self.changed is not None:
            expected = tile_shape(self.shape)
            by_field = (len(self.value), *expected)
            if self.changed.shape not in (expected, by_field) or self.changed.dtype != np.bool_:
                found = f"{self.changed.dtype}{list(self.changed.shape)}"
                raise EstimatorError(f"information model: changed is {found}, expected bool{list(expected)}")

        if self.loss_map is not None and not callable(self.loss_map):
            self._check_loss(self.loss_map)

    @property
    def expected_loss(self) -> NDArray[np.float32] | None:
        """Expected loss of `value` in each cell, float32[n, W, H]; None if the estimator gives no loss.

        The loss is the squared error times the cost of estimates that are too healthy or too sick, without
        the weights of the fields. Cells that are not scored have an expected loss too. The mean over a
        field's mask is the field's expected loss. The loss is valid as long as `value` is valid. Raise
        EstimatorError if the array has another shape or type, or the estimator has learned more observations.
        """
        if callable(self.loss_map):
            loss: NDArray[np.float32] = self.loss_map()
            self._check_loss(loss)
            return loss
        return self.loss_map

    def _check_loss(self, loss: NDArray[np.float32]) -> None:
        if loss.shape != self.value.shape or loss.dtype != np.float32:
            found, expected = f"{loss.dtype}{list(loss.shape)}", f"float32{list(self.value.shape)}"
            raise EstimatorError(f"information model: expected_loss is {found}, expected {expected}")

    @property
    def shape(self) -> tuple[int, int]:
        """Width and height of the farm in cells."""
        return int(self.value.shape[1]), int(self.value.shape[2])

    def of(self, field: str) -> NDArray[np.float32]:
        """Return the values of the field with this name, float32[W, H]."""
        if field not in self.fields:
            raise EstimatorError(f"information model: {unknown('field', field, self.fields)}")
        return self.value[self.fields.index(field)]

    def probabilities_in(self, disease: str, columns: slice) -> NDArray[np.float32]:
        """Return the class probabilities of a disease in some columns of the farm, float32[3, columns, H].

        Lazy probabilities are computed in these columns alone. Raise EstimatorError if the disease has no
        class probabilities.
        """
        known = self.probabilities
        if known is None or disease not in known:
            raise EstimatorError(f"information model: there are no class probabilities of {disease!r}")
        if isinstance(known, LazyProbabilities):
            return known.columns(disease, columns)
        return known[disease][:, columns]

    def may_be_sick(self, disease: str, where: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
        """Return a mask of the smallest set of plants that has 90 % of the sick plants, bool[W, H].

        Uncertain plants are added in descending order of the probability that they are sick, until the
        probabilities in the set add up to 90 % of the total. If the probabilities are calibrated, the set has
        90 % of the sick plants. The 90 % concern only sick plants, because nearly all plants are healthy.
        Plants that are certainly sick are in the set too.

        Parameters
        ----------
        disease : str
            The name of a field with class probabilities.
        where : bool[W, H], optional
            The plants to consider; by default all plants.

        Raises
        ------
        EstimatorError
            If the model has no class probabilities of this disease.
        """
        sick = 1.0 - self.probabilities_in(disease, slice(None))[0]
        if where is not None:
            sick *= where
        return sick >= least_sick(sick)

    def changed_in(self, k: int) -> NDArray[np.bool_]:
        """Return the tiles in which the field `k` may have changed."""
        if self.changed is None:
            return np.ones(tile_shape(self.shape), np.bool_)
        return self.changed if self.changed.ndim == 2 else self.changed[k]

    def copy(self) -> InformationModel:
        """Return a copy, which does not change when the estimator learns more observations."""
        probabilities = None
        if self.probabilities is not None:
            probabilities = {name: np.array(array) for name, array in self.probabilities.items()}
        loss = self.expected_loss
        return InformationModel(
            self.value.copy(),
            self.uncertainty.copy(),
            fields=self.fields,
            probabilities=probabilities,
            loss_map=None if loss is None else loss.copy(),
            correlation_length=self.correlation_length,
        )

    @classmethod
    def unknown(cls, shape: tuple[int, int], fields: FieldSet) -> InformationModel:
        """Return the model before any observation: the fields' defaults, in arrays that take no memory."""
        full = (len(fields), *shape)
        value = np.broadcast_to(np.array(fields.defaults, np.float32)[:, None, None], full)
        return cls(value, np.broadcast_to(np.float32(1.0), full), fields=fields.names)

    @classmethod
    def uniform(
        cls,
        shape: tuple[int, int],
        *,
        value: tuple[float, ...],
        uncertainty: float,
        fields: tuple[str, ...] = PAPER_FIELDS.names,
    ) -> InformationModel:
        """Return a model in which all cells are equal; `value` has a number for each field."""
        values = np.empty((len(fields), *shape), np.float32)
        values[:] = np.asarray(value, np.float32)[:, None, None]
        return cls(values, np.full_like(values, uncertainty), fields=fields)
