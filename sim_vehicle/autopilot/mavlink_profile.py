"""MAVLink interface of a firmware: identity, modes, message rates, deviations from the standard."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.behaviour import ModeTable
from sim_vehicle.autopilot.parameters import Setting

COMMON_CAPABILITIES = int(
    m.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | m.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | m.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
"""MAV_PROTOCOL_CAPABILITY bits of the simulated vehicle with every autopilot."""
_FIX_3D = 3


def _motor_us(share: float | None, armed: bool) -> float:
    """Return the motor pulse (us) of PX4's simulator: 900 disarmed, 1000 to 2000 armed (``PWMSim.hpp``)."""
    return 1000.0 + 1000.0 * min(share or 0.0, 1.0) if armed else 900.0


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a firmware in HEARTBEAT and AUTOPILOT_VERSION."""

    # MAV_AUTOPILOT and MAV_TYPE of the heartbeat.
    mav_autopilot: int
    mav_type: int
    version: tuple[int, int, int]
    """Major, minor, patch in AUTOPILOT_VERSION."""
    capabilities: int
    """MAV_PROTOCOL_CAPABILITY bits."""
    custom_version: bytes = bytes(8)
    """Git hash in AUTOPILOT_VERSION, eight bytes; zeros for none."""
    banner: str = ""
    """Status text in answer to a request for the banner or all parameters (ArduPilot); empty for none."""

    @property
    def flight_sw_version(self) -> int:
        """Version number in AUTOPILOT_VERSION, with the type 255 of an official release."""
        major, minor, patch = self.version
        return major << 24 | minor << 16 | patch << 8 | 255


@dataclass(frozen=True, slots=True)
class LogBehaviour:
    """Location and download of a firmware's logs."""

    directory: str = "/logs"
    """Directory of the log files."""
    by_date: bool = False
    """Whether log files are named by date and time (PX4); otherwise they are numbered."""
    first_number: int = 0
    """Number of the first log in LOG_ENTRY."""
    refusal_armed: str = ""
    """Reason why an armed vehicle refuses a download; empty if it allows downloads."""
    busy_text: str = ""
    """Reason why a second download is refused during the first; empty if the second replaces the first."""


@dataclass(frozen=True, slots=True)
class RefusalTexts:
    """Notices that a firmware sends when it refuses a command; empty for no notice.

    Sources: PX4's ``Commander.cpp`` and ``mavlink_mission.cpp``; ArduPilot's ``GCS_Common.cpp`` and
    ``AP_Mission.cpp``.
    """

    arming: str = ""
    """Notice for an invalid parameter 1 (``{}``) of COMPONENT_ARM_DISARM."""
    interval: str = ""
    """Notice if the interval of an unknown message is requested; ``{}`` is the message id."""
    current_item: str = ""
    """Notice if MISSION_SET_CURRENT is refused."""
    current_item_busy: str = ""
    """Notice if MISSION_SET_CURRENT is refused during a transfer; empty if it is accepted."""
    landing: str = ""
    """Notice if DO_LAND_START is refused."""


@dataclass(frozen=True, slots=True)
class MavlinkProfile:
    """Identity, modes, message rates and peculiarities of a firmware on MAVLink."""

    identity: Identity
    modes: ModeTable
    rates_hz: Mapping[int, float]
    """Initial rates by message id."""
    truth_message: int
    """Id of the message with the true state of the vehicle in the autopilot's own simulator."""
    link_rates_hz: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    """Initial rates by message id, for each named link with its own rates."""
    sitl_rates_hz: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    """Initial rates of the autopilot's own simulator by link name; the rates of "" replace `rates_hz`."""
    stream_parameters: Mapping[str, str] = field(default_factory=dict)
    """Rate parameters by MAV_DATA_STREAM in the autopilot's own simulator (ArduPilot)."""
    motor_us: Callable[[float | None, bool], float] = _motor_us
    """Function that returns the motor pulse (us), from thrust over maximum thrust (None on the ground), and
    whether the vehicle is armed."""
    hover_share: float = 0.49
    """Hover thrust over maximum thrust; in PX4's simulator, the weight of SIH_MASS over 4 SIH_T_MAX."""
    gps_fix: int = _FIX_3D
    """GPS_FIX_TYPE in GPS_RAW_INT while the position is known."""
    reached_repeats: int = 0
    """Number of repetitions of MISSION_ITEM_REACHED, one per second."""
    reached_merged: bool = False
    """Whether only the last item is reported if several items end together, such as a waypoint, its commands
    and a return."""
    current_lag_s: float = 0.1
    """Time from the end of an item to the MISSION_CURRENT with the next item."""
    no_mission_total: int = 0
    """Number of items in MISSION_CURRENT if there is no mission."""
    refused_result: int = int(m.MAV_RESULT_TEMPORARILY_REJECTED)
    """MAV_RESULT of a command that is refused in the present state."""
    unknown_message_result: int = int(m.MAV_RESULT_DENIED)
    """MAV_RESULT of REQUEST_MESSAGE for a message that is not sent."""
    armed_reboot_result: int = int(m.MAV_RESULT_DENIED)
    """MAV_RESULT of a reboot command while armed."""
    silent: frozenset[int] = frozenset()
    """MAV_CMDs that are not answered."""
    unsupported: frozenset[int] = frozenset()
    """MAV_CMDs that the firmware does not support, although the simulated vehicle could carry them out."""
    int_only: frozenset[int] = frozenset()
    """MAV_CMDs that are accepted as COMMAND_INT only."""
    home_above_sea: bool = False
    """Whether the altitude of DO_SET_HOME is above mean sea level in any frame (PX4)."""
    reposition_turns: bool = False
    """Whether the yaw of DO_REPOSITION is used (PX4)."""
    camera_by_default: bool = True
    """Whether simulated vehicles have a camera component by default. ArduPilot's vehicles have none, because
    DroneKit mistakes the camera's heartbeat for the heartbeat of the autopilot."""
    hover_thrust: Setting | None = None
    """Hover thrust of SET_ATTITUDE_TARGET (0 to 1); None if attitude setpoints are not supported."""
    thrust_climbs: bool = False
    """Whether thrust setpoints are climb rates, unless GUID_OPTIONS changes their meaning (ArduCopter)."""
    guided_items: bool = False
    """Whether a mission item with ``current`` 2 is a target of the guided mode (ArduPilot)."""
    tells_remaining_time: bool = False
    """Whether BATTERY_STATUS has the remaining time (PX4)."""
    special_files: bool = False
    """Whether parameters, plans and the board's tasks can be transferred as files (ArduPilot)."""
    component_metadata: tuple[str, str] | None = None
    """Name and package of the parameter tables (``lists/NAME*.csv``) from which the files for
    COMPONENT_METADATA are made (PX4). None if there are no such files."""
    reports_calibration: bool = False
    """Whether notices are sent during a calibration (PX4)."""
    calibration_text: str = ""
    """Notice that a calibration is refused while the vehicle is armed; empty for none."""
    refusals: RefusalTexts = RefusalTexts()
    """Notices for refused commands."""
    gimbal: Setting | None = None
    """Parameter that is above 0 if the firmware controls a gimbal; None if it never does."""
    logs: LogBehaviour = LogBehaviour()
