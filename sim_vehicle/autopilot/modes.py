"""Flight modes, and their custom mode numbers in a firmware."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m

if TYPE_CHECKING:
    from sim_vehicle.autopilot.parameters import RuntimeParameters, Setting

__all__ = ["BaseModes", "Mode", "ModeTable", "px4_custom_mode"]

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
    unready: Mapping[int, tuple[str, str]] = field(default_factory=dict)
    """Custom modes that cannot be entered, by number: name, and a notice before the refusal (or empty)."""
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
