"""Paths that follow a disease, along which simulated outbreaks are observed in training."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.estimators.paths import Cells

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
    value of a cell is higher near observed sick plants, lower near observed healthy plants, and 0 after it
    was observed. The legs, and the attraction of sick plants, are random draws from `rng`. The truth `sick`
    is read only along the path.
    """
    out = np.zeros((longest, 2), np.intp)
    count = min(len(begun), longest)
    out[:count] = begun[:count]
    stride = int(rng.integers(3, 13))
    decisions = -(-(longest - count) // stride)
    draws = rng.random((max(decisions, 1), _CANDIDATES + _NEAR_SICK, 2))
    # Random spots of higher value stand for other diseases, which would also attract the vehicle.
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
) -> bool:
    """Observe a cell; return whether it is sick and was not observed before."""
    if seen[x, y]:
        return False
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
    return bool(sick[x, y])


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
        if _see(out[k, 0], out[k, 1], sick, seen, worth, pull):
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
            if _see(out[count, 0], out[count, 1], sick, seen, worth, pull):
                found[n_found] = out[count]
                n_found += 1
            count += 1
        decision = (decision + 1) % len(draws)
