"""What the errors of an estimate cost the farmer: the Waterberry Farms paper's score, and plainer metrics.

The paper's loss, with estimate I, truth E and relevance mask M of each field i, over c scored times::

    L = sum_i w_i sum_xy M_i sum_t AE_i / (c * sum_i w_i sum_xy M_i)
    AE = 10 (I - E)^2   where the estimate is too healthy (I > E: a missed disease), else (I - E)^2

Soil humidity has no worse side. The score is -L: 0 is perfect, lower is worse.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensors.errors import EstimatorError
from sensors.fields import FIELDS

_CHUNK_CELLS = 1 << 16

_Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ScoreWeights:
    """What errors cost, per field.

    Parameters
    ----------
    field : tuple of three floats
        Weight of each field.
    too_healthy : tuple of three floats
        Cost of a squared error where the estimate is above the truth.
    too_sick : tuple of three floats
        Cost of a squared error where the estimate is below the truth.
    """

    field: _Triple = (1.0, 0.2, 0.1)
    too_healthy: _Triple = (10.0, 10.0, 1.0)
    too_sick: _Triple = (1.0, 1.0, 1.0)


PAPER_WEIGHTS = ScoreWeights()


@dataclass(frozen=True, slots=True)
class Score:
    """The score of one estimate, and what it is made of; tuples are in the order of `sensors.fields.FIELDS`.

    Parameters
    ----------
    loss : float
        The paper's loss L of this estimate, 0 is perfect.
    field_loss : tuple of three floats
        Mean asymmetric squared error over each field's mask; L is their mean weighted by field and cells.
    field_mse, field_mae : tuple of three floats
        Mean squared and mean absolute error over each field's mask.
    field_weighted_mae : tuple of three floats
        Mean asymmetric absolute error over each field's mask.
    authors_axis_max : float
        What the authors' code computes in place of the paper's formula (a maximum along x, taken for a clip
        at zero): it saturates, it can be positive for an estimate that is wrong everywhere, and it is here
        only to place the paper's published figures. Never rank by it.
    """

    loss: float
    field_loss: _Triple
    field_mse: _Triple
    field_mae: _Triple
    field_weighted_mae: _Triple
    authors_axis_max: float

    @property
    def score(self) -> float:
        """The paper's score, -L."""
        return -self.loss

    @property
    def field_rmse(self) -> _Triple:
        """Root mean squared error over each field's mask."""
        a, b, c = np.sqrt(self.field_mse).tolist()
        return a, b, c


def paper_loss(
    truth: NDArray[np.floating],
    estimate: NDArray[np.floating],
    masks: NDArray[np.bool_],
    weights: ScoreWeights = PAPER_WEIGHTS,
) -> float:
    """Return the paper's loss L of one estimate (see the module's formula with c = 1).

    Parameters
    ----------
    truth, estimate : float[3, W, H]
        E and I.
    masks : bool[3, W, H]
        The relevant cells of each field, see `sensors.fields.relevance_masks`.
    weights : ScoreWeights, optional
        The costs; the paper's by default.

    Raises
    ------
    EstimatorError
        If shapes differ, no cell is relevant, or the estimate is not finite in a relevant cell.

    Examples
    --------
    >>> truth = np.full((3, 2, 2), 0.5)
    >>> masks = np.ones((3, 2, 2), bool)
    >>> round(paper_loss(truth, truth + 0.1, masks), 6), round(paper_loss(truth, truth - 0.1, masks), 6)
    (0.093077, 0.01)
    """
    return RunningScore(truth, masks, weights).evaluate(estimate).loss


