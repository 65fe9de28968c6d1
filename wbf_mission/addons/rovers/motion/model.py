"""Motion models of ground vehicles: the compiled kernels with state, route and energy."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.motion.arducopter.control import Guide
from sim_vehicle.motion.arducopter.model import AlongCurves
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics
from sim_vehicle.motion.legs import KEEP, Heading, LegKind, Position, Route
from wbf_mission.addons.rovers.motion import ardurover, kernel
from wbf_mission.addons.rovers.motion import layout as wheels
from wbf_mission.addons.rovers.motion.ardurover import Drive, DriveLaw
from wbf_mission.addons.rovers.motion.layout import Leg, RoverLimits, Wheels

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.weather.wind import Wind

NOT_DRIVEN = (LegKind.TAKEOFF, LegKind.CLIMB, LegKind.DESCEND)
"""Kinds of legs without effect on the ground."""


class Rover(CompiledMotion):
    """A wheeled vehicle that drives routes and ignores heights; the wind affects only its power.

    `limits_of` returns the limits that the parameters of a vehicle's autopilot set.
    """

    dynamics = Dynamics(kernel.advance, wheels.STATE, wheels.LIMITS)

    def __init__(
        self,
        spec: VehicleSpec,
        limits_of: Callable[[VehicleSpec], RoverLimits],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        self._limits_of = limits_of
        super().__init__(spec, wind, yaw_rad)
        self.state[Wheels.PAUSE_END] = math.inf

    def attitude(self) -> tuple[float, float, float, float]:
        """Return roll and pitch (both 0), ground speed in place of airspeed, and throttle."""
        return 0.0, 0.0, float(self.state[Wheels.SPEED]), float(self.state[Wheels.THROTTLE])

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Start the vehicle at a place and velocity, at time 0 and with no energy used."""
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        self.state[Wheels.SPEED : Wheels.PIVOTING + 1] = 0.0
        self.state[Wheels.YAW_ASKED :] = 0.0
        self.state[Wheels.SPEED] = self.state[Wheels.SPEED_ASKED] = math.hypot(*velocity_m_s[:2])
        self.state[Wheels.YAW_ASKED] = self.state[State.HEADING]
        self.state[Wheels.PAUSE_END] = math.inf

    def fly(self, route: Route) -> None:
        """Start a route from the vehicle's current position and speed."""
        law = self.law
        legs, n = route.legs, len(route.legs)
        rows = np.zeros((n, len(Leg)))
        rows[:, : Leg.KIND] = route.points_m[:, :2]
        speed = np.where(np.isnan(legs["speed"]), self.spec.cruise_speed_m_s, legs["speed"])
        rows[:, Leg.SPEED] = np.clip(speed, 0.1, law.speed_max)
        rows[:, Leg.NEAR] = legs["near"]
        rows[:, Leg.PAUSE] = legs["pause"]
        x, y = self.state[State.POSITION_X : State.POSITION_Z].tolist()
        for i in range(n):
            radius = float(legs["radius"][i])
            stops = i == n - 1 or radius <= 0.0 or legs["pause"][i] > 0.0
            rows[i, Leg.KIND] = wheels.STOP if stops else wheels.THROUGH
            # For rovers, neither autopilot uses the acceptance radius of an item.
            rows[i, Leg.RADIUS] = law.acceptance
            if int(legs["kind"][i]) in NOT_DRIVEN:
                rows[i, Leg.KIND] = wheels.AT_ONCE
                rows[i, : Leg.KIND] = x, y
            x, y = rows[i, : Leg.KIND].tolist()
        self._corners(rows)
        self._begin(rows.view(wheels.LEG)[:, 0])

    def _corners(self, rows: NDArray[np.float64]) -> None:
        """Set the radius and end speed of each corner, so that the vehicle can brake for later corners."""
        law = self.law
        ends = np.vstack([self.state[None, State.POSITION_X : State.POSITION_Z], rows[:, : Leg.KIND]])
        ways = np.diff(ends, axis=0)
        lengths = np.hypot(ways[:, 0], ways[:, 1])
        leave = 0.0
        for i in range(len(rows) - 1, -1, -1):
            row = rows[i]
            if row[Leg.KIND] != wheels.THROUGH:
                leave = float(row[Leg.SPEED]) if row[Leg.KIND] == wheels.AT_ONCE else 0.0
                row[Leg.END_SPEED] = leave
                continue
            turn = 0.0
            if lengths[i] > 1e-3 and lengths[i + 1] > 1e-3:
                (ax, ay), (bx, by) = ways[i].tolist(), ways[i + 1].tolist()
                turn = abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
            tangent = math.tan(0.5 * min(turn, 0.9 * math.pi))
            if law.corner_gain > 0.0 and law.turn_radius > 0.0:
                needed = law.corner_gain * law.turn_radius * tangent
                row[Leg.RADIUS] = max(row[Leg.RADIUS], min(needed, law.corner_max))
            speed = float(rows[i + 1, Leg.SPEED])
            if law.corner_slows >= 0.0:
                slowed = law.corner_most * (1.0 - min(law.corner_slows * turn / math.pi, 1.0))
                speed = min(max(slowed, law.corner_least), float(row[Leg.SPEED]))
            elif turn > 1e-3:
                bend = max(float(row[Leg.RADIUS]) / max(tangent, 1e-6), law.turn_radius, 0.1)
                speed = min(speed, math.sqrt(law.lateral * bend), law.turn_rate * bend)
            if 0.0 < law.pivot_begin < turn:
                speed = 0.0
            reach = math.sqrt(leave * leave + 2.0 * law.deceleration * float(lengths[i + 1]))
            leave = min(speed, reach, float(row[Leg.SPEED]))
            row[Leg.END_SPEED] = leave

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Drive at a velocity, or stop; a command to descend stops the vehicle for good."""
        east, north, up = velocity_m_s
        speed = math.hypot(east, north)
        row = np.zeros((1, len(Leg)))
        row[0, : Leg.KIND] = self.state[State.POSITION_X : State.POSITION_Z]
        row[0, Leg.KIND] = wheels.BRAKE if up < 0.0 and speed == 0.0 else wheels.VELOCITY
        row[0, Leg.SPEED] = min(speed, self.law.speed_max)
        row[0, Leg.HEADING] = math.atan2(east, north) if speed > 0.0 else self.state[State.HEADING]
        self._begin(row.view(wheels.LEG)[:, 0])

    def stopping_point(self) -> Position:
        """Return the position at which the vehicle comes to rest if it brakes now."""
        x, y = self.state[State.POSITION_X : State.POSITION_Z].tolist()
        speed, yaw = float(self.state[Wheels.SPEED]), float(self.state[State.HEADING])
        distance = 0.5 * speed * speed / self.law.deceleration
        return x + distance * math.sin(yaw), y + distance * math.cos(yaw), 0.0

    def lose_power(self) -> None:
        """Stop, because the motor has no power."""
        self._limit.speed_max = 1e-3

    def touch_down(self) -> None:
        """Set the vehicle to rest."""
        super().touch_down()
        self.state[Wheels.SPEED : Wheels.PIVOTING + 1] = 0.0
        self.state[Wheels.YAW_ASKED :] = 0.0

    def _numbers(self, spec: VehicleSpec) -> Mapping[str, float]:
        """Set `law` for a vehicle; return the kernel's limits except time step and energy."""
        law = self.law = self._limits_of(spec)
        return {**{name: getattr(law, name) for name in wheels.OF_ROVER}, **law.simulated}


