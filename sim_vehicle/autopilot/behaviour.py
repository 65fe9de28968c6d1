"""Behaviour of a firmware: boot, missions, failsafes."""

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
    """Rule of a firmware that disarms an idle vehicle."""

    delay: Setting
    """Time on the ground until disarming (s); 0 or less disables the rule."""
    texts: tuple[str, ...]
    """Notices at disarming."""
    first_flight: bool = False
    """Whether the rule applies only before the first take-off after arming (PX4 has another delay after a
    landing). Otherwise the rule applies whenever the vehicle is on the ground with the throttle stick down or
    without sticks (ArduCopter). After an automatic landing the vehicle disarms without this delay."""


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
    """Failsafes of a firmware.

    Texts are sent to the operator as notices. In ``fence_text`` and ``stream_lost``, ``{}`` stands for the
    reason or the action.
    """

    # Actions of each failsafe by the value of its parameter.
    fence_actions: Mapping[int, Action]
    link_actions: Mapping[int, Action]
    battery_actions: Sequence[Mapping[int, Action]]
    """Actions for the low, critical and emergency levels, by the value of the parameter of the level."""
    critical_apart: bool
    """Whether the critical level has its own parameter (ArduPilot)."""
    watches_voltage: bool
    """Whether a voltage that stays too low counts as a low battery (ArduPilot)."""
    any_inclusion: bool
    """Whether all inclusion zones are inside the fence; if not, only the intersection of them is inside."""
    needs_stream: bool
    """Whether the setpoint mode needs a stream of setpoints before entry, and the vehicle returns home when
    the stream stops (PX4). Otherwise only velocity setpoints time out (ArduPilot)."""
    pauses_in_mode: bool
    """Whether a pause stops the vehicle in its mode (ArduPilot); otherwise a pause enters the hold mode."""
    yaws_to_setpoint: bool
    """Whether the vehicle yaws towards a position setpoint without a heading."""
    fences_setpoints: bool
    """Whether setpoints outside the fence are refused."""
    tells_link_loss: bool
    """Whether the loss of the ground station is reported even without an action."""
    preflight: str
    """Prefix of the notice about a failed preflight check without a request to arm."""
    arming_texts: tuple[str, ...]
    """Notices of a refused arming request; ``{}`` in the first notice is the reason."""
    fence_text: str
    fence_clear: str
    link_lost: str
    link_regained: str
    stream_lost: str
    defaults: FailsafeDefaults = field(default_factory=FailsafeDefaults)
    """Initial values of the safety parameters."""
    mission_goes_on_bit: int = 0
    """Bit of `failsafe_options` that continues a mission without a ground station; 0 for no such bit."""
    link_ignored: str = ""
    idle: IdleDisarm | None = None
    """Rule that disarms an idle vehicle; None for no rule."""
    any_mode_disarmed: bool = False
    """Whether a disarmed vehicle enters any mode, and a mode that it cannot fly prevents arming. Otherwise
    such a mode is refused."""
    restores_mode: bool = False
    """Whether disarming restores the last requested mode in which the vehicle can arm (PX4)."""
    fence_refusal: str = ""
    """Notice of a position refused by the fence; empty for none."""
    armed: str = "Armed by external command"
    armed_by_start: str = ""
    """Notice of arming by MISSION_START; empty if MISSION_START does not arm (ArduPilot)."""
    disarmed: str = "Disarmed by external command"
    disarming_text: str = "Disarming denied: not landed"
    """Notice of a disarming request refused in flight; empty for none."""
    landed: tuple[str, ...] = ("Disarmed by landing",)
    """Notices of disarming after a landing."""

    def fence_action(self, parameters: RuntimeParameters) -> Action:
        """Return the action after a breach of the fence."""
        return self.fence_actions.get(parameters.fence_action, Action.WARN)

    def link_action(self, parameters: RuntimeParameters) -> Action:
        """Return the action after the loss of the ground station."""
        return self.link_actions.get(parameters.link_action, Action.NONE)

    def battery_action(self, level: int, parameters: RuntimeParameters) -> Action:
        """Return the action at battery level 1 (low), 2 (critical) or 3 (emergency)."""
        apart = self.critical_apart and level > 1
        value = parameters.critical_battery_action if apart else parameters.low_battery_action
        return self.battery_actions[level - 1].get(value, Action.WARN)


def actions_by_value(**actions: str) -> Mapping[int, Action]:
    """Return actions by parameter value; each keyword is the name of an `Action` with its values as text.

    Examples
    --------
    >>> actions_by_value(NONE="0", RETURN="1 3")[3].value
    'returning'
    """
    return {int(number): Action[name] for name, numbers in actions.items() for number in numbers.split()}


MissionRule: TypeAlias = "Callable[[Sequence[MissionItem], RuntimeParameters], str | None]"
"""Function from a mission and the parameters to the reason of a refusal, or None."""


def no_rule(_items: Sequence[MissionItem], _parameters: RuntimeParameters) -> str | None:
    """Refuse no mission."""
    return None


