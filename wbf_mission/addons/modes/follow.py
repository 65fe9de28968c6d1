"""PX4's follow-me mode: the vehicle flies at a distance from a target that sends its position.

Sources: PX4's ``TargetEstimator.cpp`` and ``FlightTaskAutoFollowTarget.cpp``. Unlike PX4, the estimate has no
acceleration and no output filter, and the angle about the target has no jerk limit.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

from sim_vehicle.autopilot.parameters import Setting
from sim_vehicle.motion.legs import KEEP, Heading, Position
from sim_vehicle.pilot.controls import Controls, RefusedError

_HEIGHT = Setting("FLW_TGT_HT", 8.0)
_DISTANCE = Setting("FLW_TGT_DST", 8.0)
_ANGLE = Setting("FLW_TGT_FA", 180.0, math.radians(1.0))
_ALTITUDE_MODE, _TRACKS_TARGET = Setting("FLW_TGT_ALT_M", 0.0), 2
_RESPONSIVENESS = Setting("FLW_TGT_RS", 0.1)
_ORBIT_SPEED = Setting("FLW_TGT_MAX_VEL", 5.0)
_GAIN, _LEAST_GAIN = Setting("MPC_XY_P", 0.95), 0.1
# Constants of the sources, in metres, seconds and metres per second.
_LEAST_HEIGHT_M, _LEAST_DISTANCE_M, _LOWEST_M = 8.0, 1.0, 1.0
_POSITION_EACH_S, _VELOCITY_EACH_S, _STALE_S = 0.5, 0.1, 3.0
_LEAST_COURSE_M_S, _ORBIT_M_S2, _NEAR_HEIGHT_M, _LEAST_YAW_M = 1.0, 2.0, 3.0, 1.0
_VELOCITY_SHARE = 0.9
# Longest time step of the filter.
_LONGEST_S = 20.0


@dataclass(slots=True)
class _Target:
    """Estimate of the target's position and velocity: east, north, up."""

    position_m: list[float]
    velocity_m_s: list[float]
    now_s: float
    heard_s: float
    position_s: float
    velocity_s: float

    def move(self, now_s: float) -> None:
        """Predict the target's position at `now_s`; a silent target is assumed to stand still."""
        passed_s, self.now_s = now_s - self.now_s, now_s
        if now_s - self.heard_s >= _STALE_S:
            self.velocity_m_s = [0.0, 0.0, 0.0]
        self.position_m = [
            place + passed_s * speed for place, speed in zip(self.position_m, self.velocity_m_s, strict=True)
        ]

    def fuse(self, position_m: Position, velocity_m_s: Position | None, responsiveness: float) -> None:
        """Correct the estimate with a measurement."""
        self.heard_s = now_s = self.now_s
        beta = min(max(responsiveness, 0.1), 1.0) ** (1.0 / 3.0)
        if (passed_s := now_s - self.position_s) >= _POSITION_EACH_S:
            self.position_s = now_s
            gain, gain_v = 1.0 - beta**3, 1.5 * (1.0 - beta) ** 2 * (1.0 + beta) / min(passed_s, _LONGEST_S)
            errors = [measured - place for measured, place in zip(position_m, self.position_m, strict=True)]
            self.position_m = [p + gain * e for p, e in zip(self.position_m, errors, strict=True)]
            self.velocity_m_s = [v + gain_v * e for v, e in zip(self.velocity_m_s, errors, strict=True)]
        if velocity_m_s is not None and now_s - self.velocity_s >= _VELOCITY_EACH_S:
            self.velocity_s = now_s
            gain = 1.0 - (_VELOCITY_SHARE * beta) ** 2
            self.velocity_m_s = [
                v + gain * (measured - v) for v, measured in zip(self.velocity_m_s, velocity_m_s, strict=True)
            ]


