"""Setpoints of GUIDED (ArduPilot) and OFFBOARD (PX4): what the messages ask for, and how it is flown.

Sources: MAVLink common.xml (SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT, their type masks),
ArduPilot "Copter commands in guided mode", PX4 "Offboard mode".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import Message
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.legs import ALONG, KEEP, Heading
from sim_vehicle.pilot.notices import RefusedError, Severity

if TYPE_CHECKING:
    from sim_vehicle.pilot.pilot import Pilot

__all__ = ["MESSAGES", "Setpoint", "Steering", "setpoint_of"]

MESSAGES = frozenset(
    {
        m.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        m.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        m.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    }
)
_IGNORE_POSITION, _FORCE, _IGNORE_YAW, _IGNORE_TURN = 7, 512, 1024, 2048
_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD = 1, 7, 8, 9, 12
_GLOBAL = {0: False, 5: False, 3: True, 6: True}
_SLOWEST_M_S = 0.05


@dataclass(frozen=True, slots=True)
class Setpoint:
    """What is asked for; NaN is not asked for.

    Parameters
    ----------
    position_m : tuple of 3 floats
        East, north, up about the start.
    velocity_m_s : tuple of 3 floats
        East, north, up.
    yaw_rad, turn_rad_s : float
        Compass heading, and rate of turning (clockwise).
    """

    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    yaw_rad: float = math.nan
    turn_rad_s: float = math.nan

    @property
    def heading(self) -> Heading | None:
        """What is asked of the heading, None for nothing; a rate of turning comes first."""
        if not math.isnan(self.turn_rad_s):
            return Heading.turning(self.turn_rad_s)
        return None if math.isnan(self.yaw_rad) else Heading.fixed(self.yaw_rad)

    @property
    def is_velocity(self) -> bool:
        """Whether no horizontal place is asked for, but a velocity."""
        return math.isnan(self.position_m[0]) and not all(math.isnan(v) for v in self.velocity_m_s)


def setpoint_of(message: Message, pilot: Pilot, *, body_positions: bool) -> Setpoint:
    """Read a setpoint message.

    Parameters
    ----------
    message : Message
        SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT.
    pilot : Pilot
        Where the vehicle is and looks, for frames about it.
    body_positions : bool
        Whether places may be offsets from the vehicle (ArduPilot).

    Raises
    ------
    RefusedError
        For a frame that is not flown, a force, or numbers that are none.
    """
    frame, mask = int(message.coordinate_frame), int(message.type_mask)
    if mask & _FORCE:
        msg = "Setpoint refused: forces are not flown"
        raise RefusedError(msg, denied=True)
    local = type(message).id == m.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
    place_given = (message.x, message.y, message.z) if local else (message.alt,)
    if any(map(math.isinf, (*place_given, message.vx, message.vy, message.vz))):
        msg = "Setpoint refused: infinity is no number to fly"
        raise RefusedError(msg, denied=True)
    x, y, z, yaw = *pilot.state.position_m, pilot.state.yaw_rad
    turned = frame in (_BODY, _BODY_OFFSET, _BODY_FRD)
    velocity = _enu(message.vx, message.vy, message.vz, yaw if turned else 0.0)
    if not local:
        if frame not in _GLOBAL:
            raise RefusedError(f"Setpoint refused: frame {frame}", denied=True)
        place = pilot.place_of(
            message.lat_int / 1e7, message.lon_int / 1e7, message.alt, relative=_GLOBAL[frame]
        )
    elif frame in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD):
        asked = mask & _IGNORE_POSITION != _IGNORE_POSITION
        if frame != _LOCAL and asked and not body_positions:
            raise RefusedError(f"Setpoint refused: no places in frame {frame}", denied=True)
        place = _enu(message.x, message.y, message.z, yaw if turned else 0.0)
        if frame != _LOCAL:
            place = (x + place[0], y + place[1], z + place[2])
    else:
        raise RefusedError(f"Setpoint refused: frame {frame}", denied=True)
    heading = message.yaw + (yaw if turned else 0.0)
    if mask & _IGNORE_YAW or not math.isfinite(heading):
        heading = math.nan
    turn = math.nan if mask & _IGNORE_TURN else float(message.yaw_rate)
    setpoint = Setpoint(_masked(place, mask), _masked(velocity, mask >> 3), heading, turn)
    if all(map(math.isnan, (*setpoint.position_m, *setpoint.velocity_m_s, heading, turn))):
        msg = "Setpoint refused: neither place nor velocity"
        raise RefusedError(msg, denied=True)
    return setpoint


def _enu(north: float, east: float, down: float, yaw: float) -> tuple[float, float, float]:
    """Turn north-east-down, or forward-right-down of a vehicle with this heading, into east-north-up."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return north * sin + east * cos, north * cos - east * sin, -down


