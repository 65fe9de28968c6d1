"""What each autopilot does when something goes wrong, and how it says so: data only.

Sources: PX4 parameter reference (GF_ACTION, NAV_DLL_ACT, COM_LOW_BAT_ACT, COM_OF_LOSS_T), ArduCopter
parameter reference (FENCE_ACTION, FS_GCS_ENABLE, BATT_FS_LOW_ACT, BATT_LOW_VOLT, GUID_TIMEOUT).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters

__all__ = ["ARDUPILOT_RULES", "PX4_RULES", "Action", "Rules", "rules_for"]


class Action(Enum):
    """What a failsafe does."""

    NONE = "nothing"
    WARN = "warning"
    HOLD = "holding"
    RETURN = "returning"
    LAND = "landing"
    TERMINATE = "terminating the flight"


@dataclass(frozen=True, slots=True)
class Rules:
    """The safety functions of one autopilot.

    Parameters
    ----------
    fence_actions, link_actions : mapping of int to Action
        By the value of their parameter.
    battery_actions : tuple of 3 mappings of int to Action
        For a low, a critical and an emergency level, by the value of their parameter.
    critical_apart : bool
        The critical level has a parameter of its own (ArduPilot).
    watches_voltage : bool
        A voltage that stays too low is a low battery, too (ArduPilot).
    any_inclusion : bool
        Being in one of the inclusion zones of a fence is enough.
    keeps_item : bool
        A mission that is changed in flight goes on with the item of the same number.
    needs_stream : bool
        Setpoints have to flow before their mode is taken, and the mode is left when they stop (PX4);
        otherwise only velocities grow old (ArduPilot).
    pauses_in_mode : bool
        A pause stops the vehicle without leaving the mode (ArduPilot); otherwise it is the hold mode.
    looks_ahead : bool
        Without a heading, the nose turns to a setpoint's place.
    preflight, arming : str
        Texts before the reason that arming is refused: the check's, and that of the order.
    fence_text, fence_clear, link_lost, link_regained, stream_lost : str
        Texts for the operator; ``fence_text`` and ``stream_lost`` have a place for what follows.
    defaults : mapping of str to float
        Values of `RuntimeParameters` that are not those of its own defaults.
    """

    fence_actions: Mapping[int, Action]
    link_actions: Mapping[int, Action]
    battery_actions: tuple[Mapping[int, Action], Mapping[int, Action], Mapping[int, Action]]
    critical_apart: bool
    watches_voltage: bool
    any_inclusion: bool
    keeps_item: bool
    needs_stream: bool
    pauses_in_mode: bool
    looks_ahead: bool
    preflight: str
    arming: str
    fence_text: str
    fence_clear: str
    link_lost: str
    link_regained: str
    stream_lost: str
    defaults: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def fence_action(self, parameters: RuntimeParameters) -> Action:
        """The action that follows a breach."""
        return self.fence_actions.get(parameters.fence_action, Action.WARN)

    def link_action(self, parameters: RuntimeParameters) -> Action:
        """The action that follows the loss of the ground station."""
        return self.link_actions.get(parameters.link_action, Action.NONE)

    def battery_action(self, level: int, parameters: RuntimeParameters) -> Action:
        """The action that follows a low (1), critical (2) or almost empty (3) battery."""
        apart = self.critical_apart and level > 1
        value = parameters.critical_battery_action if apart else parameters.low_battery_action
        return self.battery_actions[level - 1].get(value, Action.WARN)


def _actions(**actions: str) -> Mapping[int, Action]:
    return MappingProxyType(
        {int(number): Action[name] for name, numbers in actions.items() for number in numbers.split()}
    )


PX4_RULES = Rules(
    fence_actions=_actions(NONE="0", WARN="1", HOLD="2", RETURN="3", TERMINATE="4", LAND="5"),
    link_actions=_actions(NONE="0", HOLD="1", RETURN="2", LAND="3", TERMINATE="5 6"),
    # 1, which PX4 no longer uses, is the way of this vehicle: home at the low level.
    battery_actions=(
        _actions(WARN="0 2 3", RETURN="1"),
        _actions(WARN="0", LAND="1 2", RETURN="3"),
        _actions(WARN="0", LAND="1 2 3"),
    ),
    critical_apart=False,
    watches_voltage=False,
    any_inclusion=True,
    keeps_item=False,
    needs_stream=True,
    pauses_in_mode=False,
    looks_ahead=False,
    preflight="Preflight Fail",
    arming="Arming denied",
    fence_text="Geofence violated: {}",
    fence_clear="Geofence violation cleared",
    link_lost="Data link lost",
    link_regained="Data link regained",
    stream_lost="Offboard control lost: {}",
)
_BATTERY = _actions(WARN="0", LAND="1", RETURN="2 3 4 6 7", TERMINATE="5")
ARDUPILOT_RULES = Rules(
    fence_actions=_actions(WARN="0", RETURN="1 3", LAND="2 5", HOLD="4"),
    link_actions=_actions(NONE="0", RETURN="1 2 3 4 6", LAND="5", HOLD="7"),
    battery_actions=(_BATTERY, _BATTERY, _actions(WARN="0 1 2 3 4 5 6 7")),
    critical_apart=True,
    watches_voltage=True,
    any_inclusion=False,
    keeps_item=True,
    needs_stream=False,
    pauses_in_mode=True,
    looks_ahead=True,
    preflight="PreArm",
    arming="Arm",
    fence_text="Fence breached: {}",
    fence_clear="Fence breach cleared",
    link_lost="GCS Failsafe",
    link_regained="GCS Failsafe Cleared",
    stream_lost="Guided timeout: {}",
    # The simulator's own way at a low battery: home, then land; ArduCopter itself only warns.
    defaults=MappingProxyType(
        {
            "fence_enable": 0,
            "fence_action": 1,
            "fence_ceiling_m": 100.0,
            "fence_radius_m": 300.0,
            "link_timeout_s": 5.0,
            "setpoint_timeout_s": 3.0,
            "low_battery_action": 2,
            "critical_battery_action": 1,
        }
    ),
)


# ArduPlane's and Rover's own numbers; the ways at a low and a critical battery are those of the copter.
_PLANE_BATTERY = _actions(WARN="0", RETURN="1 6", LAND="2 4 5", TERMINATE="3")
ARDUPLANE_RULES = replace(
    ARDUPILOT_RULES,
    fence_actions=_actions(WARN="0", RETURN="1 6 7", HOLD="8", LAND="9"),
    link_actions=_actions(NONE="0", RETURN="1 2 3"),
    battery_actions=(_PLANE_BATTERY, _PLANE_BATTERY, _actions(WARN="0 1 2 3 4 5 6 7")),
    defaults=MappingProxyType(
        {**ARDUPILOT_RULES.defaults, "low_battery_action": 1, "critical_battery_action": 2}
    ),
)
_ROVER_BATTERY = _actions(WARN="0", RETURN="1 3 4", HOLD="2 6", TERMINATE="5")
ARDUROVER_RULES = replace(
    ARDUPILOT_RULES,
    fence_actions=_actions(WARN="0", RETURN="1 3", HOLD="2 4 5"),
    link_actions=_actions(NONE="0", RETURN="1 2"),
    battery_actions=(_ROVER_BATTERY, _ROVER_BATTERY, _actions(WARN="0 1 2 3 4 5 6 7")),
    defaults=MappingProxyType(
        {**ARDUPILOT_RULES.defaults, "low_battery_action": 1, "critical_battery_action": 2}
    ),
)


def rules_for(autopilot: str, kind: str = "multirotor") -> Rules:
    """Return the rules of a persona by its name, for a kind of vehicle.

    Examples
    --------
    >>> rules_for("px4").fence_actions[5].value
    'landing'
    """
    if autopilot != "ardupilot":
        return PX4_RULES
    return {"fixed-wing": ARDUPLANE_RULES, "rover": ARDUROVER_RULES}.get(kind, ARDUPILOT_RULES)
