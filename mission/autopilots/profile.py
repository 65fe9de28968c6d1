"""The facts of an autopilot that a ground station needs, as data: `Profile`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

from mission.autopilots.dialect import Dialect, ReadBack
from mission.link.codec.dialect import mavlink as m
from mission.model import MAX_ITEMS, MissionType

__all__ = [
    "CardRoom",
    "FlightModes",
    "Meaning",
    "Motion",
    "NeededParameter",
    "Profile",
    "Questions",
    "VehicleSettings",
    "answer_to",
]


@dataclass(frozen=True, slots=True)
class NeededParameter:
    """A parameter of a vehicle that has to have one of some values, some bits set, or to be large enough.

    Examples
    --------
    >>> options = NeededParameter("FS_OPTIONS", bits=2)
    >>> options.wanted(16), options.wanted(18)
    (18, 18)
    >>> NeededParameter("FS_GCS_ENABLE", good=frozenset({1, 3}), value=1).wanted(3)
    3
    """

    name: str
    good: frozenset[int] = frozenset()
    """The values; empty if it is the bits that count."""
    value: int = 0
    """The one that is set."""
    bits: int = 0
    least: int = 0

    def wanted(self, value: int) -> int:
        """Return the value that it has to have; the present one if that is good."""
        if self.good:
            return value if value in self.good else self.value
        return max(value | self.bits, self.least)


@dataclass(frozen=True, slots=True)
class CardRoom:
    """Room for a plan on an SD card in place of the board's own, as a parameter gives it at the start.

    Source: ArduPilot ``StorageManager.cpp`` (attach_file), ``AP_Mission.cpp`` and ``AC_PolyFence_loader.cpp``
    (max_items); the documentation of the parameter tells the size of an item. Numbers of items count home.

    Examples
    --------
    >>> room = CardRoom("BRD_SD_MISSION", 64, 1312)
    >>> room.items(64), room.items(10), room.kib_for(682), room.kib_for(683), room.kib_for(5000)
    (4368, 682, 10, 11, None)
    """

    parameter: str
    """Its name; the value is in KiB, and 0 is no card."""
    largest_kib: int
    """The largest value that is documented."""
    largest_board: int
    """Items that the largest board holds without a card."""
    # Of the file on the card.
    item_bytes: int = 15
    header_bytes: int = 4
    most_bytes: int = 0xFFFF

    def items(self, kib: float) -> int:
        """Return how many items a value of the parameter, above 0, has room for."""
        return max(0, min(1024 * int(kib), self.most_bytes) - self.header_bytes) // self.item_bytes

    def kib_for(self, items: int) -> int | None:
        """Return the smallest value with room for `items`; None if there is none."""
        kib = -(-(items * self.item_bytes + self.header_bytes) // 1024)
        return kib if kib <= self.largest_kib and items <= self.items(kib) else None


@dataclass(frozen=True, slots=True)
class FlightModes:
    """An autopilot's flight modes by name, and their uses; by default none is known."""

    numbers: Callable[[int], Mapping[str, tuple[float, float, float]]] = lambda _vehicle_type: {}
    """Given a MAV_TYPE, the parameters 1 to 3 of DO_SET_MODE by the names of the modes."""
    mission: frozenset[str] = frozenset()
    """In which it flies its mission by itself."""
    resume: str = ""
    """The one of these in which it goes on with its mission where it left it; empty for none by name."""
    hold: Mapping[int | None, str] = field(default_factory=lambda: {None: ""})
    """In which it stays where it is, by MAV_TYPE; None for any other."""
    arming: Mapping[int | None, str | None] = field(default_factory=lambda: {None: None})
    """In which it arms without a stick; None where it may arm in any."""
    ends: Callable[[int, int], frozenset[str]] = lambda _vehicle_type, _last_command: frozenset()
    """Given a MAV_TYPE and the last command of a mission, the modes that the mission leads to when it is
    over, besides its own."""
    aliases: Mapping[str, str] = field(default_factory=dict)
    """Further names."""
    in_pymavlink: bool = False
    """Whether pymavlink names the mode of a HEARTBEAT; else its custom mode is parameter 2 of DO_SET_MODE."""

    def name(self, custom_mode: int, vehicle_type: int) -> str:
        """Return the name of the mode whose parameter 2 of DO_SET_MODE is the custom mode of a HEARTBEAT."""
        names = {int(main): name for name, (_, main, _) in self.numbers(vehicle_type).items()}
        return names.get(custom_mode, f"Mode({custom_mode})")

    def hold_of(self, vehicle_type: int) -> str:
        """Return the name of the mode in which a vehicle (MAV_TYPE) stays where it is."""
        return self.hold.get(vehicle_type, self.hold[None])


