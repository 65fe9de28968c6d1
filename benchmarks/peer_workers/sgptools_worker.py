"""Plans paths with sgptools (Jakkala & Akella), in a virtual environment that has it.

A question gives the box that may be flown over, the start, the length of the path, and the kernel; the answer
the points of the path and the seconds of planning, without the start of the libraries.

sgptools finds places for a given number of them, and its tour is as long as it is. So the number is searched:
first by the tours of evenly spread places, which cost little, then by the method itself, with fewer places
while its tour is too long.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from functools import partial
from typing import Any

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")

import gpflow
import numpy as np
import tensorflow as tf
from lines import serve
from sgptools.core.transformations import IPPTransform, Transform
from sgptools.methods import get_method
from sgptools.utils.misc import get_inducing_pts
from sgptools.utils.tsp import run_tsp

NOISE = 0.01
GRID_POINTS = 900
"""Most points of the grid on which the objective is defined."""
TRIES = 8
FEWER = 0.93
TOUR_LENGTH = 0.7124
"""A tour of n places in an area A is about 0.7124 sqrt(n A) long (Applegate et al., 2006)."""

Points = Any


class Question:
    """What is asked, and what every method needs of it."""

    def __init__(self, asked: dict[str, Any]) -> None:
        self.low, self.high = np.array(asked["low"]), np.array(asked["high"])
        self.start = np.array([asked["start"]], dtype=np.float64)
        self.length_m = float(asked["length_m"])
        self.max_steps = int(asked["max_steps"])
        self.seed = int(asked["seed"])
        self.kernel = gpflow.kernels.SquaredExponential(variance=1.0, lengthscales=float(asked["reach_m"]))
        width, height = self.high - self.low
        step = max(float(asked["cell_m"]), math.sqrt(width * height / GRID_POINTS))
        x, y = (
            np.linspace(low, high, max(2, round((high - low) / step) + 1))
            for low, high in zip(self.low, self.high, strict=True)
        )
        self.grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)

    @property
    def places(self) -> int:
        """About as many places as a tour of this length passes, at most those of the grid."""
        width, height = self.high - self.low
        return min(len(self.grid) - 1, max(3, int((self.length_m / TOUR_LENGTH) ** 2 / (width * height))))

    def tour(self, places: Points) -> tuple[Points, float]:
        """Return the places in the order of a tour from the start, and its length."""
        places = np.clip(np.asarray(places, dtype=np.float64).reshape(-1, 2), self.low, self.high)
        paths, lengths = run_tsp(places, start_nodes=self.start, time_limit=20)
        return paths[0][1:], float(lengths[0])

    def spread(self, count: int) -> Points:
        """Return evenly spread places."""
        return get_inducing_pts(self.grid, count, seed=self.seed)


def continuous(question: Question, count: int, method: str = "ContinuousSGP") -> Points:
    """Move the places of a tour until they tell most, within the length."""
    first, _ = question.tour(question.spread(count))
    transform = IPPTransform(sampling_rate=2, distance_budget=question.length_m, constraint_weight=100.0)
    found = get_method(method)(
        len(first), question.grid, question.kernel, NOISE, transform=transform, X_init=first
    )
    more = {"seed": question.seed} if method == "CMA" else {}
    return found.optimize(max_steps=question.max_steps, **more)[0]


def greedy(question: Question, count: int) -> Points:
    """Choose places one by one."""
    found = get_method("GreedySGP")(count, question.grid, question.kernel, NOISE, transform=Transform())
    return found.optimize(optimizer="lazy")[0]


def hexagons(question: Question, variance: float) -> Points:
    """Cover the box with hexagons that leave this variance at most."""
    found = get_method("HexCover")(len(question.grid), question.grid, question.kernel, NOISE)
    return np.unique(found.optimize(post_var_threshold=variance, tsp=False)[0], axis=0)


METHODS: dict[str, Callable[[Question, int], Points]] = {
    "ContinuousSGP": continuous,
    "CMA": partial(continuous, method="CMA"),
    "GreedySGP": greedy,
}


def by_number(question: Question, method: Callable[[Question, int], Points]) -> Points:
    """Return the tour of the most places that fits."""
    count = question.places
    while count > 3 and question.tour(question.spread(count))[1] > question.length_m:
        count = int(FEWER * count)
    for _ in range(TRIES):
        tour, length_m = question.tour(method(question, count))
        if length_m <= question.length_m:
            return tour
        count = max(3, int(count * min(FEWER, (question.length_m / length_m) ** 2)))
    msg = f"no tour of {TRIES} fits into {question.length_m:.1f} m"
    raise RuntimeError(msg)


def by_variance(question: Question) -> Points:
    """Return the tour of the densest hexagons that fits."""
    best, low, high = None, 1.1 * NOISE / (1.0 + NOISE), 0.999
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


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """Plan one path."""
    np.random.seed(int(asked["seed"]))  # noqa: NPY002 - sgptools draws from it
    tf.random.set_seed(int(asked["seed"]))
    began_s = time.process_time()
    question = Question(asked)
    method = asked["method"]
    tour = by_variance(question) if method == "HexCover" else by_number(question, METHODS[method])
    return {"points_m": tour.tolist(), "cpu_s": time.process_time() - began_s}


if __name__ == "__main__":
    serve(answer)
