"""Motion model of a fixed wing: the compiled kernel with its state, route, wind and energy."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.airframe.power_spec import DRAG, GRAVITY_M_S2, OWN_DRAG
from sim_vehicle.energy.power import power_coefficients
from sim_vehicle.errors import VehicleError
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import State, record_of, row_of
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics
from sim_vehicle.motion.legs import KEEP, Heading, LegKind, Position, Route
from sim_vehicle.weather.wind import Wind
from wbf_mission.addons.wings.kind import FixedWingAirframe, FixedWingPowerSpec
from wbf_mission.addons.wings.motion import layout as wing
from wbf_mission.addons.wings.motion.air import drag
from wbf_mission.addons.wings.motion.kernel import advance
from wbf_mission.addons.wings.motion.layout import NPFG, FixedWingLimits, Leg, Wing

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

# Default minimum pitch of a climb-out.
_TAKEOFF_PITCH = math.radians(4.0)
# Vehicles without a power model get the drag of this foam aircraft of 1.8 m span.
_TYPICAL = FixedWingPowerSpec(mass_kg=1.9, wing_area_m2=0.42, wing_span_m=1.8, parasitic_drag=0.035)
# Deceleration on grass.
_BRAKE_M_S2 = 3.0
# ArduPlane's full throw of a control surface is 45 degrees.
_ELEVATOR_RAD = 0.25 * math.pi


class FixedWing(CompiledMotion):
    """A fixed wing that flies routes and holds by circling.

    `limits_of` returns the limits that the parameters of a vehicle's autopilot set.
    """

    dynamics = Dynamics(advance, wing.STATE, wing.LIMITS)

    def __init__(
        self,
        spec: VehicleSpec,
        limits_of: Callable[[VehicleSpec], FixedWingLimits],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        self._limits_of = limits_of
        super().__init__(spec, wind, yaw_rad)
        self.state[Wing.BEARING] = math.nan

    def attitude(self) -> tuple[float, float, float, float]:
        """Return roll (right), pitch (up), true airspeed and throttle."""
        columns = [Wing.BANK, Wing.PITCH, Wing.AIRSPEED, Wing.THROTTLE]
        bank, pitch, airspeed, throttle = self.state[columns].tolist()
        return bank, pitch, airspeed, throttle

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Start the vehicle in steady flight at a place, at time 0 and with no energy used."""
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        state = self.state
        east, north, up = velocity_m_s
        wind_east, wind_north = state[col.LEVEL_WIND].tolist()
        state[Wing.BANK : Wing.WIND_UP] = 0.0
        state[Wing.AIRSPEED] = math.hypot(east - wind_east, north - wind_north, up)
        state[Wing.CLIMB] = up
        state[Wing.COURSE] = math.atan2(east, north)
        state[Wing.BEGIN_X] = state[Wing.BEARING] = math.nan
        state[Wing.DOING] = wing.FLYING
        speed = max(float(state[Wing.AIRSPEED]), 3.0)
        level = self._limit.lift_level * speed * speed
        attack = (GRAVITY_M_S2 - level) / (self._limit.lift_slope * speed * speed)
        state[Wing.PITCH] = math.asin(min(max(up / speed, -0.5), 0.5)) + min(attack, 0.3)

    def fly(self, route: Route) -> None:
        """Start a route from the vehicle's current position and speed."""
        before, first, arrived = self._route, self.leg, self.counters[col.ARRIVED] != 0
        legs = self._legs(route).view(wing.LEG)[:, 0]
        # If the first leg leads to the same waypoint as the present leg, keep the present line.
        if (
            before is None
            or arrived
            or legs[0].kind != wing.LINE
            or not math.hypot(legs[0].x - before[first].x, legs[0].y - before[first].y) < 1.0
        ):
            # The first leg starts at the last waypoint if that was reached, else at the vehicle's position.
            self.state[Wing.BEGIN_X] = math.nan
            if before is not None and arrived and before[-1].kind == wing.LINE:
                self.state[Wing.BEGIN_X : Wing.BEGIN_X + 3] = before[-1].x, before[-1].y, before[-1].z
        self._begin(legs)

    def _legs(self, route: Route) -> NDArray[np.float64]:
        law = self.law
        legs, n = route.legs, len(route.legs)
        rows = np.zeros((n, len(Leg)))
        rows[:, : Leg.KIND] = route.points_m
        # 0 means the autopilot's default radius; ArduPlane stores other radii in one byte.
        radius = np.where(legs["radius"] == self.spec.acceptance_radius_m, 0.0, legs["radius"])
        rows[:, Leg.RADIUS] = np.floor(np.minimum(radius, 255.0))
        speed = np.where(np.isnan(legs["speed"]), law.airspeed_trim, legs["speed"])
        rows[:, Leg.AIRSPEED] = np.clip(speed, law.airspeed_min, law.airspeed_max)
        rows[:, Leg.NEAR] = legs["near"]
        rows[:, Leg.TURNS] = legs["turns"]
        rows[:, Leg.EXIT_X], rows[:, Leg.EXIT_Y] = legs["exit_x"], legs["exit_y"]
        rows[:, Leg.PAUSE] = legs["pause"]
        rows[:, Leg.HEIGHT_TOLERANCE] = law.height_acceptance
        rows[:, Leg.TURN_ANGLE] = 0.5 * math.pi
        rows[:, Leg.PITCH] = np.where(legs["pitch"] > 0.0, legs["pitch"], _TAKEOFF_PITCH)
        for i in range(n):
            stops = not legs["radius"][i] > 0.0
            wanted = float(legs["circle"][i])
            rows[i, Leg.KIND] = kind = self._kind(int(legs["kind"][i]), stops, wanted)
            if not abs(wanted) > 0.0:
                wanted = law.loiter_radius
            least = 1.05 * law.tightest_m(float(rows[i, Leg.AIRSPEED]))
            rows[i, Leg.CIRCLE_RADIUS] = math.copysign(max(abs(wanted), least), wanted)
            if kind == wing.CIRCLE:
                rows[i, Leg.HEIGHT_TOLERANCE] = min(law.height_acceptance, 10.0)
            elif kind == wing.CIRCULAR_LANDING:
                rows[i, Leg.SLOPE] = law.landing_slope
            rows[i, Leg.AT_ONCE] = legs["kind"][i] == LegKind.HOME
            rows[i, Leg.ON_CIRCLE] = law.law == NPFG and legs["kind"][i] == LegKind.LOITER_TO_HEIGHT
            if i + 1 < n and legs["kind"][i + 1] == LegKind.LAND:
                tolerance = min(float(rows[i, Leg.HEIGHT_TOLERANCE]), law.landing_height_acceptance)
                rows[i, Leg.HEIGHT_TOLERANCE] = tolerance
        self._corners(rows)
        return rows

    def _kind(self, kind: int, stops: bool, radius: float) -> float:
        if kind == LegKind.TAKEOFF:
            return wing.TAKEOFF
        if kind == LegKind.LAND:
            return wing.LANDING if math.isnan(radius) else wing.CIRCULAR_LANDING
        if kind in (LegKind.LOITER, LegKind.STAY, LegKind.LOITER_TO_HEIGHT) or stops:
            return wing.CIRCLE
        return wing.LINE

    def _corners(self, rows: NDArray[np.float64]) -> None:
        """Set the angle between each leg and the next one, or the exit direction of a circle."""
        ends = np.vstack([self.state[None, State.POSITION_X : State.POSITION_Z], rows[:, : Leg.Z]])
        ways = np.diff(ends, axis=0)
        leads = rows[:, Leg.EXIT_X : Leg.PAUSE] - rows[:, : Leg.Z]
        for i in range(len(rows)):
            if not np.isnan(leads[i, 0]):
                ahead = leads[i]
            elif i + 1 < len(rows):
                ahead = ways[i + 1]
            else:
                continue
            (ax, ay), (bx, by) = ways[i].tolist(), ahead.tolist()
            if math.hypot(ax, ay) > 0.1 and math.hypot(bx, by) > 0.1:
                rows[i, Leg.TURN_ANGLE] = abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Fall, if the velocity points straight down; VehicleError for any other velocity."""
        east, north, up = velocity_m_s
        if east != 0.0 or north != 0.0 or not up < 0.0 or not math.isnan(height_m):
            msg = f"vehicle {self.spec.name}: a fixed wing cannot hold a ground velocity; give positions"
            raise VehicleError(msg)
        row = np.zeros((1, len(Leg)))
        row[0, : Leg.KIND] = self.state[col.POSITION]
        row[0, Leg.KIND] = wing.FALL
        row[0, Leg.CIRCLE_RADIUS] = self.law.loiter_radius
        self._begin(row.view(wing.LEG)[:, 0])

    def stopping_point(self) -> Position:
        """Return the centre of a hold: the centre of the current circle, or else the vehicle's position."""
        route = self._route
        if route is not None and self.state[Wing.DOING] == wing.FLYING:
            centred = route["kind"][-1] in (wing.CIRCLE, wing.LINE, wing.TAKEOFF)
            if self.counters[col.ARRIVED] and centred:
                x, y, z = self.state[Wing.CENTRE_X : Wing.CENTRE_RADIUS].tolist()
                return x, y, z
            row = route[self.leg]
            if row["kind"] == wing.CIRCLE and not math.isnan(self.state[Wing.BEARING]):
                return float(row["x"]), float(row["y"]), float(row["z"])
        return self.position_m

    def lose_power(self) -> None:
        """Stop the motor, so that the vehicle glides."""
        self._limit.throttle_limit = 0.0

    def update_spec(self, spec: VehicleSpec) -> None:
        """Change defaults and limits at once; values that legs contain change with the next route."""
        throttle = self._limit.throttle_limit
        super().update_spec(spec)
        self._limit.throttle_limit = throttle

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Set the maximum climb and descent rates; None restores the autopilot's default."""
        law, limit = self.law, self._limit
        limit.climb_rate = min(climb_m_s or law.climb_rate, law.climb_max)
        limit.sink_rate = min(descent_m_s or law.sink_rate, law.sink_max)

    def touch_down(self) -> None:
        """Set the vehicle to rest on the ground."""
        super().touch_down()
        self.state[Wing.BANK : Wing.COMMAND + 1] = 0.0
        self.state[Wing.RUNNING] = 0.0
        self.state[Wing.DOING] = wing.ON_GROUND
        self.state[Wing.BEGIN_X] = math.nan

    def _numbers(self, spec: VehicleSpec) -> Mapping[str, float]:
        """Set `law` for a vehicle; return the kernel's limits except time step and energy."""
        law = self.law = self._limits_of(spec)
        power = spec.power if isinstance(spec.power, FixedWingPowerSpec) else _TYPICAL
        frame = FixedWingAirframe() if spec.airframe is None else spec.airframe
        coefficients = power_coefficients(power)
        mass = power.mass_kg
        # rho S / (2 m): multiplied by a coefficient and V^2 it is an acceleration.
        per_coefficient = coefficients[DRAG] / (mass * power.parasitic_drag)
        values = {
            **{name: getattr(law, name) for name in wing.OF_WING},
            "wing_span": power.wing_span_m,
            "ground_drag": frame.ground_drag_1_s or 0.0,
            "braking": 0.0 if frame.ground_drag_1_s else _BRAKE_M_S2,
            "parasitic": coefficients[DRAG] / mass,
            "induced": coefficients[OWN_DRAG] / mass,
            "lift_level": per_coefficient * frame.lift_level,
            "lift_slope": per_coefficient * frame.lift_slope,
            "turn_share": frame.turn_share,
            "trim_change": _ELEVATOR_RAD * frame.elevator_per_lift / per_coefficient,
            "throttle_limit": 1.0,
            **law.control,
        }
        trim, limits = law.airspeed_trim, record_of(row_of(wing.LIMITS, values), wing.LIMITS)
        climbing = drag(limits, trim, 1.0) + GRAVITY_M_S2 * law.climb_max / trim
        return {**values, "thrust": climbing if frame.thrust_n is None else frame.thrust_n / mass}
