"""A mission that is changed while it is flown: what is asked for, what came of it, how a session is used."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from mission.autopilots.profile import Profile
from mission.errors import MissionError
from mission.ground.guard import FailsafeGuard
from mission.ground.texts import TextLog
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.model import Command, Mission, MissionItem, MissionType
from mission.transfer import (
    OWN_TRANSFERS,
    Output,
    RoundTrip,
    Transfer,
    TransferMaker,
    VerifiedUpload,
    check_plan,
)

__all__ = [
    "FLOWN_TO",
    "ChangeOutcome",
    "ChangeRecord",
    "ChangeRequest",
    "ChangeSession",
    "check_change",
    "revised_mission",
]

_RETURNS = frozenset({int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_LAND)})
CAMERA = frozenset({int(Command.DO_SET_CAM_TRIGG_DIST), int(Command.DO_SET_CAM_TRIGG_INTERVAL)})
_DO = frozenset({178, 195, 197, 201, 203, 205, 206, 214, 530, 2000, 2001})
FLOWN_TO = frozenset({16, 17, 18, 19, 31, 82})
"""MAV_CMDs of the items that lie on the path."""
_FARTHEST_DEG = 1.0
_HIGHEST_M = 10_000.0
_SAME_M = 2.0
_EARTH_M = 6_371_008.8


class ChangeOutcome(Enum):
    """How a change ended."""

    DONE = "done"
    """The new mission is flown."""
    REFUSED = "refused"
    """The autopilot did not take it; the old mission is flown."""
    GIVEN_UP = "given up"
    """It did not come about, and the vehicle flies on without it."""
    ROLLED_BACK = "rolled back"
    """The new mission had come in part; the old one was put back and is flown."""


@dataclass(frozen=True, slots=True)
class ChangeRecord:
    """One change of a mission in flight. Times are seconds of the run, None for what did not happen.

    Parameters
    ----------
    turned_s : float or None
        When the vehicle took the new target: with its confirmation of the whole mission, or before that where
        it is flown to aside from the mission.
    in_effect_s : float or None
        When its id, item or mode showed that it flies it.
    text : str
        Why it did not come about, in the autopilot's own words where it said any.
    items, resume_at : int
        Length of the new mission, and the item to go on with.
    """

    asked_s: float
    sent_s: float | None
    turned_s: float | None
    acknowledged_s: float | None
    in_effect_s: float | None
    ended_s: float
    outcome: ChangeOutcome
    text: str
    items: int
    resume_at: int
    retries: int

    @property
    def delay_s(self) -> float | None:
        """From the first message to the turn.

        A change that goes on to the present target may be sent later than asked for, when that is near.
        """
        return None if self.turned_s is None or self.sent_s is None else self.turned_s - self.sent_s


@dataclass(frozen=True, slots=True)
class ChangeRequest:
    """What a session needs to know."""

    old: Mission  # old, new: what the vehicle holds, and what it is to hold
    new: Mission
    item: int  # The item of the old mission that is flown
    resume_at: int  # The item of the new mission to fly to next
    vehicle: tuple[int, int]
    ground: tuple[int, int]
    profile: Profile
    monitor: VehicleMonitor
    texts: TextLog
    seconds_an_item: float  # What an item took to send and read back
    guard: FailsafeGuard | None = None  # What has to be set before the vehicle leaves its mission
    maker: TransferMaker = OWN_TRANSFERS
    round_trip: RoundTrip | None = None  # Of the link; the change measures its own without


class ChangeSession(ABC):
    """Brings a vehicle in flight from one mission to another, sans-IO.

    Feed it with `start`, `receive` (after the monitor took the message) and `poll` (at `next_deadline`);
    send what comes out. `record` is there when it is over.

    `held` is the mission that the vehicle holds, as far as is known.
    """

    def __init__(self, request: ChangeRequest) -> None:
        self.request = request
        self.record: ChangeRecord | None = None
        self.held = request.old
        self._round_trip = request.round_trip or RoundTrip()
        self._asked_s = 0.0
        self._sent_s: float | None = None
        self._turned_s: float | None = None
        self._acknowledged_s: float | None = None
        self._in_effect_s: float | None = None
        self._retries = 0
        self._transfer: Transfer | None = None
        self._texts_before = len(request.texts.texts)

    @property
    def done(self) -> bool:
        """Whether it is over."""
        return self.record is not None

    @abstractmethod
    def start(self, now_s: float) -> list[Message]:
        """Begin."""

    @abstractmethod
    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take a message of the vehicle."""

    @abstractmethod
    def poll(self, now_s: float) -> list[Message]:
        """Do what is due."""

    @abstractmethod
    def next_deadline(self) -> float:
        """When `poll` has something to do; infinity for never."""

    @abstractmethod
    def _take(self, output: Output, now_s: float) -> list[Message]:
        """Take what the running transfer gives; return what is to be sent."""

    @property
    def _transfer_s(self) -> float:
        """When the running transfer has something to do; infinity for never."""
        deadline_s = None if self._transfer is None else self._transfer.next_deadline()
        return math.inf if deadline_s is None else deadline_s

    def _poll_transfer(self, now_s: float) -> list[Message]:
        if self._transfer is None or now_s < self._transfer_s:
            return []
        return self._take(self._transfer.poll(now_s), now_s)

    def _end(self, outcome: ChangeOutcome, text: str, now_s: float) -> None:
        """Note how it ended."""
        request = self.request
        if outcome is ChangeOutcome.DONE:
            self.held = request.new
        self.record = ChangeRecord(
            self._asked_s,
            self._sent_s,
            self._turned_s,
            self._acknowledged_s,
            self._in_effect_s,
            now_s,
            outcome,
            text,
            len(request.new.items),
            request.resume_at,
            self._retries,
        )

    def _upload(self, items: tuple[MissionItem, ...], start_sequence: int | None) -> VerifiedUpload:
        """Return an upload of a mission."""
        request = self.request
        return request.maker.upload(
            items,
            MissionType.MISSION,
            home=request.old.home,
            start_sequence=start_sequence,
            target=request.vehicle,
            source=request.ground,
            profile=request.profile,
            round_trip=self._round_trip,
        )

    def _download(self) -> Transfer:
        """Return a reading of the mission."""
        request = self.request
        return request.maker.download(
            MissionType.MISSION,
            target=request.vehicle,
            source=request.ground,
            profile=request.profile,
            round_trip=self._round_trip,
        )

    def _said(self, otherwise: str) -> str:
        """Return the latest warning since the beginning, which says more than a result code."""
        return self.request.texts.last_warning(otherwise, self._texts_before)


