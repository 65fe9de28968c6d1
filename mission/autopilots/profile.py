"""`Profile`: the facts of an autopilot that a ground station needs, as data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

from mission.autopilots.dialect import Dialect, ReadBack
from mission.link.codec.dialect import mavlink as m
from mission.model import MAX_ITEMS, MissionType


@dataclass(frozen=True, slots=True)
class NeededParameter:
    """Required value of a vehicle parameter: one of several values, certain bits set, or a minimum.

    >>> options = NeededParameter("FS_OPTIONS", bits=2)
    >>> options.wanted(16), options.wanted(18)
    (18, 18)
    >>> NeededParameter("FS_GCS_ENABLE", good=frozenset({1, 3}), value=1).wanted(3)
    3
    """

    name: str
    good: frozenset[int] = frozenset()
    """Accepted values; if empty, ``bits`` and ``least`` apply."""
    value: int = 0
    """Value to set if the present value is not accepted."""
    bits: int = 0
    """Bits that must be set."""
    least: int = 0
    """Minimum value."""

    def wanted(self, value: int) -> int:
        """Return the value to set: the present ``value`` if it is accepted, otherwise the required value."""
        if self.good:
            return value if value in self.good else self.value
        return max(value | self.bits, self.least)


@dataclass(frozen=True, slots=True)
class CardRoom:
    """Storage for a plan on an SD card; the vehicle reads the storage size from a parameter at boot.

    Source: ArduPilot ``StorageManager.cpp`` (attach_file), ``AP_Mission.cpp`` and ``AC_PolyFence_loader.cpp``
    (max_items); sizes of items from the parameter's documentation. Numbers of items include home.

    >>> room = CardRoom("BRD_SD_MISSION", 64, 1312)
    >>> room.items(64), room.items(10), room.kib_for(682), room.kib_for(683), room.kib_for(5000)
    (4368, 682, 10, 11, None)
    """

    parameter: str
    """Name of the size parameter (KiB); 0 means no card."""
    largest_kib: int
    """Largest documented parameter value."""
    largest_board: int
    """Number of items that the largest board stores without a card."""
    item_bytes: int = 15
    header_bytes: int = 4
    most_bytes: int = 0xFFFF

    def items(self, kib: float) -> int:
        """Return the number of items that fit on the card if the size parameter is ``kib`` (above 0)."""
        return max(0, min(1024 * int(kib), self.most_bytes) - self.header_bytes) // self.item_bytes

    def kib_for(self, items: int) -> int | None:
        """Return the smallest size parameter with room for ``items`` items, or None if no value suffices."""
        kib = -(-(items * self.item_bytes + self.header_bytes) // 1024)
        return kib if kib <= self.largest_kib and items <= self.items(kib) else None


@dataclass(frozen=True, slots=True)
class FlightModes:
    """Names and uses of an autopilot's flight modes. With the default values, no mode is known."""

    numbers: Callable[[int], Mapping[str, tuple[float, float, float]]] = lambda _vehicle_type: {}
    """Function from a MAV_TYPE to the parameters 1 to 3 of DO_SET_MODE, by name of the mode."""
    mission: frozenset[str] = frozenset()
    """Modes that fly the mission."""
    resume: str = ""
    """Mission mode that resumes the mission at its current item; empty if unknown."""
    hold: Mapping[int | None, str] = field(default_factory=lambda: {None: ""})
    """Mode that holds the position, by MAV_TYPE; key None for any other."""
    arming: Mapping[int | None, str | None] = field(default_factory=lambda: {None: None})
    """Mode for arming without a radio control, by MAV_TYPE; None as the value: any mode."""
    ends: Callable[[int, int], frozenset[str]] = lambda _vehicle_type, _last_command: frozenset()
    """Function from a MAV_TYPE and the last command of a mission to the modes in which the mission may end,
    besides the mission modes."""
    aliases: Mapping[str, str] = field(default_factory=dict)
    """Name of a flight mode, by the alternative name of the mode."""
    in_pymavlink: bool = False
    """Whether pymavlink knows the names of the modes; if not, `name` finds the name of a custom_mode."""

    def name(self, custom_mode: int, vehicle_type: int) -> str:
        """Return the name of the mode whose parameter 2 of DO_SET_MODE is ``custom_mode``."""
        names = {int(main): name for name, (_, main, _) in self.numbers(vehicle_type).items()}
        return names.get(custom_mode, f"Mode({custom_mode})")

    def hold_of(self, vehicle_type: int) -> str:
        """Return the name of the mode in which a vehicle (MAV_TYPE) holds its position."""
        return self.hold.get(vehicle_type, self.hold[None])


