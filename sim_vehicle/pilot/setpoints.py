"""Flies setpoints: positions and velocities that a companion or ground station asks for, again and again.

Sources: ArduPilot "Copter commands in guided mode", PX4 "Offboard mode".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.legs import ALONG, KEEP, Heading
from sim_vehicle.pilot.notices import RefusedError, Severity

if TYPE_CHECKING:
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.failsafe import Failsafe

__all__ = ["Setpoint", "SetpointFollower"]

_SLOWEST_M_S = 0.05


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A setpoint of position, velocity and heading; NaN marks a component that is not set."""

    position_m: tuple[float, float, float]
    """East, north, up about the start."""
    velocity_m_s: tuple[float, float, float]
    """East, north, up."""
    # Compass heading, and rate of turning (clockwise).
    yaw_rad: float = math.nan
    turn_rad_s: float = math.nan

    @property
    def heading(self) -> Heading | None:
        """The heading that is asked for, None without one; a turn rate takes precedence."""
        if not math.isnan(self.turn_rad_s):
            return Heading.turning(self.turn_rad_s)
        return None if math.isnan(self.yaw_rad) else Heading.fixed(self.yaw_rad)

    @property
    def is_velocity(self) -> bool:
        """Whether no horizontal position is asked for, but a velocity."""
        return math.isnan(self.position_m[0]) and not all(math.isnan(v) for v in self.velocity_m_s)


class SetpointFollower:
    """Flies the latest setpoint and tells when setpoints have stopped to flow."""

    def __init__(self, controls: Controls, failsafe: Failsafe) -> None:
        self._controls = controls
        self._parameters = controls.parameters
        self._notices = controls.notices
        self._failsafe = failsafe
        self._rules = failsafe.rules
        self._latest: Setpoint | None = None
        self._taken_s = -math.inf
        self._flown: Setpoint | None = None
        self._complaint = ""

    @property
    def is_fresh(self) -> bool:
        """Whether setpoints flow."""
        return self._controls.now_s - self._taken_s <= self._parameters.setpoint_timeout_s

    @property
    def flown(self) -> Setpoint | None:
        """The setpoint that is flown, None while something else is."""
        return self._flown

    def listens_in(self, mode: Mode) -> bool:
        """Whether setpoints are taken in a mode, be it only to be flown later."""
        return self._rules.needs_stream or mode in (Mode.GUIDED, Mode.TAKEOFF)

    def take(self, setpoint: Setpoint) -> None:
        """Keep a setpoint to fly it."""
        self._latest = setpoint
        self._taken_s = self._controls.now_s

    def begin(self) -> None:
        """Fly the latest setpoint where the mode needs a stream of them."""
        self._flown = None
        if self._rules.needs_stream and self._latest is not None:
            self.fly()

    def expired(self) -> Mode | None:
        """Tell that setpoints have grown old; the mode that has to be taken then, None while all is well."""
        if self.is_fresh:
            return None
        if self._rules.needs_stream:
            self._notices.add(Severity.WARNING, self._rules.stream_lost.format("returning"))
            self._flown = None
            return Mode.RTL
        if self._flown is not None and self._flown.is_velocity:
            self._notices.add(Severity.WARNING, self._rules.stream_lost.format("stopping"))
            self._flown = None
            return Mode.GUIDED
        return None

    def forget(self) -> None:
        """Note that something else is flown now."""
        self._flown = None

    def fly(self) -> None:
        """Fly the latest setpoint, unless it is flown already."""
        setpoint = self._latest
        if setpoint is None or setpoint == self._flown:
            return
        try:
            self._fly(setpoint)
        except VehicleError as error:
            raise RefusedError(f"Setpoint refused: {error}") from None
        self._flown = setpoint
        self._complaint = ""

    def complain(self, text: str) -> None:
        """Tell the operator why a setpoint is not flown, but the same thing only once in a row."""
        if text != self._complaint:
            self._complaint = text
            self._notices.add(Severity.WARNING, text)

    def _fly(self, setpoint: Setpoint) -> None:
        executor = self._controls.executor
        (x, y, z), (vx, vy, vz) = setpoint.position_m, setpoint.velocity_m_s
        heading = setpoint.heading
        executor.look_at(None)
        if math.isnan(x) and not (math.isnan(vx) and math.isnan(vz)):
            across = (0.0, 0.0) if math.isnan(vx) else (vx, vy)
            up = 0.0 if math.isnan(vz) else vz
            executor.steer((*across, up), height_m=z, heading=heading or KEEP)
            return
        here = executor.motion.stopping_point()
        if heading is None:
            heading = ALONG if self._rules.yaws_to_setpoint and not math.isnan(x) else KEEP
        target = (here[0], here[1]) if math.isnan(x) else (x, y)
        height = here[2] if math.isnan(z) else z
        if self._rules.fences_setpoints and (reason := self._failsafe.outside((*target, height))) is not None:
            raise VehicleError(f"position outside the fence ({reason})")
        speed = math.nan if math.isnan(vx) else math.hypot(vx, vy)
        executor.goto(
            *target,
            height,
            heading=heading,
            speed_m_s=min(speed, executor.spec.top_speed_m_s) if speed > _SLOWEST_M_S else None,
            as_setpoint=True,
        )
