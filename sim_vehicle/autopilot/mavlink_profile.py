"""An autopilot as MAVLink peers see it: identity, mode numbers, message rates, peculiarities."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.modes import ModeTable
from sim_vehicle.autopilot.parameters import ParameterDetails, Setting

__all__ = [
    "COMMON_CAPABILITIES",
    "Identity",
    "LogBehaviour",
    "MavlinkProfile",
    "RefusalTexts",
]

COMMON_CAPABILITIES = int(
    m.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | m.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | m.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
"""MAV_PROTOCOL_CAPABILITY bits of the simulated vehicle under any autopilot."""
_FIX_3D = 3


def _motor_us(share: float | None, armed: bool) -> float:
    """Pulse of a motor of PX4's simulator: 900 disarmed, then 1000 to 2000 (``PWMSim.hpp``)."""
    return 1000.0 + 1000.0 * min(share or 0.0, 1.0) if armed else 900.0


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
    custom_version: bytes = bytes(8)
    """The source's git hash in AUTOPILOT_VERSION, eight bytes; zeros for none."""
    banner: str = ""
    """Status text that answers a request for it or for all parameters (ArduPilot); empty for none."""

    @property
    def flight_sw_version(self) -> int:
        """The version as AUTOPILOT_VERSION packs it, an official release (255)."""
        major, minor, patch = self.version
        return major << 24 | minor << 16 | patch << 8 | 255


@dataclass(frozen=True, slots=True)
class LogBehaviour:
    """A firmware's logs: their place, and when it sends them."""

    directory: str = "/logs"
    """Directory of their files."""
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
    """Texts of a firmware with its answer to an order that it refuses; empty for none.

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
    """Encoding of integer parameters in a float."""
    data_streams: bool
    """REQUEST_DATA_STREAM changes rates (ArduPilot); otherwise it is ignored."""
    rates_hz: Mapping[int, float]
    """Message id to rate after the start."""
    truth_message: int
    """Message in which the autopilot's simulator sends the true state of the vehicle."""
    link_rates_hz: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    """Links with rates of their own, by name: message id to rate after the start."""
    sitl_rates_hz: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    """The same as the autopilot's own simulator has it; "" in place of `rates_hz`."""
    stream_parameters: Mapping[str, str] = field(default_factory=dict)
    """MAV_DATA_STREAM to the parameter of its rate in the autopilot's own simulator (ArduPilot)."""
    motor_us: Callable[[float | None, bool], float] = _motor_us
    """Pulse of a motor, given its share of the greatest thrust (None while it does not fly) and whether it is
    armed."""
    hover_share: float = 0.49
    """Share of the greatest thrust in a hover: SIH_MASS of PX4's simulator over its four SIH_T_MAX."""
    gps_fix: int = _FIX_3D
    """GPS_FIX_TYPE in GPS_RAW_INT while the position is known."""
    reached_repeats: int = 0
    """Repeats of MISSION_ITEM_REACHED, one a second."""
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
    home_above_sea: bool = False
    """The altitude of DO_SET_HOME counts from mean sea level in any frame (PX4)."""
    reposition_turns: bool = False
    """DO_REPOSITION's yaw is followed (PX4)."""
    camera_by_default: bool = True
    """The simulator gives it a camera component unasked. An ArduPilot gets none: DroneKit takes the camera's
    heartbeat for the autopilot's."""
    hover_thrust: Setting | None = None
    """Thrust of SET_ATTITUDE_TARGET (0 to 1) that holds the height; None where attitudes are not flown."""
    thrust_climbs: bool = False
    """That thrust is a climb rate unless GUID_OPTIONS says otherwise (ArduCopter)."""
    guided_items: bool = False
    """A mission item with ``current`` 2 is flown to at once in the guided mode (ArduPilot)."""
    tells_remaining_time: bool = False
    """BATTERY_STATUS has the time that is left (PX4)."""
    packed_parameters: bool = False
    """All parameters can be read as one file (ArduPilot)."""
    packed_plans: bool = False
    """Mission, fence and rally points can be read and written as a file each (ArduPilot)."""
    system_files: bool = False
    """It has files about the board and its tasks (ArduPilot's @SYS)."""
    component_metadata: Callable[[], Mapping[str, ParameterDetails]] | None = None
    """Details of parameters by their names, for the files that COMPONENT_METADATA names (PX4); without, there
    are no such files."""
    tells_calibration: bool = False
    """It sends texts during a calibration (PX4)."""
    calibration_text: str = ""
    """Text when a calibration is refused because the vehicle is armed; empty for none."""
    refusals: RefusalTexts = RefusalTexts()
    """Its words when it refuses an order."""
    gimbal: Setting | None = None
    """The parameter that is above 0 where it moves a gimbal; without, it never does."""
    logs: LogBehaviour = LogBehaviour()
