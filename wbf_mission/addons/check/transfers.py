"""Checks of the mission transfer protocol: broken rules, several ground stations, addresses of messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.model import MissionItem, MissionType
from mission.transfer import result_text, wire
from wbf_mission.addons.check.peer import (
    ACK,
    ANSWERS,
    MISSION,
    RE_REQUEST_S,
    REQUESTS,
    FailedError,
    Peer,
    Sender,
    cancelling,
    needed,
    require_accepted,
    told,
)
from wbf_mission.addons.check.registry import Checks

check = Checks()

_ITEMS: tuple[type[wire.ItemMessage], ...] = (
    m.MAVLink_mission_item_int_message,
    m.MAVLink_mission_item_message,
)
_GIVE_UP_S = 12.0
_COUNT = m.MAVLink_mission_count_message
_OTHER_GROUND = wire.GROUND_STATION[0] - 1


def _listing(peer: Peer) -> Message:
    return m.MAVLink_mission_request_list_message(*peer.address, MISSION)


def _require_ours(peer: Peer, answer: wire.RequestMessage | wire.AckMessage) -> None:
    """Raise FailedError unless the answer is addressed to this station: MAVSDK stops at a broadcast ACK."""
    target = answer.target_system, answer.target_component
    if target[0] != peer.endpoint.system_id or target[1] not in (0, peer.endpoint.component_id):
        raise FailedError(f"it is addressed to {target[0]}/{target[1]}")


@check("transfer.final-ack")
def final_ack(peer: Peer) -> None:
    """The last item is acknowledged by a MISSION_ACK addressed to the sender."""
    sender = Sender.begun(peer, peer.items(3))
    answer = sender.finish()
    require_accepted(answer)
    _require_ours(peer, answer)


@check("transfer.asks-first")
def asks_first(peer: Peer) -> str:
    """COUNT is answered by a request for item 0, addressed to the sender."""
    sender = Sender.begun(peer, peer.items(4))
    answer = peer.expect(REQUESTS, RE_REQUEST_S)
    sender.cancel()
    if answer is None:
        return "asked once"
    _require_ours(peer, answer)
    return str(answer.get_type())


@check("transfer.asks-again")
def asks_again(peer: Peer) -> str:
    """An item that does not arrive is requested again."""
    sender = Sender.begun(peer, peer.items(4))
    sender.send(0)
    seen = 0
    began_s = peer.now()
    while peer.now() - began_s < RE_REQUEST_S and seen < 2:
        answer = peer.expect(REQUESTS, RE_REQUEST_S)
        seen += answer is not None and answer.seq == 1
    after_s = peer.now() - began_s
    if seen < 2:
        sender.cancel()
        raise FailedError(f"it is not requested again in {RE_REQUEST_S} s")
    sender.complete(1)
    return f"after {after_s:.2f} s"


@check("transfer.duplicate-count")
def duplicate_count(peer: Peer) -> None:
    """A duplicate COUNT does not break the upload."""
    sender = Sender.begun(peer, peer.items(4))
    peer.send(_COUNT(*peer.address, len(sender.items), MISSION))
    sender.complete()
    peer.require_equal(peer.items(4))


@check("transfer.duplicate-item")
def duplicate_item(peer: Peer) -> None:
    """A duplicate item does not break the upload."""
    sender = Sender.begun(peer, peer.items(4))
    sender.send(0)
    sender.complete()
    peer.sleep(0.5)
    peer.require_equal(peer.items(4))


@check("transfer.out-of-order")
def out_of_order(peer: Peer) -> None:
    """An item out of order is not accepted in place of the requested item."""
    sender = Sender.begun(peer, peer.items(5))
    sender.send(2)
    answer = _answer_to_wrong_item(sender)
    if answer is not None and is_a(answer, ACK) and peer.profile.order_result is None:
        return
    sender.complete()
    peer.require_equal(peer.items(5))


@check("transfer.wrong-type")
def wrong_type(peer: Peer) -> None:
    """An item of another type of plan is not accepted as a mission item."""
    sender = Sender.begun(peer, peer.items(4))
    peer.send(sender.message(0, int(MissionType.FENCE)))
    _answer_to_wrong_item(sender)
    sender.cancel()


def _answer_to_wrong_item(sender: Sender) -> wire.RequestMessage | wire.AckMessage | None:
    """Return the answer to an item that was not requested; FailedError if the vehicle accepts the item."""
    answer = sender.peer.expect(ANSWERS, RE_REQUEST_S)
    if answer is not None and wire.is_request(answer) and answer.seq > 0:
        sender.cancel()
        raise FailedError(f"it is accepted: the vehicle asks for item {answer.seq}")
    if answer is not None and is_a(answer, ACK) and answer.type == wire.ACCEPTED:
        raise FailedError("it is accepted")
    return answer


@check("transfer.cancel")
def cancel(peer: Peer) -> None:
    """After OPERATION_CANCELLED in an upload, a new upload works."""
    sender = Sender.begun(peer, peer.items(6))
    sender.send(0)
    sender.cancel()
    peer.upload(peer.items(3))


@check("transfer.cancel-download")
def cancel_download(peer: Peer) -> None:
    """After OPERATION_CANCELLED in a download, a new transfer works."""
    peer.upload(peer.items(4))
    peer.opened(_listing(peer), _COUNT)
    peer.send(cancelling(peer))
    peer.upload(peer.items(3))


@check(
    "transfer.old-plan-kept",
    required=lambda profile: profile.atomic,
    suffers="users whose link breaks in an upload: the vehicle flies a mix of the new and the old mission",
)
def old_plan_kept(peer: Peer) -> None:
    """A cancelled upload leaves the old mission unchanged."""
    old = peer.items(6)
    peer.upload(old)
    sender = Sender.begun(peer, [replace(item, z=item.z + 5.0) for item in peer.items(4)])
    sender.send_first(len(sender.items) - 2)
    sender.cancel()
    if not peer.profile.atomic:
        # ArduPilot ignores OPERATION_CANCELLED: the upload ends by timeout; until then, downloads fail.
        peer.sleep(peer.profile.abort_s + 2.0)
    peer.require_equal(old)


@check("transfer.silence")
def silence(peer: Peer) -> str:
    """A new upload works 12 s after a client stopped during an upload."""
    sender = Sender.begun(peer, peer.items(6))
    sender.send(0)
    peer.sleep(_GIVE_UP_S)
    peer.upload(peer.items(3))
    return f"tried after {_GIVE_UP_S:g} s"


@check("transfer.late-item")
def late_item(peer: Peer) -> None:
    """An item that was not requested changes nothing."""
    peer.upload(peer.items(4))
    peer.send(Sender(peer, peer.items(4)).message(1))
    peer.sleep(0.5)
    peer.require_equal(peer.items(4))


@check(
    "transfer.last-ack-again",
    required=False,
    suffers="clients that lose the last ACK: they report a failed upload",
)
def last_ack_again(peer: Peer) -> None:
    """If the last item is sent again, it is acknowledged again."""
    sender = Sender.begun(peer, peer.items(4))
    sender.complete()
    peer.forget()
    sender.send(len(sender.items) - 1)
    if peer.expect(ACK) is None:
        raise FailedError("no MISSION_ACK")


@check("transfer.unknown-command")
def unknown_command(peer: Peer) -> str:
    """An item with an unknown command is refused by MISSION_ACK."""
    items = peer.items(4)
    return _refused(peer, [*items[:2], MissionItem(31999), *items[2:]])


@check("transfer.unknown-frame")
def unknown_frame(peer: Peer) -> str:
    """An item in a frame that does not exist is refused by MISSION_ACK."""
    sender = Sender(peer, peer.items(3))
    wrong = sender.message(1)
    wrong.frame = 200
    return _refused_message(sender, wrong, 1)


@check(
    "transfer.bad-latitude",
    required=False,
    suffers="clients that do not check coordinates: MAVSDK, scripts (PX4 stores it, but does not fly it)",
)
def bad_latitude(peer: Peer) -> str:
    """A latitude of 95 degrees is refused."""
    sender = Sender(peer, peer.items(3))
    wrong = sender.message(1)
    wrong.x = 950_000_000
    return _refused_message(sender, wrong, 1)


@check("transfer.nan")
def nan(peer: Peer) -> str:
    """A yaw of NaN is stored or refused, and the vehicle keeps answering."""
    sender = Sender.begun(peer, peer.items(4))
    index = 2 if peer.profile.home_at_zero else 1
    sender.send_first(index)
    item = sender.message(index)
    item.param4 = float("nan")
    peer.send(item)
    answer = needed(peer.expect(ANSWERS, RE_REQUEST_S), "the vehicle falls silent")
    if is_a(answer, ACK) and answer.type != wire.ACCEPTED:
        return f"refused: {result_text(answer.type)}"
    sender.cancel()
    return "taken"


@check(
    "transfer.too-many",
    required=False,
    suffers="clients that do not know the limit and send the whole plan first",
)
def too_many(peer: Peer) -> str:
    """A COUNT of 65535 is refused or can be cancelled."""
    question = _COUNT(*peer.address, 65535, MISSION)
    answer = _opened_and_cancelled(peer, question)
    if is_a(answer, ACK) and answer.type == wire.ACCEPTED:
        raise FailedError("it is accepted")
    return told(answer)


def _opened_and_cancelled(peer: Peer, question: Message) -> wire.RequestMessage | wire.AckMessage:
    """Start an upload, cancel it, and return the vehicle's answer to its start."""
    answer = peer.opened(question, ANSWERS)
    Sender(peer, ()).cancel()
    if answer is None:
        raise FailedError("no answer")
    return answer


