"""What a vehicle does by itself, as data: failsafe actions by parameter value, texts, disarming when idle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

from sim_vehicle.autopilot.parameters import FailsafeDefaults, RuntimeParameters, Setting

__all__ = [
    "Action",
    "FailsafeRules",
    "IdleDisarm",
    "actions_by_value",
]


@dataclass(frozen=True, slots=True)
class IdleDisarm:
    """The rule of one firmware."""

    delay: Setting
    """Time on the ground, in seconds; 0 and less is for ever."""
    texts: tuple[str, ...]
    """What is said."""
    first_flight: bool = False
    """It is only for a vehicle that has not taken off since it was armed (PX4, which has another delay after
    a landing). Otherwise each time on the ground counts, with the throttle stick down or without sticks
    (ArduCopter); a vehicle that lands by itself does not wait for it."""


class Action(Enum):
    """Action of a failsafe."""

    NONE = "nothing"
    WARN = "warning"
    HOLD = "holding"
    RETURN = "returning"
    LAND = "landing"
    TERMINATE = "terminating the flight"
    DISARM = "disarming"


@dataclass(frozen=True, slots=True)
class FailsafeRules:
    """The safety functions of one firmware.

    Texts are for the operator; ``fence_text`` and ``stream_lost`` have a ``{}`` for what follows.
    """

    # By the value of their parameter.
    fence_actions: Mapping[int, Action]
    link_actions: Mapping[int, Action]
    battery_actions: Sequence[Mapping[int, Action]]
    """For a low, a critical and an emergency level, by the value of their parameter."""
    critical_apart: bool
    """The critical level has a parameter of its own (ArduPilot)."""
    watches_voltage: bool
    """A voltage that stays too low is a low battery, too (ArduPilot)."""
    any_inclusion: bool
    """Being in one of the inclusion zones of a fence is enough."""
    needs_stream: bool
    """Setpoints have to flow before their mode is taken, and the vehicle returns home when they stop (PX4);
    otherwise only velocities grow old (ArduPilot)."""
    pauses_in_mode: bool
    """A pause stops the vehicle without leaving the mode (ArduPilot); otherwise it is the hold mode."""
    yaws_to_setpoint: bool
    """Without a heading, the nose turns to a setpoint's position."""
    fences_setpoints: bool
    """A setpoint outside the fence is refused."""
    tells_link_loss: bool
    """The loss of the ground station is told even where nothing is done about it."""
    preflight: str
    """Before what fails when the checks are run without an order to arm."""
    arming_texts: tuple[str, ...]
    """What is said when an order to arm is refused; ``{}`` in the first is the reason."""
    fence_text: str
    fence_clear: str
    link_lost: str
    link_regained: str
    stream_lost: str
    defaults: FailsafeDefaults = field(default_factory=FailsafeDefaults)
    """Values with which the safety parameters start."""
    mission_goes_on_bit: int = 0
    """The bit of `failsafe_options` with which a mission goes on without a ground station; 0 is none."""
    link_ignored: str = ""
    idle: IdleDisarm | None = None
    """When an armed vehicle that does not fly is disarmed; None is never."""
    any_mode_disarmed: bool = False
    """Any mode is entered while the vehicle is disarmed; what it lacks keeps it from arming. Otherwise a mode
    is refused that could not be flown."""
    restores_mode: bool = False
    """Disarmed, it goes back to the mode that was last asked for and in which it arms (PX4)."""
    fence_refusal: str = ""
    """What is said when a position is refused because of the fence; empty for nothing."""
    armed: str = "Armed by external command"
    armed_by_start: str = ""
    """Text when MISSION_START starts them; empty where it does not (ArduPilot)."""
    disarmed: str = "Disarmed by external command"
    disarming_text: str = "Disarming denied: not landed"
    """What is said when an order to disarm is refused in flight; empty for nothing."""
    landed: tuple[str, ...] = ("Disarmed by landing",)
    """Texts when they stop after a landing."""

    def fence_action(self, parameters: RuntimeParameters) -> Action:
        """Action after a breach of the fence."""
        return self.fence_actions.get(parameters.fence_action, Action.WARN)

    def link_action(self, parameters: RuntimeParameters) -> Action:
        """Action after the loss of the ground station."""
        return self.link_actions.get(parameters.link_action, Action.NONE)

    def battery_action(self, level: int, parameters: RuntimeParameters) -> Action:
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
    return {int(number): Action[name] for name, numbers in actions.items() for number in numbers.split()}
