"""Budgets of flights, and travel costs in the budget's unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mission.model import Mission
from mission.planners import Budget, PlannedPath, parse_budget
from mission.planners.budget import LengthBudget, StepBudget
from mission.planners.path import Points, drop_coincident
from mission.planners.request import PlanningRequest
from mission.policies.observation import GeometricTravelCost
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.energy.power import endurance_s
from sim_vehicle.prediction.flight import Prediction
from sim_vehicle.prediction.onward import InFlight, OnwardPredictor
from sim_vehicle.prediction.predict import BOUND_PROBABILITY
from wbf_mission.planning.builder import MissionBuilder, is_beyond_battery
from wbf_mission.planning.conditions import wind_of
from wbf_mission.scenario import ScenarioError
from wbf_mission.scenario.parts import UNLIMITED

PAPER_STEPS_PER_CELL = 0.4  # Timesteps per day and owner's cell (Matloob et al., experiments)

Paths = Sequence[NDArray[np.float64]]

_MOST_KNOWN = 2000
# Fraction of the usable battery that is kept back if a policy decides in flight. Telemetry is rounded and
# delayed, so the price of the last path is inexact.
_SPARED = 0.02
# A path sets the surcharge only if it costs at least this fraction of the limit; cheaper paths fit anyway.
_NEAR = 0.5


@dataclass(slots=True)
class ReserveCharge:
    """Surcharge for gusts and estimate errors, so that a flight lands with the battery's reserve.

    A path's price assumes an exact position estimate and few gusts. One flight is therefore predicted in
    full, with estimate errors and more gusts. All prices are multiplied by the ratio of this flight's bound
    (`Prediction.most_wh`) to its price. In flight, the margin grows with the square root of the energy.
    """

    builder: MissionBuilder
    factor: float | None = (
        None  # Ratio of a whole flight's energy bound to its price, or None before the first full prediction
    )
    _onward: float = 1.0
    _spread: float = 0.0

    def learn(self, mission: Mission, price_wh: float) -> None:
        """Predict a priced flight in full, and derive the surcharge from its energy bound."""
        full = self.builder.predict(mission)
        if not (full.energy_wh > 0.0 and 0.0 < price_wh < math.inf):
            return
        self.factor = full.most_wh / price_wh
        (calm,) = self.builder.price([mission], gusts=False)
        self._onward = full.energy_wh / calm.energy_wh
        self._spread = (full.most_wh - full.energy_wh) / math.sqrt(full.energy_wh)

    def rest(self, price_wh: float) -> float:
        """Return the energy (Wh) charged for the rest of a flight with a mean-wind price of `price_wh`."""
        mean_wh = self._onward * price_wh
        return mean_wh + self._spread * math.sqrt(mean_wh)


@dataclass(frozen=True, slots=True, eq=False)
class FlightBudget:
    """Budget in seconds or watt hours; a path costs the predicted time or energy of its mission.

    A path that needs several batteries costs infinity, unless its mission may be cut into sorties.
    """

    limit: float  # Largest allowed cost of the whole flight, from take-off to touch-down.
    unit: str  # "s" or "Wh".
    builder: MissionBuilder
    reserve: ReserveCharge | None = None  # Surcharge for gusts and estimate errors.
    in_sorties: bool = False  # Whether a mission beyond one battery may be cut into sorties.
    endless: bool = False  # Whether every path is priced with an endless battery.
    # Prices are kept, since planners mostly try the same candidate paths for successive flights.
    _known: dict[bytes, float] = field(default_factory=dict, init=False, repr=False)

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        """Return the predicted cost of a path; infinite if the vehicle cannot fly the path."""
        return self.costs([path_xy_m])[0]

    def costs(self, paths_xy_m: Paths) -> list[float]:
        """Return the `cost` of each path; one call predicts all paths in parallel."""
        known = self._known
        keys = [np.asarray(path, dtype=np.float64).tobytes() for path in paths_xy_m]
        new = {key: path for key, path in zip(keys, paths_xy_m, strict=True) if key not in known}
        costs = {key: known[key] for key in keys if key in known}
        if new:
            costs |= zip(new, self._prices([self._mission(path) for path in new.values()]), strict=True)
        if len(known) + len(new) > _MOST_KNOWN:
            known.clear()
        known.update(costs)
        return [costs[key] for key in keys]

    def reason(self, path_xy_m: NDArray[np.float64]) -> str:
        """Return the reason why the vehicle cannot fly the path, or an empty text if it can."""
        endless = self.in_sorties or self.endless
        (prediction,) = self.builder.price([self._mission(path_xy_m)], endless=endless)
        return "" if prediction.feasible else str(prediction.reason)

    def onward(self, path_xy_m: NDArray[np.float64]) -> Callable[[float], float]:
        """Return a function that maps the mean-wind cost of a remaining path to the cost charged for it."""
        if self.reserve is None:
            return lambda rest: rest
        if self.reserve.factor is None:
            mission = self._mission(path_xy_m)
            (prediction,) = self.builder.price([mission])
            self.reserve.learn(mission, self._price(prediction))
        return self.reserve.rest

    def _mission(self, path_xy_m: NDArray[np.float64]) -> Mission:
        points = np.asarray(path_xy_m, dtype=np.float64).reshape(-1, 2)
        return self.builder.mission(PlannedPath(points[1:] if len(points) > 1 else points, None, "candidate"))

    def _prices(self, missions: list[Mission]) -> list[float]:
        """Return the missions' prices with surcharge; the first flight near the limit sets the surcharge."""
        flown = self.builder.price(missions, endless=self.endless)
        if self.in_sorties:
            short = [k for k, one in enumerate(flown) if is_beyond_battery(self.builder.vehicle, one)]
            again = self.builder.price([missions[k] for k in short], endless=True)
            for k, one in zip(short, again, strict=True):
                flown[k] = one
        prices, reserve = [self._price(prediction) for prediction in flown], self.reserve
        if reserve is None:
            return prices
        near = [k for k, one in enumerate(prices) if _NEAR * self.limit <= one <= self.limit]
        if near and reserve.factor is None:
            best = max(near, key=lambda k: prices[k])
            reserve.learn(missions[best], prices[best])
        return [price * (reserve.factor or 1.0) for price in prices]

    def _price(self, prediction: Prediction) -> float:
        spent = prediction.duration_s if self.unit == "s" else prediction.energy_wh
        # If a flight exceeds the limit before it fails, its price is the cost up to the failure.
        return spent if prediction.feasible or spent > self.limit else math.inf