@check("transfer.count-zero")
def count_zero(peer: Peer) -> None:
    """COUNT 0 clears the mission."""
    peer.upload(peer.items(4))
    answer = needed(peer.opened(_COUNT(*peer.address, 0, MISSION), ACK), "no MISSION_ACK")
    require_accepted(answer)
    left = peer.left(0)
    if left:
        raise FailedError(f"{left} items are left")


@check("transfer.unknown-type", required=False, suffers="clients that send plans of a later protocol")
def unknown_type(peer: Peer) -> str:
    """A COUNT with a plan type that does not exist is refused."""
    answer = _opened_and_cancelled(peer, _COUNT(*peer.address, 3, 77))
    if wire.is_request(answer) or answer.type == wire.ACCEPTED:
        raise FailedError(told(answer))
    return told(answer)


@check("transfer.request-beyond")
def request_beyond(peer: Peer) -> None:
    """A request for an item number beyond the mission is not answered with an item."""
    peer.upload(peer.items(3))
    peer.opened(_listing(peer), _COUNT)
    peer.forget()
    peer.send(m.MAVLink_mission_request_int_message(*peer.address, 300, MISSION))
    answer = peer.expect(_ITEMS, 1.0)
    peer.send(cancelling(peer))
    if answer is not None:
        raise FailedError(f"item {answer.seq} comes")
    peer.upload(peer.items(2))