class RunningScore:
    """Scores the estimates of one run against the same truth; masks and counts are prepared once.

    Parameters
    ----------
    truth : float[3, W, H]
        E; not copied.
    masks : bool[3, W, H]
        The relevant cells of each field.
    weights : ScoreWeights, optional
        The costs; the paper's by default.

    Attributes
    ----------
    losses : list of float
        The loss of each estimate that was added.

    Examples
    --------
    >>> truth = np.ones((3, 2, 2))
    >>> running = RunningScore(truth, np.ones((3, 2, 2), bool))
    >>> running.add(truth).loss, running.add(truth - 1).loss, running.score
    (0.0, 1.0, -0.5)
    """

    def __init__(
        self, truth: NDArray[np.floating], masks: NDArray[np.bool_], weights: ScoreWeights = PAPER_WEIGHTS
    ) -> None:
        if masks.ndim != 3 or masks.shape[0] != len(FIELDS) or masks.dtype != np.bool_:
            msg = f"score: masks are {masks.dtype}{list(masks.shape)}, expected bool[{len(FIELDS)}, W, H]"
            raise EstimatorError(msg)
        self._fields = [_ScoredField(k, masks[k], weights) for k in range(len(FIELDS))]
        self._weight = np.array(weights.field) * [part.cells for part in self._fields]
        if not self._weight.sum() > 0:
            msg = "score: no cell of the farm is relevant, its owner grows neither tomatoes nor strawberries"
            raise EstimatorError(msg)
        self._shape = masks.shape
        self.weights = weights
        self.losses: list[float] = []
        self.advance(truth)

    def advance(self, truth: NDArray[np.floating]) -> None:
        """Score the following estimates against another truth (the next day)."""
        self._check_shape(truth, "truth")
        self._truth = truth

    def add(self, estimate: NDArray[np.floating]) -> Score:
        """Evaluate an estimate (as `evaluate`) and count it as one of the scored times."""
        result = self.evaluate(estimate)
        self.losses.append(result.loss)
        return result

    def evaluate(self, estimate: NDArray[np.floating]) -> Score:
        """Return the score of one estimate, float[3, W, H].

        Raises
        ------
        EstimatorError
            If its shape is not the truth's, or it is not finite in a relevant cell.
        """
        self._check_shape(estimate, "estimate")
        sums = [part.errors(self._truth[k], estimate[k]) for k, part in enumerate(self._fields)]
        loss = float(np.dot(self._weight, [s.loss for s in sums]) / self._weight.sum())
        if not np.isfinite(loss):
            bad = ", ".join(FIELDS[k] for k, s in enumerate(sums) if not np.isfinite(s.loss))
            msg = f"score: the estimate (or the truth) of {bad} is not finite in every relevant cell"
            raise EstimatorError(msg)
        return Score(
            loss=loss,
            field_loss=_triple([s.loss for s in sums]),
            field_mse=_triple([s.mse for s in sums]),
            field_mae=_triple([s.mae for s in sums]),
            field_weighted_mae=_triple([s.weighted_mae for s in sums]),
            authors_axis_max=float(np.dot(self.weights.field, [s.axis_max for s in sums])),
        )

    @property
    def loss(self) -> float:
        """The mean loss over the scored times, NaN before the first."""
        return float(np.mean(self.losses)) if self.losses else float("nan")

    @property
    def score(self) -> float:
        """The paper's score of the run so far, -L."""
        return -self.loss

    def _check_shape(self, array: NDArray[np.floating], name: str) -> None:
        if array.shape != self._shape:
            msg = f"score: {name} has shape {array.shape}, the masks have {self._shape}"
            raise EstimatorError(msg)


@dataclass(slots=True)
class _Errors:
    loss: float = 0.0
    mse: float = 0.0
    mae: float = 0.0
    weighted_mae: float = 0.0
    axis_max: float = 0.0


@dataclass(slots=True)
class _ScoredField:
    """One field's mask, cut to the rows and columns that hold relevant cells."""

    k: int
    mask: NDArray[np.bool_]
    weights: ScoreWeights
    cells: int = field(init=False)
    box: tuple[slice, slice] = field(init=False)
    column_cells: NDArray[np.intp] = field(init=False)

    def __post_init__(self) -> None:
        rows = np.flatnonzero(self.mask.any(axis=1))
        self.column_cells = np.count_nonzero(self.mask, axis=0)
        columns = np.flatnonzero(self.column_cells)
        self.cells = int(self.column_cells.sum())
        self.box = (_span(rows), _span(columns))

    def errors(self, truth: NDArray[np.floating], estimate: NDArray[np.floating]) -> _Errors:
        """Sum the errors chunk by chunk, so that temporaries stay in the cache, in float64."""
        out = _Errors()
        if not self.cells:
            return out
        squares = worse_squares = absolute = worse_absolute = 0.0
        rows, columns = self.box
        step = max(1, _CHUNK_CELLS // max(1, columns.stop - columns.start))
        for start in range(rows.start, rows.stop, step):
            part = (slice(start, min(start + step, rows.stop)), columns)
            error = np.subtract(estimate[part], truth[part], dtype=np.float64)
            # A product with the mask would keep NaN and inf of cells that do not count.
            error = np.where(self.mask[part], error, 0.0).ravel()
            squares += float(error @ error)
            absolute += float(np.abs(error).sum())
            np.maximum(error, 0.0, out=error)
            worse_squares += float(error @ error)
            worse_absolute += float(error.sum())
        low, high = self.weights.too_sick[self.k], self.weights.too_healthy[self.k]
        out.mse, out.mae = squares / self.cells, absolute / self.cells
        out.loss = (low * (squares - worse_squares) + high * worse_squares) / self.cells
        out.weighted_mae = (low * (absolute - worse_absolute) + high * worse_absolute) / self.cells
        # The authors score soil by its plain mean absolute error.
        out.axis_max = -out.mae if low == high else self._axis_max(truth, estimate, low, high)
        return out

    def _axis_max(
        self, truth: NDArray[np.floating], estimate: NDArray[np.floating], low: float, high: float
    ) -> float:
        width, height = self.mask.shape
        above = np.full(height, -np.inf)
        below = np.full(height, -np.inf)
        step = max(1, _CHUNK_CELLS // height)
        for start in range(0, width, step):
            part = slice(start, start + step)
            error = np.subtract(estimate[part], truth[part], dtype=np.float64)
            np.maximum(above, error.max(axis=0), out=above)
            np.maximum(below, -error.min(axis=0), out=below)
        return -float(self.column_cells @ (low * below + high * above)) / self.cells


def _span(indices: NDArray[np.intp]) -> slice:
    return slice(int(indices[0]), int(indices[-1]) + 1) if indices.size else slice(0, 0)


def _triple(values: list[float]) -> _Triple:
    a, b, c = values
    return a, b, c
