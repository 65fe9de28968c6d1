"""MAVLink profile, parameters, behaviour and stick rules of ArduPilot.

Sources: ``mode.h`` of ArduCopter, ArduPlane and Rover (custom modes), ``GCS_MAVLink_Copter.cpp`` (base
modes), ``AP_Mission.cpp``, ArduCopter's ``mode_auto.cpp`` and ``mode_guided.cpp``, the parameter references
of version 4.6, and observations of ArduCopter 4.7 (SITL).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.behaviour import (
    Action,
    BaseModes,
    BootStage,
    ColdBoot,
    FailsafeRules,
    IdleDisarm,
    MissionBehaviour,
    Mode,
    ModeTable,
    actions_by_value,
)
from sim_vehicle.autopilot.mavlink_profile import (
    COMMON_CAPABILITIES,
    Identity,
    LogBehaviour,
    MavlinkProfile,
    RefusalTexts,
)
from sim_vehicle.autopilot.parameters import FailsafeDefaults, MavParameter, Setting
from sim_vehicle.autopilot.stick_rules import Axis, StickLoss, StickRules, Sticks, bits

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec

# ArduCopter 4.7 reports 64495, which includes terrain and compass calibration; these are not simulated.
# ArduCopter sets no capability bit for the encoding of parameters (cast).
_CAPABILITIES = COMMON_CAPABILITIES | int(
    m.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | m.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | m.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
)
# Git hash of release 4.7.0, the same for all vehicles; ArduPilot sends the hash as text.
_GIT_HASH = b"1511f271"
_BY_STICKS = int(m.MAV_MODE_FLAG_STABILIZE_ENABLED | m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED)
_GUIDED = _BY_STICKS | int(m.MAV_MODE_FLAG_GUIDED_ENABLED)

# Defaults of MOT_SPIN_ARM, MOT_SPIN_MIN, MOT_SPIN_MAX and MOT_THST_EXPO.
_SPIN_ARMED, _SPIN_LEAST, _SPIN_MOST, _EXPO = 0.1, 0.15, 0.95, 0.65


def _motor_us(share: float | None, armed: bool) -> float:
    if share is None:
        return 1000.0 + 1000.0 * _SPIN_ARMED * armed
    curve = (_EXPO - 1.0 + math.sqrt((1.0 - _EXPO) ** 2 + 4.0 * _EXPO * min(share, 1.0))) / (2.0 * _EXPO)
    return 1000.0 + 1000.0 * (_SPIN_LEAST + (_SPIN_MOST - _SPIN_LEAST) * curve)


# Parameters of the first link; before 4.7 they began with SR0_ in place of MAV1_.
_STREAM_PARAMETERS = {
    "RAW_SENSORS": "MAV1_RAW_SENS",
    "EXTENDED_STATUS": "MAV1_EXT_STAT",
    "RC_CHANNELS": "MAV1_RC_CHAN",
    "POSITION": "MAV1_POSITION",
    "EXTRA1": "MAV1_EXTRA1",
    "EXTRA2": "MAV1_EXTRA2",
    "EXTRA3": "MAV1_EXTRA3",
}
UNSUPPORTED = frozenset(
    map(int, (m.MAV_CMD_DO_ORBIT, m.MAV_CMD_DO_CHANGE_ALTITUDE, m.MAV_CMD_DO_SET_ACTUATOR))
)
COPTER_MAVLINK = MavlinkProfile(
    identity=Identity(
        mav_autopilot=int(m.MAV_AUTOPILOT_ARDUPILOTMEGA),
        mav_type=int(m.MAV_TYPE_QUADROTOR),
        version=(4, 7, 0),
        custom_version=_GIT_HASH,
        capabilities=_CAPABILITIES | int(m.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET),
        banner="ArduCopter V4.7.0 (1511f271)",
    ),
    modes=ModeTable(
        rows=(
            (0, Mode.MANUAL, "STABILIZE"),
            (2, Mode.ALTITUDE, "ALT_HOLD"),
            (3, Mode.MISSION, "AUTO"),
            (4, Mode.GUIDED, "GUIDED"),
            (4, Mode.TAKEOFF, "GUIDED"),
            (5, Mode.HOLD, "LOITER"),
            (6, Mode.RTL, "RTL"),
            (9, Mode.LAND, "LAND"),
            (16, Mode.POSITION, "POSHOLD"),
            (7, Mode.CIRCLE, "CIRCLE"),
            (14, Mode.FLIP, "FLIP"),
            (20, Mode.ATTITUDE, "GUIDED_NOGPS"),
            (1, Mode.MANUAL, "ACRO"),
            (11, Mode.ALTITUDE, "DRIFT"),
            (17, Mode.HOLD, "BRAKE"),
            (18, Mode.MANUAL, "THROW"),
            (21, Mode.RTL, "SMART_RTL"),
            (24, Mode.POSITION, "ZIGZAG"),
            (27, Mode.RTL, "AUTO RTL"),
        ),
        own_hold=17,
        # FLIP can be entered from STABILIZE, ACRO and ALT_HOLD.
        flips_from=frozenset({0, 1, 2}),
        # GUIDED, LOITER, POSHOLD, GUIDED_NOGPS and ZIGZAG have ``has_user_takeoff``.
        takes_off_from=frozenset({4, 5, 16, 20, 24}),
        unready={15: ("AUTOTUNE", ""), 22: ("FLOWHOLD", ""), 23: ("FOLLOW", "Set FOLL_ENABLE = 1")},
        # AUTO, RTL, CIRCLE, LAND, BRAKE, SMART_RTL, AUTO RTL forbid arming (``Mode::allows_arming``, SITL).
        not_armable=frozenset({3, 6, 7, 9, 17, 21, 27}),
        arms_in_mission=Setting("AUTO_OPTIONS", 0.0),
        armed_texts={18: "waiting for throw"},
        refused_text="Mode change to {name} failed: {reason}",
        unknown_text="No such mode {}",
        boot=Mode.MANUAL,
        after_takeoff=Mode.GUIDED,
        after_command=Mode.GUIDED,
        base=BaseModes(_BY_STICKS, _BY_STICKS, position=_GUIDED, landing=_BY_STICKS, other=_GUIDED),
    ),
    rates_hz={m.MAVLINK_MSG_ID_HEARTBEAT: 1.0},
    truth_message=int(m.MAVLINK_MSG_ID_SIM_STATE),
    stream_parameters=_STREAM_PARAMETERS,
    motor_us=_motor_us,
    # This is MOT_THST_HOVER of ArduPilot's simulator.
    hover_share=0.39,
    gps_fix=6,
    refused_result=int(m.MAV_RESULT_FAILED),
    unknown_message_result=int(m.MAV_RESULT_FAILED),
    armed_reboot_result=int(m.MAV_RESULT_FAILED),
    unsupported=UNSUPPORTED | {int(m.MAV_CMD_DO_GO_AROUND)},
    int_only=frozenset({int(m.MAV_CMD_DO_REPOSITION)}),
    camera_by_default=False,
    hover_thrust=Setting("MOT_THST_HOVER", 0.39),
    thrust_climbs=True,
    guided_items=True,
    special_files=True,
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
PLAIN_MODES = replace(
    COPTER_MAVLINK.modes,
    own_hold=None,
    flips_from=frozenset(),
    takes_off_from=frozenset(),
    unready={},
    not_armable=frozenset(),
    arms_in_mission=None,
    armed_texts={},
    refused_text="Flight mode change failed",
    base=BaseModes(),
)
PLAIN_MAVLINK = replace(
    COPTER_MAVLINK,
    identity=replace(
        COPTER_MAVLINK.identity,
        mav_type=int(m.MAV_TYPE_GROUND_ROVER),
        capabilities=_CAPABILITIES,
        banner="ArduRover V4.7.0 (1511f271)",
    ),
    hover_thrust=None,
    # SITL has a mount by default on copters only.
    gimbal=Setting("MNT1_TYPE", 0.0),
)

_SAFETY = (
    MavParameter("BATT_FS_CRT_ACT", "critical_battery_action", integer=True, low=0, high=7),
    MavParameter("BATT_FS_LOW_ACT", "low_battery_action", integer=True, low=0, high=7),
    MavParameter("FENCE_ACTION", "fence_action", integer=True, low=0, high=5),
    MavParameter("FENCE_ALT_MAX", "fence_ceiling_m", low=10.0, high=1000.0),
    MavParameter("FENCE_ENABLE", "fence_enable", integer=True, low=0, high=1),
    MavParameter("FENCE_RADIUS", "fence_radius_m", low=30.0, high=10_000.0),
    MavParameter("FENCE_TYPE", "fence_type", integer=True, low=0, high=7),
    MavParameter("FS_GCS_ENABLE", "link_action", integer=True, low=0, high=7),
    MavParameter("FS_GCS_TIMEOUT", "link_timeout_s", low=2.0, high=120.0),
    MavParameter("GUID_TIMEOUT", "setpoint_timeout_s", low=0.1, high=5.0),
)

# Parameters of the gimbal (`wbf_mission.addons.gimbal`); by default it points down, for a mapping camera.
_MOUNT = tuple(
    MavParameter(f"MNT1_{name}", integer=integer, bits=8, value=value, stored=True, low=low, high=high)
    for name, integer, value, low, high in (
        ("DEFLT_MODE", True, 1, 0, 6),
        ("NEUTRAL_X", False, 0, -180, 180),
        ("NEUTRAL_Y", False, -90, -180, 180),
        ("NEUTRAL_Z", False, 0, -180, 180),
        ("PITCH_MAX", False, 20, -90, 90),
        ("PITCH_MIN", False, -90, -90, 90),
        ("RETRACT_X", False, 0, -180, 180),
        ("RETRACT_Y", False, 0, -180, 180),
        ("RETRACT_Z", False, 0, -180, 180),
        ("ROLL_MAX", False, 30, -180, 180),
        ("ROLL_MIN", False, -30, -180, 180),
        ("YAW_MAX", False, 180, -180, 180),
        ("YAW_MIN", False, -180, -180, 180),
    )
)


def copter_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Return the parameters of ArduCopter."""
    ceiling_cm = 100.0 * spec.max_altitude_m
    return [
        *vehicle_parameters(spec, system_id),
        MavParameter("DISARM_DELAY", integer=True, value=10.0, stored=True, bits=8, low=0, high=127),
        MavParameter("FRAME_CLASS", integer=True, value=1),
        MavParameter("FRAME_TYPE", integer=True, value=1),
        MavParameter("FS_OPTIONS", "failsafe_options", integer=True, low=0, high=63),
        MavParameter("LAND_SPEED", "landing_speed_m_s", True, 100.0, 10, 100.0 * spec.descent_speed_m_s),
        MavParameter("PILOT_TKOFF_ALT", "takeoff_altitude_m", False, 100.0, 50.0, ceiling_cm),
        MavParameter("RTL_ALT", "return_altitude_m", True, 100.0, 50, ceiling_cm),
        MavParameter("WPNAV_ACCEL", value=100.0 * spec.acceleration_m_s2),
        MavParameter("WPNAV_RADIUS", "acceptance_radius_m", False, 100.0, 5.0, 20_000.0),
        MavParameter("WPNAV_SPEED", "cruise_speed_m_s", False, 100.0, 10.0, 100.0 * spec.top_speed_m_s),
        MavParameter("WPNAV_SPEED_DN", value=100.0 * spec.descent_speed_m_s),
        MavParameter("WPNAV_SPEED_UP", value=100.0 * spec.climb_speed_m_s),
    ]


