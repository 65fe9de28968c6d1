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

    Texts are sent to the operator as notices. ``{}`` stands for the reason in ``fence_text``, and for the
    action in ``stream_lost``.
    """

    # Actions of each failsafe by the value of its parameter.
    fence_actions: Mapping[int, Action]
    link_actions: Mapping[int, Action]
    battery_actions: Sequence[Mapping[int, Action]]
    """Actions at the low, critical and emergency battery levels, by the value of each level's parameter."""
    critical_apart: bool
    """Whether the critical level has its own parameter (ArduPilot)."""
    watches_voltage: bool
    """Whether a voltage that stays too low counts as a low battery (ArduPilot)."""
    any_inclusion: bool
    """Whether a position in any inclusion zone is inside the fence; otherwise it must be in all of them."""
    needs_stream: bool
    """Whether setpoints must arrive before the setpoint mode can be entered, and the vehicle returns home
    when they stop (PX4). Otherwise only velocity setpoints time out (ArduPilot)."""
    pauses_in_mode: bool
    """Whether a pause stops the vehicle in its mode (ArduPilot); otherwise the vehicle enters the hold
    mode."""
    yaws_to_setpoint: bool
    """Whether the vehicle yaws towards a position setpoint without a heading."""
    fences_setpoints: bool
    """Whether setpoints outside the fence are refused."""
    tells_link_loss: bool
    """Whether the loss of the ground station is reported even if no action follows."""
    preflight: str
    """Prefix of the notice about a preflight check that fails without a request to arm."""
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
    """Bit of `failsafe_options` that lets a mission continue without a ground station; 0 if there is none."""
    link_ignored: str = ""
    idle: IdleDisarm | None = None
    """Rule that disarms an idle vehicle; None for no rule."""
    any_mode_disarmed: bool = False
    """Whether a disarmed vehicle may enter a mode that it cannot fly, which then prevents arming. Otherwise
    the vehicle refuses such a mode."""
    restores_mode: bool = False
    """Whether disarming restores the last requested mode in which the vehicle can arm (PX4)."""
    fence_refusal: str = ""
    """Notice that the fence refuses a commanded position; empty for none."""
    armed: str = "Armed by external command"
    armed_by_start: str = ""
    """Notice of arming by MISSION_START; empty if MISSION_START does not arm (ArduPilot)."""
    disarmed: str = "Disarmed by external command"
    disarming_text: str = "Disarming denied: not landed"
    """Notice that a disarming request is refused in flight; empty for none."""
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
    """Return actions by parameter value, from keywords that name an `Action` and list its values as text.

    Examples
    --------
    >>> actions_by_value(NONE="0", RETURN="1 3")[3].value
    'returning'
    """
    return {int(number): Action[name] for name, numbers in actions.items() for number in numbers.split()}


MissionRule: TypeAlias = "Callable[[Sequence[MissionItem], RuntimeParameters], str | None]"
"""Function that takes a mission and the parameters, and returns the reason for a refusal, or None."""


def no_rule(_items: Sequence[MissionItem], _parameters: RuntimeParameters) -> str | None:
    """Return None, so that every mission is accepted."""
    return None


@dataclass(frozen=True, slots=True)
class MissionBehaviour:
    """Behaviour of a firmware with a mission in flight; the defaults are PX4's, unless noted.

    With every autopilot the current item keeps its number when the mission is changed.
    """

    restarts_leg: bool = False
    """Whether each uploaded item takes effect when it arrives, and the leg to the current waypoint restarts
    (ArduPilot). Otherwise the whole mission takes effect when it is acknowledged."""
    clamps_item: bool = True
    """Whether the vehicle goes on at the last item if a new mission has no item with the current number
    (PX4). Otherwise the vehicle completes the old leg, and the mission ends (ArduPilot)."""
    obeys_mark: bool = True
    """Whether the item with ``current`` = 1 becomes current when the mission is acknowledged (PX4)."""
    keeps_jumps: bool = False
    """Whether jump counters keep their values when the mission changes (ArduPilot)."""
    clears_in_flight: bool = True
    """Whether MISSION_CLEAR_ALL is accepted while the mission is flown, and ends the mission (PX4)."""
    stays_after_last: bool = False
    """Whether the vehicle stays in the mission mode after the last item, until MISSION_START (ArduPilot).
    Otherwise the vehicle enters the hold mode."""
    return_lag_s: float | None = None
    """Time after which a return item at the end of a mission ends the mission and starts the return mode
    (PX4). None if the vehicle flies the return item in the mission mode."""
    finished_texts: tuple[str, str] = ("Mission complete", "Mission complete")
    """Notices at the end of a mission in the air and on the ground."""
    return_text: str = ""
    """Further notice if a mission ends in the return mode."""
    forgets_speed_in: frozenset[Mode] = frozenset()
    """Modes in which the vehicle starts with its default speed (ArduPilot)."""
    replays_speed: bool = False
    """Whether a resumed mission uses the speed set by items before the current item, and a single command
    without a speed uses the cruise speed (PX4)."""
    rewinds_survey: bool = False
    """Whether a mission that was left during a camera series resumes one position before the last position
    that was passed (PX4)."""
    pauses_shots: bool = True
    """Whether a camera series pauses outside the mission mode and continues at the next position reached in
    the mission mode (PX4). Otherwise the series continues in any mode until the vehicle disarms
    (ArduPilot)."""
    tells_shots: bool = False
    """Whether CAMERA_FEEDBACK reports the shots that the autopilot commands (ArduPilot)."""
    changed_texts: tuple[str, ...] = ()
    """Notices that a leg restarts; ``{}`` is the number of the item."""
    # Notices that the current item is missing, and that the mission is empty; no notice if the text is empty.
    restart_failed_text: str = ""
    no_mission_text: str = ""
    outside_text: str = ""
    """Notice that a waypoint is outside the fence, besides the rejection; ``{}`` is its number (PX4)."""
    empty_mission_text: str = ""
    """Reason why the vehicle does not arm in the mission mode without a mission (ArduPilot). If empty, the
    vehicle does not enter the mission mode without a mission."""
    rejected_text: str = "Mission rejected: {}"
    """Notice that a mission cannot be flown. If this is empty, the vehicle stores such a mission without a
    notice, and can enter the mission mode (ArduPilot)."""
    no_takeoff_text: str = ""
    """Notice if an armed vehicle on the ground starts a mission without a take-off item."""
    refuses: MissionRule = no_rule
    """Further rule by which the upload of a flyable mission can be refused (PX4)."""
    refuses_to_arm: MissionRule = no_rule
    """Rule that refuses arming in any mode because of the loaded mission (ArduPlane)."""
    unknown_current_s: float = 0.0
    """Time after a change of the mission during which MISSION_CURRENT has 65535, for no item (PX4)."""
    stopped_state: bool = False
    """Whether MISSION_CURRENT outside the mission mode reports the state "not started" (2) and the mode
    "unknown" (0), like ArduPilot. Otherwise the state is "paused" (4) and the mode is "suspended" (2)."""


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
    """Reason why the vehicle does not arm without a position in the other modes."""

    def at(self, boot_s: float) -> BootStage:
        """Return the stage at this time since the boot."""
        return [stage for stage in self.stages if stage.begins_s <= max(boot_s, 0.0)][-1]

    def problem(self, stage: BootStage, mode: Mode) -> str | None:
        """Return the reason why the vehicle does not arm in a mode during the boot, or None."""
        blind = not stage.knows_position and mode not in self.blind_modes
        return stage.problem or (self.no_position if blind else None)