def make_budget(text: str | None, builder: MissionBuilder, *, steered: bool = False) -> tuple[Budget, str]:
    """Return a budget, and the budget in words.

    Without `text` the budget is the battery less its reserve; for the ideal vehicle, it is 0.4 timesteps per
    owner's cell. The battery budget of a `steered` path is slightly smaller, since telemetry is rounded and
    delayed. Raises PlanningError or ScenarioError if the budget does not suit the vehicle.
    """
    farm, vehicle = builder.farm, builder.vehicle
    home = None if vehicle.is_ideal else builder.home_m
    if text is None:
        if vehicle.is_ideal:
            steps = float(round(PAPER_STEPS_PER_CELL * farm.owner_cells))
            return StepBudget(steps, farm.cell_size_m), f"{steps:.0f} steps (0.4 x the owner's cells)"
        if vehicle.battery is None:
            msg = f"vehicle {vehicle.name} has no battery: give --budget, such as 8000m or 25min"
            raise ScenarioError(msg)
        usable = vehicle.battery.capacity_wh * (1.0 - vehicle.battery.reserve_fraction)
        less = f"{vehicle.battery.reserve_fraction:.0%} reserve"
        if steered:
            usable *= 1.0 - _SPARED
            less += f" and {_SPARED:.0%} of the rest"
        disturbed = builder.estimate_errors or wind_of(builder.weather, builder.level).is_gusty
        often = f"; enough for {BOUND_PROBABILITY:.1%} of such flights" if disturbed else ""
        words = f"{usable:.1f} Wh (the battery less {less}{often})"
        return FlightBudget(usable, "Wh", builder, ReserveCharge(builder) if disturbed else None), words
    if text.strip().lower() == UNLIMITED:
        return FlightBudget(1e9, "s", builder, endless=True), "unlimited"  # 32 years
    value, unit = parse_budget(text)
    if unit == "m":
        return LengthBudget(value, home, builder.flown_way), f"{value:g} m"
    if unit == "steps":
        return StepBudget(value, farm.cell_size_m, home, builder.flown_way), f"{value:g} steps"
    if unit == "Wh" and vehicle.power is None:
        msg = f"budget {text}: vehicle {vehicle.name} uses no energy; give metres, minutes or steps"
        raise ScenarioError(msg)
    # A policy plans for one battery, because its flight is not cut for a battery change.
    words = f"{value:g} {unit}"
    if steered and (lasts := _battery_in(unit, builder)) < value:
        words += f" (a battery less its reserve lasts for about {lasts:.3g} {unit})"
    return FlightBudget(value, unit, builder, in_sorties=not steered), words