class Meaning(Enum):
    """Autopilot-independent meaning of a vehicle parameter."""

    CRUISE_SPEED = "the speed of a mission that sets no speed"
    FASTEST = "the greatest speed"
    ACCEPTANCE_RADIUS = "the acceptance radius of waypoints"
    RETURN_HEIGHT = "the height of the return"
    LOW_BATTERY = "the action on a low battery"
    LINK_LOST = "the action on a lost link"
    LINK_LOST_OPTIONS = "whether a mission goes on without a link"
    TAKEOFF_AND_LANDING = "whether a mission needs a take-off and a landing"
    FENCE_ON = "whether the fence is enabled"
    FENCE_ACTION = "the action on a fence breach"
    FENCE_TYPES = "the kinds of fences that are enabled"
    FENCE_CEILING = "the ceiling of the fence"
    FENCE_RADIUS = "the largest distance from home"
    LANDS_AS_MISSION = "whether a return ends with the landing of the mission"
    MISSION_CARD = "the room for a mission on an SD card"
    ACCELEROMETER = "the accelerometer's calibration"
    GYROSCOPE = "the gyroscope's calibration"
    COMPASS = "the compass's calibration"


Questions: TypeAlias = Mapping[Meaning, Mapping[str, float]]
"""Parameters to request, by meaning: names from the newest to the oldest firmware, each with the factor that
converts the parameter to SI units."""


Motion: TypeAlias = Mapping[str, Mapping[str, float]]
"""Motion parameters, by name in the simulator: names from the newest to the oldest real firmware, each with
the factor that converts the real parameter to the simulated parameter."""


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """Parameters of an autopilot that matter for a plan, and the meaning of some values."""

    questions: Mapping[int | None, Questions] = field(default_factory=dict)
    """Parameters to request, by MAV_TYPE; key None for any other."""
    motion: Mapping[int | None, Motion] = field(default_factory=dict)
    """Parameters for the prediction of a flight, by MAV_TYPE; key None for any other."""
    link_goes_on: frozenset[float] = frozenset({0.0})
    """Values of `Meaning.LINK_LOST` with which a mission continues after a loss of the link."""
    fence_off: frozenset[float] = frozenset()
    """Values of `Meaning.FENCE_ACTION` that disable the fence."""
    fence_tells: frozenset[float] = frozenset({0.0})
    """Values of `Meaning.FENCE_ACTION` with which the vehicle only reports a fence breach."""

    def asked_of(self, vehicle_type: int) -> Questions:
        """Return the parameters to request from a vehicle (MAV_TYPE)."""
        return self.questions.get(vehicle_type, self.questions.get(None, {}))

    def motion_of(self, vehicle_type: int) -> Motion:
        """Return the parameters for the prediction of a flight of a vehicle (MAV_TYPE)."""
        return self.motion.get(vehicle_type, self.motion.get(None, {}))


