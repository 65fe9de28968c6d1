"""An autopilot as MAVLink peers see it: identity, mode numbers, message rates, peculiarities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.mav_parameter import Setting
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.autopilot.reference_parameters import ParameterDetails

__all__ = [
    "COMMON_CAPABILITIES",
    "BaseModes",
    "Identity",
    "LogBehaviour",
    "MavlinkProfile",
    "ModeTable",
    "RefusalTexts",
    "px4_custom_mode",
]

COMMON_CAPABILITIES = int(
    m.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | m.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | m.MAV_PROTOCOL_CAPABILITY_FTP
    | m.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
"""MAV_PROTOCOL_CAPABILITY bits of what the simulated vehicle does under any autopilot."""
_FIX_3D = 3
_PX4_AUTO = 4


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity that HEARTBEAT and AUTOPILOT_VERSION give."""

    # MAV_AUTOPILOT and MAV_TYPE of the heartbeat.
    mav_autopilot: int
    mav_type: int
    version: tuple[int, int, int]
    """Major, minor, patch in AUTOPILOT_VERSION."""
    capabilities: int
    """MAV_PROTOCOL_CAPABILITY bits."""
    banner: str = ""
    """Status text that follows a request for all parameters (ArduPilot); empty for none."""

    @property
    def flight_sw_version(self) -> int:
        """The version as AUTOPILOT_VERSION packs it, an official release (255)."""
        major, minor, patch = self.version
        return major << 24 | minor << 16 | patch << 8 | 255


@dataclass(frozen=True, slots=True)
class BaseModes:
    """What HEARTBEAT's base mode says of each mode, besides armed and the custom mode bit."""

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

    numbers: Mapping[Mode, int]
    """The custom mode number of each mode that it has."""
    boot: Mode
    """Mode after the start."""
    after_takeoff: Mode
    """The mode that follows a commanded take-off."""
    after_command: Mode
    """The mode that DO_REPOSITION, DO_ORBIT and DO_CHANGE_ALTITUDE lead to."""
    aliases: Mapping[int, Mode] = field(default_factory=lambda: MappingProxyType({}))
    """Further custom modes that are accepted, flown as another mode."""
    base: BaseModes = field(default_factory=BaseModes)
    """What the base mode of the heartbeat says of them."""
    flips_from: frozenset[int] = frozenset()
    """The custom modes that FLIP is entered from."""
    names: Mapping[int, str] = field(default_factory=lambda: MappingProxyType({}))
    """The firmware's own names of its custom modes, for its texts."""
    refused_text: str = "Mode {name} refused"
    """What is said of a mode that is not entered: ``{name}`` is its name, ``{reason}`` ArduCopter's
    reason."""
    unknown_text: str = "Mode refused: unknown number {}"
    """What is said of a mode that there is not; ``{}`` is its number."""
    orbit: int | None = None
    """The custom mode that peers are told while circles are flown by command; None is that of the hold
    mode."""
    own_hold: int | None = None
    """The custom mode in which the vehicle holds by its own decision; None is that of the hold mode."""
    main_and_sub: bool = False
    """DO_SET_MODE carries main and sub mode in parameters 2 and 3 (PX4), not the custom mode in parameter
    2."""

    def __getitem__(self, mode: Mode) -> int:
        return self.numbers[mode]

    def mode_of(self, custom_mode: int) -> Mode | None:
        """Mode with this custom number, None if there is none or it is not flown here."""
        for mode, number in self.numbers.items():
            if number == custom_mode:
                return mode
        return self.aliases.get(custom_mode)

    def refusal(self, number: int, *, has_position: bool = True) -> str:
        """What is said when the custom mode with this number is not entered."""
        mode = self.mode_of(number)
        name = self.names.get(number, number if mode is None else mode.value)
        reason = "init failed" if has_position else "requires position"
        return self.refused_text.format(name=name, reason=reason)

    def ignores(self, number: int) -> bool:
        """Whether a mode that there is not is passed over without a refusal, as PX4 does with main modes."""
        return self.main_and_sub and number >> 16 & 255 != _PX4_AUTO

    def custom_mode_of(self, second: int, third: int) -> int:
        """Custom mode that parameters 2 and 3 of DO_SET_MODE name."""
        return px4_custom_mode(second & 255, third & 255) if self.main_and_sub else second

    def set_mode_parameters(self, mode: Mode) -> tuple[float, ...]:
        """Parameters 2 and following of DO_SET_MODE that order a mode; the inverse of `custom_mode_of`."""
        number = self.numbers[mode]
        if not self.main_and_sub:
            return (float(number),)
        return float(number >> 16 & 255), float(number >> 24 & 255)


def px4_custom_mode(main: int, sub: int = 0) -> int:
    """Pack main and sub mode as PX4's ``px4_custom_mode.h`` does.

    Examples
    --------
    >>> px4_custom_mode(4, 4)
    67371008
    """
    return sub << 24 | main << 16