class Meaning(Enum):
    """Meaning of a parameter."""

    CRUISE_SPEED = "the speed of a mission that sets none"
    FASTEST = "the greatest speed"
    ACCEPTANCE_RADIUS = "the acceptance radius of waypoints"
    RETURN_HEIGHT = "the height of the return"
    LOW_BATTERY = "what a low battery does"
    LINK_LOST = "what a lost link does"
    LINK_LOST_OPTIONS = "whether a mission goes on without a link"
    TAKEOFF_AND_LANDING = "whether a mission needs a take-off and a landing"
    FENCE_ON = "whether the fence counts"
    FENCE_ACTION = "what a broken fence does"
    FENCE_TYPES = "what belongs to the fence"
    FENCE_CEILING = "the ceiling"
    FENCE_RADIUS = "how far from home"
    LANDS_AS_MISSION = "whether a return flies the landing of the mission"
    MISSION_CARD = "the room for a mission on an SD card"
    ACCELEROMETER = "the accelerometer's calibration"
    GYROSCOPE = "the gyroscope's calibration"
    COMPASS = "the compass's calibration"


Questions: TypeAlias = Mapping[Meaning, Mapping[str, float]]
"""Parameters that are asked for, by what they decide: their names, that of the newest version first, and how
many SI units are in a unit of each."""


Motion: TypeAlias = Mapping[str, Mapping[str, float]]
"""Parameters that decide how a vehicle flies, by the names of the simulated autopilot: their names in
versions of the real one, the newest first, and by what a value is multiplied."""


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """The parameters of an autopilot that a plan depends on, and the meaning of some of their values."""

    questions: Mapping[int | None, Questions] = field(default_factory=dict)
    """Parameters to request, by MAV_TYPE; None for any other."""
    motion: Mapping[int | None, Motion] = field(default_factory=dict)
    """Parameters for the prediction of its flight, likewise."""
    link_goes_on: frozenset[float] = frozenset({0.0})
    """Values of `Meaning.LINK_LOST` with which a mission is flown on."""
    fence_off: frozenset[float] = frozenset()
    """Values of `Meaning.FENCE_ACTION` with which a fence does nothing."""
    fence_tells: frozenset[float] = frozenset({0.0})
    """Values with which a broken fence is only reported."""

    def asked_of(self, vehicle_type: int) -> Questions:
        """Return the parameters to request from a vehicle (MAV_TYPE)."""
        return self.questions.get(vehicle_type, self.questions.get(None, {}))

    def motion_of(self, vehicle_type: int) -> Motion:
        """Return the parameters for the prediction of a vehicle (MAV_TYPE)."""
        return self.motion.get(vehicle_type, self.motion.get(None, {}))


def answer_to(
    meaning: Meaning, questions: Questions, parameters: Mapping[str, float]
) -> tuple[str, float] | None:
    """Return the name of a parameter and its value in SI units; None if it was not read.

    Examples
    --------
    >>> height = {Meaning.RETURN_HEIGHT: {"RTL_ALT_M": 1.0, "RTL_ALT": 0.01}}
    >>> answer_to(Meaning.RETURN_HEIGHT, height, {"RTL_ALT": 1500.0})
    ('RTL_ALT', 15.0)
    """
    names = questions.get(meaning, {})
    return next(((name, parameters[name] * unit) for name, unit in names.items() if name in parameters), None)