def vehicle_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Return the parameters common to ArduCopter, ArduPlane and Rover.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> "LAND_SPEED" in [parameter.name for parameter in vehicle_parameters(get_vehicle("rover"), 1)]
    False
    """
    return [
        *_SAFETY,
        # Storage for the plan on the SD card (KiB), read at boot; 0 selects the storage of the board.
        MavParameter("BRD_SD_FENCE", integer=True, value=0.0, stored=True, bits=16, low=0, high=64),
        MavParameter("BRD_SD_MISSION", integer=True, value=0.0, stored=True, bits=16, low=0, high=64),
        *_battery_parameters(spec),
        *_MOUNT,
        MavParameter("FENCE_TOTAL", integer=True),
        MavParameter("MIS_TOTAL", integer=True),
        MavParameter("RALLY_TOTAL", integer=True),
        MavParameter("MAV_SYSID", integer=True, value=system_id),
    ]


def _battery_parameters(spec: VehicleSpec) -> list[MavParameter]:
    if spec.battery is None:
        return []
    mah = spec.battery.capacity_mah
    return [
        MavParameter("BATT_CAPACITY", integer=True, value=round(mah)),
        MavParameter("BATT_CRT_VOLT", "critical_voltage_v", low=0.0, high=100.0),
        MavParameter("BATT_FS_VOLTSRC", "low_voltage_source", integer=True, low=0, high=1),
        MavParameter("BATT_LOW_TIMER", "low_voltage_timer_s", integer=True, low=0, high=120),
        MavParameter("BATT_LOW_VOLT", "low_voltage_v", low=0.0, high=100.0),
        MavParameter("BATT_CRT_MAH", "critical_fraction", scale=mah, low=0.0, high=0.5 * mah),
        MavParameter("BATT_LOW_MAH", "low_fraction", scale=mah, low=0.0, high=0.9 * mah),
    ]


_HOME = frozenset({int(m.MAVLINK_MSG_ID_HOME_POSITION)})
_PLACE = _HOME | {int(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT), int(m.MAVLINK_MSG_ID_GPS_RAW_INT)}
_ACCELS, _GYROS = "Accels inconsistent", "Gyros inconsistent"
# The times are from ArduCopter 4.7 (SITL), in simulated seconds.
COLD_BOOT = ColdBoot(
    stages=(
        BootStage(0.0, _ACCELS, untold=_PLACE),
        BootStage(8.5, _ACCELS, untold=_HOME),
        BootStage(10.0, _ACCELS, fix=1, tells_place=True, untold=_HOME),
        BootStage(10.2, _ACCELS, fix=6, tells_place=True, untold=_HOME),
        BootStage(18.5, _GYROS, fix=6, tells_place=True, untold=_HOME),
        BootStage(20.0, _GYROS, fix=6, tells_place=True, text="EKF3 IMU0 origin set"),
        BootStage(23.5, fix=6, tells_place=True),
        BootStage(40.0, fix=6, tells_place=True, knows_position=True, text="EKF3 IMU0 is using GPS"),
    ),
    blind_flags=167,
    blind_modes=frozenset({Mode.MANUAL, Mode.ALTITUDE}),
    no_position="Need Position Estimate",
)

MISSION = MissionBehaviour(
    restarts_leg=True,
    clamps_item=False,
    obeys_mark=False,
    keeps_jumps=True,
    clears_in_flight=False,
    stays_after_last=True,
    start_resumes=True,
    forgets_speed_in=frozenset({Mode.MISSION, Mode.GUIDED}),
    pauses_shots=False,
    tells_shots=True,
    changed_texts=("Mission: {} WP", "Auto mission changed, restarted command"),
    restart_failed_text="Auto mission changed but failed to restart command",
    empty_mission_text="Mode requires mission",
    stopped_state=True,
)


def battery_actions(**actions: str) -> tuple[Mapping[int, Action], ...]:
    """Return the actions at the low, critical and emergency battery levels; the last level only warns."""
    by_value = actions_by_value(**actions)
    return by_value, by_value, actions_by_value(WARN="0 1 2 3 4 5 6 7")


COPTER_RULES = FailsafeRules(
    fence_actions=actions_by_value(WARN="0", RETURN="1 3", LAND="2 5", HOLD="4"),
    link_actions=actions_by_value(NONE="0", RETURN="1 2 3 4 6", LAND="5", HOLD="7"),
    battery_actions=battery_actions(WARN="0", LAND="1", RETURN="2 3 4 6 7", TERMINATE="5"),
    critical_apart=True,
    watches_voltage=True,
    any_inclusion=False,
    needs_stream=False,
    pauses_in_mode=True,
    yaws_to_setpoint=True,
    fences_setpoints=True,
    tells_link_loss=False,
    preflight="PreArm",
    arming_texts=("Arm: {}",),
    fence_text="Fence breached: {}",
    fence_clear="Fence breach cleared",
    link_lost="GCS Failsafe",
    link_regained="GCS Failsafe Cleared",
    stream_lost="Guided timeout: {}",
    # ArduCopter only warns by default; the simulated vehicle returns (low level) or lands (critical).
    defaults=FailsafeDefaults(
        fence_enable=0,
        fence_action=1,
        fence_ceiling_m=100.0,
        fence_radius_m=300.0,
        link_timeout_s=5.0,
        failsafe_options=16,
        setpoint_timeout_s=3.0,
        low_battery_action=2,
        critical_battery_action=1,
        low_voltage_v=10.5,
    ),
    mission_goes_on_bit=2,
    link_ignored="GCS Failsafe - Continuing Auto Mode",
    armed="Arming motors",
    disarmed="Disarming motors",
    disarming_text="",
    landed=("Disarming motors",),
    idle=IdleDisarm(Setting("DISARM_DELAY", 10.0), ("Disarming motors",)),
)

# Failsafes common to ArduPlane and Rover.
PLAIN_RULES = replace(
    COPTER_RULES,
    mission_goes_on_bit=0,
    # Unlike in ArduCopter, action 1 is a return, and action 2 is a landing (ArduPlane) or a hold (Rover).
    defaults=replace(
        COPTER_RULES.defaults, low_battery_action=1, critical_battery_action=2, low_voltage_v=0.0
    ),
    armed="Throttle armed",
    disarmed="Throttle disarmed",
    landed=("Throttle disarmed",),
    idle=None,
)

_BRAKE, _DRIFT, _THROW = 17, 11, 18
RELEASE = Setting("RC_OVERRIDE_TIME", 3.0)
# RCn_DZ of ArduPlane and Rover: 30 us out of 400 us on each side.
DEADZONE = Axis(0.075)
COPTER_STICKS = StickRules(
    # In modes other than LOITER, sticks set the lean angle, so the vehicle's maximum speed applies.
    speeds={
        Mode.HOLD: Setting("LOIT_SPEED", 1250.0, 0.01),
        Mode.POSITION: None,
        Mode.ALTITUDE: None,
        Mode.MANUAL: None,
    },
    # RC1_DZ and RC4_DZ as fractions of 500 us; for the throttle, THR_DZ as a fraction of 500.
    level=Axis(0.04),
    vertical=Axis(0.2),
    turning=Axis(0.04),
    turn_rate=Setting("PILOT_Y_RATE", 202.5, math.radians(1.0)),
    climb=Setting("PILOT_SPEED_UP", 250.0, 0.01),
    descent=Setting("PILOT_SPEED_DN", 0.0, 0.01),
    without=frozenset({_BRAKE, _THROW}),
    coordinated=frozenset({_DRIFT}),
    # The throttle of SITL's receiver is at 1000 us (AP_RCProtocol_UDP.cpp).
    receiver=Sticks(up=-1.0),
    overrides=True,
    loss=StickLoss(
        timeout=Setting("RC_FS_TIMEOUT", 1.0),
        action=Setting("FS_THR_ENABLE", 1.0),
        actions=actions_by_value(NONE="0", RETURN="1 2 4 6", LAND="3 5", HOLD="7"),
        release=RELEASE,
        # Bits of FS_OPTIONS.
        exceptions=bits(MISSION=1, GUIDED=4, LAND=8),
        on_ground=Action.DISARM,
        arming=Setting("FS_THR_ENABLE", 1.0),
        lost="Radio Failsafe",
        ignored={
            Mode.MISSION: "Radio Failsafe - Continuing Auto Mode",
            Mode.GUIDED: "Radio Failsafe - Continuing Guided Mode",
            Mode.LAND: "Radio Failsafe - Continuing Landing",
        },
        regained="Radio Failsafe Cleared",
    ),
)
