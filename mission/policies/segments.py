"""Survey segments: rows at one distance over a part of an area, which one vehicle flies as a whole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mission.planners.path import Area, Points

VARIANTS = 4
"""A segment is flown from any of its four corners."""
SHORTEST_M = 1e-3
"""A shorter row is none."""

Box = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max."""


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One straight pass: its ends float64[2, 2] in metres, and the number of the line that it lies on."""

    ends_m: Points
    line: int


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """What is offered on the market.

    Parameters
    ----------
    number : int
        Its name.
    fine : bool
        Whether it is about something that was found; else it is a part of the first look at everything.
    box_m : tuple of float
        Bounds in metres.
    rows : tuple of Row
        Line by line; on a line in the order along it.
    """

    number: int
    fine: bool
    box_m: Box
    rows: tuple[Row, ...]

    def ordered(self, variant: int) -> list[tuple[int, Points]]:
        """Return the rows in the order and direction of a flight to and fro from a corner.

        Parameters
        ----------
        variant : int
            The corner, 0 to 3: bit 0 flies the first row backwards, bit 1 begins with the last line.

        Returns
        -------
        list of (int, float64[2, 2])
            Number of the row, and its ends as they are flown.
        """
        lines = [list(rows) for _, rows in groupby(range(len(self.rows)), lambda k: self.rows[k].line)]
        if variant & 2:
            lines.reverse()
        flown: list[tuple[int, Points]] = []
        for k, numbers in enumerate(lines):
            if (k + variant) % 2:
                flown += [(number, self.rows[number].ends_m[::-1]) for number in reversed(numbers)]
            else:
                flown += [(number, self.rows[number].ends_m) for number in numbers]
        return flown

    def overlaps(self, box_m: Box) -> bool:
        """Return whether its box has land in common with another one."""
        x_min, y_min, x_max, y_max = self.box_m
        return x_min < box_m[2] and box_m[0] < x_max and y_min < box_m[3] and box_m[1] < y_max


def rows_over(box_m: Box, flyable: Area, spacing_m: float) -> tuple[Row, ...]:
    """Return rows along the longer side of a box, as far as they can be flown, spread evenly.

    Parameters
    ----------
    box_m : tuple of float
    flyable : shapely Polygon or MultiPolygon
    spacing_m : float
        About their distance from each other; those at the border are half as far from it.
    """
    low, high = np.array(box_m[:2]), np.array(box_m[2:])
    along = int(np.argmax(high - low - np.array([0.0, SHORTEST_M])))
    across = 1 - along
    count = max(1, round(float(high[across] - low[across]) / spacing_m))
    middles = low[across] + (np.arange(count) + 0.5) * (high[across] - low[across]) / count
    ends = np.empty((count, 2, 2))
    ends[:, :, across] = middles[:, None]
    ends[:, :, along] = low[along], high[along]
    rows: list[Row] = []
    for line, part in enumerate(shapely.intersection(shapely.linestrings(ends), flyable)):
        pieces = [piece for piece in shapely.get_parts(part) if piece.length > SHORTEST_M]
        corners = [np.array([piece.coords[0], piece.coords[-1]]) for piece in pieces]
        corners = [piece[np.argsort(piece[:, along], kind="stable")] for piece in corners]
        corners.sort(key=lambda piece: float(piece[0, along]))
        rows += [Row(piece, line) for piece in corners]
    return tuple(rows)


def blocks_of(flyable: Area, count: int) -> list[Box]:
    """Return about so many equal boxes, as square as can be, that cover an area's bounds."""
    x_min, y_min, x_max, y_max = flyable.bounds
    width, height = x_max - x_min, y_max - y_min
    columns = max(1, round(math.sqrt(count * width / height)))
    rows = max(1, round(count / columns))
    x, y = np.linspace(x_min, x_max, columns + 1).tolist(), np.linspace(y_min, y_max, rows + 1).tolist()
    return [(x[i], y[j], x[i + 1], y[j + 1]) for j in range(rows) for i in range(columns)]


def groups_of(cells: NDArray[np.integer], reach: float) -> list[NDArray[np.intp]]:
    """Return the numbers of cells, int[n, 2], of each group: neighbours are no farther than the reach."""
    if not len(cells):
        return []
    pairs = cKDTree(cells).query_pairs(reach, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    count, labels = connected_components(links, directed=False)
    return [np.flatnonzero(labels == k) for k in range(count)]


def corners_of(segments: Sequence[Segment]) -> Points:
    """Return where the variants of segments begin, and then where they end, float64[segments, 8, 2]."""
    corners = np.empty((len(segments), 2 * VARIANTS, 2))
    for k, segment in enumerate(segments):
        for variant in range(VARIANTS):
            flown = segment.ordered(variant)
            corners[k, variant], corners[k, VARIANTS + variant] = flown[0][1][0], flown[-1][1][-1]
    return corners
