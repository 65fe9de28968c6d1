"""The information model: what is believed about every cell of the farm, and how firmly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.errors import EstimatorError
from sensors.fields import PAPER_FIELDS
from sensors.scoring.tiles import tile_shape


@dataclass(frozen=True, slots=True, eq=False)
class InformationModel:
    """An estimate of the fields over the whole farm.

    Parameters
    ----------
    value : float32[n, W, H]
        The estimate of each field in each cell (1 healthy, 0.5 infected, 0 lost; a continuous field 0 to 1).
    uncertainty : float32[n, W, H]
        Zero where the value is known, growing with doubt; its scale is the estimator's own.
    changed : bool[tiles along x, tiles along y], optional
        The tiles (`sensors.scoring.tiles`) outside of which no value and no uncertainty differs from the
        model that the same estimator's `predict` returned before; None if everything may differ. With an
        axis of fields before these two, the same field by field.
    revision : int, optional
        How many models the estimator returned before this one since its `fit`. `changed` is relative to the
        model of the revision before: a consumer that skipped a revision must treat every tile as changed.
    fields : tuple of str
        The names of the n fields; those of the benchmark by default.

    Raises
    ------
    EstimatorError
        If the arrays do not have the form above.

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

    def __post_init__(self) -> None:
        for name, array in (("value", self.value), ("uncertainty", self.uncertainty)):
            if array.ndim != 3 or array.shape[0] != len(self.fields) or array.dtype != np.float32:
                found = f"{array.dtype}{list(array.shape)}"
                msg = f"information model: {name} is {found}, expected float32[{len(self.fields)}, W, H]"
                raise EstimatorError(msg)
        if self.value.shape != self.uncertainty.shape:
            shapes = f"value {self.value.shape} and uncertainty {self.uncertainty.shape}"
            msg = f"information model: {shapes} differ in shape"
            raise EstimatorError(msg)
        if self.changed is not None:
            expected = tile_shape(self.shape)
            by_field = (len(self.value), *expected)
            if self.changed.shape not in (expected, by_field) or self.changed.dtype != np.bool_:
                found = f"{self.changed.dtype}{list(self.changed.shape)}"
                msg = f"information model: changed is {found}, expected bool{list(expected)}"
                raise EstimatorError(msg)

    @property
    def shape(self) -> tuple[int, int]:
        """Width and height of the farm in cells."""
        return int(self.value.shape[1]), int(self.value.shape[2])

    def of(self, field: str) -> NDArray[np.float32]:
        """Give the value array [W, H] of one field by its name."""
        if field not in self.fields:
            msg = f"information model: no field {field!r}, expected one of {', '.join(self.fields)}"
            raise EstimatorError(msg)
        value: NDArray[np.float32] = self.value[self.fields.index(field)]
        return value

    def changed_in(self, k: int) -> NDArray[np.bool_]:
        """Return the tiles in which the field with this number may have changed."""
        if self.changed is None:
            return np.ones(tile_shape(self.shape), np.bool_)
        return self.changed if self.changed.ndim == 2 else self.changed[k]

    def copy(self) -> InformationModel:
        """Give a model in arrays of its own, which stays as it is when the estimator learns more."""
        return InformationModel(self.value.copy(), self.uncertainty.copy(), fields=self.fields)

    @classmethod
    def uniform(
        cls,
        shape: tuple[int, int],
        *,
        value: tuple[float, ...],
        uncertainty: float,
        fields: tuple[str, ...] = PAPER_FIELDS.names,
    ) -> InformationModel:
        """Believe the same of every cell: `value` per field, one `uncertainty` for all."""
        values = np.empty((len(fields), *shape), np.float32)
        values[:] = np.asarray(value, np.float32)[:, None, None]
        return cls(values, np.full_like(values, uncertainty), fields=fields)
