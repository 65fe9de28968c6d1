"""How PX4 takes a mission that is changed while it flies.

Sources: PX4 v1.17 ``mission_base.cpp``, ``mission.cpp``, ``mavlink_mission.cpp``, and what PX4 1.17 (SIH) was
seen to do.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

from sim_vehicle.autopilot.failsafe_rules import Action, FailsafeRules, IdleDisarm, actions_by_value
from sim_vehicle.autopilot.mav_parameter import Setting
from sim_vehicle.autopilot.mavlink_profile import px4_custom_mode
from sim_vehicle.autopilot.mission_behaviour import MissionBehaviour, px4_takeoff_and_landing
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.stick_rules import Axis, StickLoss, StickRules, TiltSticks, WingSticks, bits
from sim_vehicle.motion.px4.parameters import drag_of

__all__ = [
    "COPTER_STICKS",
    "FIXED_WING_RULES",
    "FIXED_WING_STICKS",
    "MISSION",
    "ROVER_RULES",
    "ROVER_STICKS",
    "RULES",
]

MISSION = MissionBehaviour(
    replays_speed=True,
    rewinds_survey=True,
    return_lag_s=0.3,
    finished_texts=("Mission finished, loitering", "Mission finished, landed"),
    return_text="Returning to launch",
    no_mission_text="No valid mission available, loitering",
    unknown_current_s=0.5,
    refuses=px4_takeoff_and_landing,
)


RULES = FailsafeRules(
    fence_actions=actions_by_value(NONE="0", WARN="1", HOLD="2", RETURN="3", TERMINATE="4", LAND="5"),
    link_actions=actions_by_value(NONE="0", HOLD="1", RETURN="2", LAND="3", TERMINATE="5 6"),
    # PX4 no longer uses 1; the simulated vehicle then returns at the low level.
    battery_actions=(
        actions_by_value(WARN="0 2 3", RETURN="1"),
        actions_by_value(WARN="0", LAND="1 2", RETURN="3"),
        actions_by_value(WARN="0", LAND="1 2 3"),
    ),
    critical_apart=False,
    watches_voltage=False,
    any_inclusion=True,
    needs_stream=True,
    pauses_in_mode=False,
    yaws_to_setpoint=False,
    fences_setpoints=False,
    tells_link_loss=True,
    preflight="Preflight Fail",
    arming_texts=("Preflight Fail: {}", "Arming denied: Resolve system health failures first"),
    fence_text="Geofence violated: {}",
    fence_clear="Geofence violation cleared",
    link_lost="Data link lost",
    link_regained="Data link regained",
    stream_lost="Offboard control lost: {}",
    idle=IdleDisarm(
        Setting("COM_DISARM_PRFLT", 10.0), ("Disarmed by auto preflight disarming",), first_flight=True
    ),
    any_mode_disarmed=True,
    restores_mode=True,
    fence_refusal="Reposition is outside geofence",
    armed_by_start="Armed by mission start",
)
# PX4's defaults of its fixed wings: a mission has to land, and a return is no landing.
FIXED_WING_RULES = replace(RULES, defaults=replace(RULES.defaults, mission_requirement=2))
# An armed rover counts as one that drives.
ROVER_RULES = replace(RULES, idle=None)


_DEGREE = math.radians(1.0)
_ACRO = px4_custom_mode(5)
_AXIS = Axis(0.1, 0.6)
_LOSS = StickLoss(
    timeout=Setting("COM_RC_LOSS_T", 0.5),
    action=Setting("NAV_RCL_ACT", 2.0),
    actions=actions_by_value(NONE="0", HOLD="1", RETURN="2", LAND="3", TERMINATE="5", DISARM="6"),
    exceptions=bits(MISSION=1, HOLD=2, TAKEOFF=2, LAND=2, RTL=2, GUIDED=4),
    in_stick_modes=Action.RETURN,
    delay=Setting("COM_FAIL_ACT_T", 5.0),
    lost="Failsafe activated",
    delayed="Failsafe activated: entering Hold for {:.0f} seconds",
)
COPTER_STICKS = StickRules(
    speeds=MappingProxyType(
        {Mode.POSITION: Setting("MPC_VEL_MANUAL", 10.0), Mode.ALTITUDE: None, Mode.MANUAL: None}
    ),
    needed=frozenset({Mode.POSITION, Mode.ALTITUDE, Mode.MANUAL}),
    level=_AXIS,
    vertical=_AXIS,
    turning=_AXIS,
    turn_rate=Setting("MPC_MAN_Y_MAX", 150.0, _DEGREE),
    # Without a value of their own, the vehicle's vertical speeds.
    climb=Setting("MPC_Z_VEL_MAX_UP", 0.0),
    descent=Setting("MPC_Z_VEL_MAX_DN", 0.0),
    takeoff_stick=0.3,
    tilt=TiltSticks(
        holds_height=frozenset({Mode.ALTITUDE}),
        by_throttle=frozenset({Mode.MANUAL}),
        by_rate=frozenset({_ACRO}),
        lean=Setting("MPC_MAN_TILT_MAX", 35.0, _DEGREE),
        roll_rate=Setting("MC_ACRO_R_MAX", 100.0, _DEGREE),
        pitch_rate=Setting("MC_ACRO_P_MAX", 100.0, _DEGREE),
        yaw_rate=Setting("MC_ACRO_Y_MAX", 100.0, _DEGREE),
        hover_thrust=Setting("MPC_THR_HOVER", 0.6),
        least_thrust=Setting("MPC_MANTHR_MIN", 0.08),
        most_thrust=Setting("MPC_THR_MAX", 1.0),
        hold_below=Setting("MPC_HOLD_MAX_Z", 0.6),
        drag=drag_of,
    ),
    loss=_LOSS,
)
_WHOLE = Axis(0.0)
_BY_HAND = WingSticks(
    bank=Setting("FW_MAN_R_MAX", 45.0, _DEGREE),
    up=Setting("FW_MAN_P_MAX", 30.0, _DEGREE),
    down=Setting("FW_MAN_P_MAX", 30.0, _DEGREE),
)
_BY_HEIGHT = WingSticks(
    bank=Setting("FW_R_LIM", 50.0, _DEGREE),
    up=Setting("FW_T_CLMB_R_SP", 3.0),
    down=Setting("FW_T_SINK_R_SP", 2.0),
    by_rate=True,
)
FIXED_WING_STICKS = StickRules(
    speeds=MappingProxyType({Mode.POSITION: None, Mode.ALTITUDE: None, Mode.MANUAL: None}),
    needed=COPTER_STICKS.needed,
    level=_WHOLE,
    vertical=_WHOLE,
    turning=_WHOLE,
    turn_rate=Setting("FW_R_LIM", 50.0, _DEGREE),
    wings=MappingProxyType({Mode.POSITION: _BY_HEIGHT, Mode.ALTITUDE: _BY_HEIGHT, Mode.MANUAL: _BY_HAND}),
    loss=_LOSS,
)
ROVER_STICKS = StickRules(
    speeds=MappingProxyType({Mode.POSITION: None, Mode.MANUAL: None}),
    needed=frozenset({Mode.POSITION, Mode.MANUAL}),
    impossible=frozenset({Mode.ALTITUDE}),
    level=_AXIS,
    vertical=_AXIS,
    turning=_AXIS,
    turn_rate=Setting("RO_YAW_RATE_LIM", 0.0, _DEGREE),
    drives=True,
    loss=_LOSS,
)
