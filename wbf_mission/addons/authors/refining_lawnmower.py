"""Refining lawnmower: a policy that flies coarse rows, and makes a detour when it finds a sick plant."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.errors import PlanningError
from mission.planners import Budget, make_planner
from mission.planners.partition import STRIPS
from mission.planners.path import Area, Points, path_length
from mission.planners.terrain import TOLERANCE_M, Terrain, area_of, is_rectangle, polygons_of
from mission.policies.acquisition import scored_cells
from mission.policies.allocation import shared
from mission.policies.decision import NO_CHANGE, AcquisitionMap, Decision
from mission.policies.map_policies import RollingHorizon
from mission.policies.observation import Event, PolicyObservation, VehicleReport
from mission.policies.planning_grid import LegCosts
from mission.policies.policy import LEAST_S, Triggers
from mission.policies.route_search import COST, VALUE, leg_offsets, neighbour_shares, search_route
from mission.policies.steering import affordable
from wbf_mission.maps.blocks import SICK_BELOW

_RENEW_CELLS = 6.0
_NOTHING: Points = np.empty((0, 2))


@dataclass(slots=True)
class _Rows:
    """The unflown part of a vehicle's coarse rows."""

    rest: Points  # Points that are still to be reached, float64[n, 2], metres.
    begin: NDArray[np.float64]  # Start of the unflown part, float64[2], metres.

    def resumed(self, from_m: NDArray[np.float64]) -> Points:
        """Return the unflown points; the first is the point nearest to `from_m` on the interrupted row."""
        if not len(self.rest):
            return self.rest
        leg = self.rest[0] - self.begin
        length = float((leg * leg).sum())
        part = float(np.clip(((from_m - self.begin) * leg).sum() / length, 0.0, 1.0)) if length > 0.0 else 0.0
        return np.vstack((self.begin + part * leg, self.rest))


