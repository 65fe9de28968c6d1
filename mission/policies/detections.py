"""Detections: sick plants that were seen, and the exploration segments about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mission.errors import PlanningError
from mission.planners.inside_routing import Terrain
from mission.policies.observation import PolicyObservation
from mission.policies.segments import Box, Segment, groups_of, rows_over

ALL = "all"
_MOST_SEEN = 0.8


@dataclass(slots=True)
class Detections:
    """Makes segments about the sick plants of the day that were seen.

    Detections near each other are a group; a group is over when no more were added to it since the last look.
    Then its bounds and a border make a segment, once. It waits as long as one that overlaps with it is not
    flown.

    Parameters
    ----------
    border : float
        Beyond the detections, and how far apart those of a group may be, cells.
    step : float
        Distance of rows, cells.
    field_name : str
        Of which disease; ``all``: of every one with a weight.
    below : float
        A plant with a smaller value is a detection.
    who : str
        What errors call the policy.
    """

    border: float
    step: float
    field_name: str
    below: float
    who: str
    _known: int = field(default=0, init=False)
    _numbers: int = field(default=0, init=False)
    _offered: list[tuple[int, int, int, int]] = field(default_factory=list, init=False)

    def start(self) -> None:
        """Forget the run before."""
        self._known, self._numbers, self._offered = 0, 0, []

    def begin_day(self) -> None:
        """Offer what was offered on another day anew when it is found again."""
        self._offered = []

    def next_number(self) -> int:
        """Return a number for a segment that no other one of the run has."""
        self._numbers += 1
        return self._numbers

    def segments(
        self, observation: PolicyObservation, terrains: Sequence[Terrain], ahead: Sequence[Segment]
    ) -> list[Segment]:
        """Return segments about the groups of detections that are over.

        Parameters
        ----------
        terrains : sequence of Terrain
            Of the vehicles; a segment lies in the area of one of them.
        ahead : sequence of Segment
            The fine ones that are not flown yet.

        Raises
        ------
        PlanningError
            If there is no such disease.
        """
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
            msg = f"{self.who}: no disease that is scored is named {self.field_name!r}; there are {known}"
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
