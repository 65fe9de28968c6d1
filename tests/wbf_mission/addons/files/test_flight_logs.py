"""The logs of flights: what is kept, how much of it, and how peers read it."""

import struct

import pytest
from peer import Peer as GroundPeer

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameWriter
from mission.link.codec.signing import SETUP_SIGNING
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.server import Server
from sim_vehicle.mavlink.vehicle import SimVehicle
from wbf_mission.addons.files.logs import FlightLogs

HOME = GeoPoint(28.05, -82.15, 10.0)
EPOCH_S = 1_700_000_000.0
FRAME = b"0123456789"
RECORD = len(FRAME) + 8


def sizes(logs):
    return [len(log.data) for log in logs.all]


def test_a_log_lasts_from_arming_to_a_second_after_disarming():
    logs = FlightLogs(EPOCH_S)
    logs.write(FRAME, 0, 1.0, armed=False)
    assert logs.all == ()
    for now_s in (2.0, 3.0):
        logs.write(FRAME, 0, now_s, armed=True)
    for now_s in (3.5, 4.0, 4.1, 5.0):
        logs.write(FRAME, 0, now_s, armed=False)
    assert sizes(logs) == [4 * RECORD]
    logs.write(FRAME, 0, 9.0, armed=True)
    assert sizes(logs) == [4 * RECORD, RECORD]
    assert [log.begun_unix_s - EPOCH_S for log in logs.all] == [2.0, 9.0]
    (time_us,) = struct.unpack_from(">Q", logs.all[1].data)
    assert time_us == round((EPOCH_S + 9.0) * 1e6)


@pytest.mark.parametrize(
    "message_id", [SETUP_SIGNING, m.MAVLINK_MSG_ID_LOG_DATA, m.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL]
)
def test_keys_and_downloads_are_not_logged(message_id):
    logs = FlightLogs(EPOCH_S)
    logs.write(FRAME, message_id, 1.0, armed=True)
    assert sizes(logs) == [0]


def test_the_oldest_logs_give_way_and_a_full_one_ends():
    logs = FlightLogs(EPOCH_S, most_bytes=10 * RECORD, most_logs=3)
    for flight in range(5):
        for step in range(3):
            logs.write(FRAME, 0, 10.0 * flight + 0.1 * step, armed=True)
        logs.write(FRAME, 0, 10.0 * flight + 5.0, armed=False)
    assert [log.number for log in logs.all] == [3, 4, 5]
    assert sizes(logs) == [3 * RECORD] * 3
    for step in range(50):
        logs.write(FRAME, 0, 100.0 + step, armed=True)
    assert sizes(logs) == [10 * RECORD]


class Peer(GroundPeer):
    """Asks a vehicle that has some logs, as a ground station."""

    def __init__(self, autopilot, logs=(1000, 900)):
        super().__init__(autopilot, home=HOME)
        for size in logs:
            self.log(size)

    def log(self, size):
        """Arm, log so many bytes, disarm."""
        self.arm(1.0)
        self.vehicle.log_frame(bytes(range(256)) * 40, m.MAVLINK_MSG_ID_LOG_DATA, self.now_s)
        self.vehicle.log_frame((bytes(range(256)) * 40)[: size - 8], 0, self.now_s)
        self.arm(0.0)
        self.now_s += 5.0
        self.vehicle.poll(self.now_s)
        self.vehicle.log_frame(b"", 0, self.now_s)

    def arm(self, value):
        self.ask(m.MAVLink_command_long_message(1, 1, 400, 0, value, 0, 0, 0, 0, 0, 0))
        assert self.vehicle.pilot.armed == bool(value)

    def ask(self, message, source=255):
        return self.tell(message, FrameWriter(source, 190))

    def entries(self, start=0, end=65535):
        told = self.ask(m.MAVLink_log_request_list_message(1, 1, start, end))
        return [(e.id, e.num_logs, e.last_log_num, e.size) for e in told if e.get_type() == "LOG_ENTRY"]

    def data(self, number, offset=0, count=2**32 - 1):
        told = self.ask(m.MAVLink_log_request_data_message(1, 1, number, offset, count))
        while self.vehicle.next_deadline() < self.now_s + 0.02:
            self.now_s = self.vehicle.next_deadline()
            told += self.vehicle.poll(self.now_s)
        return [t for t in told if t.get_type() == "LOG_DATA"]


def texts(told):
    return [message.text for message in told if message.get_type() == "STATUSTEXT"]


def test_lists_are_numbered_as_each_autopilot_numbers_them():
    assert Peer("px4").entries() == [(0, 2, 1, 1000), (1, 2, 1, 900)]
    assert Peer("ardupilot").entries() == [(1, 2, 2, 1000), (2, 2, 2, 900)]
    assert Peer("ardupilot").entries(2, 2) == [(2, 2, 2, 900)]
    assert Peer("px4").entries(0, 0) == [(0, 2, 0, 1000)]
    assert Peer("px4", logs=()).entries() == [(0, 0, 0, 0)]


@pytest.mark.parametrize(("autopilot", "first"), [("px4", 0), ("ardupilot", 1)])
@pytest.mark.parametrize("size", [900, 1000, 9999])
def test_a_log_comes_whole_and_in_parts(autopilot, first, size):
    peer = Peer(autopilot, logs=(size,))
    parts = peer.data(first)
    whole = b"".join(bytes(part.data)[: part.count] for part in parts)
    assert len(whole) == size
    assert whole[8:] == (bytes(range(256)) * 40)[: size - 8]
    assert [part.ofs for part in parts] == list(range(0, size, 90))
    gap = peer.data(first, 90, 180)
    assert [(part.ofs, part.count) for part in gap] == [(90, 90), (180, 90)]
    (beyond,) = peer.data(first, 100_000)
    assert beyond.count == 0


def test_ardupilot_sends_no_logs_while_it_is_armed_and_says_so_once():
    peer = Peer("ardupilot")
    peer.arm(1.0)
    told = peer.ask(m.MAVLink_log_request_list_message(1, 1, 0, 65535))
    told += peer.ask(m.MAVLink_log_request_list_message(1, 1, 0, 65535))
    assert texts(told) == ["Disarm for log download"]
    peer = Peer("px4")
    peer.arm(1.0)
    assert len(peer.entries()) == 2


def test_one_download_at_a_time():
    request = m.MAVLink_log_request_data_message(1, 1, 1, 0, 2**32 - 1)
    peer = Peer("ardupilot", logs=(9999,))
    peer.ask(request)
    assert texts(peer.ask(request, source=254)) == ["Log download in progress"]
    assert peer.ask(request) == []
    peer.ask(m.MAVLink_log_request_end_message(1, 1))
    assert peer.data(1)[0].ofs == 0
    peer = Peer("px4", logs=(9999,))
    request.id = 0
    peer.ask(request)
    assert peer.data(0, 90, 90)[0].ofs == 90


def test_erased_logs_are_gone():
    peer = Peer("ardupilot")
    peer.ask(m.MAVLink_log_erase_message(1, 1))
    assert peer.entries() == [(0, 0, 0, 0)]


def test_only_the_server_makes_a_vehicle_keep_a_log():
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    vehicle.poll(0.0)
    vehicle.pilot.arm()
    with Server([vehicle], ["tcpin:127.0.0.1:0"], speed=float("inf")) as server:
        server.run(limit_s=3.0)
    (log,) = vehicle.extras[0]._logs.all
    assert log.data[8] == 0xFD
    assert 1000 < len(log.data) < 30_000
