"""ArduPilot's flight telemetry: navigation targets and errors, outputs, sensors, estimators.

Source: ArduPilot's ``GCS_Common.cpp``, ``GCS_MAVLink_Copter.cpp`` and the constants of its simulator (SITL).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.mavlink.wire_state import UNUSED, int16_vector

if TYPE_CHECKING:
    from sim_vehicle.mavlink.wire_state import WireState
    from sim_vehicle.motion.legs import Position

__all__ = ["ARDUPILOT_BUILDERS", "STREAMS", "group_number", "target_leg"]

# Type mask that uses only the position, with ArduPilot's unused bits set.
_ONLY_GLOBAL_POSITION = 0xFDF8
_GAUSS = (0.25, 0.0, 0.41)
_CENTIDEGREES = 2500
_BOARD_MV, _FREE_BYTES = 5000, 131_072
# TERRAIN_SPACING, and the number of 4 x 4 blocks in a grid block.
_SPACING_M, _LOADED = 100, 56
_MIDDLE_US, _LEAST_US = 1500, 1000
_MANUAL_MODES = frozenset({Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.HOLD})


def target_leg(source: WireState) -> tuple[Position, Position] | None:
    """Return start and end of the present leg; None without a leg and in modes without a target."""
    pilot = source.pilot
    executor = pilot.executor
    plan = executor.flight.plan
    if plan is None or pilot.mode in _MANUAL_MODES or executor.flight.phase is FlightPhase.STEERED:
        return None
    leg = min(executor.motion.leg, len(plan.legs) - 1)
    return plan.legs[leg - 1].end_m if leg else executor.flight.began_m, plan.legs[leg].end_m


def _nav_controller_output(source: WireState) -> Message:
    x, y, z = source.pilot.state.position_m
    bearing = distance = rise = aside = 0.0
    target = target_leg(source)
    if target is not None:
        (ax, ay, az), (bx, by, bz) = target
        distance, bearing = math.hypot(bx - x, by - y), math.degrees(math.atan2(bx - x, by - y))
        length = math.hypot(bx - ax, by - ay)
        share = 1.0
        if length > 0.0:
            ux, uy = (bx - ax) / length, (by - ay) / length
            aside = (x - ax) * uy - (y - ay) * ux
            share = min(max(((x - ax) * ux + (y - ay) * uy) / length, 0.0), 1.0)
        rise = az + share * (bz - az) - z
    roll, pitch, yaw = map(math.degrees, source.angles_rad)
    return m.MAVLink_nav_controller_output_message(
        roll, pitch, round(yaw), round(bearing), min(round(distance), UNUSED), rise, 0.0, aside
    )


def _position_target_global_int(source: WireState) -> Message | None:
    target = target_leg(source)
    if target is None:
        return None
    latitude, longitude, altitude_mm = source.e7_of(target[1])
    return m.MAVLink_position_target_global_int_message(
        source.boot_ms, 0, _ONLY_GLOBAL_POSITION, latitude, longitude, altitude_mm / 1000.0, *[0.0] * 8
    )


def _servo_output_raw(source: WireState) -> Message:
    state, spec = source.pilot.state, source.pilot.spec
    flies = state.armed and state.landed is not LandedState.ON_GROUND
    share = state.throttle if flies else 0.0
    if spec.hovers:
        if flies and source.pilot.executor.motion.attitude() is None:
            east, north, up = state.acceleration_m_s2
            share = source.mavlink.hover_share * math.hypot(east, north, up + GRAVITY_M_S2) / GRAVITY_M_S2
        outputs = (round(source.mavlink.motor_us(share if flies else None, state.armed)),) * 4
    else:
        turn = 0.0 if not flies else state.yaw_rate_rad_s / spec.yaw_rate_rad_s
        turn = state.roll_rad / (0.25 * math.pi) if spec.circles else turn
        thrust = 500.0 * share + _MIDDLE_US if spec.drives else _LEAST_US + 1000.0 * share
        steered = round(_MIDDLE_US + 500.0 * min(max(turn, -1.0), 1.0))
        outputs = (steered, _MIDDLE_US, round(thrust), _MIDDLE_US)
    return m.MAVLink_servo_output_raw_message(source.boot_ms * 1000 & 0xFFFFFFFF, 0, *outputs, 0, 0, 0, 0)


def _readings(source: WireState, *further: int) -> list[int]:
    """Return accelerometer (1e-3 g), gyroscope (mrad/s) and compass (mgauss) as forward, right, down."""
    return [
        *int16_vector(source.force_m_s2, 1000.0, GRAVITY_M_S2),
        *int16_vector(source.body_rates(), 1000.0),
        *int16_vector(source.to_body(*_GAUSS), 1000.0),
        *further,
    ]


def _ahrs2(source: WireState) -> Message:
    """AHRS2, the second estimator, with the unfiltered GPS position."""
    latitude, longitude, altitude_mm = source.e7_of(source.sensed.gps_m)
    return m.MAVLink_ahrs2_message(*source.angles_rad, altitude_mm / 1000.0, latitude, longitude)


def _terrain_report(source: WireState) -> Message:
    """TERRAIN_REPORT for flat terrain at the altitude of home."""
    height_m = source.sensed.believed_m[2]
    return m.MAVLink_terrain_report_message(
        *source.position_e7[:2], _SPACING_M, source.home.altitude_m, height_m, 0, _LOADED
    )


ARDUPILOT_BUILDERS: dict[int, Callable[[WireState], Message | None]] = {
    m.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: _nav_controller_output,
    m.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: _position_target_global_int,
    m.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output_raw,
    m.MAVLINK_MSG_ID_RAW_IMU: lambda s: m.MAVLink_raw_imu_message(
        s.boot_ms * 1000, *_readings(s, 0, _CENTIDEGREES)
    ),
    m.MAVLINK_MSG_ID_SCALED_IMU2: lambda s: m.MAVLink_scaled_imu2_message(
        s.boot_ms, *_readings(s, _CENTIDEGREES)
    ),
    m.MAVLINK_MSG_ID_POWER_STATUS: lambda _: m.MAVLink_power_status_message(_BOARD_MV, 0, 0),
    m.MAVLINK_MSG_ID_MEMINFO: lambda _: m.MAVLink_meminfo_message(0, UNUSED, _FREE_BYTES),
    # The simulated gyroscopes do not drift.
    m.MAVLINK_MSG_ID_AHRS: lambda _: m.MAVLink_ahrs_message(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    m.MAVLINK_MSG_ID_AHRS2: _ahrs2,
    m.MAVLINK_MSG_ID_TERRAIN_REPORT: _terrain_report,
}
"""Builders by message id; a builder returns None if there is nothing to send."""

_GROUPS = {
    "RAW_SENSORS": "RAW_IMU SCALED_IMU2 SCALED_PRESSURE",
    "EXTENDED_STATUS": "SYS_STATUS POWER_STATUS MEMINFO MISSION_CURRENT GPS_RAW_INT NAV_CONTROLLER_OUTPUT "
    "POSITION_TARGET_GLOBAL_INT EXTENDED_SYS_STATE",
    "POSITION": "GLOBAL_POSITION_INT LOCAL_POSITION_NED",
    "RC_CHANNELS": "SERVO_OUTPUT_RAW RC_CHANNELS",
    "EXTRA1": "ATTITUDE AHRS2",
    "EXTRA2": "VFR_HUD",
    "EXTRA3": "AHRS SYSTEM_TIME WIND TERRAIN_REPORT BATTERY_STATUS GIMBAL_DEVICE_ATTITUDE_STATUS "
    "EKF_STATUS_REPORT VIBRATION",
}


def _ids(names: str) -> tuple[int, ...]:
    return tuple(getattr(m, f"MAVLINK_MSG_ID_{name}") for name in names.split())


def group_number(name: str) -> int:
    """Return the number of a MAV_DATA_STREAM from its name."""
    return int(getattr(m, f"MAV_DATA_STREAM_{name}"))


STREAMS: dict[int, tuple[int, ...]] = {
    m.MAV_DATA_STREAM_ALL: _ids(" ".join(_GROUPS.values())),
    **{group_number(name): _ids(names) for name, names in _GROUPS.items()},
}
"""Messages of each REQUEST_DATA_STREAM stream on ArduPilot."""
