"""Setpoints of GUIDED (ArduPilot) and OFFBOARD (PX4).

Sources: MAVLink common.xml (SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT, their type masks),
ArduPilot "Copter commands in guided mode", ``GCS_Common.cpp`` and ``GCS_MAVLink_Copter.cpp``, PX4 "Offboard
mode" and ``mavlink_receiver.cpp``.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, TypeAlias

from geo.frame import angles_of
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.parameters import Setting
from sim_vehicle.motion.legs import KEEP, Heading
from sim_vehicle.motion.model import attitude_of
from sim_vehicle.pilot.controls import RefusedError
from wbf_mission.addons.modes.guided import AttitudeTarget, GuidedFlight, Setpoint

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.mavlink.wire_state import WireState
    from sim_vehicle.motion.legs import Position

__all__ = ["SetpointMessage", "Steering"]

PositionTarget: TypeAlias = (
    m.MAVLink_set_position_target_local_ned_message | m.MAVLink_set_position_target_global_int_message
)
SetpointMessage: TypeAlias = PositionTarget | m.MAVLink_set_attitude_target_message
_GUIDED_OPTIONS, _THRUST_AS_THRUST = Setting("GUID_OPTIONS", 0.0), 8
_IGNORE_POSITION, _IGNORE_FORCE, _FORCE, _IGNORE_YAW, _IGNORE_TURN = 7, 448, 512, 1024, 2048
_IGNORE_RATES, _IGNORE_THRUST, _IGNORE_ATTITUDE = 7, 64, 128
_IGNORE_MOTION = 63
# Lower limit of the hover thrust; MPC_THR_HOVER and MOT_THST_HOVER have minima of 0.1 and 0.125.
_LEAST_HOVER = 0.1
# Minimum lift (m/s^2), which keeps a vehicle steerable; maximum thrust, in units of the hover thrust.
_LEAST_LIFT, _MOST_THRUST = 1.0, 2.0
# Tolerance of a unit quaternion's squared length.
_UNIT = 2e-3
_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD = 1, 7, 8, 9, 12
_GLOBAL = {0: False, 5: False, 3: True, 6: True}


class Steering:
    """Handles setpoint messages of a vehicle."""

    def __init__(self, state: WireState, guided: GuidedFlight) -> None:
        self._state = state
        self._guided = guided
        self._pilot = state.pilot

    def take(self, message: SetpointMessage, _now_s: float) -> None:
        """Handle SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT or SET_ATTITUDE_TARGET."""
        pilot = self._pilot
        if is_a(message, m.MAVLink_set_attitude_target_message):
            mavlink = self._state.mavlink
            if mavlink.hover_thrust is None:
                pilot.complain("Setpoint refused: no attitude control")
                return
            climbs = mavlink.thrust_climbs
            climbs &= not int(_GUIDED_OPTIONS.of(pilot.parameters)) & _THRUST_AS_THRUST
            hover = mavlink.hover_thrust.of(pilot.parameters)
            with suppress(RefusedError):
                self._guided.take_attitude(_attitude_of(message, pilot.spec, hover, climbs=climbs))
        elif self._guided.setpoints.listens_in(pilot.mode):
            try:
                setpoint = self._setpoint_of(message)
                if isinstance(setpoint, AttitudeTarget):
                    self._guided.take_attitude(setpoint)
                else:
                    self._guided.take_setpoint(setpoint)
            except RefusedError as refusal:
                pilot.complain(str(refusal))

    def _setpoint_of(self, message: PositionTarget) -> Setpoint | AttitudeTarget:
        """Return a message's setpoint; raise RefusedError for an unsupported frame, a force, or no values."""
        kind, mask = int(message.coordinate_frame), int(message.type_mask)
        if mask & _FORCE and mask & _IGNORE_FORCE != _IGNORE_FORCE:
            raise RefusedError("Setpoint refused: forces are not flown", denied=True)
        by_acceleration = mask & _IGNORE_MOTION == _IGNORE_MOTION and mask & _IGNORE_FORCE != _IGNORE_FORCE
        numbers = [message.vx, message.vy, message.vz, message.afx, message.afy, message.afz]
        numbers += (
            [message.x, message.y, message.z]
            if is_a(message, m.MAVLink_set_position_target_local_ned_message)
            else [message.alt]
        )
        if any(map(math.isinf, numbers)):
            raise RefusedError("Setpoint refused: infinite values", denied=True)
        state, frame = self._pilot.state, self._pilot.frame
        x, y, z, yaw = *state.position_m, state.yaw_rad
        turned = kind in (_BODY, _BODY_OFFSET, _BODY_FRD)
        velocity = _enu(message.vx, message.vy, message.vz, yaw if turned else 0.0)
        if not is_a(message, m.MAVLink_set_position_target_local_ned_message):
            if kind not in _GLOBAL:
                raise RefusedError(f"Setpoint refused: frame {kind}", denied=True)
            x_m, y_m = frame.from_wgs84(message.lat_int / 1e7, message.lon_int / 1e7)
            position = (x_m, y_m, self._state.above_start(message.alt, kind))
        elif kind in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET, _BODY_FRD):
            asked = mask & _IGNORE_POSITION != _IGNORE_POSITION
            # Only ArduPilot accepts positions as offsets from the vehicle.
            if kind != _LOCAL and asked and self._pilot.rules.needs_stream:
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
        if by_acceleration and self._state.mavlink.hover_thrust is not None:
            east, north, up = _enu(message.afx, message.afy, message.afz, yaw if turned else 0.0)
            return _attitude_for((east, north, up), heading, turn, yaw)
        setpoint = Setpoint(_masked(position, mask), _masked(velocity, mask >> 3), heading, turn)
        if all(map(math.isnan, (*setpoint.position_m, *setpoint.velocity_m_s, heading, turn))):
            raise RefusedError("Setpoint refused: neither position nor velocity", denied=True)
        return setpoint


