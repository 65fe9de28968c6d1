"""Computes, from class probabilities, estimates with least expected loss, their loss and their deviation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import product
from sensors.scoring.score import PAPER_WEIGHTS

CLASS_VALUES = np.array([1.0, 0.5, 0.0])
"""Values of the classes susceptible, infected and removed."""


def least_loss_value(
    probabilities: NDArray[np.floating], asymmetry: float = PAPER_WEIGHTS.too_healthy[0]
) -> NDArray[np.float64]:
    """Return the estimate that minimises the expected loss of the score.

    The loss is ``a (v - e)^2`` if the estimate v is above the truth e, else ``(e - v)^2``. The best estimate
    is an expectile (Newey & Powell 1987), the solution of::

        a sum_{e < v} p_e (v - e) = sum_{e > v} p_e (e - v)

    For the values 1, 0.5 and 0, the solution has a closed form above 0.5, and another one below 0.5.

    `probabilities`, float[..., 3], are for the classes susceptible, infected and removed.

    Examples
    --------
    >>> least_loss_value(np.array([[1, 0, 0], [0.9, 0.1, 0], [0, 0.5, 0.5], [0, 0, 1]])).round(3).tolist()
    [1.0, 0.737, 0.045, 0.0]
    """
    susceptible, infected, removed = np.moveaxis(np.asarray(probabilities, np.float64), -1, 0)
    upper = (susceptible + 0.5 * asymmetry * infected) / (susceptible + asymmetry * (infected + removed))
    lower = (susceptible + 0.5 * infected) / (susceptible + infected + asymmetry * removed)
    value: NDArray[np.float64] = np.where(upper >= 0.5, upper, lower)
    return value


def expected_loss(
    probabilities: NDArray[np.floating], value: NDArray[np.floating], too_healthy: float, too_sick: float
) -> NDArray[np.float64]:
    """Return the expected loss of estimated values: the mean over the classes, weighted by probability.

    Examples
    --------
    >>> p = np.array([[0.0, 1, 0], [0.5, 0, 0.5]])
    >>> expected_loss(p, np.array([0.7, 0.1]), 10.0, 1.0).round(3).tolist()
    [0.4, 0.455]
    """
    susceptible, infected, removed = np.moveaxis(np.asarray(probabilities, np.float64), -1, 0)
    of_infected = np.where(value > CLASS_VALUES[1], too_healthy, too_sick)
    loss: NDArray[np.float64] = too_sick * susceptible * (value - CLASS_VALUES[0]) ** 2
    loss += of_infected * infected * (value - CLASS_VALUES[1]) ** 2
    loss += too_healthy * removed * (value - CLASS_VALUES[2]) ** 2
    return loss


def standard_deviation(probabilities: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the standard deviation of a cell's true value, given class probabilities, float[..., 3].

    Examples
    --------
    >>> standard_deviation(np.array([[1.0, 0, 0], [0.5, 0, 0.5]])).tolist()
    [0.0, 0.5]
    """
    p = np.asarray(probabilities, np.float64)
    mean = product(p, CLASS_VALUES)
    deviation: NDArray[np.float64] = np.sqrt(np.maximum(product(p, CLASS_VALUES**2) - mean**2, 0.0))
    return deviation
