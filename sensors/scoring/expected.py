"""What errors are expected to cost, for estimators that state a standard deviation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensors.scoring.score import ScoreWeights


def loss_of_deviation(
    uncertainty: NDArray[np.float32],
    weights: ScoreWeights,
    out: NDArray[np.float32] | None = None,
    *,
    first: int = 0,
) -> NDArray[np.float32]:
    """Return the expected loss of a mean that the truth lies around symmetrically.

    Half of the squared error is then above and half below::

        E[c] = (c_above + c_below) / 2 * s^2

    Parameters
    ----------
    uncertainty : float32[n, W, H]
        Standard deviation s of each field's true value.
    weights : ScoreWeights
        The costs; the weights of the fields are not used.
    out : float32[n, W, H], optional
        Array to fill: on a large farm new memory takes longer than the sums.
    first : int
        Which field of the weights the first of the array is.

    Returns
    -------
    float32[n, W, H]

    Examples
    --------
    >>> from sensors.scoring.score import PAPER_WEIGHTS
    >>> loss_of_deviation(np.full((3, 1, 1), 0.5, np.float32), PAPER_WEIGHTS).ravel().tolist()
    [1.375, 1.375, 0.25]
    """
    costs = (
        0.5 * (np.array(weights.too_healthy) + np.array(weights.too_sick))[first : first + len(uncertainty)]
    )
    loss: NDArray[np.float32] = np.square(uncertainty, out=out)
    loss *= costs.astype(np.float32)[:, None, None]
    return loss