def _attitude_of(
    message: m.MAVLink_set_attitude_target_message, spec: VehicleSpec, hover: float, *, climbs: bool
) -> AttitudeTarget | None:
    """Return the target of SET_ATTITUDE_TARGET as ArduCopter reads it; None stops the vehicle.

    If `climbs`, thrust 1 means the climb speed, 0 the descent speed. If not, thrust `hover` holds the height.
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
    thrust = min(max(message.thrust, 0.0), 1.0)
    share = 2.0 * thrust - 1.0
    climb = share * (spec.climb_speed_m_s if share > 0.0 else spec.descent_speed_m_s)
    return AttitudeTarget(
        roll,
        pitch,
        heading,
        climb if climbs else math.nan,
        (rates[0], rates[1]),
        thrust / max(hover, _LEAST_HOVER),
    )


def _attitude_for(acceleration: Position, heading: float, turn: float, yaw: float) -> AttitudeTarget:
    """Return attitude and thrust for an acceleration (east, north, up); NaN components count as 0."""
    east, north, up = (0.0 if math.isnan(part) else part for part in acceleration)
    up = max(up, _LEAST_LIFT - GRAVITY_M_S2) + GRAVITY_M_S2
    roll, pitch = attitude_of(east, north, up, yaw if math.isnan(heading) else heading)
    nose = KEEP if math.isnan(heading) else Heading.fixed(heading)
    if math.isfinite(turn):
        nose = Heading.turning(turn)
    thrust = min(math.hypot(east, north, up) / GRAVITY_M_S2, _MOST_THRUST)
    return AttitudeTarget(roll, pitch, nose, math.nan, thrust=thrust)


def _enu(north: float, east: float, down: float, yaw: float) -> Position:
    """Convert north-east-down, or forward-right-down at heading `yaw`, to east-north-up."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return north * sin + east * cos, north * cos - east * sin, -down


def _masked(vector: Position, mask: int) -> Position:
    """Return the vector with NaN for ignored components; mask bits 0, 1, 2 are north, east, down."""
    hidden = bool(mask & 3) or math.isnan(vector[0] + vector[1])
    flat = (math.nan, math.nan) if hidden else vector[:2]
    return *flat, math.nan if mask & 4 else vector[2]
