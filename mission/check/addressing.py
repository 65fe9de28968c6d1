"""Checks of who may transfer a mission, and of how a vehicle is addressed."""

from __future__ import annotations

from mission.check.peer import GROUND, FailedError, Peer
from mission.check.registry import Checks
from mission.check.sender import (
    ACK,
    ANSWERS,
    MISSION,
    RE_REQUEST_S,
    REQUESTS,
    Sender,
    require_accepted,
    told,
)
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.transfer import wire

check = Checks()

_COUNT = m.MAVLink_mission_count_message
_OTHER_GROUND = GROUND[0] - 1


@check("transfer.second-station", "a second ground station does not get into an upload")
def second_station(peer: Peer) -> str:
    """Announce a plan from another system in the middle of ours."""
    items = peer.items(4)
    sender = Sender(peer, items)
    sender.begin()
    sender.send(0)
    peer.expect(REQUESTS, RE_REQUEST_S, lambda a: a.seq == 1)
    peer.forget()
    peer.send_as(_OTHER_GROUND, _COUNT(*peer.address, 2, MISSION))
    answer = peer.expect(ANSWERS, where=lambda a: a.target_system == _OTHER_GROUND)
    if answer is not None and not (is_a(answer, ACK) and answer.type != wire.ACCEPTED):
        peer.send_as(_OTHER_GROUND, wire.ack(peer.address, wire.OPERATION_CANCELLED, MISSION))
        # Not all know cancelling: what is left of it runs out.
        peer.sleep(peer.profile.abort_s + 1.0)
        raise FailedError(f"{told(answer)} of the second station")
    require_accepted(sender.finish(1))
    peer.require_equal(items)
    return "not answered" if answer is None else told(answer)


@check("transfer.components", "a request for component 0 or 190 of the vehicle's system is answered")
def components(peer: Peer) -> None:
    """Ask for the list as clients do that know only the system, and those that mean any mission planner."""
    for component in (0, int(m.MAV_COMP_ID_MISSIONPLANNER)):
        question = m.MAVLink_mission_request_list_message(peer.address[0], component, MISSION)
        if peer.ask(question, _COUNT) is None:
            raise FailedError(f"no MISSION_COUNT for component {component}")
        peer.send(wire.ack(peer.address, wire.OPERATION_CANCELLED, MISSION))


@check("transfer.foreign-system", "a request for another system is not answered")
def foreign_system(peer: Peer) -> None:
    """Ask for the list of a system that nobody has."""
    other = 237 if peer.address[0] != 237 else 236
    peer.forget()
    peer.send(m.MAVLink_mission_request_list_message(other, peer.address[1], MISSION))
    if peer.expect((_COUNT,)) is not None:
        peer.send(wire.ack(peer.address, wire.OPERATION_CANCELLED, MISSION))
        raise FailedError(f"it answers a request for system {other}")
