"""What a firmware does when something goes wrong, and how it says so: data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["Action", "ActionParameters", "FailsafeRules", "actions_by_value"]

_VOLTAGE_CELLS = 3


class Action(Enum):
    """What a failsafe does."""

    NONE = "nothing"
    WARN = "warning"
    HOLD = "holding"
    RETURN = "returning"
    LAND = "landing"
    TERMINATE = "terminating the flight"


class ActionParameters(Protocol):
    """The parameters that choose an action, as numbers of the firmware's own."""

    @property
    def fence_action(self) -> int:
        """Value of GF_ACTION or FENCE_ACTION."""

    @property
    def link_action(self) -> int:
        """Value of NAV_DLL_ACT or FS_GCS_ENABLE."""

    @property
    def low_battery_action(self) -> int:
        """Value of COM_LOW_BAT_ACT or BATT_FS_LOW_ACT."""

    @property
    def critical_battery_action(self) -> int:
        """Value of BATT_FS_CRT_ACT."""


@dataclass(frozen=True, slots=True)
class FailsafeRules:
    """The safety functions of one firmware.

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
    low_voltage_v : float
        Voltage of the whole pack that is low, for batteries of three cells and more; 0 is none. ArduCopter's
        default refuses to arm with fewer cells.
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
    low_voltage_v: float = 0.0

    def defaults_for(self, spec: VehicleSpec) -> Mapping[str, float]:
        """Values of `RuntimeParameters` with which a vehicle starts, where its own defaults do not hold."""
        if spec.battery is None or spec.battery.cells < _VOLTAGE_CELLS:
            return self.defaults
        return {**self.defaults, "low_voltage_v": self.low_voltage_v}

    def fence_action(self, parameters: ActionParameters) -> Action:
        """Action after a breach of the fence."""
        return self.fence_actions.get(parameters.fence_action, Action.WARN)

    def link_action(self, parameters: ActionParameters) -> Action:
        """Action after the loss of the ground station."""
        return self.link_actions.get(parameters.link_action, Action.NONE)

    def battery_action(self, level: int, parameters: ActionParameters) -> Action:
        """Action at a low (1), critical (2) or almost empty (3) battery."""
        apart = self.critical_apart and level > 1
        value = parameters.critical_battery_action if apart else parameters.low_battery_action
        return self.battery_actions[level - 1].get(value, Action.WARN)


def actions_by_value(**actions: str) -> Mapping[int, Action]:
    """Actions by the value of a parameter; each keyword is an `Action`, its text the values.

    Examples
    --------
    >>> actions_by_value(NONE="0", RETURN="1 3")[3].value
    'returning'
    """
    return MappingProxyType(
        {int(number): Action[name] for name, numbers in actions.items() for number in numbers.split()}
    )