def check_change(new: Mission, resume_at: int, old: Mission) -> None:
    """Refuse a mission that must not be sent to a vehicle in flight; PX4 itself checks no ranges.

    What the autopilot would not take is told by `mission.transfer.rendering`.

    MissionError if the item to go on with is no position to fly to, the mission does not lead home although
    the old one did, or a position is far from home or too high; LocalTransferError if it cannot be sent.

    Examples
    --------
    >>> there = Mission((MissionItem.waypoint(28.05, -82.15, 10.0),))
    >>> check_change(there, 1, there)
    Traceback (most recent call last):
        ...
    mission.errors.MissionError: mission: item 2 to go on with does not exist; there are 1 items
    """
    items = new.items
    check_plan(items, MissionType.MISSION)
    if not 0 <= resume_at < len(items):
        msg = f"mission: item {resume_at + 1} to go on with does not exist; there are {len(items)} items"
        raise MissionError(msg)
    if items[resume_at].command not in FLOWN_TO | _RETURNS or not (
        items[resume_at].has_position or items[resume_at].command in _RETURNS
    ):
        msg = (
            f"mission: item {resume_at + 1} to go on with (command {items[resume_at].command}) is no position"
        )
        raise MissionError(msg)
    if leads_home(old.items, 0) and not leads_home(items, resume_at):
        end = "end with NAV_RETURN_TO_LAUNCH or NAV_LAND"
        msg = f"mission: nothing after item {resume_at + 1} leads home; {end}"
        raise MissionError(msg)
    home = old.home
    for k, item in enumerate(items):
        if not item.has_position or item.x == item.y == 0.0:
            continue
        if abs(item.z) > _HIGHEST_M:
            limit = f"more than {_HIGHEST_M:g} m is not sent in flight"
            msg = f"mission: item {k + 1} is {item.z:g} m high; {limit}"
            raise MissionError(msg)
        if (
            home is not None
            and max(abs(item.x - home.latitude_deg), abs(item.y - home.longitude_deg)) > _FARTHEST_DEG
        ):
            msg = f"mission: item {k + 1} is more than {_FARTHEST_DEG:g} degree from home; is it in degrees?"
            raise MissionError(msg)


def leads_home(items: tuple[MissionItem, ...], begin: int) -> bool:
    """Tell whether a return or a landing comes from an item on."""
    return any(item.command in _RETURNS for item in items[begin:])


def is_return(item: MissionItem) -> bool:
    """Tell whether an item is the return or the landing."""
    return item.command in _RETURNS


def is_command(item: MissionItem) -> bool:
    """Tell whether an item is one of the DO commands between positions."""
    return item.command in _DO


