"""Rewards whose sum is the score of the run.

With the loss L_0 of the estimate before anything was seen, and L_1, ... L_c at the c scored times, the k-th
scored time gives::

    r_k = (c - k + 1) / c * (L_{k-1} - L_k)

what the estimate became better by, times the part of the scored times that profits from it. The sum of all is
``L_0 - mean(L_1 ... L_c)``, the score of the run (`sensors.scoring.score`) plus the constant L_0, which no
action changes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Returns", "rewards_of"]


def rewards_of(
    number: NDArray[np.integer], points: int, before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the reward of the scored times with these numbers, from 1, of `points`.

    Parameters
    ----------
    before, after : float64[n]
        The losses at the scored time before each, and at it.

    Examples
    --------
    >>> rewards_of(np.array([1, 2]), 2, np.array([3.0, 2.0]), np.array([2.0, 0.0])).tolist()
    [1.0, 1.0]
    """
    part = np.maximum(points - number + 1, 0) / points
    rewards: NDArray[np.float64] = part * (before - after)
    return rewards


class Returns:
    """The rewards of one run.

    Parameters
    ----------
    points : int
        How often the estimate is scored in a run all of whose images lie on the farm.
    loss : float
        Of the estimate before anything was seen.
    """

    def __init__(self, points: int, loss: float) -> None:
        self.points = points
        self.loss_before = loss
        self.total = 0.0
        self._last = loss
        self._count = 0

    def add(self, losses: list[float]) -> float:
        """Return the reward of the next scored times."""
        reward = 0.0
        for loss in losses:
            self._count += 1
            number, before, after = np.array([self._count]), np.array([self._last]), np.array([loss])
            reward += float(rewards_of(number, self.points, before, after)[0])
            self._last = loss
        self.total += reward
        return reward

    def rest(self, score: float) -> float:
        """Return what is missing at the end; not 0 only if images beyond the border made times fewer."""
        if self._count == self.points:
            return 0.0
        rest = self.loss_before + score - self.total
        self.total += rest
        return rest
