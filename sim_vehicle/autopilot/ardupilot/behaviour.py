"""How ArduPilot takes a mission that is changed while it flies, and how ArduCopter comes up.

Sources: ArduPilot ``AP_Mission.cpp``, ArduCopter ``mode_auto.cpp`` and ``mode_guided.cpp``, and what
ArduCopter 4.7 (SITL) was seen to do.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.cold_boot import BootStage, ColdBoot
from sim_vehicle.autopilot.failsafe_rules import (
    Action,
    FailsafeDefaults,
    FailsafeRules,
    IdleDisarm,
    actions_by_value,
)
from sim_vehicle.autopilot.mav_parameter import Setting
from sim_vehicle.autopilot.mission_behaviour import MissionBehaviour
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.stick_rules import Axis, StickLoss, StickRules, Sticks, WingSticks, bits

__all__ = [
    "COLD_BOOT",
    "COPTER_RULES",
    "COPTER_STICKS",
    "MISSION",
    "PLANE_RULES",
    "PLANE_STICKS",
    "ROVER_RULES",
    "ROVER_STICKS",
]

_HOME = frozenset({int(m.MAVLINK_MSG_ID_HOME_POSITION)})
_PLACE = _HOME | {int(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT), int(m.MAVLINK_MSG_ID_GPS_RAW_INT)}
_ACCELS, _GYROS = "Accels inconsistent", "Gyros inconsistent"
# Times of ArduCopter 4.7 (SITL), in its own seconds.
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
    forgets_speed_in=frozenset({Mode.MISSION, Mode.GUIDED}),
    pauses_shots=False,
    tells_shots=True,
    changed_texts=("Mission: {} WP", "Auto mission changed, restarted command"),
    restart_failed_text="Auto mission changed but failed to restart command",
    empty_mission_text="Mode requires mission",
    stopped_state=True,
)


_BATTERY = actions_by_value(WARN="0", LAND="1", RETURN="2 3 4 6 7", TERMINATE="5")
COPTER_RULES = FailsafeRules(
    fence_actions=actions_by_value(WARN="0", RETURN="1 3", LAND="2 5", HOLD="4"),
    link_actions=actions_by_value(NONE="0", RETURN="1 2 3 4 6", LAND="5", HOLD="7"),
    battery_actions=(_BATTERY, _BATTERY, actions_by_value(WARN="0 1 2 3 4 5 6 7")),
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
    # The simulated vehicle returns at a low and lands at a critical battery; ArduCopter itself only warns.
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

# ArduPlane's and Rover's own numbers; a low and a critical battery end the flight as the copter's do.
_PLANE_ROVER_DEFAULTS = replace(
    COPTER_RULES.defaults, low_battery_action=1, critical_battery_action=2, low_voltage_v=0.0
)
_PLANE_BATTERY = actions_by_value(WARN="0", RETURN="1 6", LAND="2 4 5", TERMINATE="3")
PLANE_RULES = replace(
    COPTER_RULES,
    fence_actions=actions_by_value(WARN="0", RETURN="1 6 7", HOLD="8", LAND="9"),
    link_actions=actions_by_value(NONE="0", RETURN="1 2 3"),
    mission_goes_on_bit=0,
    battery_actions=(_PLANE_BATTERY, _PLANE_BATTERY, actions_by_value(WARN="0 1 2 3 4 5 6 7")),
    defaults=_PLANE_ROVER_DEFAULTS,
    armed="Throttle armed",
    disarmed="Throttle disarmed",
    landed=("Throttle disarmed", "Auto disarmed"),
    idle=None,
)
_ROVER_BATTERY = actions_by_value(WARN="0", RETURN="1 3 4", HOLD="2 6", TERMINATE="5")
ROVER_RULES = replace(
    COPTER_RULES,
    fence_actions=actions_by_value(WARN="0", RETURN="1 3", HOLD="2 4 5"),
    link_actions=actions_by_value(NONE="0", RETURN="1 2"),
    mission_goes_on_bit=0,
    battery_actions=(_ROVER_BATTERY, _ROVER_BATTERY, actions_by_value(WARN="0 1 2 3 4 5 6 7")),
    defaults=_PLANE_ROVER_DEFAULTS,
    armed="Throttle armed",
    disarmed="Throttle disarmed",
    landed=("Throttle disarmed",),
    idle=None,
)


_BRAKE, _DRIFT = 17, 11
_RELEASE = Setting("RC_OVERRIDE_TIME", 3.0)
# RCn_DZ: 30 of the 400 microseconds to either side.
_DEADZONE = Axis(0.075)
COPTER_STICKS = StickRules(
    # Leaning with the sticks, as all but LOITER do, ends at the vehicle's greatest speed.
    speeds=MappingProxyType(
        {
            Mode.HOLD: Setting("LOIT_SPEED", 1250.0, 0.01),
            Mode.POSITION: None,
            Mode.ALTITUDE: None,
            Mode.MANUAL: None,
        }
    ),
    # RC1_DZ and RC4_DZ of 500 microseconds, THR_DZ of the throttle's 500.
    level=Axis(0.04),
    vertical=Axis(0.2),
    turning=Axis(0.04),
    turn_rate=Setting("PILOT_Y_RATE", 202.5, math.radians(1.0)),
    climb=Setting("PILOT_SPEED_UP", 250.0, 0.01),
    descent=Setting("PILOT_SPEED_DN", 0.0, 0.01),
    without=frozenset({_BRAKE}),
    coordinated=frozenset({_DRIFT}),
    # SITL's receiver has its throttle at 1000 microseconds (AP_RCProtocol_UDP.cpp).
    receiver=Sticks(up=-1.0),
    overrides=True,
    loss=StickLoss(
        timeout=Setting("RC_FS_TIMEOUT", 1.0),
        action=Setting("FS_THR_ENABLE", 1.0),
        actions=actions_by_value(NONE="0", RETURN="1 2 4 6", LAND="3 5", HOLD="7"),
        release=_RELEASE,
        # FS_OPTIONS.
        exceptions=bits(MISSION=1, GUIDED=4, LAND=8),
        on_ground=Action.DISARM,
        arming=Setting("FS_THR_ENABLE", 1.0),
        lost="Radio Failsafe",
        ignored="Radio Failsafe - Continuing {}",
        regained="Radio Failsafe Cleared",
    ),
)
_DEGREE = math.radians(1.0)
# MANUAL, TRAINING, ACRO, AUTOTUNE.
_BY_HAND = frozenset({0, 3, 4, 8})
_WING = WingSticks(
    bank=Setting("ROLL_LIMIT_DEG", 45.0, _DEGREE),
    up=Setting("PTCH_LIM_MAX_DEG", 20.0, _DEGREE),
    down=Setting("PTCH_LIM_MIN_DEG", -25.0, _DEGREE),
)
PLANE_STICKS = StickRules(
    # STABILIZE and FBWA, FBWB, CRUISE.
    speeds=MappingProxyType({Mode.MANUAL: None, Mode.ALTITUDE: None, Mode.POSITION: None}),
    level=_DEADZONE,
    vertical=_DEADZONE,
    turning=_DEADZONE,
    turn_rate=Setting("ROLL_LIMIT_DEG", 45.0, _DEGREE),
    wings=MappingProxyType(dict.fromkeys((Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION), _WING)),
    landing_abort=Setting("LAND_ABORT_THR", 0.0),
    without=_BY_HAND,
    overrides=True,
    pwm_half=400.0,
    loss=StickLoss(
        timeout=Setting("RC_FS_TIMEOUT", 1.0),
        action=Setting("FS_LONG_ACTN", 0.0),
        actions=actions_by_value(NONE="0", RETURN="1"),
        exceptions=bits(),
        in_stick_modes=Action.RETURN,
        release=_RELEASE,
        delay=Setting("FS_LONG_TIMEOUT", 5.0),
        arming=Setting("THR_FAILSAFE", 1.0),
        delayed="RC Short Failsafe: switched to CIRCLE",
        lost="RC Long Failsafe: switched to RTL",
        regained="RC Failsafe Cleared",
    ),
)
ROVER_STICKS = StickRules(
    speeds=MappingProxyType({Mode.MANUAL: None, Mode.ALTITUDE: None, Mode.POSITION: None}),
    level=_DEADZONE,
    vertical=_DEADZONE,
    turning=_DEADZONE,
    turn_rate=Setting("ATC_STR_RAT_MAX", 120.0, math.radians(1.0)),
    overrides=True,
    drives=True,
    throttle_middle=0.0,
    pwm_half=400.0,
    loss=StickLoss(
        timeout=Setting("FS_TIMEOUT", 1.5),
        action=Setting("FS_ACTION", 2.0),
        actions=actions_by_value(NONE="0", RETURN="1 3", HOLD="2 4 6", TERMINATE="5"),
        release=_RELEASE,
        exceptions=bits(),
        arming=Setting("FS_THR_ENABLE", 1.0),
        lost="Radio Failsafe",
        regained="Radio Failsafe Cleared",
    ),
)
