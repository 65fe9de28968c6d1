"""PX4's failsafes.

Source: PX4 parameter reference (GF_ACTION, NAV_DLL_ACT, COM_LOW_BAT_ACT, COM_OF_LOSS_T),
``Commander.cpp`` and ``UserModeIntention.cpp``.
"""

from __future__ import annotations

from dataclasses import replace

from sim_vehicle.autopilot.failsafe_rules import FailsafeRules, actions_by_value
from sim_vehicle.autopilot.idle_disarm import IdleDisarm
from sim_vehicle.autopilot.setting import Setting

__all__ = ["FIXED_WING_RULES", "ROVER_RULES", "RULES"]

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
