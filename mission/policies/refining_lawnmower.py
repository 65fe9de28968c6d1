"""The refining lawnmower: coarse rows over everything, then fine ones where sick plants showed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from mission.errors import PlanningError
from mission.planners import Budget, make_planner
from mission.planners.inside_routing import TOLERANCE_M
from mission.planners.path import Points, path_length
from mission.policies.decision import GO_ON, Decision
from mission.policies.policy import LEAST_S, Asking
from mission.policies.situation import Event, Situation, VehicleReport
from mission.policies.steering import affordable

_SICK_BELOW = 0.75
_EVERY = 4
_RENEW_CELLS = 6.0
_PATCHES_AT_ONCE = 3
_NOTHING: Points = np.empty((0, 2))


class RefiningLawnmower:
    """Fly a planner's rows with a part of the budget, then rows close to each other about the sick plants.

    Sick plants near each other make a patch. The patches are flown the most promising first: sick plants
    seen there by the weight of their disease, for the length of the way there and of its rows. It works with
    any estimator, as only the observations count.

    Parameters
    ----------
    planner : str
        Of the coarse rows.
    coarse : float
        Part of the budget for them.
    margin : float
        How far the fine rows go beyond the sick plants, cells.
    spacing : float
        Distance of the fine rows, cells.
    link : int
        Sick plants at most so far apart along each axis are one patch, cells.
    """

    def __init__(
        self,
        planner: str = "adaptive-lawnmower",
        coarse: float = 0.5,
        margin: float = 2.0,
        spacing: float = 1.0,
        link: int = 4,
    ) -> None:
        if not 0.0 < coarse < 1.0:
            msg = f"refining-lawnmower: coarse must be between 0 and 1, not {coarse!r}"
            raise PlanningError(msg)
        self._planner = planner
        self._coarse = float(coarse)
        self._margin, self._spacing = float(margin), float(spacing)
        self._link = int(link)

    @property
    def asking(self) -> Asking:
        """After some observations: a path is renewed before it ends."""
        return Asking(observations=_EVERY, least_s=LEAST_S)

    def start(self) -> None:
        """Nothing is remembered."""

    def decide(self, situation: Situation) -> Decision:
        """Give coarse rows at the start, and fine ones when a vehicle's path is nearly flown."""
        if situation.event is Event.START:
            return Decision(
                {one.system_id: self._rows(one, self._coarse) for one in situation.steerable}, reason="coarse"
            )
        paths: dict[int, Points] = {}
        taken = np.zeros(situation.model.shape, np.bool_)
        for vehicle in situation.steerable:
            if not self._nearly_flown(vehicle, situation.farm.cell_size_m):
                continue
            points = self._fine_rows(vehicle, situation, taken)
            if not len(points):
                points = self._more_rows(vehicle)
            points = affordable(vehicle, points)
            if len(points):
                paths[vehicle.system_id] = points
        return Decision(paths, reason="fine rows") if paths else GO_ON

    def _rows(self, vehicle: VehicleReport, part: float) -> Points:
        """Plan coarse rows for a part of the budget; for all of it if the part is too small."""
        budget = vehicle.request.budget
        planner = make_planner(self._planner)
        try:
            return planner(replace(vehicle.request, budget=_PartOf(budget, part * budget.limit))).points_m
        except PlanningError:
            return planner(vehicle.request).points_m

    def _more_rows(self, vehicle: VehicleReport) -> Points:
        """Plan rows from where the vehicle is with what is left; none if that is too little for them."""
        if vehicle.left <= 0.0:
            return _NOTHING
        request = replace(
            vehicle.request,
            start_xy_m=vehicle.position_m,
            budget=_PartOf(vehicle.request.budget, vehicle.left),
        )
        try:
            return make_planner(self._planner)(request).points_m
        except PlanningError:
            return _NOTHING

    @staticmethod
    def _nearly_flown(vehicle: VehicleReport, cell_m: float) -> bool:
        path = np.vstack((np.asarray(vehicle.position_m)[None], vehicle.rest_m))
        return path_length(path) <= _RENEW_CELLS * cell_m

    def _fine_rows(self, vehicle: VehicleReport, situation: Situation, taken: NDArray[np.bool_]) -> Points:
        """Return rows over the patches, the best next one after the other; marks their cells as taken."""
        worth = self._beside_sick(situation)
        worth[taken] = 0.0
        cell_m = situation.farm.cell_size_m
        boxes = self._patches(worth)
        here = np.asarray(vehicle.position_m) / cell_m
        rows: list[NDArray[np.float64]] = []
        for _ in range(_PATCHES_AT_ONCE):
            best: tuple[float, int, NDArray[np.float64]] | None = None
            for number, box in enumerate(boxes):
                path = _rows_of(box, here, self._spacing)
                length = path_length(np.vstack((here[None], path)))
                rate = float(worth[box].sum()) / max(length, 1.0)
                if best is None or rate > best[0]:
                    best = (rate, number, path)
            if best is None:
                break
            taken[boxes.pop(best[1])] = True
            rows.append(best[2])
            here = best[2][-1]
        if not rows:
            return _NOTHING
        points: Points = np.concatenate(rows) * cell_m
        inside = shapely.covers(shapely.buffer(vehicle.request.area, TOLERANCE_M), shapely.points(points))
        kept: Points = points[inside]
        return kept

    def _beside_sick(self, situation: Situation) -> NDArray[np.float64]:
        """Return the weight of plants not observed within the margin of a sick one, float64[W, H]."""
        seen, grid = situation.observations, situation.farm.grid()
        seen = seen[seen.day == situation.day]
        worth = np.zeros(grid.shape)
        reach = math.ceil(self._margin)
        axis = np.arange(-reach, reach + 1)
        disk = axis[:, None] ** 2 + axis[None, :] ** 2 <= self._margin**2
        for k, field in enumerate(situation.fields):
            if field.kind != "disease":
                continue
            sick = np.zeros(grid.shape, np.bool_)
            unknown = field.mask(grid)
            known = seen[seen.sensed[:, k]]
            unknown[known.x, known.y] = False
            found = known[known.values[:, k] < _SICK_BELOW]
            sick[found.x, found.y] = True
            near = ndimage.binary_dilation(sick, disk)
            worth += situation.weights.field[k] * (near & unknown)
        return worth

    def _patches(self, worth: NDArray[np.float64]) -> list[tuple[slice, slice]]:
        """Return the boxes of the patches of cells that are worth something."""
        near = ndimage.maximum_filter(worth > 0.0, size=self._link)
        labels, _ = ndimage.label(near, structure=np.ones((3, 3)))
        return [(box[0], box[1]) for box in ndimage.find_objects(np.where(worth > 0.0, labels, 0)) if box]