class RefiningLawnmower:
    """Fly coarse rows; if a sick plant is observed, make a detour until all plants beside it are known.

    The vehicle first flies over the crop whose disease has the largest weight in the score. The rows there
    are as close as the budget allows, but not closer than `gap`, the width of an outbreak. The remaining
    budget goes to rows over the next crop. After the rows, `mission.policies.map_policies.RollingHorizon`
    spends the rest of the budget. The rows and detours depend only on observations, so any estimator works.
    Several vehicles divide the land into strips.

    Parameters
    ----------
    coarse : float
        Fraction of the budget for the rows.
    gap, later_gap : float
        Minimum row spacing (cells) over the first crop, and over the other crops.
    least_rate : float
        Minimum number of plants beside sick plants that a detour reaches per cell of flight.
    every : int
        Number of observations between two searches for a detour.

    Raises
    ------
    PlanningError
        If a parameter is out of its range.
    """

    def __init__(
        self,
        coarse: float = 0.9,
        gap: float = 6.0,
        later_gap: float = 3.5,
        least_rate: float = 0.35,
        every: int = 2,
    ) -> None:
        if not 0.0 < coarse <= 1.0:
            raise PlanningError(f"refining-lawnmower: coarse must be above 0 and at most 1, not {coarse!r}")
        if not min(gap, later_gap) > 0.0:
            msg = f"refining-lawnmower: gap and later_gap must be above 0, not {gap!r} and {later_gap!r}"
            raise PlanningError(msg)
        self._coarse = float(coarse)
        self._gaps = float(gap), float(later_gap)
        self._least_rate = float(least_rate)
        self.triggers = Triggers(observations=int(every), least_s=LEAST_S)
        self._after = RollingHorizon()
        self._rows: dict[int, _Rows] = {}
        self._away: set[int] = set()
        self._terrains: dict[int, Terrain] = {}

    def start(self) -> None:
        """Reset the policy for a new run."""
        self._rows, self._away = {}, set()
        self._after.start()

    def decide(self, observation: PolicyObservation) -> Decision:
        """Return paths along the rows, detours from them, and after the rows routes of `RollingHorizon`."""
        if observation.event is Event.START:
            return self._begin(observation)
        paths: dict[int, Points] = {}
        done: list[int] = []
        windows: list[Window] = []
        for vehicle in observation.steerable:
            rows = self._rows.get(vehicle.system_id)
            if rows is None:
                done.append(vehicle.system_id)
                continue
            path = self._path(vehicle, rows, observation, paths, windows)
            ends = observation.event is Event.ENDING and len(vehicle.rest_m) <= 1
            if path is None and (ends or _nearly_flown(vehicle, observation.farm.cell_size_m)):
                del self._rows[vehicle.system_id]
                done.append(vehicle.system_id)
            elif path is not None:
                paths[vehicle.system_id] = path
        acquisition = _joined(windows, observation)
        if done:
            after = self._after.decide(observation)
            routes = {system_id: after.paths[system_id] for system_id in done if system_id in after.paths}
            acquisition = after.acquisition if routes else acquisition
            paths |= routes
        if not paths:
            return NO_CHANGE
        reason = "plants beside sick ones" if self._away else "rows"
        return Decision(paths, reason=reason, acquisition=acquisition)

    def _begin(self, observation: PolicyObservation) -> Decision:
        vehicles = observation.steerable
        if not vehicles:
            return NO_CHANGE
        parts = shared(vehicles, STRIPS)
        self._rows, self._away = {}, set()
        for vehicle in vehicles:
            self._terrains[vehicle.system_id] = Terrain(
                vehicle.request.area, vehicle.request.footprint_m, vehicle.request.passable
            )
            points = affordable(vehicle, self._plan(vehicle, parts[vehicle.system_id], observation))
            self._rows[vehicle.system_id] = _Rows(points, np.asarray(vehicle.position_m))
        return Decision({system_id: rows.rest for system_id, rows in self._rows.items()}, reason="rows")

    def _plan(self, vehicle: VehicleReport, part: Area, observation: PolicyObservation) -> Points:
        """Return the rows over the land of each crop in turn, as long as the budget for rows lasts."""
        request, cell_m = vehicle.request, observation.farm.cell_size_m
        points, here = _NOTHING, vehicle.position_m
        for number, land in enumerate(self._lands(vehicle, part, observation)):
            spent = vehicle.travel_cost.rest([points])[0] if len(points) else 0.0
            left = self._coarse * vehicle.left - spent
            if left <= 0.0:
                break
            gap_m = max(self._gaps[min(number, 1)] * cell_m, request.footprint_m)
            planner = make_planner("lawnmower")
            budget = _PartOf(request.budget, left)
            # A footprint as wide as the gap puts the first row half a gap from the border.
            task = replace(
                request, area=land, start_xy_m=here, budget=budget, crop_areas=(), footprint_m=gap_m
            )
            try:
                more = planner(task).points_m
            except PlanningError:
                continue
            more = self._terrains[vehicle.system_id].join([more], here)
            points = np.vstack((points, more))
            here = (float(points[-1, 0]), float(points[-1, 1]))
        if len(points):
            return points
        return make_planner("lawnmower")(replace(request, area=part)).points_m

    @staticmethod
    def _lands(vehicle: VehicleReport, part: Area, observation: PolicyObservation) -> list[Area]:
        """Return the land of each crop in a part of the area, largest weight of a disease first."""
        fields, weights = observation.fields, observation.weights.field
        weight_of = {
            crop: max(
                weights[k]
                for k, field in enumerate(fields)
                if field.kind == "disease" and crop in field.crops
            )
            for crop in {crop for disease in fields.diseases for crop in disease.crops}
        }
        grown = [land for land in vehicle.request.crop_areas if weight_of.get(land.crop, 0.0) > 0.0]
        grown.sort(key=lambda one: -weight_of[one.crop])
        lands = []
        for one in grown:
            polygons = polygons_of(shapely.intersection(one.area, part))
            if polygons:
                lands.append(area_of(polygons))
        return lands or [part]

    def _path(
        self,
        vehicle: VehicleReport,
        rows: _Rows,
        observation: PolicyObservation,
        new: dict[int, Points],
        windows: list[Window],
    ) -> Points | None:
        """Return a vehicle's new path and update its progress on the rows; None to keep the path.

        The window that was searched for a detour is appended to `windows`.
        """
        here = np.asarray(vehicle.position_m)
        if len(vehicle.rest_m) <= len(rows.rest):
            rows.rest, rows.begin = vehicle.rest_m, here
            self._away.discard(vehicle.system_id)
        promised = [
            np.vstack((np.asarray(other.position_m), new.get(other.system_id, other.rest_m)))
            for other in observation.vehicles
            if other.system_id != vehicle.system_id and other.system_id in self._away
        ]
        window = window_of(vehicle, observation, promised)
        windows.append(window)
        route = detour(vehicle, observation, window, self._least_rate)
        if len(route):
            self._away.add(vehicle.system_id)
            return self._joined(vehicle, [route, rows.resumed(route[-1])])
        if vehicle.system_id not in self._away:
            return None
        self._away.discard(vehicle.system_id)
        return self._joined(vehicle, [rows.resumed(here)])

    def _joined(self, vehicle: VehicleReport, pieces: list[Points]) -> Points:
        """Join the parts of `pieces` inside the area into one path, as long as the vehicle's budget lasts.

        Points outside the area are dropped: a detour may begin, or the budget end, between parts of the area.
        """
        area = shapely.buffer(vehicle.request.room, TOLERANCE_M)
        kept = [piece[shapely.covers(area, shapely.points(piece))] for piece in pieces if len(piece)]
        kept = [piece for piece in kept if len(piece)]
        if not kept:
            return _NOTHING
        path = affordable(vehicle, self._terrains[vehicle.system_id].join(kept, vehicle.position_m))
        return path[:-1] if len(path) and not shapely.covers(area, shapely.Point(path[-1])) else path