@dataclass(frozen=True, slots=True)
class MissionBehaviour:
    """Behaviour of a firmware with a mission in flight; the defaults are PX4's, unless noted.

    With every autopilot the current item keeps its number when the mission is changed.
    """

    restarts_leg: bool = False
    """Whether each item takes effect when it arrives, and the leg to the current waypoint restarts
    (ArduPilot). Otherwise the whole mission takes effect with its acknowledgement."""
    clamps_item: bool = True
    """Whether a new mission with fewer items than the current number is continued at its last item (PX4).
    Otherwise the vehicle completes the old leg, which ends the mission (ArduPilot)."""
    obeys_mark: bool = True
    """Whether the item with ``current`` = 1 becomes the current item with the acknowledgement (PX4)."""
    keeps_jumps: bool = False
    """Whether the counts of jumps are kept when the mission changes (ArduPilot)."""
    clears_in_flight: bool = True
    """Whether MISSION_CLEAR_ALL is accepted while the mission is flown, and ends the mission (PX4)."""
    stays_after_last: bool = False
    """Whether the vehicle stays in the mission mode after the last item, until MISSION_START (ArduPilot).
    Otherwise the vehicle enters the hold mode."""
    return_lag_s: float | None = None
    """Time until a return, as the last item, ends the mission and enters the return mode (PX4). None if the
    return is flown as an item in the mission mode."""
    finished_texts: tuple[str, str] = ("Mission complete", "Mission complete")
    """Notices at the end of a mission in the air and on the ground."""
    return_text: str = ""
    """Further notice at the end of a mission in the return mode."""
    forgets_speed_in: frozenset[Mode] = frozenset()
    """Modes that start with the default speed of the vehicle (ArduPilot)."""
    replays_speed: bool = False
    """Whether a resumed mission has the speed that items before the current item set (PX4); single commands
    use their own speed."""
    rewinds_survey: bool = False
    """Whether a mission left during a camera series is resumed one position earlier than the last position
    passed (PX4)."""
    pauses_shots: bool = True
    """Whether a camera series pauses outside the mission mode and continues at the next position reached in
    the mission mode (PX4). Otherwise the series continues in any mode until the vehicle disarms
    (ArduPilot)."""
    tells_shots: bool = False
    """Whether CAMERA_FEEDBACK reports the shots commanded by the autopilot (ArduPilot)."""
    changed_texts: tuple[str, ...] = ()
    """Notices of a restarted leg; ``{}`` is the number of the item."""
    # Notices of a missing current item and of a cleared mission; empty for none.
    restart_failed_text: str = ""
    no_mission_text: str = ""
    outside_text: str = ""
    """Notice of a waypoint outside the fence, in addition to the rejection; ``{}`` is its number (PX4)."""
    empty_mission_text: str = ""
    """Reason why the vehicle does not arm in the mission mode without a mission (ArduPilot). If empty, the
    vehicle does not enter the mission mode without a mission."""
    rejected_text: str = "Mission rejected: {}"
    """Notice of a mission that cannot be flown. If empty, such a mission is stored without a notice, and the
    mission mode can be entered (ArduPilot)."""
    no_takeoff_text: str = ""
    """Notice of a mission without a take-off item, started on the ground while armed."""
    refuses: MissionRule = no_rule
    """Rule that refuses a flyable mission at upload (PX4)."""
    refuses_to_arm: MissionRule = no_rule
    """Rule that refuses arming in any mode because of the loaded mission (ArduPlane)."""
    unknown_current_s: float = 0.0
    """Time after a change during which MISSION_CURRENT has no item, 65535 (PX4)."""
    stopped_state: bool = False
    """Whether MISSION_CURRENT outside the mission mode has the state "not started" (2) and the mode "unknown"
    (0), like ArduPilot. Otherwise state and mode are "paused" (4) and "suspended" (2)."""


@dataclass(frozen=True, slots=True)
class BootStage:
    """A stage of a boot, which lasts until the next stage."""

    begins_s: float
    """Start of the stage (s since boot)."""
    problem: str = ""
    """Reason why the vehicle does not arm in any mode; empty if it arms."""
    fix: int = 0
    """GPS_FIX_TYPE during the stage."""
    tells_place: bool = False
    """Whether GLOBAL_POSITION_INT has the position; otherwise latitude and longitude are 0."""
    knows_position: bool = False
    """Whether the estimator has a position."""
    untold: frozenset[int] = frozenset()
    """Ids of messages that are not sent during the stage."""
    text: str = ""
    """Notice at the start of the stage."""


@dataclass(frozen=True, slots=True)
class ColdBoot:
    """Stages of a boot; in the last stage the vehicle is ready."""

    stages: tuple[BootStage, ...]
    blind_flags: int
    """EKF_STATUS_FLAGS before the estimator has a position."""
    blind_modes: frozenset[Mode]
    """Modes in which the vehicle arms without a position."""
    no_position: str
    """Reason why the vehicle does not arm in other modes without a position."""

    def at(self, boot_s: float) -> BootStage:
        """Return the stage at a time since the start."""
        return [stage for stage in self.stages if stage.begins_s <= max(boot_s, 0.0)][-1]

    def problem(self, stage: BootStage, mode: Mode) -> str | None:
        """Return the reason why the vehicle does not arm in a mode during the boot, or None."""
        blind = not stage.knows_position and mode not in self.blind_modes
        return stage.problem or (self.no_position if blind else None)