# Legs followed by pure pursuit: bends of a curve, and repeated position setpoints. ArduPilot's Rover does not
# use S-curves for these legs either.
_PURSUED = (LegKind.ARC, LegKind.SETPOINT)


class ArduRover(AlongCurves, Rover):
    """A wheeled or tracked vehicle under ArduPilot's Rover; velocity setpoints are followed as by `Rover`.

    `law_of` returns the law, float64[LAW], that a vehicle's parameters set.
    """

    dynamics = Dynamics(
        ardurover.advance,
        wheels.STATE,
        wheels.LIMITS,
        (("guide", ardurover.GUIDE), ("numbers", ardurover.LAW), ("heads", None), ("curves", None)),
        "_rows",
    )
    generic = Rover.dynamics
    # A return starts from the point where the vehicle would stop.
    begins_anew = LegKind.HOME

    def __init__(
        self,
        spec: VehicleSpec,
        limits_of: Callable[[VehicleSpec], RoverLimits],
        law_of: Callable[[VehicleSpec], NDArray[np.float64]],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        super().__init__(spec, limits_of, wind, yaw_rad)
        self._law_of = law_of
        self._remember(len(Guide) + len(Drive))
        self.numbers = law_of(spec)
        self._rest()

    def _rest(self) -> None:
        """Reset the guidance to no path, at the vehicle's present speed."""
        self._rows = None
        self.guide[:] = 0.0
        self.guide[Guide.LEVEL] = self.spec.cruise_speed_m_s
        self.guide[Guide.RESET] = 1.0
        self.guide[Drive.SPEED_ASKED] = self.state[Wheels.SPEED]

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Start the vehicle at a place and velocity, at time 0 and with no energy used.

        If the first leg lies ahead, its speed profile starts at the vehicle's speed.
        """
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        self.heads[:] = 0.0
        self._rest()
        self._under_way = True

    def fly(self, route: Route) -> None:
        """Start a route from the vehicle's current position and speed."""
        kind = route.legs["kind"]
        if np.isin(kind, _PURSUED).any():
            self._rest()
            super().fly(route)
            return
        if self._rows is None and not self._continues_leg:
            self._rest()
        ends = np.column_stack((route.points_m[:, :2], np.zeros(len(kind))))
        kind = np.where(np.isin(kind, NOT_DRIVEN), ardurover.AT_ONCE, kind)
        self._set_out(route, self.numbers, ends, kind, self.law.speed_max)

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Drive at a velocity, or stop; a command to descend stops the vehicle for good."""
        self._rest()
        super().steer(velocity_m_s, height_m=height_m, heading=heading)

    def lose_power(self) -> None:
        """Stop, because the motor has no power."""
        super().lose_power()
        self.numbers[DriveLaw.TOP_SPEED] = 0.0

    def update_spec(self, spec: VehicleSpec) -> None:
        """Change defaults and limits, effective from the next route on."""
        super().update_spec(spec)
        self.numbers = self._law_of(spec)

    def touch_down(self) -> None:
        """Set the vehicle to rest."""
        super().touch_down()
        self._rest()
