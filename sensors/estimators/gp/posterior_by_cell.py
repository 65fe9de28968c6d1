"""What the posteriors of a Gaussian process that are kept cell by cell have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel


class CellPosterior(ABC):
    """Mean and variance of each cell of a farm given the observations so far.

    The prior mean is not fixed here: the posterior mean under a constant prior mean m is
    ``m + response[0] - m * response[1]``.

    Parameters
    ----------
    shape : tuple of int
        Width and height in cells.
    kernel : RbfKernel
        The covariance.

    Attributes
    ----------
    response : float64[2, W * H]
        What the observed values, and a constant of one, give under a zero prior mean.
    variance : float64[W * H]
        Variance of the smooth part.
    """

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel) -> None:
        cells = shape[0] * shape[1]
        self.shape = shape
        self.kernel = kernel
        self.response = np.zeros((2, cells))
        self.variance = np.full(cells, kernel.amplitude)

    @abstractmethod
    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Take further observations, each for a part of one."""
