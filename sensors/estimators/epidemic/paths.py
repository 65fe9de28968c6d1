"""Random drone paths for the observation of simulated outbreaks in training."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.compiled import compiled

Cells = NDArray[np.intp]

_KINDS = ("rows", "spiral", "straight legs", "scattered")
_SHARES = (0.4, 0.15, 0.35, 0.1)


def random_path(shape: tuple[int, int], longest: int, rng: Generator) -> Cells:
    """Draw a path over a field: rows, a spiral, straight legs between random points, or scattered cells.

    The result is the cells in the order of observation, int[n, 2]. Cells may repeat.
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
    """Return the cells along straight legs, with about one step per cell of length."""
    corners = np.array(points)
    parts = [np.floor(corners[:1])]
    for begin, end in itertools.pairwise(corners):
        steps = max(1, int(np.ceil(np.hypot(*(end - begin)))))
        parts.append(np.floor(begin + (end - begin) * (np.arange(1, steps + 1) / steps)[:, None]))
    return np.concatenate(parts).astype(np.intp)


_CANDIDATES = 40
_NEAR_SICK = 12
_NEAR = 4
_SPREAD = 3
_LONGEST_LEG = 30
_KNOWN = 0.12
_WIDTH = 4.5


def chasing_path(begun: Cells, sick: NDArray[np.bool_], longest: int, rng: Generator) -> Cells:
    """Continue a path towards observed sick plants and unobserved cells.

    Each round draws random straight legs and follows the leg with the highest mean value for a few cells. The
    value of a cell is higher near observed sick plants, lower near healthy ones, and 0 once observed.

    The generator draws the legs and the attraction of sick plants. The truth `sick` is read only along the
    path.
    """
    out = np.zeros((longest, 2), np.intp)
    count = min(len(begun), longest)
    out[:count] = begun[:count]
    stride = int(rng.integers(3, 13))
    decisions = -(-(longest - count) // stride)
    draws = rng.random((max(decisions, 1), _CANDIDATES + _NEAR_SICK, 2))
    # Unrelated attractive spots stand for the other diseases, which attract the drone, too.
    worth = np.full(sick.shape, 1.0)
    attraction = float(10.0 ** rng.uniform(0.3, 1.7))
    for spot in rng.random((int(rng.integers(0, 4)), 2)):
        x, y = (spot * np.array(sick.shape)).astype(np.intp).tolist()
        worth[max(0, x - 2) : x + 3, max(0, y - 2) : y + 3] += 0.5 * attraction
    _chase(out, count, sick, worth, attraction, stride, draws)
    return out


@compiled(nogil=True)
def _see(
    x: int, y: int, sick: NDArray[np.bool_], seen: NDArray[np.bool_], worth: NDArray[np.float64], pull: float
) -> None:
    if seen[x, y]:
        return
    seen[x, y] = True
    worth[x, y] = 0.0
    for i in range(max(0, x - _SPREAD), min(sick.shape[0], x + _SPREAD + 1)):
        for j in range(max(0, y - _SPREAD), min(sick.shape[1], y + _SPREAD + 1)):
            if not seen[i, j]:
                near = np.exp(-((i - x) ** 2 + (j - y) ** 2) / _WIDTH)
                if sick[x, y]:
                    worth[i, j] += pull * near
                else:
                    worth[i, j] *= 1.0 - _KNOWN * near


@compiled(nogil=True)
def _chase(
    out: Cells,
    count: int,
    sick: NDArray[np.bool_],
    worth: NDArray[np.float64],
    pull: float,
    stride: int,
    draws: NDArray[np.float64],
) -> None:
    width, height = sick.shape
    seen = np.zeros(sick.shape, np.bool_)
    found = np.zeros((len(out), 2), np.int64)
    n_found = 0
    for k in range(count):
        new = not seen[out[k, 0], out[k, 1]]
        _see(out[k, 0], out[k, 1], sick, seen, worth, pull)
        if new and sick[out[k, 0], out[k, 1]]:
            found[n_found] = out[k]
            n_found += 1
    decision = 0
    while count < len(out):
        x, y = out[count - 1, 0], out[count - 1, 1]
        best, best_x, best_y, best_steps = -1.0, x, y, 1
        for k in range(draws.shape[1]):
            u, v = draws[decision, k, 0], draws[decision, k, 1]
            if k < _CANDIDATES or n_found == 0:
                to_x, to_y = int(u * width), int(v * height)
            else:
                # Aim at a cell near a recently found sick plant.
                which = found[n_found - 1 - (k % min(n_found, _NEAR_SICK))]
                to_x = min(max(which[0] + int((2 * u - 1) * (_NEAR + 1)), 0), width - 1)
                to_y = min(max(which[1] + int((2 * v - 1) * (_NEAR + 1)), 0), height - 1)
            steps = max(abs(to_x - x), abs(to_y - y))
            if steps == 0:
                continue
            total = 0.0
            for s in range(1, min(steps, _LONGEST_LEG) + 1):
                total += worth[x + round((to_x - x) * s / steps), y + round((to_y - y) * s / steps)]
            mean = total / min(steps, _LONGEST_LEG)
            if mean > best:
                best, best_x, best_y, best_steps = mean, to_x, to_y, steps
        for s in range(1, min(best_steps, stride) + 1):
            if count == len(out):
                break
            out[count, 0] = x + round((best_x - x) * s / best_steps)
            out[count, 1] = y + round((best_y - y) * s / best_steps)
            i, j = out[count, 0], out[count, 1]
            if sick[i, j] and not seen[i, j]:
                found[n_found] = out[count]
                n_found += 1
            _see(i, j, sick, seen, worth, pull)
            count += 1
        decision = (decision + 1) % len(draws)
