"""Behaviour of a firmware: its boot, its handling of missions, its reactions to failures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, TypeAlias

from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.parameters import FailsafeDefaults, RuntimeParameters, Setting

if TYPE_CHECKING:
    from mission.model import MissionItem

__all__ = [
    "Action",
    "BootStage",
    "ColdBoot",
    "FailsafeRules",
    "IdleDisarm",
    "MissionBehaviour",
    "MissionRule",
    "actions_by_value",
    "no_rule",
]


@dataclass(frozen=True, slots=True)
class IdleDisarm:
    """The rule of one firmware."""

    delay: Setting
    """Time on the ground, in seconds; 0 and less is for ever."""
    texts: tuple[str, ...]
    """Notices."""
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

    Texts are for the operator; ``fence_text`` and ``stream_lost`` have a ``{}`` for the reason or the action.
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
    """A position inside one inclusion zone is inside the fence; otherwise it has to be in all."""
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
    """The loss of the ground station is reported even without an action."""
    preflight: str
    """Prefix of a failure when the checks are run without an order to arm."""
    arming_texts: tuple[str, ...]
    """Notices when an order to arm is refused; ``{}`` in the first is the reason."""
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
    """Any mode is entered while the vehicle is disarmed; a mode that it cannot fly keeps it from arming.
    Otherwise such a mode is refused."""
    restores_mode: bool = False
    """Disarmed, it goes back to the mode that was last asked for and in which it arms (PX4)."""
    fence_refusal: str = ""
    """Notice when the fence refuses a position; empty for none."""
    armed: str = "Armed by external command"
    armed_by_start: str = ""
    """Text when MISSION_START starts them; empty where it does not (ArduPilot)."""
    disarmed: str = "Disarmed by external command"
    disarming_text: str = "Disarming denied: not landed"
    """Notice when an order to disarm is refused in flight; empty for none."""
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


MissionRule: TypeAlias = "Callable[[Sequence[MissionItem], RuntimeParameters], str | None]"
"""Given a mission and the parameters, why it is refused; None when it is not."""


def no_rule(_items: Sequence[MissionItem], _parameters: RuntimeParameters) -> str | None:
    """Want nothing."""
    return None


@dataclass(frozen=True, slots=True)
class MissionBehaviour:
    """Behaviour of one firmware with a mission in flight; the defaults are PX4's, unless noted.

    The item that is flown keeps its number when a mission is changed, under any autopilot.
    """

    restarts_leg: bool = False
    """Each item holds as soon as it arrives, and the leg to the present waypoint begins anew (ArduPilot).
    Otherwise a mission holds as a whole, with its acknowledgement."""
    clamps_item: bool = True
    """Of a mission that is shorter than the number of the present item the last item is flown (PX4).
    Otherwise the old leg is flown to its end, which ends the mission (ArduPilot)."""
    obeys_mark: bool = True
    """The item with ``current`` = 1 is the present one from the acknowledgement on (PX4)."""
    keeps_jumps: bool = False
    """How often a jump was taken is remembered over a change (ArduPilot)."""
    clears_in_flight: bool = True
    """MISSION_CLEAR_ALL is accepted while the mission is flown, and ends it (PX4)."""
    stays_after_last: bool = False
    """After the last item the vehicle stays in the mission mode; only MISSION_START goes on (ArduPilot).
    Otherwise it holds."""
    return_lag_s: float | None = None
    """A return that is the last item ends the mission: after this time the vehicle is in the mode of returns
    (PX4). None: it is flown as an item, in the mission mode."""
    finished_texts: tuple[str, str] = ("Mission complete", "Mission complete")
    """Notices when the mission is over in the air, and on the ground."""
    return_text: str = ""
    """Further notice when it ends in the mode of returns."""
    forgets_speed_in: frozenset[Mode] = frozenset()
    """Modes that begin at the vehicle's own speed (ArduPilot)."""
    replays_speed: bool = False
    """A mission that is gone on with has the speed that its items before the present one set (PX4); a single
    order has its own."""
    rewinds_survey: bool = False
    """A mission that was left while its camera was shooting is gone on with at the position before the one it
    came from (PX4)."""
    pauses_shots: bool = True
    """Shots that go on by themselves stop when the mission mode is left, and go on from the next position
    that is reached in it (PX4). Otherwise they go on in any mode, until the vehicle disarms (ArduPilot)."""
    tells_shots: bool = False
    """CAMERA_FEEDBACK reports the shots that the autopilot has ordered (ArduPilot)."""
    changed_texts: tuple[str, ...] = ()
    """Notice when a leg begins anew; ``{}`` is the number of the item."""
    # Notices when the present item is gone, and when the mission was cleared; empty for none.
    restart_failed_text: str = ""
    no_mission_text: str = ""
    outside_text: str = ""
    """Notice of a waypoint outside the fence, besides the rejection; ``{}`` is its number (PX4)."""
    empty_mission_text: str = ""
    """Why a vehicle whose mission mode was taken without a mission does not arm (ArduPilot); where it is
    empty, the mode is refused."""
    rejected_text: str = "Mission rejected: {}"
    """Notice of a mission that cannot be flown; empty where it is stored without a word, and its mode
    is entered all the same (ArduPilot)."""
    no_takeoff_text: str = ""
    """Notice when a mission without a take-off item is to begin on the ground with the motors on."""
    refuses: MissionRule = no_rule
    """Why a mission that could be flown is refused when it comes (PX4)."""
    refuses_to_arm: MissionRule = no_rule
    """Why a vehicle with this mission does not arm, in any mode (ArduPlane)."""
    unknown_current_s: float = 0.0
    """So long after a change MISSION_CURRENT names no item, 65535 (PX4)."""
    stopped_state: bool = False
    """Outside its mode a mission is not started (2) and MISSION_CURRENT's mode unknown (0), as ArduPilot
    says; otherwise it is paused (4) and suspended (2)."""


@dataclass(frozen=True, slots=True)
class BootStage:
    """One stage of a boot, which lasts until the next."""

    begins_s: float
    """Since the autopilot's start."""
    problem: str = ""
    """Why it does not arm, in any mode; empty for nothing."""
    fix: int = 0
    """GPS_FIX_TYPE."""
    tells_place: bool = False
    """GLOBAL_POSITION_INT has the position; latitude and longitude are 0 otherwise."""
    knows_position: bool = False
    """The estimator has a position."""
    untold: frozenset[int] = frozenset()
    """Messages that are not sent yet."""
    text: str = ""
    """Notice when it begins."""


@dataclass(frozen=True, slots=True)
class ColdBoot:
    """The stages of a boot, the last of which is that of a vehicle that is ready."""

    stages: tuple[BootStage, ...]
    blind_flags: int
    """EKF_STATUS_FLAGS before it has a position."""
    blind_modes: frozenset[Mode]
    """Modes in which it arms without a position."""
    no_position: str
    """Why it does not arm in the others."""

    def at(self, boot_s: float) -> BootStage:
        """Return the stage at a time since the start."""
        return [stage for stage in self.stages if stage.begins_s <= max(boot_s, 0.0)][-1]

    def problem(self, stage: BootStage, mode: Mode) -> str | None:
        """Return why a vehicle does not arm in a mode; None when nothing of the boot is in the way."""
        blind = not stage.knows_position and mode not in self.blind_modes
        return stage.problem or (self.no_position if blind else None)