def _masked(vector: tuple[float, float, float], mask: int) -> tuple[float, float, float]:
    """Hide what is to be ignored; the bits are in the order north, east, down."""
    hidden = bool(mask & 3) or math.isnan(vector[0] + vector[1])
    flat = (math.nan, math.nan) if hidden else vector[:2]
    return *flat, math.nan if mask & 4 else vector[2]


class Steering:
    """Flies setpoints.

    Parameters
    ----------
    pilot : Pilot
    """

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self._rules = pilot.failsafe.rules
        self._latest: Setpoint | None = None
        self._heard_s = -math.inf
        self._flown: Setpoint | None = None
        self._complaint = ""

    @property
    def is_fresh(self) -> bool:
        """Whether setpoints flow."""
        return self._pilot.now_s - self._heard_s <= self._pilot.parameters.setpoint_timeout_s

    def take(self, message: Message) -> None:
        """Take a setpoint message; it is flown in the mode for it, and in no other."""
        if type(message).id == m.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET:
            self._complain("Setpoint refused: attitudes are not flown")
            return
        pilot = self._pilot
        listening = self._rules.needs_stream or pilot.mode in (Mode.GUIDED, Mode.TAKEOFF)
        if not listening:
            return
        try:
            self._latest = setpoint_of(message, pilot, body_positions=not self._rules.needs_stream)
            self._heard_s = pilot.now_s
            if pilot.mode is Mode.TAKEOFF and not self._rules.needs_stream:
                pilot.mode = Mode.GUIDED
            if pilot.mode is Mode.GUIDED and pilot.armed:
                self.fly()
        except RefusedError as refusal:
            self._complain(str(refusal))

    def begin(self) -> None:
        """Fly the latest setpoint where the mode needs a stream of them."""
        self._flown = None
        if self._rules.needs_stream and self._latest is not None:
            self.fly()

    def check(self) -> None:
        """Leave what has grown old."""
        pilot = self._pilot
        if pilot.mode is not Mode.GUIDED or self.is_fresh:
            return
        if self._rules.needs_stream:
            pilot.note(Severity.WARNING, self._rules.stream_lost.format("holding"))
            self._flown = None
            pilot.turn_to(Mode.HOLD)
        elif self._flown is not None and self._flown.is_velocity:
            pilot.note(Severity.WARNING, self._rules.stream_lost.format("stopping"))
            self._flown = None
            pilot.turn_to(Mode.GUIDED)

    def forget(self) -> None:
        """Something else is flown now."""
        self._flown = None

    def fly(self) -> None:
        """Fly the latest setpoint, unless it is flown already."""
        setpoint, pilot = self._latest, self._pilot
        if setpoint is None or setpoint == self._flown:
            return
        try:
            self._fly(setpoint, pilot)
        except VehicleError as error:
            raise RefusedError(f"Setpoint refused: {error}") from None
        self._flown = setpoint
        self._complaint = ""

    def _fly(self, setpoint: Setpoint, pilot: Pilot) -> None:
        executor = pilot.executor
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
            heading = ALONG if self._rules.looks_ahead and not math.isnan(x) else KEEP
        target = (here[0], here[1]) if math.isnan(x) else (x, y)
        height = here[2] if math.isnan(z) else z
        if self._rules.looks_ahead and (reason := pilot.failsafe.outside((*target, height))) is not None:
            raise VehicleError(f"the place is outside the fence ({reason})")
        speed = math.nan if math.isnan(vx) else math.hypot(vx, vy)
        executor.goto(
            *target,
            height,
            heading=heading,
            speed_m_s=min(speed, pilot.spec.top_speed_m_s) if speed > _SLOWEST_M_S else None,
        )

    def _complain(self, text: str) -> None:
        """Tell the operator, but the same thing only once in a row."""
        if text != self._complaint:
            self._complaint = text
            self._pilot.note(Severity.WARNING, text)
