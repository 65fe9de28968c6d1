"""Grids and observations of estimator tests."""

import numpy as np

from geo.grid import FarmGrid
from sensors.observations import Observations


def grid_of(width, height):
    return FarmGrid(
        (width, height), 0.3048, np.ones((width, height), np.int8), np.ones((width, height), bool)
    )


def observations(x, y, values):
    n = len(x)
    return Observations(np.asarray(x), np.asarray(y), np.arange(n), np.full(n, 6), np.reshape(values, (n, 3)))


def random_observations(n, shape, seed=0):
    rng = np.random.default_rng(seed)
    x, y = rng.integers(0, shape[0], n), rng.integers(0, shape[1], n)
    smooth = 0.5 + 0.4 * np.sin(x / 4) * np.cos(y / 6)
    return observations(x, y, np.stack([smooth, rng.choice([0, 0.5, 1], n), rng.random(n)], axis=1))
