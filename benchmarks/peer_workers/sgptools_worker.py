"""Worker for path planning with sgptools (Jakkala & Akella), run in a virtual environment with sgptools.

A request has the box in which flight is allowed, points of the land of interest, start, path length and
kernel. The response has the points of the path.

ContinuousSGP and CMA support a length constraint, a fixed start, and sensing along the path. HexCover returns
positions without a length limit, so the smallest variance is searched for which a tour fits the length.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from functools import partial
from typing import Any

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")

import gpflow
import numpy as np
import tensorflow as tf
from lines import serve
from sgptools.core.transformations import IPPTransform
from sgptools.methods import get_method
from sgptools.utils.misc import get_inducing_pts
from sgptools.utils.tsp import resample_path, run_tsp

SAMPLING_RATE = 5
"""Sensing points per leg, the value in the library's tutorial on continuous sensing."""
CONSTRAINT_WEIGHT = 500.0
"""Weight of the length constraint, the value in the tutorial with a distance budget."""
FEWER = 0.93
TOUR_LENGTH = 0.7124
"""A tour of n places in an area A has a length of about 0.7124 sqrt(n A) (Applegate et al., 2006)."""

Points = Any


class Question:
    """Request, with derived values that all methods need."""

    def __init__(self, asked: dict[str, Any]) -> None:
        self.low, self.high = np.array(asked["low"]), np.array(asked["high"])
        self.start = np.array([asked["start"]], dtype=np.float64)
        self.length_m = float(asked["length_m"])
        self.max_steps = asked["max_steps"]
        self.waypoints = int(asked["waypoints"])
        self.seed = int(asked["seed"])
        self.variance, self.noise = float(asked["variance"]), float(asked["noise"])
        self.kernel = gpflow.kernels.SquaredExponential(self.variance, float(asked["reach_m"]))
        self.grid = np.array(asked["land"], dtype=np.float64)

    @property
    def places(self) -> int:
        """Approximate number of places on a tour of the given length, at most that of the grid."""
        width, height = self.high - self.low
        return min(len(self.grid) - 1, max(3, int((self.length_m / TOUR_LENGTH) ** 2 / (width * height))))

    def tour(self, places: Points) -> tuple[Points, float]:
        """Return the places in the order of a tour from the start, and the length of the tour."""
        places = np.clip(np.asarray(places, dtype=np.float64).reshape(-1, 2), self.low, self.high)
        paths, lengths = run_tsp(places, start_nodes=self.start, time_limit=20)
        return paths[0][1:], float(lengths[0])

    def spread(self, count: int) -> Points:
        """Return evenly spread places."""
        return get_inducing_pts(self.grid, count, seed=self.seed)


def continuous(question: Question, method: str = "ContinuousSGP") -> Points:
    """Return a path from a length-constrained optimisation that starts with a tour."""
    # The tutorial's initial path: a tour of evenly spread places, resampled to the number of waypoints.
    count = question.places
    while (found := question.tour(question.spread(count)))[1] > question.length_m:
        count = int(FEWER * count)
    tour = resample_path(np.vstack((question.start, found[0])), question.waypoints)
    transform = IPPTransform(
        sampling_rate=SAMPLING_RATE,
        distance_budget=question.length_m,
        constraint_weight=CONSTRAINT_WEIGHT,
        Xu_fixed=question.start[None],
    )
    planner = get_method(method)(
        len(tour), question.grid, question.kernel, question.noise, transform=transform, X_init=tour
    )
    given = {} if question.max_steps is None else {"max_steps": int(question.max_steps)}
    if method == "CMA":
        given["seed"] = question.seed
    path = planner.optimize(**given)[0]
    return np.clip(path[1:], question.low, question.high)


def hexagons(question: Question, variance: float) -> Points:
    """Return places on a hexagonal cover of the box with at most this posterior variance."""
    found = get_method("HexCover")(len(question.grid), question.grid, question.kernel, question.noise)
    return np.unique(found.optimize(post_var_threshold=variance, tsp=False)[0], axis=0)


def by_variance(question: Question) -> Points:
    """Return the tour of the densest hexagonal cover within the length."""
    least = question.variance * question.noise / (question.variance + question.noise)
    best, low, high = None, 1.01 * least, 0.999 * question.variance
    for _ in range(12):
        variance = math.sqrt(low * high)
        tour, length_m = question.tour(hexagons(question, variance))
        if length_m <= question.length_m:
            best, high = tour, variance
        else:
            low = variance
    if best is None:
        msg = f"no hexagons fit into {question.length_m:.1f} m"
        raise RuntimeError(msg)
    return best


METHODS: dict[str, Callable[[Question], Points]] = {
    "ContinuousSGP": continuous,
    "CMA": partial(continuous, method="CMA"),
    "HexCover": by_variance,
}


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """Return the path for a request."""
    np.random.seed(int(asked["seed"]))  # noqa: NPY002 - sgptools draws from it
    tf.random.set_seed(int(asked["seed"]))
    path = METHODS[asked["method"]](Question(asked))
    return {"points_m": path.tolist()}


if __name__ == "__main__":
    # One core, for a fair comparison with our planners.
    tf.config.threading.set_intra_op_parallelism_threads(1)
    tf.config.threading.set_inter_op_parallelism_threads(1)
    serve(answer)