@dataclass(frozen=True, slots=True)
class Profile:
    """Facts of one autopilot."""

    name: str
    """Name in messages to the user."""
    autopilot: int
    """MAV_AUTOPILOT in the heartbeat."""
    home_at_zero: bool = False
    """Whether item 0 of a mission on the wire is home, which shifts all items and jump targets by one."""
    atomic: bool = True
    """Whether the old plan stays in effect until the new plan is complete."""
    request_int: bool = True
    """Whether the vehicle requests items by MISSION_REQUEST_INT, not by MISSION_REQUEST."""
    float_answers: bool = False
    """Whether the vehicle answers MISSION_REQUEST with the float message MISSION_ITEM."""
    stateless_download: bool = False
    """Whether the vehicle answers any item request at any time, which allows several pending requests."""
    answers_unheard: bool = False
    """Whether the vehicle handles messages to a component of its system from which it heard nothing."""
    restart_on_count: bool = False
    """Whether a second COUNT of the same ground station restarts an upload at any item, not only before item
    0."""
    repeats_ack: bool = True
    """Whether the last item of an upload, received again, is acknowledged again; if not, the ACK is ERROR."""
    re_request_s: float = 0.25
    """Timeout after which the vehicle repeats the request for an item (s)."""
    abort_s: float = 5.0
    """Timeout after which the vehicle aborts a transfer (s)."""
    abort_result: int | None = None
    """ACK that the vehicle sends when it aborts an upload, or None for no ACK."""
    busy_result: int = m.MAV_MISSION_ERROR
    """ACK for a COUNT that arrives during another transfer."""
    order_result: int | None = None
    """ACK for an item out of order, or None for no ACK."""
    range_result: int = m.MAV_MISSION_ERROR
    """ACK for a request beyond the end of the plan."""
    clear_all_types: bool = True
    """Whether MISSION_CLEAR_ALL with type 255 clears all three plans; if not, the ACK is UNSUPPORTED."""
    frames: frozenset[int] | None = None
    """Accepted MAV_FRAMEs, or None for any."""
    usual_limits: tuple[int | None, int | None, int | None] = (None, None, None)
    """Number of items that common boards store, per plan type, for `count_warning`."""
    lossy: Mapping[int, frozenset[str]] = field(default_factory=dict)
    """Item fields that the vehicle does not store, by command; the comparison after an upload skips them."""
    read_back: Mapping[int, Mapping[str, ReadBack]] = field(default_factory=dict)
    """Item fields that change between upload and download, by command."""
    whole_seconds: bool = False
    """Whether the hold time of a waypoint is stored in whole seconds."""
    keeps_autocontinue: frozenset[MissionType] = frozenset(MissionType)
    """Plan types with items that keep ``autocontinue``."""
    keeps_default: bool = True
    """Whether a NaN parameter reads back as NaN, not as 0."""
    keeps_frame: bool = True
    """Whether an item without a position keeps its frame; if not, the frame reads back as GLOBAL."""
    int_frames: bool = False
    """Whether MISSION_ITEM_INT has the frames 5 and 6 in place of 0 and 3."""
    strict_frames: bool = True
    """Whether ``frames`` applies to items without a position too."""
    range_checked: bool = True
    """Whether items with values out of range are refused; if not, they are stored unchanged."""
    nan_parameters: Mapping[int, frozenset[str]] | None = None
    """Parameters that may be NaN, by command, or None if all may be."""
    placed: frozenset[int] | None = None
    """Commands accepted in a global frame, or None for any."""
    unplaced: frozenset[int] | None = None
    """Commands accepted in frame MISSION; None for any."""
    checks_jumps: bool = False
    """Whether a DO_JUMP to a target outside the plan is refused."""
    marks_current: bool = True
    """Whether a download marks the current item."""
    opaque_ids: bool = True
    """Whether plans have opaque ids."""
    capacity: tuple[int, int, int] = (MAX_ITEMS, MAX_ITEMS, MAX_ITEMS)
    """Largest number of items that the simulated autopilot accepts, per plan type, without home (`room`)."""
    card: CardRoom | None = None
    """Storage of longer missions on an SD card."""
    fence_card: CardRoom | None = None
    """Storage of larger fences on an SD card."""
    space_text: str | None = "Only {} items are supported"
    """STATUSTEXT for a plan with too many items; {} is the capacity including home. None: no text."""
    item_text: str | None = None
    """STATUSTEXT (MAV_SEVERITY_CRITICAL) for an invalid item, unless the ACK is ERROR. None: no text."""
    type_result: int = m.MAV_MISSION_INVALID
    """ACK for an unknown plan type."""
    partial_write: bool = False
    """Whether MISSION_WRITE_PARTIAL_LIST is supported."""
    partial_result: int | None = m.MAV_MISSION_ERROR
    """ACK for a refused partial list, or None for no ACK."""
    checks_stored_mission: bool = False
    """Whether an uploaded fence triggers a check of the stored mission, with a STATUSTEXT."""
    empty_hold_s: float = 0.0
    """Time after a COUNT of 0 during which the vehicle refuses every COUNT (s)."""
    received_texts: tuple[str, str, str] | None = None
    """STATUSTEXT (MAV_SEVERITY_INFO) after an upload, per plan type, or None for no text."""
    timeout_text: str = "Operation timeout"
    """STATUSTEXT after an aborted upload."""
    text_prefix: str | None = None
    """Prefix of STATUSTEXTs about refusals. None: no texts."""
    streams_on_request: bool = False
    """Whether the vehicle sends only heartbeats until a ground station requests its streams."""
    change_modes: Mapping[int, tuple[int, int]] | None = None
    """Custom modes (guided mode, mission mode), by MAV_TYPE, for vehicles whose mission is best replaced
    while they fly to a position in guided mode. None: the whole mission is replaced in mission mode, with the
    next item marked as current."""
    change_failsafe: Mapping[int, tuple[NeededParameter, ...]] = field(default_factory=dict)
    """Parameters to set before a change in guided mode, by MAV_TYPE, so that a vehicle that loses its ground
    station in guided mode returns home."""
    dialect: Dialect = field(default_factory=Dialect)
    """Conversion rules for items (`mission.transfer.rendering`)."""
    modes: FlightModes = field(default_factory=lambda: FlightModes(in_pymavlink=True))
    """Flight modes."""
    settings: VehicleSettings = field(default_factory=VehicleSettings)
    """Parameters that matter for a plan."""
    bytewise: bool = False
    """Whether integer parameters are sent as the bytes of a float, not as a float value."""
    start_arms: bool = False
    """Whether MISSION_START arms a disarmed vehicle, so that it takes off."""
    takeoff_needs_arming: bool = False
    """Whether NAV_TAKEOFF is refused while disarmed."""
    takeoff_above_sea: bool = True
    """Whether the altitude of NAV_TAKEOFF is above mean sea level, not above home."""
    item_command: bool = True
    """Whether DO_SET_MISSION_CURRENT selects an item; if not, only MISSION_SET_CURRENT does."""
    stays_armed: frozenset[int] = frozenset()
    """MAV_TYPEs that stay armed after the return home."""
    radius_in_space: bool = False
    """Whether a multirotor's acceptance radius is three-dimensional, so that height errors count."""
    estimator_message: int = m.MAVLINK_MSG_ID_ESTIMATOR_STATUS
    """Id of the message that reports the quality of the position estimate."""

    @property
    def cards(self) -> dict[MissionType, CardRoom]:
        """SD card storage by plan type."""
        both = {MissionType.MISSION: self.card, MissionType.FENCE: self.fence_card}
        return {kind: card for kind, card in both.items() if card is not None}

    def room(self, mission_type: MissionType, card_kib: float = 0.0) -> int:
        """Return the capacity of a plan (items without home) with ``card_kib`` KiB of SD card storage.

        >>> from mission.autopilots import ARDUPILOT
        >>> ARDUPILOT.room(MissionType.MISSION), ARDUPILOT.room(MissionType.MISSION, 64)
        (649, 4367)
        >>> ARDUPILOT.room(MissionType.FENCE), ARDUPILOT.room(MissionType.FENCE, 1)
        (70, 128)
        """
        card = self.cards.get(mission_type)
        if card is None or card_kib <= 0.0:
            return self.capacity[mission_type]
        return card.items(card_kib) - (self.home_at_zero and mission_type == MissionType.MISSION)

    def most(self, mission_type: MissionType) -> int:
        """Return the capacity of a plan (items without home) with the largest SD card storage."""
        card = self.cards.get(mission_type)
        return self.room(mission_type, 0.0 if card is None else card.largest_kib)
