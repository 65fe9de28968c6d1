"""Random drone paths along which simulated outbreaks are observed in training."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Cells = NDArray[np.intp]

_KINDS = ("rows", "spiral", "straight legs", "scattered")
_SHARES = (0.4, 0.15, 0.35, 0.1)


def random_path(shape: tuple[int, int], longest: int, rng: Generator) -> Cells:
    """Draw a path over a field: rows, a spiral, straight legs between random points, or scattered cells.

    Return the cells in the order of observation, int[n, 2]. A cell may be observed more than once.
    """
    kind = _KINDS[int(rng.choice(len(_KINDS), p=_SHARES))]
    width, height = shape
    if kind == "straight legs":
        return np.clip(_legs(_random_points(shape, longest, rng))[:longest], 0, np.array(shape) - 1)
    if kind == "scattered":
        return np.stack([rng.integers(0, width, longest), rng.integers(0, height, longest)], axis=1)
    turned = bool(rng.random() < 0.4)
    sides = (height, width) if turned else shape
    cells = _rows(sides, rng) if kind == "rows" else _spiral(sides, rng)
    cells = np.clip(cells, 0, np.array(sides) - 1)
    for axis in range(2):
        if rng.random() < 0.4:
            cells[:, axis] = sides[axis] - 1 - cells[:, axis]
    return (cells[:, ::-1] if turned else cells)[:longest]


def _random_points(shape: tuple[int, int], length: int, rng: Generator) -> list[tuple[float, float]]:
    points = [(0.0, 0.0) if rng.random() < 0.5 else _point(shape, rng)]
    flown = 0.0
    while flown < length:
        point = _point(shape, rng)
        flown += float(np.hypot(point[0] - points[-1][0], point[1] - points[-1][1])) + 1.0
        points.append(point)
    return points


def _point(shape: tuple[int, int], rng: Generator) -> tuple[float, float]:
    return float(rng.uniform(0, shape[0])), float(rng.uniform(0, shape[1]))


def _rows(sides: tuple[int, int], rng: Generator) -> Cells:
    widest = min(20.0, sides[1]) if rng.random() < 0.8 else float(sides[1])
    gap = float(rng.uniform(1.5, 8.0)) if rng.random() < 0.7 else float(rng.uniform(1.5, max(widest, 2.0)))
    first = float(rng.uniform(0, min(gap, sides[1]))) if rng.random() < 0.6 else 0.0
    points: list[tuple[float, float]] = []
    for number, row in enumerate(np.arange(first, sides[1], gap).tolist()):
        ends = [(0.0, row), (sides[0] - 1.0, row)]
        points += ends if number % 2 == 0 else ends[::-1]
    return _legs(points)


def _spiral(sides: tuple[int, int], rng: Generator) -> Cells:
    gap = float(rng.uniform(1.5, 6.0))
    low_x, low_y, high_x, high_y = 0.0, 0.0, sides[0] - 1.0, sides[1] - 1.0
    points = [(0.0, 0.0)]
    while high_x > low_x and high_y > low_y:
        points += [(high_x, low_y), (high_x, high_y), (low_x, high_y), (low_x, min(low_y + gap, high_y))]
        low_x, low_y, high_x, high_y = low_x + gap, low_y + gap, high_x - gap, high_y - gap
        points.append((low_x, points[-1][1]))
    return _legs(points)


def _legs(points: list[tuple[float, float]]) -> Cells:
    """Return the cells on straight legs between points, one cell for about each cell length of a leg."""
    corners = np.array(points)
    parts = [np.floor(corners[:1])]
    for begin, end in itertools.pairwise(corners):
        steps = max(1, int(np.ceil(np.hypot(*(end - begin)))))
        parts.append(np.floor(begin + (end - begin) * (np.arange(1, steps + 1) / steps)[:, None]))
    return np.concatenate(parts).astype(np.intp)