def next_flown_to(items: tuple[MissionItem, ...], index: int) -> int:
    """Return the next item that is flown to after DO items; the item itself when there is none."""
    following = index + 1
    while following < len(items) and is_command(items[following]):
        following += 1
    known = following < len(items) and items[following].command in FLOWN_TO | _RETURNS
    return following if known else index


def same_position(a: MissionItem, b: MissionItem) -> bool:
    """Tell whether two items lead to the same position."""
    if not a.has_position or not b.has_position:
        return False
    return apart_m((a.x, a.y), (b.x, b.y)) < _SAME_M


def apart_m(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the distance of two positions (latitude, longitude) that are near each other, on a sphere."""
    north, east = b[0] - a[0], (b[1] - a[1]) * math.cos(math.radians(a[0]))
    return _EARTH_M * math.radians(math.hypot(north, east))


def first_command(items: tuple[MissionItem, ...], index: int) -> int:
    """Return the first of the DO items that lie directly before an item; the item itself without any."""
    while index > 0 and is_command(items[index - 1]):
        index -= 1
    return index


def speed_before(items: tuple[MissionItem, ...], index: int) -> float | None:
    """Return the ground speed that was set before an item, None for the vehicle's own."""
    for item in reversed(items[:index]):
        if item.command == Command.DO_CHANGE_SPEED and (item.param1 or 0.0) <= 1.0:
            speed = item.param2
            return speed if speed is not None and speed > 0.0 else None
    return None


def item_to_mark(old: Mission, item: int, new: Mission, resume_at: int) -> int:
    """Return the item that goes on without a gap: the target, or the first DO item before it that is needed.

    DO items that would set what holds already are left out: a camera that is told its distance again may
    take an image at once.
    """
    first = first_command(new.items, resume_at)
    for k in range(first, resume_at):
        one = new.items[k]
        if one.command == Command.DO_CHANGE_SPEED:
            if speed_before(new.items, k + 1) != speed_before(old.items, item):
                return k
        elif one.command not in CAMERA or _camera_before(new.items, k + 1) != _camera_before(old.items, item):
            return k
    return resume_at


def _camera_before(items: tuple[MissionItem, ...], index: int) -> tuple[int, float]:
    """Return command and distance or interval of the camera before an item; (0, 0) when it is off."""
    for item in reversed(items[:index]):
        if item.command in CAMERA:
            value = item.param1 or 0.0
            return (item.command, value) if value > 0.0 else (0, 0.0)
    return 0, 0.0


def revised_mission(
    held: Mission,
    item: int,
    path_deg: Sequence[tuple[float, float]],
    *,
    altitude_m: float,
    acceptance_radius_m: float,
) -> tuple[Mission, int]:
    """Return the mission that goes on through other waypoints, and its item to go on with.

    It keeps take-off, speed and camera of the held mission, of which `item` is flown now, and ends as that
    does. A camera that takes images already goes on without one of its own at the change; otherwise it
    begins at the change. The waypoints are latitudes and longitudes; none is the way home at once.

    Examples
    --------
    >>> items = (MissionItem.waypoint(28.05, -82.15, 10.0), MissionItem(Command.NAV_RETURN_TO_LAUNCH))
    >>> new, resume_at = revised_mission(
    ...     Mission(items), 0, [(28.06, -82.15)], altitude_m=10.0, acceptance_radius_m=1.0
    ... )
    >>> [one.command for one in new.items], resume_at
    ([16, 20], 0)
    """
    items = held.items
    end = next(
        (k for k, one in enumerate(items) if is_return(one) or one.command == Command.DO_LAND_START),
        len(items),
    )
    begin = [one for one in items[:end] if one.command == Command.NAV_TAKEOFF][:1]
    speeds = [one for one in items[:end] if one.command == Command.DO_CHANGE_SPEED]
    before = [one for one in items[: min(item, end)] if one.command == Command.DO_CHANGE_SPEED]
    begin += before[-1:] or speeds[:1]
    cameras = [one for one in items[:end] if one.command in CAMERA]
    taking = [one for one in items[: min(item, end)] if one.command in CAMERA]
    starts = [one for one in cameras if (one.param1 or 0.0) > 0.0]
    on = bool(taking) and (taking[-1].param1 or 0.0) > 0.0
    waypoints = [
        MissionItem.waypoint(latitude, longitude, altitude_m, acceptance_radius_m=acceptance_radius_m)
        for latitude, longitude in path_deg
    ]
    if on and waypoints:
        begin.append(replace(taking[-1], param3=0.0))
    elif waypoints:
        begin += starts[:1]
    resume_at = len(begin)
    stop = [MissionItem(starts[0].command)] if starts else []
    if not waypoints:
        resume_at += len(stop)
    return replace(held, items=(*begin, *waypoints, *stop, *items[end:])), resume_at
