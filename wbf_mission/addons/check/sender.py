"""Manual mission upload, for checks that break the rules of the transfer protocol."""

from __future__ import annotations

from collections.abc import Sequence

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.model import MissionItem
from mission.transfer import result_text, wire
from wbf_mission.addons.check.peer import ACK, ANSWERS, MISSION, RE_REQUEST_S, REQUESTS, FailedError, Peer

_SETTLE_S = 1.0  # A slow radio may still deliver messages of the previous check.


class Sender:
    """A mission upload in which a check can send, omit or alter each message."""

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
        """Send MISSION_COUNT until the vehicle requests item 0; FailedError if it does not."""
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
        """Send one item."""
        self.peer.send(self.message(number))

    def send_first(self, count: int) -> None:
        """Send the first `count` items; after each item, wait until the vehicle requests the next item."""
        for number in range(count):
            self.send(number)
            self.peer.expect(REQUESTS, RE_REQUEST_S, lambda a, number=number: a.seq == number + 1)  # type: ignore[misc]

    def complete(self, first: int = 0) -> None:
        """Finish the upload; FailedError unless the vehicle accepts it."""
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
