"""Flight modes, and the custom mode numbers that a firmware gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m

if TYPE_CHECKING:
    from sim_vehicle.autopilot.parameters import RuntimeParameters, Setting

__all__ = ["BaseModes", "Mode", "ModeTable", "px4_custom_mode"]

_PX4_AUTO = 4


class Mode(Enum):
    """Flight modes; each autopilot has its own custom mode numbers for them."""

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
    """Flags of each mode in HEARTBEAT's base mode, besides armed and the custom mode bit."""

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
    """In LAND."""
    other: int = int(
        m.MAV_MODE_FLAG_AUTO_ENABLED | m.MAV_MODE_FLAG_STABILIZE_ENABLED | m.MAV_MODE_FLAG_GUIDED_ENABLED
    )
    """In the modes that fly by themselves."""

    def of(self, mode: Mode) -> int:
        """Bits in a mode."""
        known = {
            Mode.MANUAL: self.manual,
            Mode.ALTITUDE: self.altitude,
            Mode.POSITION: self.position,
            Mode.LAND: self.landing,
            Mode.ATTITUDE: self.altitude,
            Mode.FLIP: self.altitude,
        }
        return known.get(mode, self.other)


@dataclass(frozen=True, slots=True)
class ModeTable:
    """The custom modes of a firmware."""

    rows: tuple[tuple[int, Mode, str], ...]
    """Its custom modes: number, the mode that it is flown as, and the firmware's own name for its texts. The
    first of a mode is its number; further ones are accepted, too."""
    boot: Mode
    """Mode after the start."""
    after_takeoff: Mode
    """The mode that follows a commanded take-off."""
    after_command: Mode
    """The mode that DO_REPOSITION, DO_ORBIT and DO_CHANGE_ALTITUDE lead to."""
    base: BaseModes = field(default_factory=BaseModes)
    """Their flags in the base mode of the heartbeat."""
    flips_from: frozenset[int] = frozenset()
    """The custom modes that FLIP is entered from."""
    unready: Mapping[int, tuple[str, str]] = field(default_factory=dict)
    """Custom modes whose init fails here: name, and the notice before it (empty for none)."""
    not_armable: frozenset[int] = frozenset()
    """Custom modes in which the vehicle does not arm."""
    not_armable_text: str = "{name} mode not armable"
    arms_in_mission: Setting | None = None
    """The parameter whose lowest bit lets it arm in the mission mode all the same."""
    armed_texts: Mapping[int, str] = field(default_factory=dict)
    """Further notices when it arms in a custom mode."""
    refused_text: str = "Mode {name} refused"
    """Notice of a mode that is not entered: ``{name}`` is its name, ``{reason}`` ArduCopter's
    reason."""
    unknown_text: str = "Mode refused: unknown number {}"
    """Notice of an unknown mode; ``{}`` is its number."""
    orbit: int | None = None
    """The custom mode in the heartbeat while circles are flown by command; None is that of the hold
    mode."""
    own_hold: int | None = None
    """The custom mode in which the vehicle holds by its own decision; None is that of the hold mode."""
    main_and_sub: bool = False
    """DO_SET_MODE carries main and sub mode in parameters 2 and 3 (PX4), not the custom mode in parameter
    2."""

    def __getitem__(self, mode: Mode) -> int:
        return self.numbers[mode]

    @property
    def numbers(self) -> dict[Mode, int]:
        """The custom mode number of each mode that it has."""
        numbers: dict[Mode, int] = {}
        for number, mode, _ in self.rows:
            numbers.setdefault(mode, number)
        return numbers

    def mode_of(self, custom_mode: int) -> Mode | None:
        """Mode with this custom number, None if there is none or it is not flown here."""
        return next((mode for number, mode, _ in self.rows if number == custom_mode), None)

    def refusal(self, number: int, *, has_position: bool = True) -> str:
        """Notice when the custom mode with this number is not entered."""
        reason = "init failed" if has_position else "requires position"
        return self.refused_text.format(name=self.name_of(number), reason=reason)

    def name_of(self, number: int) -> str:
        """The firmware's name of a custom mode; the number of one that it does not have."""
        if number in self.unready:
            return self.unready[number][0]
        return next((name or mode.value for known, mode, name in self.rows if known == number), str(number))

    def why_not_arm(self, number: int, parameters: RuntimeParameters) -> str | None:
        """Why the vehicle does not arm in a custom mode; None when the mode lets it."""
        setting = self.arms_in_mission if number == self.numbers.get(Mode.MISSION) else None
        if setting is not None and int(setting.of(parameters)) & 1:
            return None
        if number not in self.not_armable:
            return None
        # The real one writes it without the underscore ("SMARTRTL").
        return self.not_armable_text.format(name=self.name_of(number).replace("_", ""))

    def ignores(self, number: int) -> bool:
        """Whether a mode that there is not is passed over without a refusal, as PX4 does with main modes."""
        return self.main_and_sub and number >> 16 & 255 != _PX4_AUTO

    def custom_mode_of(self, second: int, third: int) -> int:
        """Custom mode that parameters 2 and 3 of DO_SET_MODE name."""
        return px4_custom_mode(second & 255, third & 255) if self.main_and_sub else second


def px4_custom_mode(main: int, sub: int = 0) -> int:
    """Pack main and sub mode as PX4's ``px4_custom_mode.h`` does.

    Examples
    --------
    >>> px4_custom_mode(4, 4)
    67371008
    """
    return sub << 24 | main << 16
