"""ArduCopter, ArduPlane and Rover as their MAVLink peers see them.

Sources of the custom modes: ``mode.h`` of ArduCopter, ArduPlane and Rover; of ArduCopter's base modes its
``GCS_MAVLink_Copter.cpp``.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.mav_parameter import Setting
from sim_vehicle.autopilot.mavlink_profile import (
    COMMON_CAPABILITIES,
    BaseModes,
    Identity,
    LogBehaviour,
    MavlinkProfile,
    ModeTable,
    RefusalTexts,
)
from sim_vehicle.autopilot.modes import Mode

__all__ = ["COPTER_MAVLINK", "PLANE_MAVLINK", "ROVER_MAVLINK"]

# ArduCopter 4.7 claims 64495: terrain and compass calibration besides, which the simulated one does not do.
# It says nothing of how parameters are encoded (they are cast).
_CAPABILITIES = COMMON_CAPABILITIES | int(
    m.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | m.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | m.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
)
_STICKS = int(m.MAV_MODE_FLAG_STABILIZE_ENABLED | m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED)
_GUIDED = _STICKS | int(m.MAV_MODE_FLAG_GUIDED_ENABLED)

_UNSUPPORTED = frozenset(
    int(command)
    for command in (
        m.MAV_CMD_DO_ORBIT,
        m.MAV_CMD_DO_CHANGE_ALTITUDE,
        m.MAV_CMD_DO_SET_ACTUATOR,
    )
)
# SITL gives copters a mount, planes and rovers none until it is set.
_NO_MOUNT = Setting("MNT1_TYPE", 0.0)
COPTER_MAVLINK = MavlinkProfile(
    identity=Identity(
        mav_autopilot=int(m.MAV_AUTOPILOT_ARDUPILOTMEGA),
        mav_type=int(m.MAV_TYPE_QUADROTOR),
        version=(4, 6, 0),
        capabilities=_CAPABILITIES | int(m.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET),
    ),
    modes=ModeTable(
        numbers=MappingProxyType(
            {
                Mode.MANUAL: 0,
                Mode.ALTITUDE: 2,
                Mode.MISSION: 3,
                Mode.GUIDED: 4,
                Mode.TAKEOFF: 4,
                Mode.HOLD: 5,
                Mode.RTL: 6,
                Mode.LAND: 9,
                Mode.POSITION: 16,
                Mode.CIRCLE: 7,
                Mode.FLIP: 14,
                Mode.ATTITUDE: 20,
            }
        ),
        aliases=MappingProxyType(
            {
                1: Mode.MANUAL,
                11: Mode.ALTITUDE,
                13: Mode.ALTITUDE,
                17: Mode.HOLD,
                21: Mode.RTL,
                24: Mode.POSITION,
                27: Mode.RTL,
            }
        ),
        own_hold=17,
        # STABILIZE, ACRO, ALT_HOLD.
        flips_from=frozenset({0, 1, 2}),
        names=MappingProxyType(
            {
                0: "STABILIZE",
                1: "ACRO",
                2: "ALT_HOLD",
                3: "AUTO",
                4: "GUIDED",
                5: "LOITER",
                6: "RTL",
                7: "CIRCLE",
                9: "LAND",
                11: "DRIFT",
                13: "SPORT",
                14: "FLIP",
                16: "POSHOLD",
                17: "BRAKE",
                20: "GUIDED_NOGPS",
                21: "SMART_RTL",
                24: "ZIGZAG",
                27: "AUTO RTL",
            }
        ),
        refused_text="Mode change to {name} failed: {reason}",
        unknown_text="No such mode {}",
        boot=Mode.MANUAL,
        after_takeoff=Mode.GUIDED,
        after_command=Mode.GUIDED,
        base=BaseModes(_STICKS, _STICKS, position=_GUIDED, landing=_STICKS, other=_GUIDED),
    ),
    parameter_encoding="cast",
    data_streams=True,
    rates_hz=MappingProxyType({m.MAVLINK_MSG_ID_HEARTBEAT: 1.0}),
    truth_message=int(m.MAVLINK_MSG_ID_SIM_STATE),
    gps_fix=6,
    refused_result=int(m.MAV_RESULT_FAILED),
    unknown_message_result=int(m.MAV_RESULT_FAILED),
    armed_reboot_result=int(m.MAV_RESULT_FAILED),
    unsupported=_UNSUPPORTED | {int(m.MAV_CMD_DO_GO_AROUND)},
    int_only=frozenset({int(m.MAV_CMD_DO_REPOSITION)}),
    takeoff_needs_arming=True,
    flies_attitudes=True,
    guided_items=True,
    packed_parameters=True,
    packed_plans=True,
    system_files=True,
    calibration_text="Disarm to allow calibration",
    refusals=RefusalTexts(
        interval="No ap_message for mavlink id ({})", landing="Unable to start landing sequence"
    ),
    gimbal=Setting("MNT1_TYPE", 1.0),
    logs=LogBehaviour(
        "/APM/LOGS",
        first_number=1,
        refusal_armed="Disarm for log download",
        busy_text="Log download in progress",
    ),
)
PLANE_MAVLINK = replace(
    COPTER_MAVLINK,
    identity=replace(
        COPTER_MAVLINK.identity,
        mav_type=int(m.MAV_TYPE_FIXED_WING),
        capabilities=_CAPABILITIES,
        version=(4, 7, 0),
        banner="ArduPlane V4.7.0",
    ),
    modes=replace(
        COPTER_MAVLINK.modes,
        numbers=MappingProxyType(
            {
                Mode.MANUAL: 0,
                Mode.ALTITUDE: 6,
                Mode.POSITION: 7,
                Mode.MISSION: 10,
                Mode.RTL: 11,
                Mode.HOLD: 12,
                Mode.TAKEOFF: 13,
                Mode.GUIDED: 15,
                Mode.LAND: 26,
            }
        ),
        aliases=MappingProxyType(
            {1: Mode.HOLD, 2: Mode.MANUAL, 3: Mode.MANUAL, 4: Mode.MANUAL, 5: Mode.MANUAL, 8: Mode.MANUAL}
        ),
        own_hold=None,
        flips_from=frozenset(),
        refused_text="Flight mode change failed",
        after_takeoff=Mode.TAKEOFF,
        base=BaseModes(),
    ),
    unsupported=_UNSUPPORTED | {int(m.MAV_CMD_CONDITION_YAW)},
    flies_attitudes=False,
    gimbal=_NO_MOUNT,
)
ROVER_MAVLINK = replace(
    COPTER_MAVLINK,
    identity=replace(
        COPTER_MAVLINK.identity,
        mav_type=int(m.MAV_TYPE_GROUND_ROVER),
        capabilities=_CAPABILITIES,
        banner="ArduRover V4.6.0",
    ),
    modes=replace(
        COPTER_MAVLINK.modes,
        numbers=MappingProxyType(
            {
                Mode.MANUAL: 0,
                Mode.ALTITUDE: 1,
                Mode.POSITION: 3,
                Mode.HOLD: 4,
                Mode.MISSION: 10,
                Mode.RTL: 11,
                Mode.GUIDED: 15,
                Mode.TAKEOFF: 15,
                Mode.LAND: 4,
            }
        ),
        own_hold=None,
        flips_from=frozenset(),
        refused_text="Flight mode change failed",
        aliases=MappingProxyType({5: Mode.HOLD, 7: Mode.MANUAL, 12: Mode.RTL}),
        base=BaseModes(),
    ),
    unsupported=COPTER_MAVLINK.unsupported | {int(m.MAV_CMD_CONDITION_YAW)},
    flies_attitudes=False,
    gimbal=_NO_MOUNT,
)