@dataclass(frozen=True, slots=True)
class Profile:
    """One autopilot's behaviour."""

    name: str
    """For messages."""
    autopilot: int
    """MAV_AUTOPILOT of its heartbeat."""
    home_at_zero: bool = False
    """Item 0 of the mission on the wire is home; ours follow it and jump targets count from there."""
    atomic: bool = True
    """The old plan is kept until the new one is complete."""
    request_int: bool = True
    """The vehicle asks with MISSION_REQUEST_INT (otherwise with MISSION_REQUEST)."""
    float_answers: bool = False
    """The vehicle answers MISSION_REQUEST with the float MISSION_ITEM."""
    stateless_download: bool = False
    """The vehicle answers any request at any time, so a client may ask for several items at once."""
    restart_on_count: bool = False
    """A second COUNT of the same ground station restarts an upload at any point (otherwise only before item
    0)."""
    # The vehicle's timers: ask again for an item; give up after nothing has come for so long.
    re_request_s: float = 0.25
    abort_s: float = 5.0
    abort_result: int | None = None
    """ACK that it sends when it gives an upload up, None for none."""
    busy_result: int = m.MAV_MISSION_ERROR
    """ACK for a COUNT while another transfer runs."""
    order_result: int | None = None
    """ACK for an item out of order, None for none."""
    range_result: int | None = m.MAV_MISSION_ERROR
    """ACK for a request beyond the plan, None for none."""
    clear_all_types: bool = True
    """MISSION_CLEAR_ALL with type 255 clears all three plans (otherwise UNSUPPORTED)."""
    frames: frozenset[int] | None = None
    """MAV_FRAMEs that are accepted; None for any."""
    usual_limits: tuple[int | None, int | None, int | None] = (None, None, None)
    """Items that common boards hold, per plan; beyond it `count_warning` speaks up."""
    lossy: Mapping[int, frozenset[str]] = field(default_factory=dict)
    """Per command, the fields of an item that it does not keep, for the comparison after an upload."""
    read_back: Mapping[int, Mapping[str, ReadBack]] = field(default_factory=dict)
    """Per command, the fields that read back changed, and how."""
    whole_seconds: bool = False
    """A waypoint's hold time is kept in whole seconds."""
    keeps_autocontinue: frozenset[MissionType] = frozenset(MissionType)
    """Plans whose items come back with their ``autocontinue``."""
    keeps_default: bool = True
    """A NaN parameter reads back as NaN (otherwise as 0)."""
    keeps_frame: bool = True
    """The frame of an item without a position is kept (otherwise it reads back as GLOBAL)."""
    int_frames: bool = False
    """MISSION_ITEM_INT carries the frames 5 and 6 for 0 and 3."""
    strict_frames: bool = True
    """``frames`` is also asked of items without a position."""
    range_checked: bool = True
    """Items with positions and numbers out of range are refused (otherwise stored as they came)."""
    nan_parameters: Mapping[int, frozenset[str]] | None = None
    """Per command, the parameters that may be NaN; None for all of all commands."""
    # Commands that are taken in a global frame, and in the frame MISSION; None for any.
    placed: frozenset[int] | None = None
    unplaced: frozenset[int] | None = None
    checks_jumps: bool = False
    """A DO_JUMP out of the plan is refused."""
    marks_current: bool = True
    """A download says which item is the current one."""
    opaque_ids: bool = True
    """Plans have ids."""
    capacity: tuple[int, int, int] = (MAX_ITEMS, MAX_ITEMS, MAX_ITEMS)
    """The most items that the autopilot's simulator takes, per plan, without home; see `room`."""
    card: CardRoom | None = None
    """Room for a longer mission."""
    fence_card: CardRoom | None = None
    """Room for a larger fence."""
    space_text: str | None = "Only {} items are supported"
    """Its text about a plan that is too long, None for none; takes the number of items with home."""
    item_text: str | None = None
    """Its text (MAV_SEVERITY_CRITICAL) about an item that it refuses by its content, None for none; the ACK
    ERROR comes without a text, too."""
    type_result: int = m.MAV_MISSION_INVALID
    """ACK for a plan type that does not exist."""
    partial_write: bool = False
    """MISSION_WRITE_PARTIAL_LIST works."""
    partial_result: int | None = m.MAV_MISSION_ERROR
    """ACK for a part that is not taken, None for none."""
    checks_stored_mission: bool = False
    """The mission that it holds is checked, aloud, against a fence that comes."""
    empty_hold_s: float = 0.0
    """After a COUNT of 0 every COUNT is refused for this time."""
    received_texts: tuple[str, str, str] | None = None
    """Its text (MAV_SEVERITY_INFO) after a plan was received, per plan."""
    timeout_text: str = "Operation timeout"
    """Its text after it gave up an upload."""
    text_prefix: str = ""
    """Prefix of its texts about refusals."""
    streams_on_request: bool = False
    """It sends nothing but heartbeats until a ground station asks for its streams."""
    change_modes: Mapping[int, tuple[int, int]] | None = None
    """How a mission that is being flown is replaced most safely. None: in the mission mode, by the whole plan
    at once with the item to go on with marked as current. Otherwise aside from the mission, by a position in
    the guided mode: by MAV_TYPE the custom modes of the guided and of the mission mode."""
    change_failsafe: Mapping[int, tuple[NeededParameter, ...]] = field(default_factory=dict)
    """By MAV_TYPE, the parameters to set before that, so that a vehicle in the guided mode comes home if it
    loses its ground station."""
    dialect: Dialect = field(default_factory=Dialect)
    """The form in which it takes items, for `mission.transfer.rendering`."""
    modes: FlightModes = field(default_factory=lambda: FlightModes(in_pymavlink=True))
    """Its flight modes."""
    settings: VehicleSettings = field(default_factory=VehicleSettings)
    """Its parameters that a plan depends on."""
    bytewise: bool = False
    """Integer parameters travel as the bytes of a float (otherwise as numbers)."""
    start_arms: bool = False
    """MISSION_START starts the motors of a vehicle that stands, and it takes off."""
    takeoff_needs_arming: bool = False
    """NAV_TAKEOFF is refused while the motors stand."""
    takeoff_above_sea: bool = True
    """The altitude of NAV_TAKEOFF counts from mean sea level (otherwise from home)."""
    item_command: bool = True
    """DO_SET_MISSION_CURRENT chooses an item (otherwise only the message does)."""
    stays_armed: frozenset[int] = frozenset()
    """MAV_TYPEs that stay armed when they have come home."""
    radius_in_space: bool = False
    """The acceptance radius of a multirotor counts in space, errors of its height estimate with it."""
    estimator_message: int = m.MAVLINK_MSG_ID_ESTIMATOR_STATUS
    """The message with the quality of its estimate."""

    @property
    def cards(self) -> dict[MissionType, CardRoom]:
        """The plans that may be on a card."""
        both = {MissionType.MISSION: self.card, MissionType.FENCE: self.fence_card}
        return {kind: card for kind, card in both.items() if card is not None}

    def room(self, mission_type: MissionType, card_kib: float = 0.0) -> int:
        """Return how many items of a plan its simulator takes, without home; on a card of ``card_kib``.

        Examples
        --------
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
        """Return how many items of a plan it takes with the largest card, without home."""
        card = self.cards.get(mission_type)
        return self.room(mission_type, 0.0 if card is None else card.largest_kib)