@dataclass(frozen=True, slots=True)
class _PartOf:
    """A part of a budget."""

    whole: Budget
    limit: float

    @property
    def unit(self) -> str:
        return self.whole.unit

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        return self.whole.cost(path_xy_m)


def _rows_of(box: tuple[slice, slice], here: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return rows to and fro over a box of cells, along its longer side, from the corner nearest to a place.

    Parameters
    ----------
    box : tuple of slice
        Cells.
    here : float64[2]
        The place, in cells.
    spacing : float
        Largest distance of rows, cells.

    Returns
    -------
    float64[2 rows, 2]
    """
    low = np.array([side.start + 0.5 for side in box])
    high = np.array([side.stop - 0.5 for side in box])
    along = int(np.argmax(high - low))
    across = 1 - along
    count = math.ceil((high[across] - low[across]) / spacing - 1e-9) + 1
    heights = np.linspace(low[across], high[across], count)
    if abs(here[across] - high[across]) < abs(here[across] - low[across]):
        heights = heights[::-1]
    ends = np.array([low[along], high[along]])
    if abs(here[along] - ends[1]) < abs(here[along] - ends[0]):
        ends = ends[::-1]
    path = np.empty((2 * count, 2))
    path[:, across] = np.repeat(heights, 2)
    path[:, along] = np.resize(np.concatenate((ends, ends[::-1])), 2 * count)
    return path
