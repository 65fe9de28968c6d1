"""The vehicle behind a bad radio, and before mutated frames."""

import random

import pytest

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import Command, Frame, GeoPoint, MissionItem, MissionType
from mission.transfer import MissionDownload, MissionUpload
from mission.transfer.events import DownloadComplete, UploadComplete
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.component import NEVER
from sim_vehicle.host.simulation import Impairment, Simulation, StopReason
from sim_vehicle.mavlink import SimVehicle

HOME = GeoPoint(28.05, -82.15, 20.0)


def plan(count):
    places = [MissionItem.waypoint(28.05 + 1e-5 * i, -82.15, 10.0) for i in range(count)]
    takeoff = MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, x=28.05, y=-82.15, z=10.0)
    return (takeoff, *places, MissionItem(Command.NAV_RETURN_TO_LAUNCH))


class Client:
    """Runs transfers one after another."""

    system_id, component_id, wanted = 255, 190, None

    def __init__(self, *transfers):
        self.waiting, self.transfer, self.events = list(transfers), None, []

    def _take(self, output):
        self.events += output.events
        return list(output.messages)

    def receive(self, message, now_s):
        return [] if self.transfer is None else self._take(self.transfer.receive(message, now_s))

    def poll(self, now_s):
        if self.transfer is None or self.transfer.done:
            if not self.waiting:
                return []
            self.transfer = self.waiting.pop(0)
            return self._take(self.transfer.start(now_s))
        return self._take(self.transfer.poll(now_s))

    def next_deadline(self):
        if self.transfer is None or self.transfer.done:
            return 0.0 if self.waiting else NEVER
        return self.transfer.next_deadline() or NEVER


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("seed", range(4))
def test_a_plan_crosses_a_bad_radio_unharmed(autopilot, seed):
    items = plan(20)
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=autopilot)
    client = Client(
        MissionUpload(items, home=HOME, profile=autopilot.for_vehicle("multirotor").profile),
        MissionDownload(MissionType.MISSION, profile=autopilot.for_vehicle("multirotor").profile),
    )
    radio = Impairment(loss=0.1, duplication=0.05, delay_s=0.02, jitter_s=0.05, seed=seed)
    simulation = Simulation([vehicle, client], impairment=radio, remote=[client])
    reason = simulation.run(lambda _: not client.waiting and client.transfer.done, limit_s=300.0)
    assert reason is StopReason.FINISHED
    assert any(isinstance(event, UploadComplete) for event in client.events)
    assert vehicle.pilot.mission.size == len(items)
    read = next(event for event in client.events if isinstance(event, DownloadComplete))
    assert [item.command for item in read.items] == [item.command for item in items]


def test_mutated_frames_neither_raise_nor_fly_the_vehicle_away():
    rng = random.Random(5)
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    reader, ground, out = FrameReader(), FrameWriter(255, 190), FrameWriter(1, 1)
    templates = [
        m.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0),
        m.MAVLink_command_int_message(1, 1, 6, 192, 0, 0, -1, 1, 0, 0, 280500000, -821500000, 10.0),
        m.MAVLink_mission_count_message(1, 1, 3, 0),
        m.MAVLink_mission_item_int_message(1, 1, 0, 6, 22, 0, 1, 0, 0, 0, 0, 280500000, -821500000, 5.0),
        m.MAVLink_mission_set_current_message(1, 1, 2),
        m.MAVLink_param_set_message(1, 1, b"MPC_XY_CRUISE", 5.0, 9),
        m.MAVLink_set_mode_message(1, 1, 0x04040000),
        m.MAVLink_timesync_message(0, 5),
        m.MAVLink_request_data_stream_message(1, 1, 0, 4, 1),
    ]
    now_s = 0.0
    for _ in range(4000):
        message = rng.choice(templates)
        frame = bytearray(ground.encode(message))
        for _ in range(rng.choice([0, 0, 1, 3])):
            frame[rng.randrange(10, len(frame) - 2)] = rng.randrange(256)
        crc = m.x25crc(frame[1:-2])
        crc.accumulate(bytes([message.crc_extra]))
        frame[-2:] = crc.crc.to_bytes(2, "little")
        for heard in reader.feed(bytes(frame)):
            for answer in vehicle.receive(heard, now_s):
                out.encode(answer)
        now_s += 0.02
        for answer in vehicle.poll(now_s):
            out.encode(answer)
    assert reader.frames == 4000
    assert all(abs(value) < 1e5 for value in vehicle.pilot.state.position_m)
    assert vehicle.next_deadline() <= now_s + 0.1
