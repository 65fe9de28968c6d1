"""PX4 as its MAVLink peers see it.

Sources: PX4 ``px4_custom_mode.h``, ``mavlink_main.cpp`` (rates), ``Commander.cpp`` and ``ModeUtil`` (texts)
and what PX4 1.17 (SIH) was seen to do.
"""

from __future__ import annotations

from functools import partial
from types import MappingProxyType

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.mavlink_profile import (
    COMMON_CAPABILITIES,
    Identity,
    LogBehaviour,
    MavlinkProfile,
    ModeTable,
    RefusalTexts,
    px4_custom_mode,
)
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.reference_parameters import parameter_details

__all__ = ["mavlink_profile"]

_DETAILS = partial(parameter_details, "px4")

_RATES_HZ = MappingProxyType(
    {
        m.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
        m.MAVLINK_MSG_ID_ATTITUDE: 10.0,
        m.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 5.0,
        m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 5.0,
        m.MAVLINK_MSG_ID_VFR_HUD: 5.0,
        m.MAVLINK_MSG_ID_ALTITUDE: 1.0,
        m.MAVLINK_MSG_ID_HIGHRES_IMU: 1.0,
        m.MAVLINK_MSG_ID_ODOMETRY: 1.0,
        m.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
        m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
        m.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        m.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
        m.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
        m.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        m.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    }
)
_MODES = ModeTable(
    numbers=MappingProxyType(
        {
            Mode.MANUAL: px4_custom_mode(1),
            Mode.ALTITUDE: px4_custom_mode(2),
            Mode.POSITION: px4_custom_mode(3),
            Mode.TAKEOFF: px4_custom_mode(4, 2),
            Mode.HOLD: px4_custom_mode(4, 3),
            Mode.MISSION: px4_custom_mode(4, 4),
            Mode.RTL: px4_custom_mode(4, 5),
            Mode.LAND: px4_custom_mode(4, 6),
            Mode.GUIDED: px4_custom_mode(6),
        }
    ),
    aliases=MappingProxyType(
        {
            px4_custom_mode(4, 1): Mode.HOLD,
            px4_custom_mode(5): Mode.MANUAL,
            px4_custom_mode(7): Mode.MANUAL,
        }
    ),
    boot=Mode.HOLD,
    after_takeoff=Mode.HOLD,
    after_command=Mode.HOLD,
    orbit=px4_custom_mode(3, 1),
    names=MappingProxyType(
        {
            px4_custom_mode(1): "Manual",
            px4_custom_mode(2): "Altitude",
            px4_custom_mode(3): "Position",
            px4_custom_mode(4, 1): "Hold",
            px4_custom_mode(4, 2): "Takeoff",
            px4_custom_mode(4, 3): "Hold",
            px4_custom_mode(4, 4): "Mission",
            px4_custom_mode(4, 5): "Return",
            px4_custom_mode(4, 6): "Land",
            px4_custom_mode(5): "Acro",
            px4_custom_mode(6): "Offboard",
            px4_custom_mode(7): "Stabilized",
        }
    ),
    refused_text="Switching to {name} is currently not available",
    unknown_text="Unsupported auto mode",
    main_and_sub=True,
)


def mavlink_profile(mav_type: int) -> MavlinkProfile:
    """PX4's profile on a vehicle of this MAV_TYPE; all else is equal on all vehicles."""
    return MavlinkProfile(
        identity=Identity(
            mav_autopilot=int(m.MAV_AUTOPILOT_PX4),
            mav_type=int(mav_type),
            version=(1, 17, 0),
            capabilities=COMMON_CAPABILITIES | int(m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE),
        ),
        modes=_MODES,
        parameter_encoding="bytewise",
        data_streams=False,
        rates_hz=_RATES_HZ,
        truth_message=int(m.MAVLINK_MSG_ID_HIL_STATE_QUATERNION),
        reached_repeats=10,
        reached_merged=True,
        no_mission_total=65535,
        unsupported=frozenset(
            {
                int(m.MAV_CMD_CONDITION_YAW),
                int(m.MAV_CMD_DO_FENCE_ENABLE),
                int(m.MAV_CMD_DO_GO_AROUND),
                int(m.MAV_CMD_DO_PAUSE_CONTINUE),
                int(m.MAV_CMD_DO_SET_MISSION_CURRENT),
                int(m.MAV_CMD_DO_SET_RELAY),
                int(m.MAV_CMD_DO_SET_SERVO),
                int(m.MAV_CMD_DO_START_MAG_CAL),
                int(m.MAV_CMD_DO_ACCEPT_MAG_CAL),
                int(m.MAV_CMD_DO_CANCEL_MAG_CAL),
            }
        ),
        silent=frozenset({int(m.MAV_CMD_INJECT_FAILURE)}),
        takeoff_above_sea=True,
        reposition_turns=True,
        tells_remaining_time=True,
        component_metadata=_DETAILS,
        tells_calibration=True,
        refusals=RefusalTexts(
            arming="Unsupported ARM_DISARM param: {:.3f}", current_item="WPM: WP CURR CMD: Not in list"
        ),
        logs=LogBehaviour("/fs/microsd/log", by_date=True),
    )