@dataclass(frozen=True, slots=True)
class _PartOf:
    """A budget with the path costs of the budget `whole`, but with a smaller limit."""

    whole: Budget
    limit: float

    @property
    def unit(self) -> str:
        return self.whole.unit

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        return self.whole.cost(path_xy_m)


def _nearly_flown(vehicle: VehicleReport, cell_m: float) -> bool:
    path = np.vstack((np.asarray(vehicle.position_m)[None], vehicle.rest_m))
    return path_length(path) <= _RENEW_CELLS * cell_m


_WINDOW = 24
_MAP_BLOCKS = 1024
"""Maximum number of blocks along the longer side of the reported map; displays show no more."""
_HORIZON = 20.0
_LONGEST_LEG = 10
_INTERVAL = 3.0
_BEAM = 4
_BESIDE, _NEAR = 1.5, 2.9
_NEAR_VALUE = 0.3
_OFFSETS = leg_offsets(_LONGEST_LEG)
_ALONE = neighbour_shares(0.0, 1.0, 1)


@dataclass(frozen=True, slots=True)
class Window:
    """Values of plants around a vehicle: float32[w, h], cells from `low` on; 0 outside the flyable area."""

    low: NDArray[np.int_]
    values: NDArray[np.float32]
    free: NDArray[np.bool_]


def window_of(vehicle: VehicleReport, observation: PolicyObservation, promised: Iterable[Points]) -> Window:
    """Return the values of the plants around a vehicle.

    An unobserved plant that can have the disease of a sick plant nearby has a value: 1 beside the sick plant,
    and 0.3 within three cells of it. Other plants, and plants on the paths of other vehicles, have value 0.
    """
    cell_m, shape = observation.farm.cell_size_m, np.array(observation.model.shape)
    here = np.asarray(vehicle.position_m) / cell_m
    low = np.clip(np.floor(here).astype(int) - _WINDOW, 0, shape - 1)
    high = np.clip(np.floor(here).astype(int) + _WINDOW + 1, low + 1, shape)
    values = _beside_sick(observation, low, high)
    for path in promised:
        _take(values, path / cell_m - low)
    if not values.any():
        return Window(low, values, np.zeros(values.shape, np.bool_))
    free = _free(vehicle.request.area, low, high, cell_m)
    return Window(low, np.where(free, values, np.float32(0.0)), free)


def detour(
    vehicle: VehicleReport, observation: PolicyObservation, window: Window, least_rate: float
) -> Points:
    """Return a route past plants beside sick plants; empty if it reaches fewer than `least_rate` per cell."""
    if not window.values.any():
        return _NOTHING
    cell_m = observation.farm.cell_size_m
    x, y = np.asarray(vehicle.position_m) / cell_m - window.low
    costs = LegCosts.of(vehicle, cell_m)
    per_cell = costs.per_cell
    horizon = min(_HORIZON * per_cell, vehicle.left)
    route = search_route(
        window.values, _ALONE, window.free, x, y, _OFFSETS,
        horizon, costs.turn, costs.slopes, _HORIZON * per_cell, max(1, int(_HORIZON / _INTERVAL)), _BEAM,
    )  # fmt: skip
    rates = per_cell * route[:, VALUE] / np.maximum(route[:, COST], per_cell)
    good = np.flatnonzero(rates >= least_rate)
    if not len(good):
        return _NOTHING
    return (route[: good[-1] + 1, :2] + window.low) * cell_m