def _battery_in(unit: str, builder: MissionBuilder) -> float:
    """Return the time ("s") or energy ("Wh") of steady flight on a battery less its reserve."""
    battery = builder.vehicle.battery
    if battery is None or builder.vehicle.power is None:
        return math.inf
    usable_wh = battery.capacity_wh * (1.0 - battery.reserve_fraction)
    if unit == "Wh":
        return usable_wh
    return usable_wh / _watt_hours_a_second(builder.vehicle, builder.level.speed_m_s)


# Time lost in an average turn, in multiples of the braking time from cruise speed.
_TURN_SHARE = 1.0
_SLOWEST_M_S = 0.5
# Mission items round degrees to 1e-7, so a point read back from its mission is off by up to this.
_SAME_M = 0.05


@dataclass(frozen=True, slots=True)
class LegCosts:
    """Approximate cost of straight legs, from the ground speed in the mean wind and one turn per leg."""

    speed_m_s: float  # Airspeed.
    acceleration_m_s2: float  # Horizontal acceleration.
    wind_m_s: tuple[float, float]  # Velocity of the mean wind along x and y of the farm frame.
    a_second: float  # Cost of a second of flight, in the unit of the budget.

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return the costs of the legs from each of n points to each of m points, float64[n, m]."""
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
    """Travel cost of a vehicle before take-off: the budget's price for whole flights."""

    request: PlanningRequest
    builder: MissionBuilder
    # Whether the path is changed in flight; if so, a repeated point is not a loiter
    # (`VehicleAssignment.plan_of`)
    steered: bool = False

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return the costs of whole flights; 0 for a path without points."""
        flown = [drop_coincident(path) if self.steered else path for path in paths_m if len(path)]
        costs = iter(self.request.costs(flown) if flown else ())
        return [next(costs) if len(path) else 0.0 for path in paths_m]

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return the approximate costs of straight legs, float64[n, m]."""
        return leg_travel_cost(self.request, self.builder).legs(from_m, to_m)

    def change(self, points_m: Points) -> float:  # noqa: ARG002 (the same for every path)
        """Return 0: the vehicle has no path yet."""
        return 0.0


