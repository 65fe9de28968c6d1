"""Extras of add-ons: what they hook into, with the vehicle's own answers first."""

import pytest

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.mavlink import extras
from sim_vehicle.mavlink.extras import VehicleExtra
from tests.support.peer import Peer

HOME_COMMAND, OWN_COMMAND, OWN_MESSAGE = 410, 31010, m.MAVLINK_MSG_ID_MOUNT_STATUS


class Extra(VehicleExtra):
    """An extra with a command, a message and an opinion of its own."""

    capabilities = 1 << 40

    def __init__(self, *parts):
        super().__init__(*parts)
        self.calls = []
        self.commands = {OWN_COMMAND: lambda command: m.MAV_RESULT_FAILED, HOME_COMMAND: self._failed}
        self.builders = {OWN_MESSAGE: lambda state: m.MAVLink_mount_status_message(0, 0, 1, 2, 3, 0)}
        self.handlers = {m.MAVLINK_MSG_ID_PING: lambda message, now_s: [m.MAVLink_ping_message(7, 7, 7, 7)]}
        self.ready = False

    def _failed(self, command):
        self.calls.append(command.id)
        return m.MAV_RESULT_FAILED

    def is_ready(self, message_id):
        return message_id != OWN_MESSAGE or self.ready

    def why_not_enter(self, mode):
        return "not today" if mode is Mode.LAND else None


def peer_with(monkeypatch, *makers, autopilot="px4"):
    monkeypatch.setattr(extras, "_makers", lambda: makers)
    return Peer(autopilot)


def test_an_extra_that_overrides_nothing_changes_nothing(monkeypatch):
    told = []
    for makers in ((), (VehicleExtra,)):
        peer = peer_with(monkeypatch, *makers)
        peer.result(400, 1.0)
        peer.result(22, 0, 0, 0, 0, 0, 0, 30.0)
        peer.wait(20.0)
        told.append([message.to_dict() for message in peer.told])
    assert len(told[0]) > 300 and str(told[0]) == str(told[1])


def test_commands_messages_and_capabilities_of_an_extra(monkeypatch):
    peer = peer_with(monkeypatch, Extra)
    (extra,) = peer.vehicle.extras
    assert peer.result(OWN_COMMAND) == m.MAV_RESULT_FAILED
    assert peer.result(HOME_COMMAND) == m.MAV_RESULT_ACCEPTED, "the vehicle's own handler gives the result"
    assert extra.calls == [HOME_COMMAND]
    assert peer.asked(OWN_MESSAGE).pointing_a == 1
    extra.builders[OWN_MESSAGE], peer.vehicle.builders[OWN_MESSAGE] = [lambda state: None] * 2
    assert peer.result(512, OWN_MESSAGE) == m.MAV_RESULT_DENIED
    extra.ready = True
    assert peer.result(512, OWN_MESSAGE) == m.MAV_RESULT_ACCEPTED
    assert peer.asked(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION).capabilities & Extra.capabilities
    pings = peer.tell(m.MAVLink_ping_message(1, 2, 0, 0))
    assert [ping.seq for ping in pings] == [2, 7]


def test_a_message_of_a_stream_waits_until_it_is_ready(monkeypatch):
    monkeypatch.setattr("sim_vehicle.mavlink.vehicle.STREAMS", {1: (OWN_MESSAGE,)})
    peer = peer_with(monkeypatch, Extra, autopilot="ardupilot")
    (extra,) = peer.vehicle.extras
    peer.tell(m.MAVLink_request_data_stream_message(1, 1, 1, 5, 1))
    peer.wait(2.0)
    assert not peer.of("MOUNT_STATUS")
    extra.ready = True
    peer.wait(2.0)
    assert len(peer.of("MOUNT_STATUS")) == pytest.approx(10, abs=5)