def _joined(windows: Sequence[Window], observation: PolicyObservation) -> AcquisitionMap | None:
    """Return the values of plants in all windows as a map of the whole farm; None if all are 0."""
    worth = [window for window in windows if window.values.any()]
    if not worth:
        return None
    shape = observation.model.shape
    cells = -(-max(shape) // _MAP_BLOCKS)
    values = np.zeros([-(-side // cells) for side in shape], np.float32)
    for one in worth:
        x, y = np.nonzero(one.values)
        # Overlapping windows of two vehicles contain the same plants: count each plant once.
        blocks = np.zeros_like(values)
        np.add.at(blocks, ((x + one.low[0]) // cells, (y + one.low[1]) // cells), one.values[x, y])
        np.maximum(values, blocks, out=values)
    return AcquisitionMap(values, cells * observation.farm.cell_size_m)


def _beside_sick(
    observation: PolicyObservation, low: NDArray[np.int_], high: NDArray[np.int_]
) -> NDArray[np.float32]:
    """Return the values of the plants of a window, float32[w, h]."""
    grid, seen = observation.farm.grid(), observation.observations
    reach = math.ceil(_NEAR)
    near = (seen.x >= low[0] - reach) & (seen.x < high[0] + reach)
    near &= (seen.y >= low[1] - reach) & (seen.y < high[1] + reach) & (seen.day == observation.day)
    rows = np.flatnonzero(near)
    x, y, values = seen.x[rows] - low[0], seen.y[rows] - low[1], seen.values[rows]
    width, height = high - low
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    columns, lines = np.arange(width)[:, None], np.arange(height)[None, :]
    wanted = np.zeros((width, height), np.float32)
    for k, field in enumerate(observation.fields):
        if field.kind != "disease" or observation.weights.field[k] <= 0.0:
            continue
        with np.errstate(invalid="ignore"):
            sick = np.flatnonzero(values[:, k] < SICK_BELOW)
        if not len(sick):
            continue
        unknown = scored_cells(field, grid)[low[0] : high[0], low[1] : high[1]].copy()
        read = inside & np.isfinite(values[:, k])
        unknown[x[read], y[read]] = False
        away = np.full((width, height), np.inf)
        for i, j in zip(x[sick].tolist(), y[sick].tolist(), strict=True):
            part = slice(max(i - reach, 0), i + reach + 1), slice(max(j - reach, 0), j + reach + 1)
            there = (columns[part[0]] - i) ** 2 + (lines[:, part[1]] - j) ** 2
            np.minimum(away[part], there, out=away[part])
        wanted += unknown * np.where(away <= _BESIDE**2, 1.0, np.where(away <= _NEAR**2, _NEAR_VALUE, 0.0))
    return wanted


def _take(values: NDArray[np.float32], path: NDArray[np.float64]) -> None:
    """Set the value of the cells under a path to 0; the path's coordinates are cells of the window."""
    for begin, end in itertools.pairwise(path):
        steps = max(1, math.ceil(float(np.hypot(*(end - begin)))))
        cells = np.floor(begin + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - begin)).astype(int)
        cells = cells[((cells >= 0) & (cells < values.shape)).all(axis=1)]
        values[cells[:, 0], cells[:, 1]] = 0.0


def _free(area: Area, low: NDArray[np.int_], high: NDArray[np.int_], cell_m: float) -> NDArray[np.bool_]:
    """Return which cells of a window lie entirely in the area, bool[w, h]."""
    x, y = np.meshgrid(*(np.arange(a, b) * cell_m for a, b in zip(low, high, strict=True)), indexing="ij")
    window = shapely.box(*(low * cell_m), *(high * cell_m))
    part = shapely.intersection(area, shapely.buffer(window, cell_m, join_style="mitre"))
    if is_rectangle(part):
        x_0, y_0, x_1, y_1 = part.bounds
        inside = (x >= x_0 - TOLERANCE_M) & (x + cell_m <= x_1 + TOLERANCE_M)
        return inside & (y >= y_0 - TOLERANCE_M) & (y + cell_m <= y_1 + TOLERANCE_M)
    wide = shapely.buffer(part, TOLERANCE_M, join_style="mitre", mitre_limit=2.0)
    shapely.prepare(wide)
    return shapely.covers(wide, shapely.box(x, y, x + cell_m, y + cell_m))
