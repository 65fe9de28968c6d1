"""Survey segments: rows at equal spacing over a part of an area, flown by one vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mission.errors import PlanningError
from mission.planners.path import Area, Points
from mission.planners.terrain import Terrain
from mission.policies.observation import PolicyObservation

VARIANTS = 4
"""Number of corners from which a segment can be flown."""
SHORTEST_M = 1e-3
"""Minimum length of a row."""

Box = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max."""


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """A straight pass: its ends, float64[2, 2] in metres, and the number of its line."""

    ends_m: Points
    line: int


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """Rows of the survey that are auctioned together."""

    number: int  # Unique in a run
    # Whether the segment is around detections; otherwise it is part of the first survey.
    fine: bool
    box_m: Box  # Bounds in metres
    rows: tuple[Row, ...]  # Sorted by line, then along the line

    def ordered(self, variant: int) -> list[tuple[int, Points]]:
        """Return each row's number and ends, float64[2, 2]; rows are flown to and fro from corner `variant`.

        Bit 0 of `variant`: the first row is flown backwards. Bit 1: the last line comes first.
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
        """Return whether the segment's bounds overlap with `box_m`."""
        x_min, y_min, x_max, y_max = self.box_m
        return x_min < box_m[2] and box_m[0] < x_max and y_min < box_m[3] and box_m[1] < y_max


def rows_over(box_m: Box, flyable: Area, spacing_m: float) -> tuple[Row, ...]:
    """Return the flyable parts of evenly spaced rows along the longer side of a box."""
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
    """Return about `count` equal boxes, nearly square, that cover the bounds of an area."""
    x_min, y_min, x_max, y_max = flyable.bounds
    width, height = x_max - x_min, y_max - y_min
    columns = max(1, round(math.sqrt(count * width / height)))
    rows = max(1, round(count / columns))
    x, y = np.linspace(x_min, x_max, columns + 1).tolist(), np.linspace(y_min, y_max, rows + 1).tolist()
    return [(x[i], y[j], x[i + 1], y[j + 1]) for j in range(rows) for i in range(columns)]


def groups_of(cells: NDArray[np.integer], reach: float) -> list[NDArray[np.intp]]:
    """Group cells, int[n, 2], whose neighbours are within `reach`; return the indices of each group."""
    if not len(cells):
        return []
    pairs = cKDTree(cells).query_pairs(reach, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    count, labels = connected_components(links, directed=False)
    return [np.flatnonzero(labels == k) for k in range(count)]


def corners_of(segments: Sequence[Segment]) -> Points:
    """Return start points, then end points of each segment's 4 variants, float64[segments, 8, 2]."""
    corners = np.empty((len(segments), 2 * VARIANTS, 2))
    for k, segment in enumerate(segments):
        for variant in range(VARIANTS):
            flown = segment.ordered(variant)
            corners[k, variant], corners[k, VARIANTS + variant] = flown[0][1][0], flown[-1][1][-1]
    return corners


ALL = "all"
_MOST_SEEN = 0.8


@dataclass(slots=True)
class Detections:
    """Makes segments around the sick plants seen today.

    Detections near each other form a group. A group is complete when no detection has been added since the
    last search. Then its bounds and a border become one segment. The group waits while an overlapping segment
    is unflown.
    """

    border: float  # Margin around the detections, and maximum distance between neighbours in a group, cells
    step: float  # Row spacing, cells
    field_name: str  # Disease of the detections; all: every disease with a weight
    below: float  # Upper limit of a detection's value
    who: str  # Name of the policy in error messages
    _known: int = field(default=0, init=False)
    _numbers: int = field(default=0, init=False)
    _offered: list[tuple[int, int, int, int]] = field(default_factory=list, init=False)

    def start(self) -> None:
        """Reset the detections for a new run."""
        self._known, self._numbers, self._offered = 0, 0, []

    def begin_day(self) -> None:
        """Forget the places offered on earlier days, so that they may be offered again."""
        self._offered = []

    def next_number(self) -> int:
        """Return an unused segment number."""
        self._numbers += 1
        return self._numbers

    def segments(
        self, observation: PolicyObservation, terrains: Sequence[Terrain], ahead: Sequence[Segment]
    ) -> list[Segment]:
        """Return new segments around the groups of detections that are complete."""
        fields = self._fields(observation)
        seen = observation.observations
        latest, self._known = self._known, len(seen)
        with np.errstate(invalid="ignore"):
            sick = (seen.values[:, fields] < self.below).any(axis=1) & (seen.day == observation.day)
        numbers = np.flatnonzero(sick)
        cells = np.stack((seen.x[numbers], seen.y[numbers]), axis=1)
        for x_0, y_0, x_1, y_1 in self._offered:
            x, y = cells[:, 0], cells[:, 1]
            outside = (x < x_0) | (x >= x_1) | (y < y_0) | (y >= y_1)
            cells, numbers = cells[outside], numbers[outside]
        made: list[Segment] = []
        for group in groups_of(cells, self.border):
            if numbers[group].max() >= latest:
                continue
            segment = self._segment(observation, cells[group], terrains, [*ahead, *made])
            if segment is not None:
                made.append(segment)
        return made

    def _fields(self, observation: PolicyObservation) -> list[int]:
        weights = observation.weights.field
        diseases = [
            k for k, one in enumerate(observation.fields) if one.kind == "disease" and weights[k] > 0.0
        ]
        if self.field_name == ALL:
            return diseases
        names = {observation.fields.names[k]: k for k in diseases}
        if self.field_name not in names:
            known = ", ".join([*names, ALL])
            msg = f"{self.who}: no scored disease is named {self.field_name!r}; give one of {known}"
            raise PlanningError(msg)
        return [names[self.field_name]]

    def _segment(
        self,
        observation: PolicyObservation,
        cells: NDArray[np.integer],
        terrains: Sequence[Terrain],
        ahead: Sequence[Segment],
    ) -> Segment | None:
        border, shape = round(self.border), observation.model.shape
        x_0, y_0 = np.maximum(cells.min(axis=0) - border, 0).tolist()
        x_1, y_1 = np.minimum(cells.max(axis=0) + border + 1, shape).tolist()
        cell_m = observation.farm.cell_size_m
        box: Box = (x_0 * cell_m, y_0 * cell_m, x_1 * cell_m, y_1 * cell_m)
        if any(segment.overlaps(box) for segment in ahead):
            return None
        self._offered.append((x_0, y_0, x_1, y_1))
        seen = observation.observations
        inside = (
            (seen.x >= x_0)
            & (seen.x < x_1)
            & (seen.y >= y_0)
            & (seen.y < y_1)
            & (seen.day == observation.day)
        )
        known = len(np.unique(seen.x[inside].astype(np.int64) * shape[1] + seen.y[inside]))
        if known >= _MOST_SEEN * (x_1 - x_0) * (y_1 - y_0):
            return None
        for terrain in terrains:
            rows = rows_over(box, terrain.flyable, self.step * cell_m)
            if rows:
                return Segment(self.next_number(), True, box, rows)
        return None