@dataclass(frozen=True, slots=True)
class LogBehaviour:
    """Where a firmware keeps its logs, and when it sends them."""

    directory: str = "/logs"
    """Where their files are."""
    by_date: bool = False
    """The files are named by date and time (PX4); otherwise they are numbered."""
    first_number: int = 0
    """Number of the first log in LOG_ENTRY."""
    refusal_armed: str = ""
    """Why none is sent while the vehicle is armed; empty where they are."""
    busy_text: str = ""
    """Why none is sent while another one is; empty where the later request replaces the earlier one."""


@dataclass(frozen=True, slots=True)
class RefusalTexts:
    """What a firmware says besides its answer to an order that it refuses; empty for nothing.

    Sources: PX4's ``Commander.cpp`` and ``mavlink_mission.cpp``; ArduPilot's ``GCS_Common.cpp`` and
    ``AP_Mission.cpp``.
    """

    arming: str = ""
    """To parameter 1 of COMPONENT_ARM_DISARM, which is ``{}``."""
    interval: str = ""
    """To the interval of a message that there is not; ``{}`` is its number."""
    current_item: str = ""
    """To MISSION_SET_CURRENT."""
    landing: str = ""
    """To DO_LAND_START."""


@dataclass(frozen=True, slots=True)
class MavlinkProfile:
    """One firmware as its MAVLink peers see it."""

    identity: Identity
    modes: ModeTable
    parameter_encoding: Literal["bytewise", "cast"]
    """How integer parameters travel in a float."""
    data_streams: bool
    """REQUEST_DATA_STREAM changes rates (ArduPilot); otherwise it is ignored."""
    rates_hz: Mapping[int, float]
    """Message id to rate after the start."""
    truth_message: int
    """Message in which the autopilot's simulator sends the true state of the vehicle."""
    gps_fix: int = _FIX_3D
    """GPS_FIX_TYPE in GPS_RAW_INT while the position is known."""
    reached_repeats: int = 0
    """How often MISSION_ITEM_REACHED is sent again, once a second, after it happened."""
    reached_merged: bool = False
    """Of items that end together (a waypoint, the commands after it, a return that follows) only the last is
    reported."""
    current_lag_s: float = 0.1
    """Time from an item's end to the MISSION_CURRENT that names the next one."""
    no_mission_total: int = 0
    """Total in MISSION_CURRENT when there is no mission."""
    refused_result: int = int(m.MAV_RESULT_TEMPORARILY_REJECTED)
    """MAV_RESULT of a command that cannot be done now."""
    unknown_message_result: int = int(m.MAV_RESULT_DENIED)
    """MAV_RESULT of REQUEST_MESSAGE for a message that it does not send."""
    armed_reboot_result: int = int(m.MAV_RESULT_DENIED)
    """MAV_RESULT of an order to start again while it is armed."""
    silent: frozenset[int] = frozenset()
    """MAV_CMDs that get no answer."""
    unsupported: frozenset[int] = frozenset()
    """MAV_CMDs that the firmware does not take, though the vehicle could."""
    int_only: frozenset[int] = frozenset()
    """MAV_CMDs that are only taken as COMMAND_INT."""
    takeoff_needs_arming: bool = False
    """NAV_TAKEOFF is refused while the vehicle is disarmed (ArduPilot)."""
    takeoff_above_sea: bool = False
    """The altitude of NAV_TAKEOFF counts from mean sea level unless its frame says otherwise (PX4), not from
    home."""
    reposition_turns: bool = False
    """DO_REPOSITION's yaw is followed (PX4)."""
    flies_attitudes: bool = False
    """SET_ATTITUDE_TARGET is flown (ArduCopter)."""
    guided_items: bool = False
    """A mission item with ``current`` 2 is flown to at once in the guided mode (ArduPilot)."""
    tells_remaining_time: bool = False
    """BATTERY_STATUS tells how long the battery lasts (PX4)."""
    packed_parameters: bool = False
    """All parameters can be read as one file (ArduPilot)."""
    packed_plans: bool = False
    """Mission, fence and rally points can be read and written as a file each (ArduPilot)."""
    system_files: bool = False
    """Files tell of the board and its tasks (ArduPilot's @SYS)."""
    component_metadata: Callable[[], Mapping[str, ParameterDetails]] | None = None
    """What the files that COMPONENT_METADATA names tell of parameters, by their names (PX4); without it there
    are none."""
    tells_calibration: bool = False
    """Texts tell how a calibration goes (PX4)."""
    calibration_text: str = ""
    """What is said when a calibration is refused, because the vehicle is armed; empty for nothing."""
    refusals: RefusalTexts = RefusalTexts()
    """Its words when it refuses an order."""
    gimbal: Setting | None = None
    """The parameter that is above 0 where it moves a gimbal; without, it never does."""
    logs: LogBehaviour = LogBehaviour()
