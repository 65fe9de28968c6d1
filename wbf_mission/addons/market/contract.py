"""A vehicle's contract on the market: its path, the segments it serves, and its progress."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mission.planners.path import Points
from wbf_mission.addons.market.segments import SHORTEST_M, Row, Segment

_SAME_M = 0.1
_ROW_POINTS = 2
NO_POINTS: Points = np.empty((0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Part of a path: a row and the way to this row, or a leg to a random place."""

    segment: Segment | None  # None for a leg to a random place
    row: int  # Index of the row in the segment
    # float64[n, 2]: the way, then the row's two ends (only the far end if the vehicle is at the near end).
    points_m: Points


@dataclass(slots=True, eq=False)
class Contract:
    """Path of one vehicle, and the segments it serves."""

    stretches: tuple[Stretch, ...]  # In order of flight
    points_m: Points  # float64[n, 2]: the path as sent; its last leg may be shortened
    under_way: Segment | None = None  # First segment, if it was partly flown before this contract
    _left: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._left = len(self.points_m)

    def follow(self, rest_m: Points) -> bool:
        """Update the progress by the vehicle's remaining path; return False if it flies another path."""
        count = min(len(rest_m), len(self.points_m))
        mine, flown = self.points_m[len(self.points_m) - count :], rest_m[len(rest_m) - count :]
        if not np.allclose(mine, flown, rtol=0.0, atol=_SAME_M):
            return False
        self._left = count
        return True

    @property
    def ahead(self) -> list[tuple[Stretch, int]]:
        """Stretches not fully flown, each with its number of remaining points."""
        found = []
        end = len(self.points_m)
        passed = end - self._left
        begin = 0
        for stretch in self.stretches:
            stop = begin + len(stretch.points_m)
            left = min(stop - max(begin, passed), end - begin)
            if stop > passed and begin < end and left > 0:
                found.append((stretch, left))
            begin = stop
        return found

    @property
    def begun(self) -> Segment | None:
        """Segment that is partly flown."""
        ahead = self.ahead
        if not ahead:
            return None
        stretch, left = ahead[0]
        first = next(one for one in self.stretches if one.segment is stretch.segment)
        whole = stretch is first and left == len(stretch.points_m)
        return None if whole and stretch.segment is not self.under_way else stretch.segment

    def work(self) -> Points:
        """Return the remaining points of all segments, float64[n, 2]."""
        parts = [one.points_m[-left:] for one, left in self.ahead if one.segment is not None]
        return np.concatenate(parts) if parts else NO_POINTS

    def unflown(self, here_m: tuple[float, float] | None = None) -> list[Segment]:
        """Return the segments with their remaining rows; a row that is partly flown starts at `here_m`."""
        rows: dict[int, dict[int, Row]] = {}
        segments: dict[int, Segment] = {}
        for stretch, left in self.ahead:
            if stretch.segment is None:
                continue
            row = stretch.segment.rows[stretch.row]
            if left < _ROW_POINTS and here_m is not None:
                row = _rest_of(row, stretch.points_m[-1], here_m)
            if np.hypot(*(row.ends_m[1] - row.ends_m[0])) <= SHORTEST_M:
                continue
            segments[stretch.segment.number] = stretch.segment
            rows.setdefault(stretch.segment.number, {})[stretch.row] = row
        return [
            replace(segment, rows=tuple(rows[number][k] for k in sorted(rows[number])))
            for number, segment in segments.items()
        ]


def _rest_of(row: Row, end_m: Points, here_m: tuple[float, float]) -> Row:
    """Return the rest of a row that a vehicle at `here_m` flies towards `end_m`."""
    low, high = row.ends_m
    along = high - low
    share = float(np.clip(((np.asarray(here_m) - low) * along).sum() / (along * along).sum(), 0.0, 1.0))
    here = low + share * along
    towards_high = np.hypot(*(end_m - high)) < np.hypot(*(end_m - low))
    return Row(np.stack((here, high)) if towards_high else np.stack((low, here)), row.line)
