"""ArduPilot's plans as files: the format, and what a vehicle does with an upload."""

import math
import struct

import pytest
from ftp_client import Client
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import GeoPoint, MissionType
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.mavlink.vehicle import SimVehicle
from wbf_mission.addons.files.extra import PLAN_PATHS, pack_plan, unpack_plan
from wbf_mission.addons.files.file_tree import FtpError
from wbf_mission.addons.files.ftp import Operation

HOME = GeoPoint(28.05, -82.15, 10.0)
X, Y = 280500000, -821500000
MISSION = PLAN_PATHS[MissionType.MISSION]


def item(seq, command=16, frame=3, z=10.0, params=(0.0, 0.0, 0.0, 0.0), x=X, y=Y, kind=0):
    return m.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, 0, 1, *params, x + 1000 * seq, y, z, kind
    )


ITEMS = [item(0, frame=0), item(1, 22), item(2), item(3), item(4, 20, x=0, y=0)]


class Vehicle(Client):
    """A vehicle, and whoever reads and writes its files."""

    def __init__(self, autopilot="ardupilot"):
        self.vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot(autopilot))
        self.vehicle.poll(0.0)
        super().__init__(self.vehicle)

    def tell(self, message, source=255):
        (crossed,) = FrameReader().feed(FrameWriter(source, 190).encode(message))
        return self.vehicle.receive(crossed, 0.0)

    def read(self, path):
        data = super().read(path)
        assert len(data) == self.told_size
        return data

    @property
    def commands(self):
        return [one.command for one in self.vehicle.pilot.mission.items]


def test_the_layout_is_ardupilots():
    data = pack_plan(MissionType.MISSION, [item(7, 82, z=3.5, params=(1.0, 2.0, 3.0, 4.0))])
    assert struct.unpack_from("<HHHHH", data) == (0x763D, 0, 0, 0, 1)
    assert data[10:] == m.MAVLink_mission_item_int_message.unpacker.pack(
        1.0, 2.0, 3.0, 4.0, X + 7000, Y, 3.5, 7, 82, 1, 1, 3, 0, 1, 0
    )
    assert len(data) == 48


@given(
    st.lists(
        st.tuples(
            st.integers(1, 65535),
            st.integers(0, 255),
            st.floats(width=32, allow_nan=False),
            st.integers(-(2**31), 2**31 - 65_000_000),
        ),
        max_size=20,
    ),
    st.sampled_from(MissionType),
)
def test_plans_come_back_from_their_bytes(rows, kind):
    items = [
        item(seq, command, frame, z=z, x=x, kind=int(kind)) for seq, (command, frame, z, x) in enumerate(rows)
    ]
    plan = unpack_plan(pack_plan(kind, items), kind)
    assert plan.start is None
    assert pack_plan(kind, plan.items) == pack_plan(kind, [without_target(one) for one in items])


def without_target(message):
    message.target_system = message.target_component = 0
    return message


@given(st.binary(max_size=200))
@settings(max_examples=200)
def test_any_bytes_are_a_plan_or_none(data):
    plan = unpack_plan(b"\x3d\x76" + data, MissionType.MISSION)
    assert plan is None or len(data) == 8 + 38 * len(plan.items)


def test_a_mission_is_written_and_read():
    one = Vehicle()
    assert one.write(MISSION, pack_plan(MissionType.MISSION, ITEMS)) == b""
    assert one.commands == [22, 16, 16, 20]
    read = unpack_plan(one.read(MISSION), MissionType.MISSION).items
    assert [(i.seq, i.command, i.frame) for i in read] == [
        (0, 16, 0), (1, 22, 3), (2, 16, 3), (3, 16, 3), (4, 20, 0)
    ]  # fmt: skip
    for seq, packed in enumerate(read):
        (sent,) = [
            a
            for a in one.tell(m.MAVLink_mission_request_int_message(1, 1, seq, 0))
            if a.get_type() == "MISSION_ITEM_INT"
        ]
        assert pack_plan(0, [without_target(sent)]) == pack_plan(0, [packed])
    assert one.ask(Operation.LIST, b"@MISSION") == b"Ffence.dat\t10\0Fmission.dat\t200\0Frally.dat\t10\0"


def test_rally_points_and_fences_are_written():
    one = Vehicle()
    rally = [item(0, 5100, kind=2), item(1, 5100, kind=2)]
    assert one.write(PLAN_PATHS[MissionType.RALLY], pack_plan(MissionType.RALLY, rally)) == b""
    assert one.vehicle._plans.server.count(MissionType.RALLY) == 2
    circle = [item(0, 5003, params=(50.0, 0.0, 0.0, 0.0), kind=1)]
    assert one.write(PLAN_PATHS[MissionType.FENCE], pack_plan(MissionType.FENCE, circle)) == b""
    assert one.vehicle._plans.server.count(MissionType.FENCE) == 1
    assert one.write(PLAN_PATHS[MissionType.FENCE], pack_plan(MissionType.FENCE, [])) == b""
    assert one.vehicle._plans.server.count(MissionType.FENCE) == 0


def test_a_part_of_a_mission_is_written():
    one = Vehicle()
    one.write(MISSION, pack_plan(MissionType.MISSION, ITEMS))
    data = bytearray(pack_plan(MissionType.MISSION, [item(0, 82)]))
    struct.pack_into("<HH", data, 4, 1, 2)
    assert one.write(MISSION, bytes(data)) == b""
    assert one.commands == [22, 82, 16, 20]


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x3d\x76\0\0\0\0\0\0\x05\0",
        pack_plan(MissionType.FENCE, []),
        pack_plan(MissionType.MISSION, ITEMS)[:-1],
        pack_plan(MissionType.MISSION, [item(0), item(1, 9999)]),
        pack_plan(MissionType.MISSION, [item(0), item(1, z=math.nan)]),
        pack_plan(MissionType.MISSION, [item(0)]).replace(struct.pack("<HH", 0, 1), struct.pack("<HH", 0, 2))
        + bytes(38),
    ],
    ids=["empty", "no items", "another kind", "cut", "unknown command", "no height", "a gap"],
)
def test_what_is_no_plan_is_refused_and_leaves_the_vehicle_ready(data):
    one = Vehicle()
    assert one.write(MISSION, data) is FtpError.FAIL
    assert not one.vehicle._plans.server.busy
    assert one.write(MISSION, pack_plan(MissionType.MISSION, ITEMS)) == b""
    assert one.commands == [22, 16, 16, 20]


def test_a_file_waits_for_the_end_of_an_upload_by_another_station():
    one = Vehicle()
    one.tell(m.MAVLink_mission_count_message(1, 1, 3, 0), source=254)
    assert one.write(MISSION, pack_plan(MissionType.MISSION, ITEMS)) is FtpError.FAIL
    assert one.vehicle._plans.server.busy


def test_ardupilot_tells_nothing_of_a_system_that_it_does_not_have():
    one = Vehicle()
    assert one.ask(Operation.OPEN_TO_READ, b"@SYS/threads.txt") is FtpError.NOT_FOUND
    assert one.ask(Operation.CREATE, b"@SYS/tasks.txt") is FtpError.PROTECTED
    assert Vehicle("px4").ask(Operation.LIST, b"@SYS") is FtpError.NOT_FOUND


def test_ardupilots_scheduler_has_no_tasks_to_tell_of():
    one = Vehicle()
    assert one.ask(Operation.LIST, b"@SYS") == b"Ftasks.txt\t8\0"
    assert one.read("@SYS/tasks.txt") == b"TasksV2\n"
