"""Behaviour of a firmware: flight modes, boot, missions, failsafes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.parameters import FailsafeDefaults, RuntimeParameters, Setting

if TYPE_CHECKING:
    from mission.model import MissionItem

_PX4_AUTO = 4


class Mode(Enum):
    """Flight modes of the simulated vehicle, mapped to custom modes by `ModeTable`."""

    MANUAL = "manual"
    ALTITUDE = "altitude"
    POSITION = "position"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    MISSION = "mission"
    RTL = "return"
    LAND = "land"
    GUIDED = "guided"
    ATTITUDE = "attitude"
    CIRCLE = "circle"
    FLIP = "flip"
    FOLLOW = "follow me"


@dataclass(frozen=True, slots=True)
class BaseModes:
    """Base mode flags of each mode in HEARTBEAT, without the armed and custom mode flags."""

    # MAV_MODE_FLAG bits in MANUAL, ALTITUDE and POSITION.
    manual: int = int(m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED)
    altitude: int = int(m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | m.MAV_MODE_FLAG_STABILIZE_ENABLED)
    position: int = int(
        m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        | m.MAV_MODE_FLAG_STABILIZE_ENABLED
        | m.MAV_MODE_FLAG_GUIDED_ENABLED
    )
    landing: int = int(
        m.MAV_MODE_FLAG_AUTO_ENABLED | m.MAV_MODE_FLAG_STABILIZE_ENABLED | m.MAV_MODE_FLAG_GUIDED_ENABLED
    )
    """MAV_MODE_FLAG bits in LAND."""
    other: int = int(
        m.MAV_MODE_FLAG_AUTO_ENABLED | m.MAV_MODE_FLAG_STABILIZE_ENABLED | m.MAV_MODE_FLAG_GUIDED_ENABLED
    )
    """MAV_MODE_FLAG bits in automatic modes."""

    def of(self, mode: Mode) -> int:
        """Return the MAV_MODE_FLAG bits of a mode."""
        known = {
            Mode.MANUAL: self.manual,
            Mode.ALTITUDE: self.altitude,
            Mode.POSITION: self.position,
            Mode.LAND: self.landing,
            Mode.ATTITUDE: self.altitude,
            Mode.FLIP: self.altitude,
        }
        return known.get(mode, self.other)


@dataclass(frozen=True)
class ModeTable:
    """Custom modes of a firmware."""

    rows: tuple[tuple[int, Mode, str], ...]
    """Rows of custom mode number, simulated mode, and the firmware's name for notices. HEARTBEAT reports the
    number in the first row of a mode; the numbers in later rows are accepted, too."""
    boot: Mode
    """Mode after boot."""
    after_takeoff: Mode
    """Mode after a commanded take-off."""
    after_command: Mode
    """Mode after DO_REPOSITION, DO_ORBIT and DO_CHANGE_ALTITUDE."""
    base: BaseModes = field(default_factory=BaseModes)
    """Base mode flags in HEARTBEAT."""
    flips_from: frozenset[int] = frozenset()
    """Custom modes from which FLIP can be entered."""
    takes_off_from: frozenset[int] = frozenset()
    """Custom modes in which NAV_TAKEOFF is obeyed, on the ground only; empty for any mode, also in flight."""
    unready: Mapping[int, tuple[str, str]] = field(default_factory=dict)
    """Names of custom modes that cannot be entered, by number, and the notice before a refusal (or empty)."""
    not_armable: frozenset[int] = frozenset()
    """Custom modes in which the vehicle does not arm."""
    not_armable_text: str = "{name} mode not armable"
    arms_in_mission: Setting | None = None
    """Parameter whose lowest bit allows arming in the mission mode; None without such a parameter."""
    armed_texts: Mapping[int, str] = field(default_factory=dict)
    """Further notices when the vehicle arms, by custom mode."""
    refused_text: str = "Mode {name} refused"
    """Notice of a refused mode; ``{name}`` stands for the mode, ``{reason}`` for ArduCopter's reason."""
    unknown_text: str = "Mode refused: unknown number {}"
    """Notice of an unknown mode; ``{}`` is the number."""
    orbit: int | None = None
    """Custom mode in HEARTBEAT during a commanded orbit; None for the hold mode's number."""
    own_hold: int | None = None
    """Custom mode in HEARTBEAT while the autopilot holds by its own decision; None for the hold mode's
    number."""
    main_and_sub: bool = False
    """Whether DO_SET_MODE has main and sub mode in parameters 2 and 3 (PX4); otherwise the custom mode is in
    parameter 2."""

    def __getitem__(self, mode: Mode) -> int:
        return self.numbers[mode]

    @cached_property
    def numbers(self) -> dict[Mode, int]:
        """Custom mode number of each available mode."""
        numbers: dict[Mode, int] = {}
        for number, mode, _ in self.rows:
            numbers.setdefault(mode, number)
        return numbers

    def mode_of(self, custom_mode: int) -> Mode | None:
        """Return the mode with this custom mode number; None if it is unknown or not simulated."""
        return next((mode for number, mode, _ in self.rows if number == custom_mode), None)

    def refusal(self, number: int, *, has_position: bool = True) -> str:
        """Return the notice of a refused custom mode."""
        reason = "init failed" if has_position else "requires position"
        return self.refused_text.format(name=self.name_of(number), reason=reason)

    def name_of(self, number: int) -> str:
        """Return the firmware's name of a custom mode; the number if the mode is unknown."""
        if number in self.unready:
            return self.unready[number][0]
        return next((name or mode.value for known, mode, name in self.rows if known == number), str(number))

    def why_not_arm(self, number: int, parameters: RuntimeParameters) -> str | None:
        """Return the reason why the vehicle does not arm in a custom mode, or None."""
        setting = self.arms_in_mission if number == self.numbers.get(Mode.MISSION) else None
        if setting is not None and int(setting.of(parameters)) & 1:
            return None
        if number not in self.not_armable:
            return None
        # The firmware writes the name without underscore ("SMARTRTL").
        return self.not_armable_text.format(name=self.name_of(number).replace("_", ""))

    def ignores(self, number: int) -> bool:
        """Return whether an unknown mode is ignored without a refusal; PX4 ignores unknown main modes."""
        return self.main_and_sub and number >> 16 & 255 != _PX4_AUTO

    def custom_mode_of(self, second: int, third: int) -> int:
        """Return the custom mode in parameters 2 and 3 of DO_SET_MODE."""
        return px4_custom_mode(second & 255, third & 255) if self.main_and_sub else second


