"""Hostile bytes, crowds and clients that stop half-way: nothing raises, grows or stalls."""

import gc
import random
import socket
import struct
import threading
import time
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.link import MavlinkEndpoint
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import GeoPoint, Mission, MissionItem
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from tests.support.peer import running

HOME = GeoPoint(28.05, -82.15, 20.0)
KINDS = sorted(m.mavlink_map)
LIKELY = sorted(SimVehicle(get_vehicle("quad"), HOME).wanted or ())


def crc_of(body, kind):
    crc = m.x25crc(body)
    crc.accumulate(bytes([m.mavlink_map[kind].crc_extra]))
    return struct.pack("<H", crc.crc)


def valid_frame(rng, kind):
    """A frame with a good checksum and random fields; often addressed to the vehicle."""
    message_type = m.mavlink_map[kind]
    payload = bytearray(rng.randbytes(message_type.unpacker.size))
    for _ in range(rng.randrange(3)):
        at = rng.randrange(len(payload))
        payload[at : at + 4] = rng.choice(
            [b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\0\x80\x7f", b"\0\0\xc0\x7f"]
        )
        del payload[message_type.unpacker.size :]
    if rng.random() < 0.8:
        from sim_vehicle.host.router import target_offsets

        for at, value in zip(target_offsets(kind), (1, rng.choice([1, 1, 0, 190, 100])), strict=True):
            if at >= 0:
                payload[at] = value
    cut = bytes(payload[: rng.randrange(1, len(payload) + 1)]) if rng.random() < 0.2 else bytes(payload)
    head = struct.pack("<BBBBBBHB", len(cut), 0, 0, rng.randrange(256), 255, 190, kind & 0xFFFF, kind >> 16)
    return b"\xfd" + head + cut + crc_of(head + cut, kind)


def attack(rng):
    """Some bytes that nobody would want."""
    luck = rng.random()
    if luck < 0.15:
        return rng.randbytes(rng.randrange(1, 300))
    frame = valid_frame(rng, rng.choice(LIKELY if luck < 0.7 else KINDS))
    if luck > 0.9:
        broken = bytearray(frame)
        for _ in range(rng.randrange(1, 4)):
            broken[rng.randrange(len(broken))] = rng.randrange(256)
        return bytes(broken[: rng.randrange(1, len(broken) + 1)])
    return frame


def bombard(vehicle, rng, total, *, step_s=0.003):
    """Feed a vehicle on the virtual clock until so many bytes went in; returns the simulation."""
    simulation = Simulation([vehicle])
    link = simulation.open_link()
    sent = steps = 0
    while sent < total:
        data = b"".join(attack(rng) for _ in range(20))
        sent += len(data)
        link.send(data)
        steps += 1
        before_s = simulation.now_s
        link.sleep(step_s * 20)
        assert simulation.now_s == pytest.approx(before_s + step_s * 20)
        link.receive()
    return simulation


def still_works(vehicle):
    """Whether a vehicle takes a mission after all that."""
    simulation = Simulation([vehicle])
    simulation.now_s = vehicle.state.now_us / 1e6
    link = simulation.open_link()
    driver = TransferDriver(MavlinkEndpoint(link, 255, 190), clock=link.clock, wait=link.wait)
    link.sleep(20.0)
    items = tuple(MissionItem.waypoint(28.05 + 1e-5 * k, -82.15, 10.0) for k in range(4))
    driver.wait_for_vehicle()
    driver.upload(Mission(items, home=HOME))
    position = vehicle.pilot.state.position_m
    return all(abs(value) < 1e6 for value in position)


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_short_bombardment(autopilot):
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=autopilot)
    bombard(vehicle, random.Random(3), 150_000)
    assert still_works(vehicle)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_ten_million_bytes(autopilot):
    rng = random.Random(9)
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=autopilot)
    simulation = bombard(vehicle, rng, 500_000)
    gc.collect()
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    link = simulation.open_link()
    sent = 0
    while sent < 5_000_000:
        data = b"".join(attack(rng) for _ in range(20))
        sent += len(data)
        link.send(data)
        link.sleep(0.06)
        link.receive()
        simulation._links[0].receive()
    gc.collect()
    growth = sum(stat.size_diff for stat in tracemalloc.take_snapshot().compare_to(before, "filename"))
    tracemalloc.stop()
    assert growth < 8_000_000, growth
    assert still_works(vehicle)


@pytest.mark.parametrize("kind", ["all"])
def test_every_message_of_the_dialect_with_random_fields(kind):
    rng = random.Random(11)
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    reader, writer = FrameReader(), FrameWriter(1, 1)
    now_s = 0.0
    for number in KINDS:
        for _ in range(4):
            for message in reader.feed(valid_frame(rng, number)):
                for answer in vehicle.receive(message, now_s):
                    writer.encode(answer)
            now_s += 0.01
        for answer in vehicle.poll(now_s):
            writer.encode(answer)
    assert reader.frames > 2 * len(KINDS)


