"""PX4's failsafes.

Source: PX4 parameter reference (GF_ACTION, NAV_DLL_ACT, COM_LOW_BAT_ACT, COM_OF_LOSS_T).
"""

from __future__ import annotations

from sim_vehicle.autopilot.failsafe_rules import FailsafeRules, actions_by_value

__all__ = ["RULES"]

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
    arming="Arming denied",
    fence_text="Geofence violated: {}",
    fence_clear="Geofence violation cleared",
    link_lost="Data link lost",
    link_regained="Data link regained",
    stream_lost="Offboard control lost: {}",
)
