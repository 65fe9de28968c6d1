"""Parallel rows over polygons, as boustrophedon cells in flight order."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry import Polygon

from geo.linear_algebra import arctan2, cos, product, sin
from geo.texts import is_number
from mission.errors import PlanningError
from mission.planners.path import Area, Points
from mission.planners.terrain import Terrain, is_rectangle, parts_of, straight_lengths

_EDGE_M = 1e-7  # Outermost rows lie this far inside, because crossings exactly on an edge are unreliable.
_MERGE_M = 1e-9  # Pieces of a row closer than this distance are merged.
_MAX_ROWS = 50_000  # Greatest number of rows; a mission cannot have items for more rows.
_ROUNDED_RAD = 5.1e-5  # Error of an angle rounded to four decimals.


class Sweep:
    """Parallel rows over an inset area, for any number of rows.

    Each part of the area has rows from border to border. All parts have about the same row spacing, at least
    `min_spacing_m`. The part with the greatest extent across the rows sets the spacing. Raises PlanningError
    if no number of rows keeps `min_spacing_m` and `max_spacing_m`.
    """

    def __init__(
        self,
        area: Area,
        min_spacing_m: float,
        angle_rad: float = 0.0,
        *,
        max_spacing_m: float = math.inf,
    ) -> None:
        self._min_spacing_m = min_spacing_m
        self._turn = rotation(angle_rad)
        self._parts = [_Part(part, self._turn) for part in parts_of(area)]
        self._height_m = max(part.height_m for part in self._parts)
        self.most_rows = self._most_rows(self._height_m)
        needed = math.ceil(self._height_m / max_spacing_m - 1e-9) + 1
        self.least_rows = max(min(2, self.most_rows), needed if self._height_m > max_spacing_m else 1)
        if self.least_rows > self.most_rows:
            raise PlanningError(
                f"rows at most {max_spacing_m:g} m and at least {min_spacing_m:g} m apart do not fit into "
                f"the {self._height_m:g} m of the area across the rows; widen the limits"
            )

    def _most_rows(self, height_m: float) -> int:
        if self._min_spacing_m <= 0:
            return _MAX_ROWS
        return min(_MAX_ROWS, math.floor(height_m / self._min_spacing_m + 1e-9) + 1)

    def spacing_m(self, rows: int) -> float:
        """Return the distance between neighbouring rows; for a single row, the height of the area."""
        return self._height_m / max(rows - 1, 1)

    def pieces(self, rows: int, start_m: ArrayLike) -> list[Points]:
        """Return the rows in flight order, cell by cell.

        A cell is a stack of rows that no border splits, flown to and fro.
        """
        spacing = self.spacing_m(rows)
        cells: list[NDArray[np.float64]] = []
        owners: list[int] = []
        for number, part in enumerate(self._parts):
            count = rows if part.height_m == self._height_m else math.ceil(part.height_m / spacing - 1e-9) + 1
            found = part.cells(min(count, self._most_rows(part.height_m)))
            cells += found
            owners += [number] * len(found)
        start = product(np.asarray(start_m, dtype=np.float64), self._turn.T)
        ordered = product(np.vstack(order_cells(cells, owners, start)), self._turn)
        return list(ordered.reshape(-1, 2, 2))


class _Part:
    """A polygon, turned so that the rows run along x."""

    def __init__(self, polygon: Polygon, turn: NDArray[np.float64]) -> None:
        rings = (polygon.exterior, *polygon.interiors)
        turned = [product(shapely.get_coordinates(ring), turn.T) for ring in rings]
        self._from = np.vstack([ring[:-1] for ring in turned])
        self._to = np.vstack([ring[1:] for ring in turned])
        self._low, self._high = self._from.min(axis=0), self._from.max(axis=0)
        self._rectangle = is_rectangle(Polygon(turned[0], turned[1:]))
        self.height_m = float(self._high[1] - self._low[1])

    def cells(self, rows: int) -> list[NDArray[np.float64]]:
        """Return the boustrophedon cells, each float64[n, 2, 2]: row, (left end, right end), (x, y)."""
        low, high = self._low, self._high
        heights = np.linspace(low[1], high[1], rows) if rows > 1 else np.array([(low[1] + high[1]) / 2])
        if self._rectangle:
            ends = np.empty((rows, 2, 2))
            ends[:, :, 1] = heights[:, None]
            ends[:, 0, 0], ends[:, 1, 0] = low[0], high[0]
            return [ends]
        edge = min(_EDGE_M, self.height_m / 4)
        row, left, right = self._scan(np.clip(heights, low[1] + edge, high[1] - edge))
        y = np.clip(heights, low[1] + edge, high[1] - edge)[row]
        ends = np.stack((np.stack((left, y), axis=-1), np.stack((right, y), axis=-1)), axis=1)
        return [ends[chain] for chain in row_chains(row, left, right)]

    def _scan(
        self, heights: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        """Return row index, left end and right end of each piece of a row, sorted by row, then by x."""
        rows: list[NDArray[np.intp]] = []
        crossings: list[NDArray[np.float64]] = []
        for (x_0, y_0), (x_1, y_1) in zip(self._from, self._to, strict=True):
            first, last = np.searchsorted(heights, (min(y_0, y_1), max(y_0, y_1)))
            hit = np.arange(first, last)
            rows.append(hit)
            crossings.append(x_0 + (heights[hit] - y_0) / (y_1 - y_0 or 1.0) * (x_1 - x_0))
        row, x = np.concatenate(rows), np.concatenate(crossings)
        order = np.lexsort((x, row))
        row, left, right = row[order][::2], x[order][::2], x[order][1::2]
        splits = np.ones(len(row), dtype=bool)
        splits[1:] = (row[1:] != row[:-1]) | (left[1:] - right[:-1] > _MERGE_M)
        firsts = np.nonzero(splits)[0]
        lasts = np.append(firsts[1:], len(row)) - 1
        return row[firsts], left[firsts], right[lasts]


def row_chains(
    row: NDArray[np.intp], left: NDArray[np.float64], right: NDArray[np.float64]
) -> list[list[int]]:
    """Return cells as indices of row pieces, one piece per row; a cell ends where pieces fork or merge."""
    pieces: dict[int, list[int]] = {}
    for index, number in enumerate(row.tolist()):
        pieces.setdefault(number, []).append(index)
    lefts, rights = left.tolist(), right.tolist()
    chains: list[list[int]] = []
    chain_of: dict[int, list[int]] = {}
    for number in sorted(pieces):
        below = pieces.get(number - 1, [])
        touching = {
            index: [old for old in below if lefts[old] <= rights[index] and lefts[index] <= rights[old]]
            for index in pieces[number]
        }
        uses: dict[int, int] = {}
        for olds in touching.values():
            for old in olds:
                uses[old] = uses.get(old, 0) + 1
        for index, olds in touching.items():
            if len(olds) == 1 and uses[olds[0]] == 1:
                chain = chain_of[olds[0]]
            else:
                chain = []
                chains.append(chain)
            chain.append(index)
            chain_of[index] = chain
    return chains


def order_cells(
    cells: Sequence[NDArray[np.float64]], owners: Sequence[int], start: NDArray[np.float64]
) -> list[Points]:
    """Return the cells as to-and-fro paths, part by part; the cell with the nearest corner comes next."""
    # Entry corners of each cell, in this order: first row left and right, last row left and right.
    entries = np.array([[cell[0, 0], cell[0, 1], cell[-1, 0], cell[-1, 1]] for cell in cells])
    owner = np.asarray(owners)
    left = np.ones(len(cells), dtype=bool)
    here, current = start, -1
    ordered: list[Points] = []
    while left.any():
        open_cells = left & (owner == current) if (left & (owner == current)).any() else left
        candidates = np.nonzero(open_cells)[0]
        distance = np.hypot(*np.moveaxis(entries[candidates] - here, -1, 0))
        nearest, corner = np.unravel_index(int(np.argmin(np.round(distance, 9))), distance.shape)
        index = int(candidates[nearest])
        piece = boustrophedon(cells[index], from_last=bool(corner >= 2), from_right=bool(corner % 2))
        ordered.append(piece)
        left[index] = False
        here, current = piece[-1], int(owner[index])
    return ordered


def boustrophedon(ends: NDArray[np.float64], *, from_last: bool = False, from_right: bool = False) -> Points:
    """Return the to-and-fro path along rows.

    >>> boustrophedon(np.array([[[0, 0], [4, 0]], [[0, 1], [4, 1]]])).tolist()
    [[0, 0], [4, 0], [4, 1], [0, 1]]
    """
    rows = ends[::-1].copy() if from_last else ends.copy()
    rows[int(not from_right) :: 2] = rows[int(not from_right) :: 2, ::-1]
    return rows.reshape(-1, 2)


def sweep_angle(area: Area, direction: str | float | None = None) -> float:
    """Return the angle of the rows, in radians anticlockwise from the x axis.

    `direction` is one of:

    - ``"x"``: along the x axis.
    - ``"longest-side"``: along the longest straight side.
    - ``"fewest-turns"``: along the edge of the convex hull across which the area is narrowest.
    - A number: the angle itself. An angle that equals the angle of a hull edge to four decimals snaps to this
      edge, because rows almost parallel to a border would otherwise lose the outermost row.
    - None: ``"x"`` for an axis-aligned rectangle, as in the paper, otherwise ``"fewest-turns"``.

    Any other value raises PlanningError.

    >>> tall = shapely.box(0, 0, 1, 9)
    >>> sweep_angle(tall), round(sweep_angle(tall, "fewest-turns"), 4)
    (0.0, 1.5708)
    >>> sweep_angle(tall, 1.5708) == sweep_angle(tall, "fewest-turns")
    True
    """
    if direction is None:
        direction = "x" if is_rectangle(area) else "fewest-turns"
    if direction == "x":
        return 0.0
    angle = None if isinstance(direction, str) or not is_number(direction) else float(direction)
    if angle is None and direction not in ("longest-side", "fewest-turns"):
        msg = f"sweep direction {direction!r} is not x, longest-side, fewest-turns or an angle in radians"
        raise PlanningError(msg)
    if direction == "longest-side":
        rings = [part.exterior for part in parts_of(shapely.simplify(area, _EDGE_M))]
    else:
        rings = [part.convex_hull.exterior for part in parts_of(area)]
    edges = np.vstack([np.diff(shapely.get_coordinates(ring), axis=0) for ring in rings])
    angles = np.round(arctan2(edges[:, 1], edges[:, 0]) % math.pi, 12)
    angles[angles >= round(math.pi, 12)] = 0.0
    if direction == "longest-side":
        return float(angles[np.argmax(np.round(np.hypot(*edges.T), 9))])
    candidates = np.unique(angles)
    if angle is not None:
        edges_rad = candidates + math.pi * np.round((angle - candidates) / math.pi)
        nearest = float(edges_rad[np.argmin(np.abs(edges_rad - angle))])
        return nearest if abs(nearest - angle) <= _ROUNDED_RAD else angle
    across = np.stack((-sin(candidates), cos(candidates)))
    heights = sum(np.ptp(product(shapely.get_coordinates(ring), across), axis=0) for ring in rings)
    return float(candidates[np.argmin(np.round(heights, 9))])


def rotation(angle_rad: float) -> NDArray[np.float64]:
    """Return the matrix of a rotation into a frame with its x axis at the angle (``points @ matrix.T``)."""
    if angle_rad == 0.0:
        return np.eye(2)
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, sine], [-sine, cosine]])


MOST_EXACT = 9
"""Greatest number of cells for which the optimal order is computed; more cells are ordered by 2-opt."""
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
    end. The flight goes from `start_m` to `home_m`; it ends with the last row if `home_m` is None. With
    `exact`, transits are measured round corners and holes of the terrain; otherwise transits are straight.
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
    """Return the exit corner for each entry corner (0 to 3: first row left, right, last row left, right)."""
    if rows == 1:
        return [1, 0, 3, 2]
    return [(2 if entry < 2 else 0) + (entry % 2 if rows % 2 == 0 else 1 - entry % 2) for entry in range(4)]


class _Tour:
    """Search for a short order of cells, given the transit lengths between their corners."""

    def __init__(self, ways: NDArray[np.float64], exits: list[list[int]], *, returns: bool) -> None:
        count = len(exits)
        at = 4 * np.arange(count)[:, None] + np.arange(4)
        leave = 4 * np.arange(count)[:, None] + np.array(exits)
        # Lengths of transits, by the two cells and their entry corners: [cell, entry, next cell, entry].
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
