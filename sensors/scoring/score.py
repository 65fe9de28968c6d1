"""The score of an estimate by the loss of the Waterberry Farms paper, and plain measures of errors.

The paper's loss L over c scored times has the estimate I, the truth E and the relevance mask M of each field
i::

    L = sum_i w_i sum_xy M_i sum_t AE_i / (c * sum_i w_i sum_xy M_i)
    AE = 10 (I - E)^2   where the estimate is too healthy (I > E: a missed disease), else (I - E)^2

For soil humidity both costs are 1. The score is -L; 0 is perfect, and less is worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import product
from geo.system import in_parallel
from sensors.errors import EstimatorError
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.lazy_fields import LazyFields
from sensors.scoring.information import SUMS, TILE_CELLS, InformationModel, tile_shape

_PerField = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ScoreWeights:
    """Weights of the fields, and costs of errors.

    Parameters
    ----------
    field : tuple of float
        Weight of each field.
    too_healthy : tuple of float
        Cost of a squared error of an estimate above the truth.
    too_sick : tuple of float
        Cost of a squared error of an estimate below the truth.
    """

    field: _PerField
    too_healthy: _PerField
    too_sick: _PerField

    def __post_init__(self) -> None:
        costs = (self.field, self.too_healthy, self.too_sick)
        if len({len(part) for part in costs}) != 1 or not all(
            0.0 <= cost < np.inf for part in costs for cost in part
        ):
            msg = f"score weights: {self} are not three tuples with a finite number >= 0 for each field"
            raise EstimatorError(msg)

    @classmethod
    def of(cls, fields: FieldSet) -> ScoreWeights:
        """Return the weights and costs that a field set has."""
        return cls(
            tuple(field.weight for field in fields),
            tuple(field.cost_above for field in fields),
            tuple(field.cost_below for field in fields),
        )


PAPER_WEIGHTS = ScoreWeights.of(PAPER_FIELDS)


@dataclass(frozen=True, slots=True)
class Score:
    """The score of an estimate, and the parts of the score; tuples are in the order of the fields.

    Parameters
    ----------
    loss : float
        The paper's loss L of this estimate; 0 is perfect.
    field_loss : tuple of float
        Mean asymmetric squared error over each field's mask. L is the mean of these losses, weighted by each
        field's weight times its number of cells.
    field_mse, field_mae : tuple of float
        Mean squared and mean absolute error over each field's mask.
    field_weighted_mae : tuple of float
        Mean asymmetric absolute error over each field's mask.
    authors_axis_max : float
        Score by the authors' code, which differs from the paper's formula: it takes the maximum along x
        instead of clipping at zero. This score saturates, and can be positive for an estimate that is wrong
        everywhere. Use it only to compare with published figures, never for rankings.
    fields : tuple of str
        Names of the fields.
    """

    loss: float
    field_loss: _PerField
    field_mse: _PerField
    field_mae: _PerField
    field_weighted_mae: _PerField
    authors_axis_max: float
    fields: tuple[str, ...]

    @property
    def score(self) -> float:
        """The paper's score, -L."""
        return -self.loss

    @property
    def field_rmse(self) -> _PerField:
        """Root mean squared error over each field's mask."""
        return tuple(np.sqrt(self.field_mse).tolist())


