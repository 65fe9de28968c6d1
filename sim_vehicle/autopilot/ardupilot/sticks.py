"""ArduPilot's sticks: MANUAL_CONTROL and RC_CHANNELS_OVERRIDE, without a radio receiver beside them."""

from __future__ import annotations

import math
from types import MappingProxyType

from sim_vehicle.autopilot.failsafe_rules import Action, actions_by_value
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.setting import Setting
from sim_vehicle.autopilot.stick_rules import Axis, StickLoss, StickRules, Sticks, WingSticks, bits

__all__ = ["COPTER_STICKS", "PLANE_STICKS", "ROVER_STICKS"]

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
