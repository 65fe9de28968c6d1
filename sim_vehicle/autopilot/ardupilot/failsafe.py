"""ArduPilot's failsafes: ArduCopter, ArduPlane, Rover.

Source: ArduPilot parameter references (FENCE_ACTION, FS_GCS_ENABLE, FS_OPTIONS, BATT_FS_LOW_ACT,
BATT_LOW_VOLT, GUID_TIMEOUT), ArduCopter/events.cpp, AP_Arming.cpp and the AP_Arming of each vehicle.
"""

from __future__ import annotations

from dataclasses import replace

from sim_vehicle.autopilot.failsafe_rules import FailsafeDefaults, FailsafeRules, actions_by_value
from sim_vehicle.autopilot.idle_disarm import IdleDisarm
from sim_vehicle.autopilot.setting import Setting

__all__ = ["COPTER_RULES", "PLANE_RULES", "ROVER_RULES"]

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