@given(st.lists(st.binary(max_size=300), max_size=20))
@settings(max_examples=60)
def test_any_bytes_through_a_link(pieces):
    simulation = Simulation([SimVehicle(get_vehicle("quad"), HOME)])
    link = simulation.open_link()
    for piece in pieces:
        link.send(piece)
        link.sleep(0.05)
    assert simulation.now_s == pytest.approx(0.05 * len(pieces))


def serving():
    """A vehicle on TCP and UDP, in its own thread."""
    urls = ["tcpin:127.0.0.1:0", "udpin:127.0.0.1:0"]
    return running(Server([SimVehicle(get_vehicle("quad"), HOME)], urls))


def port_of(url):
    return int(url.rsplit(":", 1)[1])


def connected(server):
    return socket.create_connection(("127.0.0.1", port_of(server.urls[0])))


def ping(connection, number):
    """Ask something, and wait for the answer."""
    codec = m.MAVLink(None, 240, 190)
    reader = FrameReader({4})
    connection.settimeout(0.2)
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        connection.send(m.MAVLink_ping_message(1, number, 0, 0).pack(codec))
        try:
            data = connection.recv(65536)
        except TimeoutError:
            continue
        if any(message.seq == number and message.target_system for message in reader.feed(data)):
            return True
    return False


def test_a_server_under_fire_goes_on_answering():
    rng = random.Random(5)
    with serving() as server:
        attackers = [connected(server) for _ in range(3)]
        udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        udp.connect(("127.0.0.1", port_of(server.urls[1])))
        for _ in range(150):
            for attacker in attackers:
                attacker.setblocking(False)
                try:
                    attacker.send(b"".join(attack(rng) for _ in range(5)))
                    attacker.recv(1 << 20)
                except (BlockingIOError, ConnectionError):
                    pass
            udp.send(attack(rng))
        honest = connected(server)
        assert ping(honest, 77)
        for one in (*attackers, udp, honest):
            one.close()


def test_ten_clients_at_once():
    with serving() as server:
        items = tuple(MissionItem.waypoint(28.05 + 1e-5 * k, -82.15, 10.0) for k in range(5))
        clients = [connected(server) for _ in range(10)]
        answers = []
        threads = [
            threading.Thread(target=lambda c=c, i=i: answers.append(ping(c, 100 + i)))
            for i, c in enumerate(clients)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10.0)
        assert answers == [True] * 10
        from mission.link import open_link

        with TransferDriver(
            MavlinkEndpoint(open_link(f"tcp:127.0.0.1:{port_of(server.urls[0])}"), 255, 190)
        ) as driver:
            driver.upload(Mission(items, home=HOME))
        assert len(server.clients) >= 10
        for client in clients:
            client.close()


def steps_of_upload(items):
    yield m.MAVLink_mission_count_message(1, 1, len(items), 0)
    for seq, item in enumerate(items):
        yield m.MAVLink_mission_item_int_message(
            1, 1, seq, 3, item.command, 0, 1, 0, 0, 0, 0, item.wire_x(), item.wire_y(), item.z, 0
        )


def steps_of_download(count):
    yield m.MAVLink_mission_request_list_message(1, 1, 0)
    for seq in range(count):
        yield m.MAVLink_mission_request_int_message(1, 1, seq, 0)
    yield m.MAVLink_mission_ack_message(1, 1, 0, 0)


ITEMS = tuple(MissionItem.waypoint(28.05 + 1e-5 * k, -82.15, 10.0) for k in range(4))


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("what", ["upload", "download", "parameters"])
def test_a_client_that_stops_in_the_middle_of_each_step(autopilot, what):
    scripts = {
        "upload": list(steps_of_upload(ITEMS)),
        "download": list(steps_of_download(4)),
        "parameters": [
            m.MAVLink_param_request_list_message(1, 1),
            m.MAVLink_param_request_read_message(1, 1, b"", 3),
        ],
    }
    script = scripts[what]
    for stop in range(1, len(script) + 1):
        vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=autopilot)
        simulation = Simulation([vehicle])
        driver_link = simulation.open_link("good")
        driver = TransferDriver(
            MavlinkEndpoint(driver_link, 255, 190), clock=driver_link.clock, wait=driver_link.wait
        )
        driver.upload(Mission(ITEMS, home=HOME))
        writer = FrameWriter(250, 190)
        bad = simulation.open_link("bad")
        for message in script[:stop]:
            frame = writer.encode(message)
            bad.send(frame)
            driver_link.sleep(0.02)
        frame = writer.encode(script[min(stop, len(script) - 1)])
        bad.send(frame[: len(frame) // 2])  # stops in the middle of a frame too
        bad.close()
        driver_link.sleep(12.0)
        driver.upload(Mission(ITEMS[:3], home=HOME))
        assert len(driver.download()[0].items) == 3
        assert vehicle.next_deadline() < simulation.now_s + 2.0