class RunningScore:
    """Scores the estimates of a run against the truth; masks and counts are prepared once.

    Sums over cells are stored for each tile of the farm (`sensors.scoring.information`). If a model reports
    its changes since the preceding model, only the changed tiles are summed again. The result equals a sum
    over all cells to the bit, because no old errors are subtracted.

    Parameters
    ----------
    truth : float[n, W, H]
        E; not copied.
    masks : bool[n, W, H]
        The relevant cells of each field.
    weights : ScoreWeights, optional
        The weights and costs; by default those that `fields` have.
    fields : FieldSet
        The fields; by default the benchmark's fields.

    Attributes
    ----------
    losses : list of float
        Loss of each added estimate.

    Examples
    --------
    >>> truth = np.ones((3, 2, 2))
    >>> running = RunningScore(truth, np.ones((3, 2, 2), bool))
    >>> running.add(truth).loss, running.add(truth - 1).loss, running.score
    (0.0, 1.0, -0.5)
    """

    def __init__(
        self,
        truth: NDArray[np.floating],
        masks: NDArray[np.bool_],
        weights: ScoreWeights | None = None,
        fields: FieldSet = PAPER_FIELDS,
    ) -> None:
        weights = ScoreWeights.of(fields) if weights is None else weights
        if masks.ndim != 3 or masks.shape[0] != len(fields) or masks.dtype != np.bool_:
            msg = f"score: masks are {masks.dtype}{list(masks.shape)}, expected bool[{len(fields)}, W, H]"
            raise EstimatorError(msg)
        if len(weights.field) != len(fields):
            msg = f"score: {len(weights.field)} weights for the fields {', '.join(fields.names)}"
            raise EstimatorError(msg)
        self._parts = [_ScoredField(k, masks, weights) for k in range(len(fields))]
        self.fields = fields.names
        self._weight = np.array(weights.field) * [part.cells for part in self._parts]
        if not self._weight.sum() > 0:
            crops = ", ".join(sorted({crop for field in fields for crop in field.crops}))
            raise EstimatorError(f"score: no cell of the farm is relevant: its owner grows none of {crops}")
        self._shape = masks.shape
        self._tiles = tile_shape((masks.shape[1], masks.shape[2]))
        self._summed: tuple[NDArray[np.floating], int] | None = None
        self.weights = weights
        self.losses: list[float] = []
        self.advance(truth)

    def advance(self, truth: NDArray[np.floating]) -> None:
        """Compare later estimates with `truth`, the truth of the next day."""
        self._check_shape(truth, "truth")
        self._truth = truth
        self._summed = None

    @property
    def shape(self) -> tuple[int, int]:
        """Width and height of the farm in cells."""
        return int(self._shape[1]), int(self._shape[2])

    def add(self, estimate: NDArray[np.floating] | InformationModel) -> Score:
        """Evaluate an estimate as `evaluate` does, and append the loss to `losses`."""
        result = self.evaluate(estimate)
        self.losses.append(result.loss)
        return result

    def evaluate(self, estimate: NDArray[np.floating] | InformationModel) -> Score:
        """Return the score of an estimate without appending the loss to `losses`.

        Parameters
        ----------
        estimate : float[n, W, H] or InformationModel
            The estimate. For the revision after the model evaluated last, only changed tiles are summed.

        Raises
        ------
        EstimatorError
            If the estimate has another shape than the truth, or is not finite in a relevant cell.
        """
        value = estimate.value if isinstance(estimate, InformationModel) else estimate
        self._check_shape(value, "estimate")
        follows = self._follows(estimate)
        self._summed = None
        everything = np.ones(self._tiles, np.bool_)
        sums = [
            part.errors(
                estimate.changed_in(k) if follows and isinstance(estimate, InformationModel) else everything,
                self._truth,
                value[k],
            )
            for k, part in enumerate(self._parts)
        ]
        loss = float(product(self._weight, np.array([s.loss for s in sums])) / self._weight.sum())
        if not np.isfinite(loss):
            bad = ", ".join(self.fields[k] for k, s in enumerate(sums) if not np.isfinite(s.loss))
            msg = f"score: the estimate (or the truth) of {bad} is not finite in every relevant cell"
            raise EstimatorError(msg)
        if isinstance(estimate, InformationModel):
            self._summed = value, estimate.revision
        axis_max = np.array([s.axis_max for s in sums])
        return Score(
            loss=loss,
            field_loss=tuple([s.loss for s in sums]),
            field_mse=tuple([s.mse for s in sums]),
            field_mae=tuple([s.mae for s in sums]),
            field_weighted_mae=tuple([s.weighted_mae for s in sums]),
            authors_axis_max=float(product(np.array(self.weights.field), axis_max)),
            fields=self.fields,
        )

    @property
    def loss(self) -> float:
        """Mean loss over the scored times; NaN before the first scored time."""
        return float(np.mean(self.losses)) if self.losses else float("nan")

    @property
    def score(self) -> float:
        """The paper's score of the run, -L over all scored times."""
        return -self.loss

    def _follows(self, estimate: NDArray[np.floating] | InformationModel) -> bool:
        """Return whether an estimate is the next revision of the model that was evaluated last."""
        if self._summed is None or not isinstance(estimate, InformationModel):
            return False
        value, revision = self._summed
        return estimate.value is value and estimate.revision == revision + 1

    def _check_shape(self, array: NDArray[np.floating], name: str) -> None:
        if array.shape != self._shape:
            raise EstimatorError(f"score: {name} has shape {array.shape}, the masks have {self._shape}")


