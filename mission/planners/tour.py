"""The flight order of cells of rows, and the entry corner of each cell."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mission.planners.path import Points
from mission.planners.sweep import boustrophedon
from mission.planners.terrain import Terrain, straight_lengths

MOST_EXACT = 9
"""Greatest number of cells with an optimal order; more cells are ordered by 2-opt and single-cell moves."""
_ROUGHLY_EXACT = 5
_TRIALS, _ROUGH_TRIALS = 3000, 200
_GAIN_M = 1e-6  # Smaller gains are rounding errors


def fly_cells(
    cells: Sequence[NDArray[np.float64]],
    terrain: Terrain,
    start_m: ArrayLike,
    *,
    home_m: ArrayLike | None = None,
    exact: bool = True,
) -> list[Points]:
    """Return the rows of all cells in an order and direction with short transits between cells.

    A cell is float64[n, 2, 2] (row, end, (x, y)), or the points of a line, float64[n, 2], flown from either
    end. The flight goes from `start_m` to `home_m`; it ends with the last row if `home_m` is None. `exact`:
    measure transits round corners and holes of the terrain. Otherwise transits are straight.
    """
    home = start_m if home_m is None else home_m
    corners = np.array([_corners(cell) for cell in cells])
    places = np.vstack((corners.reshape(-1, 2), start_m, home))
    ways = terrain.lengths(places) if exact else straight_lengths(places)
    tour = _Tour(
        ways, [_exits(1 if _is_line(cell) else len(cell)) for cell in cells], returns=home_m is not None
    )
    few = len(cells) <= (MOST_EXACT if exact else _ROUGHLY_EXACT)
    order = tour.best() if few else tour.good(_TRIALS if exact else _ROUGH_TRIALS)
    entries = tour.entries(order)
    return [
        piece
        for index, entry in zip(order, entries, strict=True)
        for piece in _flown(cells[index], from_last=entry >= 2, from_right=bool(entry % 2))
    ]


def _is_line(cell: NDArray[np.float64]) -> bool:
    return cell.ndim == 2


def _corners(cell: NDArray[np.float64]) -> list[Points]:
    ends = 2 * [cell] if _is_line(cell) else [cell[0], cell[-1]]
    return [place for end in ends for place in (end[0], end[-1])]


def _flown(cell: NDArray[np.float64], *, from_last: bool, from_right: bool) -> list[Points]:
    if _is_line(cell):
        return [cell[::-1] if from_right else cell]
    return list(boustrophedon(cell, from_last=from_last, from_right=from_right).reshape(-1, 2, 2))


def _exits(rows: int) -> list[int]:
    """Return the exit corner for each entry corner (first row left and right, last row left and right)."""
    if rows == 1:
        return [1, 0, 3, 2]
    return [(2 if entry < 2 else 0) + (entry % 2 if rows % 2 == 0 else 1 - entry % 2) for entry in range(4)]


class _Tour:
    """Search for a short order of cells, given the transit lengths between their corners."""

    def __init__(self, ways: NDArray[np.float64], exits: list[list[int]], *, returns: bool) -> None:
        count = len(exits)
        at = 4 * np.arange(count)[:, None] + np.arange(4)
        leave = 4 * np.arange(count)[:, None] + np.array(exits)
        # Transit lengths between cells, by the entry corner of each: [from, entry, to, entry].
        self._step = ways[leave[:, :, None, None], at[None, None]]
        self._first = ways[-2][at]
        self._last = ways[-1][leave] if returns else np.zeros((count, 4))
        self._count = count

    def entries(self, order: Sequence[int]) -> list[int]:
        """Return the best entry corner of each cell in an order."""
        spent, came = self._first[order[0]], []
        for here, there in itertools.pairwise(order):
            both = spent[:, None] + self._step[here, :, there]
            came.append(both.argmin(axis=0))
            spent = both.min(axis=0)
        entry = int((spent + self._last[order[-1]]).argmin())
        chosen = [entry]
        for back in reversed(came):
            entry = int(back[entry])
            chosen.append(entry)
        return chosen[::-1]

    def length(self, order: Sequence[int]) -> float:
        """Return the total transit length of an order."""
        spent = self._first[order[0]]
        for here, there in itertools.pairwise(order):
            spent = (spent[:, None] + self._step[here, :, there]).min(axis=0)
        return float((spent + self._last[order[-1]]).min())

    def best(self) -> list[int]:
        """Return the optimal order, by dynamic programming over sets of cells (Held and Karp 1962)."""
        count, whole = self._count, (1 << self._count) - 1
        spent = np.full((whole + 1, count, 4), np.inf)
        came = np.full((whole + 1, count, 4), -1)
        for cell in range(count):
            spent[1 << cell, cell] = self._first[cell]
        for visited in range(1, whole):
            inside = [cell for cell in range(count) if visited >> cell & 1]
            for other in (cell for cell in range(count) if not visited >> cell & 1):
                total = (spent[visited, inside][:, :, None] + self._step[inside, :, other]).reshape(-1, 4)
                source = total.argmin(axis=0)
                spent[visited | 1 << other, other] = total[source, np.arange(4)]
                came[visited | 1 << other, other] = np.array(inside)[source // 4] * 4 + source % 4
        cell, entry = divmod(int((spent[whole] + self._last).argmin()), 4)
        order, visited = [cell], whole
        while (before := int(came[visited, cell, entry])) >= 0:
            visited ^= 1 << cell
            cell, entry = divmod(before, 4)
            order.append(cell)
        return order[::-1]

    def good(self, most_trials: int) -> list[int]:
        """Return a good order: nearest neighbour, improved by 2-opt and moves of single cells."""
        order = self._nearest()
        length, trials, improved = self.length(order), 0, True
        while improved and trials < most_trials:
            improved = False
            for candidate in _neighbours(order):
                trials += 1
                if (shorter := self.length(candidate)) < length - _GAIN_M:
                    order, length, improved = candidate, shorter, True
                    break
                if trials >= most_trials:
                    break
        return order

    def _nearest(self) -> list[int]:
        spent = self._first.min(axis=1)
        order = [int(spent.argmin())]
        entry = int(self._first[order[0]].argmin())
        while len(order) < self._count:
            step = self._step[order[-1], entry].copy()
            step[order] = np.inf
            there, entry = map(int, np.unravel_index(int(step.argmin()), step.shape))
            order.append(there)
        return order


def _neighbours(order: list[int]) -> Iterator[list[int]]:
    """Yield the orders with one reversed section, then the orders with one moved cell."""
    count = len(order)
    for begin in range(count - 1):
        for end in range(begin + 2, count + 1):
            yield order[:begin] + order[begin:end][::-1] + order[end:]
    for moved in range(count):
        rest = order[:moved] + order[moved + 1 :]
        for to in range(count):
            if to not in (moved - 1, moved):
                yield [*rest[:to], order[moved], *rest[to:]]