def px4_custom_mode(main: int, sub: int = 0) -> int:
    """Return PX4's custom mode number for a main mode and a sub mode (``px4_custom_mode.h``).

    Examples
    --------
    >>> px4_custom_mode(4, 4)
    67371008
    """
    return sub << 24 | main << 16


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
    """Whether a position in one inclusion zone is allowed (PX4); otherwise it must be in all (ArduPilot)."""
    needs_stream: bool
    """Whether the setpoint mode can be entered only while setpoints arrive, and the vehicle returns home when
    setpoints stop (PX4). Otherwise only velocity setpoints time out (ArduPilot)."""
    pauses_in_mode: bool
    """Whether a pause stops the vehicle in its mode (ArduPilot); otherwise the vehicle enters the hold
    mode."""
    yaws_to_setpoint: bool
    """Whether the vehicle yaws towards the position of a setpoint that gives no heading."""
    fences_setpoints: bool
    """Whether setpoints outside the fence are refused."""
    tells_link_loss: bool
    """Whether the loss of the ground station is reported even if no action follows."""
    preflight: str
    """Prefix of notices about preflight checks that fail before anybody has requested arming."""
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
    """Rule that disarms an idle vehicle; None if an idle vehicle stays armed."""
    any_mode_disarmed: bool = False
    """Whether a disarmed vehicle may enter a mode that it cannot fly, which then prevents arming. Otherwise
    the vehicle refuses to enter the mode."""
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
    start_resumes: bool = False
    """Whether MISSION_START with item 0 resumes the mission (ArduPilot); otherwise it restarts it (PX4)."""
    return_lag_s: float | None = None
    """Time after which a return item at the end of a mission ends the mission and starts the return mode
    (PX4). None if the vehicle flies the return item in the mission mode."""
    finished_texts: tuple[str, str] = ("Mission complete", "Mission complete")
    """Notices at the end of a mission in the air and on the ground."""
    return_text: str = ""
    """Further notice if a mission ends in the return mode."""
    forgets_speed_in: frozenset[Mode] = frozenset()
    """Modes in which the vehicle forgets a changed speed and flies at its default speed (ArduPilot)."""
    replays_speed: bool = False
    """Whether a resumed mission uses the speed set by items before the current item, and a single command
    without a speed uses the cruise speed (PX4)."""
    rewinds_survey: bool = False
    """Whether a mission that the vehicle left during a camera series resumes one position before the last
    position that the vehicle passed (PX4)."""
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
    """Reason for refusing to arm in the mission mode with an empty mission (ArduPilot). Without such a text,
    the vehicle refuses the mission mode instead."""
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
    """Reason that prevents arming in every mode; empty if the vehicle arms."""
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
