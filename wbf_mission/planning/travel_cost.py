"""What flying costs a vehicle, in the unit of its budget."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mission.planners.budget import LengthBudget, StepBudget
from mission.planners.path import Points, drop_coincident
from mission.planners.request import PlanningRequest
from mission.policies.travel_cost import GeometricTravelCost
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.energy.endurance import endurance_s
from sim_vehicle.prediction.onward import InFlight, OnwardPredictor
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.planning.weather import wind_of

# Of the time to brake from cruise speed to rest: what a turn costs on average, braking and speeding up again.
_TURN_SHARE = 1.0
_SLOWEST_M_S = 0.5
# Items count degrees in 1e-7: a point comes back from its mission that much off.
_SAME_M = 0.05


@dataclass(frozen=True, slots=True)
class LegFares:
    """Roughly what straight legs cost: their length by the speed over ground in the mean wind, and a turn.

    Parameters
    ----------
    speed_m_s : float
        Through the air.
    acceleration_m_s2 : float
        With which the vehicle brakes and speeds up.
    wind_m_s : tuple of float
        Mean wind, the velocity of the air along x and y of the farm frame.
    a_second : float
        What a second of flight costs, in the unit of the budget.
    """

    speed_m_s: float
    acceleration_m_s2: float
    wind_m_s: tuple[float, float]
    a_second: float

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return what the legs cost, float64[n, m], from n points to m others."""
        steps = np.asarray(to_m, np.float64)[None, :, :] - np.asarray(from_m, np.float64)[:, None, :]
        length_m = np.hypot(steps[..., 0], steps[..., 1])
        along = steps / np.maximum(length_m, 1e-9)[..., None]
        wind_along = along[..., 0] * self.wind_m_s[0] + along[..., 1] * self.wind_m_s[1]
        wind_across = along[..., 1] * self.wind_m_s[0] - along[..., 0] * self.wind_m_s[1]
        through_air = np.sqrt(np.maximum(self.speed_m_s**2 - wind_across**2, 0.0))
        ground_m_s = np.maximum(np.minimum(through_air + wind_along, self.speed_m_s), _SLOWEST_M_S)
        turn_s = _TURN_SHARE * self.speed_m_s / self.acceleration_m_s2
        seconds: NDArray[np.float64] = length_m / ground_m_s + turn_s
        return seconds * self.a_second


@dataclass(frozen=True, slots=True)
class StartTravelCost:
    """The travel cost of a vehicle that stands at its start: whole flights, as its budget prices them.

    Parameters
    ----------
    steered : bool
        Whether the paths are changed in flight: then a point that is named again is no stay
        (`VehicleAssignment.plan_of`).
    """

    request: PlanningRequest
    builder: MissionBuilder
    steered: bool = False

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return what whole flights cost; one without points costs nothing."""
        flown = [drop_coincident(path) if self.steered else path for path in paths_m if len(path)]
        costs = iter(self.request.costs(flown) if flown else ())
        return [next(costs) if len(path) else 0.0 for path in paths_m]

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return roughly what straight legs cost, float64[n, m]."""
        return leg_travel_cost(self.request, self.builder).legs(from_m, to_m)

    def change(self, points_m: Points) -> float:  # noqa: ARG002 (the same for every path)
        """Return 0: no path is flown yet."""
        return 0.0


