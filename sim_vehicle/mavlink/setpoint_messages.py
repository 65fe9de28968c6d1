"""Setpoint messages of GUIDED (ArduPilot) and OFFBOARD (PX4).

Sources: MAVLink common.xml (SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT, their type masks),
ArduPilot "Copter commands in guided mode", PX4 "Offboard mode".
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

from geo.rotation import angles_of
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from sim_vehicle.motion.legs import KEEP, Heading
from sim_vehicle.pilot.attitude import AttitudeTarget
from sim_vehicle.pilot.notices import RefusedError
from sim_vehicle.pilot.setpoints import Setpoint

if TYPE_CHECKING:
    from geo.frame import LocalFrame
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.execution.state import VehicleState
    from sim_vehicle.motion.legs import Position

__all__ = ["MESSAGES", "PositionTarget", "attitude_of", "setpoint_of"]

MESSAGES = frozenset(
    {
        m.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        m.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        m.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    }
)
PositionTarget: TypeAlias = (
    m.MAVLink_set_position_target_local_ned_message | m.MAVLink_set_position_target_global_int_message
)
_IGNORE_POSITION, _IGNORE_FORCE, _FORCE, _IGNORE_YAW, _IGNORE_TURN = 7, 448, 512, 1024, 2048
_IGNORE_RATES, _IGNORE_THRUST, _IGNORE_ATTITUDE = 7, 64, 128
# How far the length of a quaternion may be from 1.
_UNIT = 2e-3
_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD = 1, 7, 8, 9, 12
_GLOBAL = {0: False, 5: False, 3: True, 6: True}


def setpoint_of(
    message: PositionTarget, state: VehicleState, frame: LocalFrame, *, body_positions: bool
) -> Setpoint:
    """Read a setpoint message.

    Parameters
    ----------
    message : PositionTarget
        SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT.
    state : VehicleState
        Where the vehicle is and where its nose points, for frames about it.
    frame : LocalFrame
        About the start.
    body_positions : bool
        Whether positions may be offsets from the vehicle (ArduPilot).

    Raises
    ------
    RefusedError
        For a frame that is not flown, a force, or numbers that are none.
    """
    kind, mask = int(message.coordinate_frame), int(message.type_mask)
    if mask & _FORCE and mask & _IGNORE_FORCE != _IGNORE_FORCE:
        msg = "Setpoint refused: forces are not flown"
        raise RefusedError(msg, denied=True)
    numbers = [message.vx, message.vy, message.vz]
    numbers += (
        [message.x, message.y, message.z]
        if is_a(message, m.MAVLink_set_position_target_local_ned_message)
        else [message.alt]
    )
    if any(map(math.isinf, numbers)):
        msg = "Setpoint refused: infinity is no number to fly"
        raise RefusedError(msg, denied=True)
    x, y, z, yaw = *state.position_m, state.yaw_rad
    turned = kind in (_BODY, _BODY_OFFSET, _BODY_FRD)
    velocity = _enu(message.vx, message.vy, message.vz, yaw if turned else 0.0)
    if not is_a(message, m.MAVLink_set_position_target_local_ned_message):
        if kind not in _GLOBAL:
            raise RefusedError(f"Setpoint refused: frame {kind}", denied=True)
        x_m, y_m = frame.from_wgs84(message.lat_int / 1e7, message.lon_int / 1e7)
        position = (x_m, y_m, message.alt - (0.0 if _GLOBAL[kind] else frame.altitude_m))
    elif kind in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD):
        asked = mask & _IGNORE_POSITION != _IGNORE_POSITION
        if kind != _LOCAL and asked and not body_positions:
            raise RefusedError(f"Setpoint refused: no positions in frame {kind}", denied=True)
        position = _enu(message.x, message.y, message.z, yaw if turned else 0.0)
        if kind != _LOCAL:
            position = (x + position[0], y + position[1], z + position[2])
    else:
        raise RefusedError(f"Setpoint refused: frame {kind}", denied=True)
    heading = message.yaw + (yaw if turned else 0.0)
    if mask & _IGNORE_YAW or not math.isfinite(heading):
        heading = math.nan
    turn = math.nan if mask & _IGNORE_TURN else float(message.yaw_rate)
    setpoint = Setpoint(_masked(position, mask), _masked(velocity, mask >> 3), heading, turn)
    if all(map(math.isnan, (*setpoint.position_m, *setpoint.velocity_m_s, heading, turn))):
        msg = "Setpoint refused: neither position nor velocity"
        raise RefusedError(msg, denied=True)
    return setpoint


def attitude_of(
    message: m.MAVLink_set_attitude_target_message, spec: VehicleSpec, *, by_thrust: bool
) -> AttitudeTarget | None:
    """Read SET_ATTITUDE_TARGET as ArduCopter does; None is what makes it stop.

    Parameters
    ----------
    spec : VehicleSpec
        Its climb and descent speeds are those of a thrust of 1 and 0.
    by_thrust : bool
        The thrust is one (GUID_OPTIONS), not a climb rate.
    """
    mask = int(message.type_mask)
    rates = [message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate]
    ignored = mask & _IGNORE_RATES
    if mask & _IGNORE_THRUST or ignored not in (0, _IGNORE_RATES) or not math.isfinite(message.thrust):
        return None
    roll = pitch = math.nan
    heading = KEEP
    if not mask & _IGNORE_ATTITUDE:
        w, x, y, z = message.q
        if not abs(w * w + x * x + y * y + z * z - 1.0) < _UNIT:
            return None
        roll, pitch, yaw = angles_of(message.q)
        heading = Heading.fixed(yaw)
    elif ignored or not all(map(math.isfinite, rates)):
        return None
    if not ignored and math.isfinite(rates[2]) and (rates[2] or math.isnan(roll)):
        heading = Heading.turning(rates[2])
    share = 2.0 * min(max(message.thrust, 0.0), 1.0) - 1.0
    climb = share * (spec.climb_speed_m_s if share > 0.0 else spec.descent_speed_m_s)
    return AttitudeTarget(
        roll,
        pitch,
        heading,
        math.nan if by_thrust else climb,
        (rates[0], rates[1]),
        min(max(message.thrust, 0.0), 1.0),
    )


def _enu(north: float, east: float, down: float, yaw: float) -> Position:
    """Turn north-east-down, or forward-right-down of a vehicle with this heading, into east-north-up."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return north * sin + east * cos, north * cos - east * sin, -down


def _masked(vector: Position, mask: int) -> Position:
    """Hide what is to be ignored; the bits are in the order north, east, down."""
    hidden = bool(mask & 3) or math.isnan(vector[0] + vector[1])
    flat = (math.nan, math.nan) if hidden else vector[:2]
    return *flat, math.nan if mask & 4 else vector[2]