@dataclass(frozen=True, slots=True)
class FlightTravelCost:
    """Travel cost of a vehicle in flight, with a budget in seconds or watt hours."""

    state: InFlight  # State of the vehicle from its telemetry
    predictor: OnwardPredictor
    rough: LegCosts | GeometricTravelCost
    unit: str  # "s" or "Wh".
    # Maps the mean-wind cost of the remaining path to its charge (`FlightBudget.onward`)
    charged: Callable[[float], float]
    # Present path, float64[n, 2]
    present_m: Points = field(default_factory=lambda: np.empty((0, 2)))
    # Whether the autopilot leaves its mission for a change of path, so that the vehicle has to brake
    loses_speed: bool = False
    # Prices are kept, since the check of an answer prices the policy's paths again.
    _known: dict[bytes, float] = field(default_factory=dict, init=False, repr=False, compare=False)

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return the cost of each remaining path, with the flight home and the landing."""
        keys = [np.asarray(path, np.float64).tobytes() for path in paths_m]
        new = {key: path for key, path in zip(keys, paths_m, strict=True) if key not in self._known}
        if new:
            anew = [self.loses_speed and not is_same_path(path, self.present_m) for path in new.values()]
            seconds, watt_hours = self.predictor.rest(self.state, list(new.values()), anew=anew)
            priced = (seconds if self.unit == "s" else watt_hours).tolist()
            self._known.update(zip(new, map(self.charged, priced), strict=True))
        return [self._known[key] for key in keys]

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return the approximate costs of straight legs, float64[n, m]."""
        return self.rough.legs(from_m, to_m)

    def change(self, points_m: Points) -> float:
        """Return the cost of changing to another path, in addition to the difference in length.

        The first legs of both paths are predicted from the present velocity. The first leg of the new path
        begins at the point at which ArduPilot stops the vehicle for a change.
        """
        if not self.loses_speed or not len(points_m) or not len(self.present_m):
            return 0.0
        if is_same_path(points_m, self.present_m):
            return 0.0
        ends = [np.asarray(path, np.float64)[:1] for path in (points_m, self.present_m)]
        seconds, watt_hours = self.predictor.rest(self.state, ends, anew=[True, False])
        flown = seconds if self.unit == "s" else watt_hours
        here, home = np.array([self.state.position_m]), np.array([self.predictor.home_m])
        way = [float(self.legs(here, end)[0, 0] + self.legs(end, home)[0, 0]) for end in ends]
        return max(0.0, float(flown[0] - flown[1]) - (way[0] - way[1]))


def is_same_path(one_m: Points, other_m: Points) -> bool:
    """Return whether two paths have the same points, up to the rounding of mission items."""
    one, other = np.asarray(one_m, np.float64), np.asarray(other_m, np.float64)
    return one.shape == other.shape and bool(np.allclose(one, other, rtol=0.0, atol=_SAME_M))


def onward_predictor(builder: MissionBuilder) -> OnwardPredictor:
    """Return the predictor of the cost of a vehicle's remaining path."""
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


def leg_travel_cost(request: PlanningRequest, builder: MissionBuilder) -> LegCosts | GeometricTravelCost:
    """Return the approximate costs of legs, in the unit of the request's budget."""
    budget, vehicle = request.budget, builder.vehicle
    if isinstance(budget, LengthBudget | StepBudget):
        return GeometricTravelCost(budget, request.start_xy_m)
    a_second = 1.0 if budget.unit == "s" else _watt_hours_a_second(vehicle, builder.level.speed_m_s)
    return leg_costs(builder, a_second)


def leg_costs(builder: MissionBuilder, a_second: float = 1.0) -> LegCosts:
    """Return the approximate leg costs of a vehicle; each second of flight costs `a_second`."""
    wind = wind_of(builder.weather, builder.level, gusts=False).mean_at(builder.level.altitude_m)
    return LegCosts(
        min(builder.level.speed_m_s, builder.vehicle.top_speed_m_s),
        builder.vehicle.acceleration_m_s2,
        builder.farm.frame.from_east_north(wind[0], wind[1]),
        a_second,
    )


def _watt_hours_a_second(vehicle: VehicleSpec, speed_m_s: float) -> float:
    """Return the power of steady flight, in Wh/s."""
    if vehicle.battery is None or vehicle.power is None:
        return 0.0
    return vehicle.battery.capacity_wh / endurance_s(vehicle, speed_m_s)
