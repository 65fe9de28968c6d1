"""Hostile bytes, crowds and clients that stop half-way: nothing raises, grows or stalls."""

import gc
import random
import struct
import tracemalloc

import pytest
from fastcrc import crc16

from mission.link import MavlinkEndpoint
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameWriter
from mission.model import GeoPoint, Mission, MissionItem
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.host.router import target_offsets
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle

HOME = GeoPoint(28.05, -82.15, 20.0)
ITEMS = tuple(MissionItem.waypoint(28.05 + 1e-5 * k, -82.15, 10.0) for k in range(4))
KINDS = sorted(m.mavlink_map)
LIKELY = sorted(SimVehicle(get_vehicle("quad"), HOME).wanted or ())


def crc_of(body, kind):
    return struct.pack("<H", crc16.mcrf4xx(body + bytes([m.mavlink_map[kind].crc_extra])))


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
    driver.wait_for_vehicle()
    driver.upload(Mission(ITEMS, home=HOME))
    position = vehicle.pilot.state.position_m
    return all(abs(value) < 1e6 for value in position)


@pytest.mark.parametrize("flies", [False, True], ids=["standing", "flying"])
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_short_bombardment(autopilot, flies):
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=autopilot)
    if flies:
        takeoff = MissionItem(22, 3, x=HOME.latitude_deg, y=HOME.longitude_deg, z=10.0)
        vehicle.pilot.load([takeoff, *ITEMS])
        vehicle.pilot.arm()
        vehicle.pilot.start_mission()
        vehicle.poll(3.0)
        assert vehicle.pilot.state.position_m[2] > 0.0
    bombard(vehicle, random.Random(3), 80_000)
    assert still_works(vehicle)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_four_million_bytes(autopilot):
    rng = random.Random(9)
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=autopilot)
    simulation = bombard(vehicle, rng, 500_000)
    gc.collect()
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    link = simulation.open_link()
    sent = 0
    while sent < 1_500_000:
        data = b"".join(attack(rng) for _ in range(20))
        sent += len(data)
        link.send(data)
        link.sleep(0.06)
        link.receive()
        simulation._links[0].receive()
    gc.collect()
    growth = sum(stat.size_diff for stat in tracemalloc.take_snapshot().compare_to(before, "filename"))
    tracemalloc.stop()
    # A quarter of a byte each stays: names of routes, up to their limit.
    assert growth < 1_200_000, growth
    assert still_works(vehicle)


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