@dataclass(slots=True)
class _Errors:
    loss: float = 0.0
    mse: float = 0.0
    mae: float = 0.0
    weighted_mae: float = 0.0
    axis_max: float = 0.0


class _ScoredField:
    """The relevant cells of a field, and the sums of errors of the estimate evaluated last."""

    def __init__(self, k: int, masks: NDArray[np.bool_], weights: ScoreWeights) -> None:
        _, width, height = masks.shape
        columns, rows = tile_shape((width, height))
        self._k, self._masks = k, masks
        self._low, self._high = weights.too_sick[k], weights.too_healthy[k]
        strips = np.stack(
            [np.count_nonzero(masks[k, x : x + TILE_CELLS], axis=0) for x in range(0, width, TILE_CELLS)]
        )
        self._tile_cells = np.add.reduceat(strips, range(0, height, TILE_CELLS), axis=1)
        self.cells = int(self._tile_cells.sum())
        self._sums = np.zeros((columns, rows, SUMS))
        self._line_cells = strips.sum(axis=0)
        # For soil, whose two costs are equal, the authors take the mean absolute error.
        lines = height if self.cells and self._low != self._high else 0
        self._above, self._below = np.zeros((columns, lines)), np.zeros((columns, lines))

    def errors(
        self, tiles: NDArray[np.bool_], truth: NDArray[np.floating], estimate: NDArray[np.floating]
    ) -> _Errors:
        """Sum the errors in the given tiles, and return the mean errors over all tiles.

        `truth` is float32[n, W, H] of all fields, and `estimate` is float32[W, H] of this field.
        """
        out = _Errors()
        if not self.cells:
            return out
        from sensors.scoring.score_sums import find_extremes, sum_errors

        def work(parts: Sequence[slice]) -> None:
            for part in parts:
                columns = slice(part.start * TILE_CELLS, part.stop * TILE_CELLS)
                cells = self._masks[self._k, columns], truth[self._k, columns], estimate[columns]
                sum_errors(tiles[part], self._tile_cells[part], *cells, self._sums[part])
                if self._low != self._high:
                    find_extremes(tiles[part], self._line_cells, *cells, self._above[part], self._below[part])

        strips = [slice(i, i + 1) for i in np.flatnonzero(tiles.any(axis=1)).tolist()]
        in_parallel(work, strips if isinstance(truth, LazyFields) else [slice(0, len(tiles))])
        squares, worse_squares, absolute, worse_absolute = (
            self._sums.reshape(-1, SUMS).sum(axis=0) / self.cells
        ).tolist()
        low, high = self._low, self._high
        out.mse, out.mae = squares, absolute
        out.loss = low * (squares - worse_squares) + high * worse_squares
        out.weighted_mae = low * (absolute - worse_absolute) + high * worse_absolute
        out.axis_max = -out.mae
        if low != high:
            worst = low * self._below.max(axis=0) + high * self._above.max(axis=0)
            # If a line has no relevant cells, its extremes may be NaN or infinite.
            worst[self._line_cells == 0] = 0.0
            out.axis_max = -float(product(self._line_cells, worst)) / self.cells
        return out