@dataclass(frozen=True, slots=True)
class FlightTravelCost:
    """The travel cost of a vehicle in flight, where the budget counts seconds or watt hours.

    Parameters
    ----------
    state : InFlight
        The vehicle, as its telemetry tells it.
    unit : {"s", "Wh"}
    charged : callable
        From what a rest takes in the mean wind to what is charged for it (`FlightBudget.onward`).
    present_m : float64[n, 2]
        The path that is flown.
    loses_speed : bool
        Whether the autopilot leaves its mission for a change, and begins anew where it could stop.
    """

    state: InFlight
    predictor: OnwardPredictor
    rough: LegFares | GeometricTravelCost
    unit: str
    charged: Callable[[float], float]
    present_m: Points = field(default_factory=lambda: np.empty((0, 2)))
    loses_speed: bool = False
    # A policy asks for what it chose, and who checks its answer asks again.
    _known: dict[bytes, float] = field(default_factory=dict, init=False, repr=False, compare=False)

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return what rests of the path take, the way home and the landing included."""
        keys = [np.asarray(path, np.float64).tobytes() for path in paths_m]
        new = {key: path for key, path in zip(keys, paths_m, strict=True) if key not in self._known}
        if new:
            anew = [self.loses_speed and not is_same_path(path, self.present_m) for path in new.values()]
            seconds, watt_hours = self.predictor.rest(self.state, list(new.values()), anew=anew)
            priced = (seconds if self.unit == "s" else watt_hours).tolist()
            self._known.update(zip(new, map(self.charged, priced), strict=True))
        return [self._known[key] for key in keys]

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return roughly what straight legs cost, float64[n, m]."""
        return self.rough.legs(from_m, to_m)

    def change(self, points_m: Points) -> float:
        """Return what leaving the present path costs: how much more than their lengths take both first legs.

        Both are flown by the vehicle's own motion from its present speed, the new one as the autopilot begins
        it after a change.
        """
        if not self.loses_speed or not len(points_m) or not len(self.present_m):
            return 0.0
        if is_same_path(points_m, self.present_m):
            return 0.0
        ends = [np.asarray(path, np.float64)[:1] for path in (points_m, self.present_m)]
        anew = [True, False]
        seconds, watt_hours = self.predictor.rest(self.state, ends, anew=anew)
        flown = seconds if self.unit == "s" else watt_hours
        here, home = np.array([self.state.position_m]), np.array([self.predictor.home_m])
        way = [float(self.legs(here, end)[0, 0] + self.legs(end, home)[0, 0]) for end in ends]
        return max(0.0, float(flown[0] - flown[1]) - (way[0] - way[1]))


def is_same_path(one_m: Points, other_m: Points) -> bool:
    """Return whether two paths have the same points, to the digits of a mission item."""
    one, other = np.asarray(one_m, np.float64), np.asarray(other_m, np.float64)
    return one.shape == other.shape and bool(np.allclose(one, other, rtol=0.0, atol=_SAME_M))


def onward_predictor(builder: MissionBuilder) -> OnwardPredictor:
    """Return what prices rests of a vehicle's paths."""
    vehicle = builder.priced_vehicle
    return OnwardPredictor(
        vehicle,
        builder.farm.frame,
        builder.home_m,
        altitude_m=builder.level.altitude_m,
        speed_m_s=min(builder.level.speed_m_s, vehicle.top_speed_m_s),
        waypoints=builder.waypoints,
        wind=wind_of(builder.weather, builder.level, gusts=False),
    )


def leg_travel_cost(request: PlanningRequest, builder: MissionBuilder) -> LegFares | GeometricTravelCost:
    """Return what tells roughly what legs cost, in the unit of the request's budget."""
    budget, vehicle = request.budget, builder.vehicle
    if isinstance(budget, LengthBudget | StepBudget):
        return GeometricTravelCost(budget, request.start_xy_m)
    wind = wind_of(builder.weather, builder.level, gusts=False).mean_at(builder.level.altitude_m)
    return LegFares(
        min(builder.level.speed_m_s, vehicle.top_speed_m_s),
        vehicle.acceleration_m_s2,
        builder.farm.frame.from_east_north(wind[0], wind[1]),
        1.0 if budget.unit == "s" else _watt_hours_a_second(vehicle, builder.level.speed_m_s),
    )


def _watt_hours_a_second(vehicle: VehicleSpec, speed_m_s: float) -> float:
    """Return what steady flight takes."""
    if vehicle.battery is None or vehicle.power is None:
        return 0.0
    return vehicle.battery.capacity_wh / endurance_s(vehicle, speed_m_s)
