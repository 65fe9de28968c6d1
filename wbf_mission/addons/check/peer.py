"""Ground station of the checks: sends requests, commands and plans, and uploads that break the rules."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import TypeAlias, TypeVar

from geo.errors import WbfMissionError
from mission.autopilots.profile import Profile
from mission.errors import TransferError
from mission.link.address import Link, MavlinkEndpoint
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import CommandMessage, is_a
from mission.model import Command, GeoPoint, Mission, MissionItem, MissionType
from mission.transfer import RoundTrip, VerifiedUpload, compare_plans, result_text, wire
from mission.transfer.driver import TransferDriver, wait_readable
from mission.transfer.vehicles import Vehicle


class CheckError(WbfMissionError, ValueError):
    """A check that does not exist is requested, or the vehicle is armed before the checks."""


class FailedError(WbfMissionError):
    """Raised by a check that fails; the text describes the observation."""


class SkippedError(WbfMissionError):
    """Raised by a check that cannot be run on this vehicle; the text states the reason."""


M = TypeVar("M", bound=Message)
T = TypeVar("T")
Ack: TypeAlias = m.MAVLink_command_ack_message
_LONGEST_WAIT_S = 0.1
_ANSWER_S = 1.5
_TRIES = 3
BUSY_S = 12.0
"""Longest time (s) for which an autopilot refuses a new transfer: PX4 refuses for 5 s, ArduPilot for 8 s."""
_SLOW_S = 3.0
_SPARE_S = 0.3
_SOMEWHERE = GeoPoint(47.397742, 8.545594, 488.0)


class Peer:
    """A ground station that sends requests to the vehicle under test and waits for answers.

    `clock` returns monotonic seconds; ``wait(link, seconds)`` returns when data may have arrived. A
    `sim_vehicle.host.simulation.VirtualLink` provides both for a simulation on its virtual clock.
    """

    def __init__(
        self,
        link: Link,
        *,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[Link, float], None] = wait_readable,
    ) -> None:
        self.endpoint = MavlinkEndpoint(link, *wire.GROUND_STATION)
        self.driver = TransferDriver(self.endpoint, clock=clock, wait=wait)
        self.endpoint.reader.wanted = None
        self.texts: deque[str] = deque(maxlen=200)
        self.armed = False
        self.home = _SOMEWHERE
        self.now = clock
        self._wait = wait
        self._queue: deque[tuple[float, Message]] = deque()
        self._beat_s = -math.inf
        self._round_trip = RoundTrip()
        self._others: set[int] = set()
        self._unsettled = False

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle under test, once the driver has found it."""
        assert self.driver.vehicle is not None
        return self.driver.vehicle

    @property
    def profile(self) -> Profile:
        """Mission behaviour of the vehicle's autopilot."""
        return self.vehicle.profile

    @property
    def address(self) -> tuple[int, int]:
        """System and component id of the vehicle."""
        return self.vehicle.system_id, self.vehicle.component_id

    def send(self, *messages: Message) -> None:
        """Send messages to the vehicle under test."""
        for message in messages:
            self._unsettled |= type(message).id in wire.SERVER_MESSAGES
            self.endpoint.send(message)

    def send_as(self, system_id: int, *messages: Message) -> None:
        """Send messages as another ground station."""
        other = MavlinkEndpoint(self.endpoint.link, system_id, self.endpoint.component_id)
        self._others.add(system_id)
        self._unsettled = True
        for message in messages:
            other.send(message)

    def forget(self) -> None:
        """Discard the messages received until now."""
        self._receive()
        self._queue.clear()

    def heard(self, seconds: float) -> Iterator[tuple[float, Message]]:
        """Yield (time, message) from the vehicle's autopilot during `seconds`."""
        end_s = self.now() + seconds
        while True:
            while self._queue:
                now_s, message = self._queue.popleft()
                if (message.get_srcSystem(), message.get_srcComponent()) == self.address:
                    yield now_s, message
            left_s = end_s - self.now()
            if left_s <= 0.0:
                return
            if self.now() >= self._beat_s + 1.0:
                self._beat_s = self.now()
                self.send(wire.ground_heartbeat())
            self._wait(self.endpoint.link, min(left_s, _LONGEST_WAIT_S))
            self._receive()

    def _receive(self) -> None:
        now_s = self.now()
        for message in self.endpoint.receive():
            if message.get_srcSystem() == self.vehicle.system_id:
                if is_a(message, m.MAVLink_statustext_message):
                    self.texts.append(str(message.text))
                elif (
                    is_a(message, m.MAVLink_heartbeat_message)
                    and message.get_srcComponent() == self.address[1]
                ):
                    self.armed = bool(message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED)
            self._queue.append((now_s, message))

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` and discard the messages received meanwhile."""
        for _ in self.heard(seconds):
            pass

    def collect(self, kind: type[M], seconds: float) -> list[tuple[float, M]]:
        """Return the messages of one kind received in the next `seconds`, with their times."""
        self.forget()
        return [(now_s, message) for now_s, message in self.heard(seconds) if is_a(message, kind)]

    def expect(
        self,
        kinds: type[M] | tuple[type[M], ...],
        seconds: float = _ANSWER_S,
        where: Callable[[M], bool] = lambda _: True,
        *,
        to: int | None = None,
    ) -> M | None:
        """Return the first message of one of these kinds, or None after `seconds`.

        With `to`, only messages to this system count. By default, messages to other stations are ignored.
        """
        wanted = kinds if isinstance(kinds, tuple) else (kinds,)
        for _, message in self.heard(seconds):
            target = getattr(message, "target_system", None)
            if target != to if to is not None else target in self._others:
                continue
            for kind in wanted:
                if is_a(message, kind) and where(message):
                    return message
        return None

    def ask(
        self,
        question: Message,
        kinds: type[M] | tuple[type[M], ...],
        *,
        where: Callable[[M], bool] = lambda _: True,
        tries: int = _TRIES,
    ) -> M | None:
        """Send `question` until an answer arrives, at most `tries` times; return the answer, or None."""
        for _ in range(tries):
            self.forget()
            self.send(question)
            answer = self.expect(kinds, where=where)
            if answer is not None:
                return answer
        return None

    def opened(
        self,
        question: Message,
        kinds: type[M] | tuple[type[M], ...],
        where: Callable[[M], bool] = lambda answer: not (is_a(answer, ACK) and answer.type == wire.ERROR),
    ) -> M | None:
        """Repeat `question` until `where` holds for the answer, since an earlier transfer may still be open.

        After `BUSY_S` the last answer is returned, even if `where` does not hold for it.
        """
        end_s = self.now() + BUSY_S
        while True:
            answer = self.ask(question, kinds, tries=1)
            if (answer is not None and where(answer)) or self.now() >= end_s:
                return answer
            if answer is not None:
                self.sleep(_ANSWER_S)

    def left(self, expected: int) -> int:
        """Return the number of mission items; poll it for a few seconds until it equals `expected`."""
        end_s = self.now() + _SLOW_S
        while (found := len(self.download())) != expected and self.now() < end_s:
            self.sleep(0.5)
        return found

    def command(self, command: int, *params: float, tries: int = _TRIES) -> Ack | None:
        """Send COMMAND_LONG; return the COMMAND_ACK that follows any IN_PROGRESS; None without an answer."""
        values = [*params, *[0.0] * (7 - len(params))]
        for number in range(tries):
            question = m.MAVLink_command_long_message(*self.address, command, number, *values)
            answer = self.acknowledged(question, tries=1)
            while answer is not None and answer.result == m.MAV_RESULT_IN_PROGRESS:
                answer = self.expect(Ack, 10.0, lambda a: a.command == command)
            if answer is not None:
                return answer
        return None

    def acknowledged(self, question: CommandMessage, tries: int = _TRIES) -> Ack | None:
        """Send a command until its COMMAND_ACK arrives, at most `tries` times; None without an answer."""
        return self.ask(question, Ack, where=lambda answer: answer.command == question.command, tries=tries)

    def must(self, command: int, *params: float) -> Ack:
        """Send a command; FailedError unless the vehicle accepts the command."""
        answer = self.command(command, *params)
        name = wire.command_name(command)
        if answer is None:
            raise FailedError(f"no COMMAND_ACK for {name}")
        if answer.result != m.MAV_RESULT_ACCEPTED:
            raise FailedError(f"{name} was answered {result_name(answer.result)}{self.said()}")
        return answer

    def request(self, kind: type[M]) -> M | None:
        """Request a message by REQUEST_MESSAGE and return it; None if no such message arrives."""
        return self.ask(wire.command_long(self.address, m.MAV_CMD_REQUEST_MESSAGE, float(kind.id)), kind)

    def said(self) -> str:
        """Return the vehicle's last STATUSTEXT in parentheses, to append to an error text."""
        return f" ({self.texts[-1]!r})" if self.texts else ""

    def items(self, number: int) -> tuple[MissionItem, ...]:
        """Return a harmless mission: take-off, waypoints within 100 m of home, return."""
        home = self.home
        takeoff = MissionItem(
            Command.NAV_TAKEOFF, 3, param1=0.0, x=home.latitude_deg, y=home.longitude_deg, z=10.0
        )
        if number == 1:
            return (MissionItem.waypoint(home.latitude_deg, home.longitude_deg, 10.0),)
        waypoints = [
            MissionItem.waypoint(
                home.latitude_deg + 5e-4 * math.sin(0.7 * k),
                home.longitude_deg + 5e-4 * math.cos(0.7 * k),
                10.0 + k % 7,
            )
            for k in range(number - 2)
        ]
        return (takeoff, *waypoints, MissionItem(Command.NAV_RETURN_TO_LAUNCH))

    def upload(
        self,
        items: Iterable[MissionItem],
        kind: MissionType = MissionType.MISSION,
        *,
        home: GeoPoint | None = None,
    ) -> None:
        """Upload a plan unchanged, download it and compare; RemoteTransferError if any step fails."""
        upload = VerifiedUpload(
            tuple(items),
            kind,
            home=home or self.home,
            target=self.address,
            source=wire.GROUND_STATION,
            profile=self.profile,
            round_trip=self._round_trip,
        )
        self.driver.run(upload)

    def download(self, kind: MissionType = MissionType.MISSION) -> tuple[MissionItem, ...]:
        """Download a plan from the vehicle under test."""
        return self.driver.download(types=[kind])[0].plan(kind)

    def require_equal(self, items: tuple[MissionItem, ...]) -> None:
        """Download the mission; FailedError if the mission differs from `items`."""
        differences = compare_plans(items, self.download(), self.profile)
        if differences:
            raise FailedError(f"the mission differs: {differences[0]}")

    def settle(self) -> None:
        """Cancel pending transfers and wait until an upload works, so that the next check starts clean."""
        self.texts.clear()
        if not self._unsettled:
            return
        off = [wire.ack(self.address, wire.OPERATION_CANCELLED, kind) for kind in MissionType]
        self.send(*off)
        for system_id in self._others:
            self.send_as(system_id, *off)
        end_s, quiet_s = self.now() + BUSY_S, self.profile.re_request_s + _SPARE_S
        while self.now() < end_s and self.expect(MISSION_ANSWERS, quiet_s) is not None:
            pass
        self._others.clear()
        # `upload` retries longer than the vehicle refuses new transfers.
        with suppress(TransferError):
            self.upload(self.items(1))
        self._unsettled = False

    def put_back(self, plans: Mission) -> None:
        """Upload these plans and clear all other plan types; TransferError on failure."""
        self.sleep(0.2)
        for kind in MissionType:
            plan = plans.plan(kind)
            if plan:
                self.upload(plan, kind)
            elif self.download(kind):
                self.driver.clear([kind])


def needed(answer: T | None, otherwise: str) -> T:
    """Return `answer`; if `answer` is None, FailedError with the text `otherwise`."""
    if answer is None:
        raise FailedError(otherwise)
    return answer


def result_name(result: int) -> str:
    """Return the name of a MAV_RESULT.

    >>> result_name(3)
    'UNSUPPORTED'
    """
    return wire.enum_name("MAV_RESULT", result, f"result {result}").removeprefix("MAV_RESULT_")


ACK = m.MAVLink_mission_ack_message
REQUESTS: tuple[type[wire.RequestMessage], ...] = (
    m.MAVLink_mission_request_message,
    m.MAVLink_mission_request_int_message,
)
ANSWERS: tuple[type[wire.RequestMessage | wire.AckMessage], ...] = (*REQUESTS, ACK)
MISSION_ANSWERS: tuple[type[Message], ...] = (
    *ANSWERS,
    m.MAVLink_mission_count_message,
    m.MAVLink_mission_item_message,
    m.MAVLink_mission_item_int_message,
)
RE_REQUEST_S = 4.0
MISSION = int(MissionType.MISSION)


_SETTLE_S = 1.0  # A slow radio may still deliver messages of the previous check.


class Sender:
    """A mission upload in which a check decides about each message: send, omit or alter it."""

    def __init__(self, peer: Peer, items: Sequence[MissionItem]) -> None:
        self.peer = peer
        self.items = [*(wire.home_items(peer.home) if peer.profile.home_at_zero else ()), *items]

    @classmethod
    def begun(cls, peer: Peer, items: Sequence[MissionItem]) -> Sender:
        """Return an upload for which the vehicle has requested item 0."""
        sender = cls(peer, items)
        sender.begin()
        return sender

    def begin(self, kind: int = MISSION) -> None:
        """Send MISSION_COUNT until the vehicle requests item 0; FailedError if item 0 is not requested."""
        question = m.MAVLink_mission_count_message(*self.peer.address, len(self.items), kind)
        answer = self.peer.opened(question, ANSWERS, _asks_for_the_first)
        if answer is None:
            raise FailedError("COUNT is not answered by a request for item 0")
        if not _asks_for_the_first(answer):
            raise FailedError(told(answer))

    def message(self, number: int, kind: int = MISSION) -> wire.ItemMessage:
        """Return the message of one item."""
        return wire.item_to_message(self.items[number], number, kind, self.peer.address, current=number == 0)

    def send(self, number: int) -> None:
        """Send one mission item of the upload."""
        self.peer.send(self.message(number))

    def send_first(self, count: int) -> None:
        """Send the first `count` items; after each item, wait until the vehicle requests the next item."""
        for number in range(count):
            self.send(number)
            self.peer.expect(REQUESTS, RE_REQUEST_S, lambda a, number=number: a.seq == number + 1)  # type: ignore[misc]

    def complete(self, first: int = 0) -> None:
        """Finish the upload; FailedError unless the vehicle accepts the mission."""
        require_accepted(self.finish(first))

    def finish(self, first: int = 0) -> wire.AckMessage:
        """Answer item requests until the final MISSION_ACK, and return it."""
        self.send(first)
        asked = first
        for _ in range(4 * len(self.items) + 20):
            answer = self.peer.expect(ANSWERS, RE_REQUEST_S)
            if answer is None:
                raise FailedError("the vehicle stops answering during the upload")
            if is_a(answer, ACK):
                if answer.type == self.peer.profile.order_result:
                    continue
                return answer
            if answer.seq >= len(self.items):
                raise FailedError(f"the vehicle requests item {answer.seq} of {len(self.items)}")
            if answer.seq > asked + 1:
                self.cancel()
                raise FailedError(f"the vehicle requests item {answer.seq} after item {asked}")
            asked = answer.seq
            self.send(asked)
        self.cancel()
        raise FailedError(f"the vehicle does not end the upload; it still requests item {asked}")

    def cancel(self) -> None:
        """Cancel the upload and wait until the vehicle has processed the message."""
        self.peer.send(cancelling(self.peer))
        self.peer.sleep(_SETTLE_S)


def _asks_for_the_first(answer: wire.RequestMessage | wire.AckMessage) -> bool:
    return wire.is_request(answer) and answer.seq == 0


def cancelling(peer: Peer) -> Message:
    """Return the message that cancels a mission transfer."""
    return wire.ack(peer.address, wire.OPERATION_CANCELLED, MISSION)


def told(message: wire.RequestMessage | wire.AckMessage) -> str:
    """Describe the vehicle's answer in words."""
    if is_a(message, ACK):
        return f"the vehicle answers: {result_text(message.type)}"
    return f"the vehicle asks for item {message.seq}"


def require_accepted(answer: wire.AckMessage) -> None:
    """Raise FailedError unless `answer` accepts the upload."""
    if answer.type != wire.ACCEPTED:
        raise FailedError(told(answer))