@check("transfer.re-read")
def re_read(peer: Peer) -> None:
    """A repeated request is answered again."""
    peer.upload(peer.items(3))
    peer.opened(_listing(peer), _COUNT)
    question = m.MAVLink_mission_request_int_message(*peer.address, 0, MISSION)
    for number in (1, 2):
        if peer.ask(question, m.MAVLink_mission_item_int_message, where=lambda a: a.seq == 0) is None:
            raise FailedError(f"request {number} of item 0 gives no MISSION_ITEM_INT")
    peer.send(cancelling(peer))


@check("transfer.second-station")
def second_station(peer: Peer) -> str:
    """A second ground station cannot interfere with an upload."""
    items = peer.items(4)
    sender = Sender.begun(peer, items)
    sender.send(0)
    peer.expect(REQUESTS, RE_REQUEST_S, lambda a: a.seq == 1)
    peer.forget()
    peer.send_as(_OTHER_GROUND, _COUNT(*peer.address, 2, MISSION))
    answer = peer.expect(ANSWERS, to=_OTHER_GROUND)
    if answer is not None and not (is_a(answer, ACK) and answer.type != wire.ACCEPTED):
        peer.send_as(_OTHER_GROUND, cancelling(peer))
        # Some autopilots ignore OPERATION_CANCELLED: the second upload ends by timeout.
        peer.sleep(peer.profile.abort_s + 1.0)
        raise FailedError(f"{told(answer)} of the second station")
    sender.complete(1)
    peer.require_equal(items)
    return "not answered" if answer is None else told(answer)


@check("transfer.components")
def components(peer: Peer) -> None:
    """A request for component 0 or 190 of the vehicle's system is answered."""
    for component in (0, int(m.MAV_COMP_ID_MISSIONPLANNER)):
        question = m.MAVLink_mission_request_list_message(peer.address[0], component, MISSION)
        if peer.opened(question, _COUNT) is None:
            raise FailedError(f"no MISSION_COUNT for component {component}")
        peer.send(cancelling(peer))


@check("transfer.foreign-system")
def foreign_system(peer: Peer) -> None:
    """A request for another system is not answered."""
    other = 237 if peer.address[0] != 237 else 236
    peer.forget()
    peer.send(m.MAVLink_mission_request_list_message(other, peer.address[1], MISSION))
    if peer.expect((_COUNT,)) is not None:
        peer.send(cancelling(peer))
        raise FailedError(f"it answers a request for system {other}")


def _refused(peer: Peer, items: Sequence[MissionItem]) -> str:
    sender = Sender.begun(peer, items)
    answer = sender.finish()
    if answer.type == wire.ACCEPTED:
        raise FailedError("it is accepted")
    return result_text(answer.type)


def _refused_message(sender: Sender, wrong: wire.ItemMessage, number: int) -> str:
    """Upload a mission with `wrong` in place of item `number`, and return the refusal in words."""
    peer = sender.peer
    sender.begin()
    sender.send(0)
    for _ in range(4 * len(sender.items) + 20):
        answer = peer.expect(ANSWERS, RE_REQUEST_S)
        if answer is None:
            sender.cancel()
            raise FailedError("the vehicle falls silent")
        if is_a(answer, ACK):
            if answer.type == wire.ACCEPTED:
                raise FailedError("it is accepted")
            return result_text(answer.type)
        if answer.seq == number:
            peer.send(wrong)
        else:
            sender.send(min(answer.seq, len(sender.items) - 1))
    sender.cancel()
    raise FailedError("it is neither refused nor accepted")