class FollowPilot:
    """Flies at a distance from the target, at an angle to the target's course, and faces the target."""

    def __init__(self, controls: Controls) -> None:
        self._controls = controls
        self._target: _Target | None = None
        # Course of the target, and bearing of the vehicle from the target, clockwise from north.
        self._course_rad = self._orbit_rad = self._turning_rad_s = self._flown_s = 0.0

    def begin(self) -> None:
        """Wait for the first message of a target."""
        self._target = None
        self._course_rad = self._turning_rad_s = 0.0

    def take(self, position_m: Position, velocity_m_s: Position | None) -> None:
        """Process a position and, if known, a velocity of the target."""
        controls = self._controls
        if not math.hypot(*position_m[:2]) <= controls.spec.max_distance_m:
            return
        now_s = controls.now_s
        if self._target is None:
            moves = list(velocity_m_s or (0.0, 0.0, 0.0))
            self._target = _Target(list(position_m), moves, now_s, now_s, now_s, now_s)
            x, y, _ = controls.state.position_m
            self._orbit_rad = math.atan2(x - position_m[0], y - position_m[1])
            self._flown_s = now_s
        self._target.move(now_s)
        self._target.fuse(position_m, velocity_m_s, _RESPONSIVENESS.of(controls.parameters))

    def check(self) -> None:
        """Fly round the target; without a target, the vehicle holds its position."""
        target, controls = self._target, self._controls
        if target is None:
            return
        get = controls.parameters
        target.move(controls.now_s)
        step_s, self._flown_s = controls.now_s - self._flown_s, controls.now_s
        distance_m = max(_DISTANCE.of(get), _LEAST_DISTANCE_M)
        v_east, v_north, _ = target.velocity_m_s
        if math.hypot(v_east, v_north) >= _LEAST_COURSE_M_S:
            self._course_rad = math.atan2(v_east, v_north)
        self._turn(self._course_rad + _ANGLE.of(get), distance_m, step_s)
        x, y, z = controls.state.position_m
        height_m = max(_HEIGHT.of(get), _LEAST_HEIGHT_M)
        if _ALTITUDE_MODE.of(get) == _TRACKS_TARGET:
            # The target may be below the ground or above the vehicle's maximum altitude.
            height_m = min(max(height_m + target.position_m[2], _LOWEST_M), controls.spec.max_altitude_m)
        executor, gain = controls.executor, _GAIN.of(get)
        east, north, _ = executor.motion.stopping_point()
        # The vehicle first climbs or descends, then flies round the target.
        if abs(height_m - z) < _NEAR_HEIGHT_M:
            sine, cosine = math.sin(self._orbit_rad), math.cos(self._orbit_rad)
            along = self._turning_rad_s * distance_m
            # If the position setpoint is this far ahead, the controller flies at the setpoint's velocity.
            lead_s = 1.0 / max(gain, _LEAST_GAIN)
            east = target.position_m[0] + distance_m * sine + lead_s * (v_east + along * cosine)
            north = target.position_m[1] + distance_m * cosine + lead_s * (v_north - along * sine)
        to_east, to_north = target.position_m[0] - x, target.position_m[1] - y
        sees = math.hypot(to_east, to_north) > _LEAST_YAW_M
        heading = Heading.fixed(math.atan2(to_east, to_north)) if sees else KEEP

        def fly() -> None:
            if controls.spec.autopilot == controls.firmware.procedures.name:
                speed_m_s = controls.spec.top_speed_m_s
                executor.goto(east, north, height_m, heading=heading, speed_m_s=speed_m_s, as_setpoint=True)
            else:
                # The generic dynamics do not brake before a moving position, so a velocity is commanded.
                velocity_m_s = (gain * (east - x), gain * (north - y), 0.0)
                executor.steer(velocity_m_s, height_m=height_m, heading=heading)

        with suppress(RefusedError):  # the vehicle is lost, or the position is out of range
            controls.order(fly)

    def _turn(self, wanted_rad: float, distance_m: float, step_s: float) -> None:
        """Move round the target towards a bearing, within the limits of speed and acceleration."""
        left_rad = math.remainder(wanted_rad - self._orbit_rad, 2.0 * math.pi)
        most = max(_ORBIT_SPEED.of(self._controls.parameters), 0.0) / distance_m
        change = _ORBIT_M_S2 / distance_m
        before = math.copysign(self._turning_rad_s, self._turning_rad_s * left_rad)
        rate = min(most, math.sqrt(2.0 * change * abs(left_rad)), max(before, 0.0) + change * step_s)
        turned_rad = min(rate * step_s, abs(left_rad))
        self._turning_rad_s = math.copysign(turned_rad / step_s if step_s > 0.0 else 0.0, left_rad)
        self._orbit_rad += math.copysign(turned_rad, left_rad)
