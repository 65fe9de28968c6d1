"""The gimbal over MAVLink, and the leaf camera that it carries."""

import math
from itertools import pairwise

import numpy as np
import pytest

from geo.farms import get_farm
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import Command, Frame, GeoPoint, MissionItem
from sensors.camera.leaf_camera import LeafCamera
from sensors.camera.wire import ObservationAssembler
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink.vehicle import SimVehicle
from tests.support.peer import Peer as GroundPeer
from wbf_mission.addons.gimbal.extra import GimbalExtra

FARM = get_farm("miniberry-100")
LATITUDE, LONGITUDE = FARM.frame.to_wgs84(*FARM.cell_centre(30, 30))
HOME = GeoPoint(LATITUDE, LONGITUDE, 10.0)
NAN = math.nan
PITCHYAW, CONFIGURE, MOUNT, MODE = 1000, 1001, 205, 204
ATTITUDE, STATUS, INFORMATION, MOUNT_STATUS = 285, 281, 280, 158


def gimbal_of(vehicle):
    return next(extra.gimbal for extra in vehicle.extras if isinstance(extra, GimbalExtra))


class Peer(GroundPeer):
    """A vehicle with a gimbal, a peer that commands it, and what it told."""

    def __init__(self, autopilot="ardupilot", kind="quad"):
        super().__init__(autopilot, kind, home=HOME)

    def looks(self):
        """Flags, and roll, pitch, yaw in degrees, when it has turned."""
        self.wait(6.0)
        told = self.asked(ATTITUDE)
        w, x, y, z = told.q
        angles = (
            math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
            math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        )
        return told.flags, *(round(math.degrees(angle), 1) for angle in angles)


# What ArduCopter 4.7 answered in SITL (MNT1_TYPE 1, MNT1_PITCH_MAX 45), in this order.
@pytest.mark.parametrize(
    ("command", "params", "result", "flags", "looks"),
    [
        (PITCHYAW, (-30, 20, NAN, NAN, 0), 0, 44, (0, -30, 20)),
        (PITCHYAW, (-30, 20, NAN, NAN, 16), 0, 60, (0, -30, 20)),
        (PITCHYAW, (45, -150, NAN, NAN, 0, 0, 1), 0, 44, (0, 45, -150)),
        (PITCHYAW, (-20, 10, 5, 5, 0), 0, 44, (0, -20, 10)),
        (PITCHYAW, (-10, 0, NAN, NAN, 0, 0, 2), 4, None, None),
        (PITCHYAW, (-5, NAN, NAN, NAN), 4, None, None),
        (PITCHYAW, (NAN, NAN, 5, NAN), 4, None, None),
        (PITCHYAW, (NAN, NAN, NAN, NAN, 16), 0, None, None),
        (PITCHYAW, (0, 0, 0, 0, 1), 0, 45, (0, 0, 0)),
        (PITCHYAW, (0, 0, 0, 0, 2), 0, 46, None),
        (CONFIGURE, (-4, 0), 4, None, None),
        (CONFIGURE, (0, 0, 0, 0, 0, 0, 3), 4, None, None),
        (MOUNT, (-45, 10, 30, 0, 0, 0, 2), 0, 44, (10, -45, 30)),
        (MOUNT, (-100, 0, 0, 0, 0, 0, 2), 4, None, None),
        (MOUNT, (-4500, 0, 0, 0, 0, 0, 2), 4, None, None),
        (MOUNT, (0, 0, 0, 0, 0, 0, 0), 0, 45, (0, 0, 0)),
        (MOUNT, (0, 0, 0, 0, 0, 0, 1), 0, 46, None),
        (MOUNT, (0, 0, 0, 0, 0, 0, 3), 0, 44, (0, -22.5, 0)),
        (MOUNT, (0, 0, 0, 0, 0, 0, 5), 4, None, None),
        (MOUNT, (0, 0, 0, 0, 0, 0, 6), 0, 60, None),
        (MOUNT, (0, 0, 0, 0, 0, 0, 7), 4, None, None),
        (MOUNT, (-45, 10, 0, 0, 0, 0, 4), 4, None, None),
        (MODE, (1,), 0, 46, None),
        (MODE, (77,), 0, None, None),
        (int(Command.DO_SET_ROI_LOCATION), (0, 0, 0, 0, LATITUDE, LONGITUDE + 0.001, 0), 0, 60, (0, 0, 90)),
        (int(Command.DO_SET_ROI), (3, 0, 0, 0, LATITUDE + 0.001, LONGITUDE, 0), 0, 60, (0, 0, 0)),
        (int(Command.DO_SET_ROI_NONE), (), 0, 46, None),
    ],
)
def test_answers_and_attitudes_are_those_of_arducopter(command, params, result, flags, looks):
    peer = Peer()
    peer.tell(m.MAVLink_param_set_message(1, 1, b"MNT1_PITCH_MAX", 45.0, 9))
    assert peer.result(command, *params) == result
    told = peer.looks()
    if result == 0 and flags is not None:
        assert told[0] == flags
    else:
        assert told[:3:2] == (46, -90.0)
    if looks is not None:
        assert told[1:] == pytest.approx(looks, abs=0.3)  # positions came in single precision


def test_it_tells_what_it_can_and_who_has_control():
    peer = Peer()
    can = peer.asked(INFORMATION)
    assert (can.cap_flags, can.gimbal_device_id) == (206847, 1)
    limits = (can.roll_min, can.roll_max, can.pitch_min, can.pitch_max, can.yaw_min, can.yaw_max)
    assert [round(math.degrees(limit)) for limit in limits] == [-30, 30, -90, 20, -180, 180]
    before = peer.asked(STATUS)
    assert (before.flags, before.primary_control_sysid, before.primary_control_compid) == (12, 0, 0)
    ack, told = peer.command(CONFIGURE, -2, -2)
    assert (ack.result, told.primary_control_sysid, told.primary_control_compid) == (0, 255, 190)
    assert len(peer.command(CONFIGURE, -1, -1)) == 1
    (_, told) = peer.command(CONFIGURE, 7, 8)
    assert (told.primary_control_sysid, told.primary_control_compid) == (7, 8)
    assert len(peer.command(CONFIGURE, -3, -3)) == 1, "only who has control gives it up"
    assert peer.result(PITCHYAW, -30, 0, NAN, NAN) == 0, "control hinders nobody"
    assert peer.result(CONFIGURE, NAN, NAN) == 4
    peer.result(PITCHYAW, NAN, NAN, NAN, NAN, 16)
    assert peer.asked(STATUS).flags == 28


def test_the_messages_of_the_protocol_turn_it_too():
    peer = Peer()
    peer.tell(m.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 0, 0, -0.5, 0.3, NAN, NAN))
    assert peer.looks() == (44, 0.0, -28.6, 17.2)
    peer.tell(m.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 0, 0, 0.1, 0.1, 0.0, 0.0))
    peer.tell(m.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 0, 2, 0.1, 0.1, NAN, NAN))
    peer.tell(m.MAVLink_gimbal_manager_set_manual_control_message(1, 1, 0, 0, 0.5, 0.5, NAN, NAN))
    assert peer.looks() == (44, 0.0, -28.6, 17.2), "both at once, another device, manual control: ignored"
    q = (math.cos(-0.4), 0.0, math.sin(-0.4), 0.0)
    peer.tell(m.MAVLink_gimbal_manager_set_attitude_message(1, 1, 16, 0, q, NAN, NAN, NAN))
    assert peer.looks() == (60, 0.0, -45.8, 0.0)
    peer.tell(m.MAVLink_gimbal_manager_set_attitude_message(1, 1, 0, 0, (NAN,) * 4, 0.0, 0.1, 0.0))
    peer.wait(1.0)
    peer.tell(m.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 0, 0, NAN, NAN, 0.0, 0.0))
    assert peer.looks()[2] == pytest.approx(-45.8 + 5.7, abs=0.2)
    peer.tell(m.MAVLink_mount_control_message(1, 1, -3000, 500, 2000, 0))
    assert peer.looks() == (44, 5.0, -30.0, 20.0)
    told = peer.asked(MOUNT_STATUS)
    assert (told.pointing_a, told.pointing_b, told.pointing_c) == (-3000, 500, 2000)
    peer.tell(m.MAVLink_mount_configure_message(1, 1, 1, 1, 1, 1))
    assert peer.looks()[0] == 46
    peer.tell(m.MAVLink_gimbal_manager_set_attitude_message(1, 1, 0, 0, (3e38,) * 4, NAN, NAN, NAN))
    assert peer.looks()[0] == 46


def test_it_turns_at_its_rate_and_streams_where_it_is():
    peer = Peer()
    assert peer.vehicle.schedule.interval_us(ATTITUDE) == -1
    peer.tell(m.MAVLink_request_data_stream_message(1, 1, 12, 10, 1))
    assert peer.vehicle.schedule.interval_us(ATTITUDE) == -1, "flights without gimbal stay as they are"
    peer.result(PITCHYAW, 0, 0, NAN, NAN)
    assert peer.vehicle.schedule.interval_us(ATTITUDE) == 100_000
    pitches = []
    for _ in range(20):
        peer.now_s += 0.1
        pitches += [
            round(math.degrees(2.0 * math.asin(one.q[2])), 1)
            for one in peer.vehicle.poll(peer.now_s)
            if one.get_type() == "GIMBAL_DEVICE_ATTITUDE_STATUS"
        ]
    assert pitches == [min(-90.0 + 6.0 * step, 0.0) for step in range(1, 21)]


def test_without_a_gimbal_commands_fail_and_px4_knows_none():
    rover = Peer(kind="rover")
    assert [rover.result(command, 0, 0, 0, 0, 0, 0, 1) for command in (PITCHYAW, CONFIGURE, MOUNT, MODE)] == [
        4
    ] * 4
    assert rover.asked(ATTITUDE) is None
    assert rover.result(int(Command.DO_SET_ROI_NONE)) == 0
    rover.tell(m.MAVLink_param_set_message(1, 1, b"MNT1_TYPE", 1.0, 2))
    rover.result(m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    assert rover.result(PITCHYAW, -30, 0, NAN, NAN) == 0
    assert rover.looks()[2] == -30.0
    px4 = Peer("px4")
    assert px4.result(PITCHYAW, -30, 0, NAN, NAN) == 3
    assert px4.asked(ATTITUDE) is None


class Numbered:
    """A world in which each cell reads as its own place."""

    def sample(self, _day, ix, iy):
        return np.stack([ix, iy, ix], axis=1).astype(np.float32)


class Airborne:
    """A copter at 10 m over the middle of the farm with its camera, and what the ground knows."""

    def __init__(self, height_m=10.0):
        self.vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot("ardupilot"))
        camera = LeafCamera(Numbered(), FARM.grid().shape, 0)
        self.camera = LeafCameraComponent(camera, FARM, looks=self.vehicle.camera_attitude)
        self.simulation = Simulation([self.vehicle, self.camera])
        self.link = self.simulation.open_link()
        self.writer = FrameWriter(255, 190)
        self.assembler = ObservationAssembler(FARM, day=0)
        self.images = []
        self.wait(3.0)
        for command, params in ((176, (1, 4)), (400, (1,)), (22, (0, 0, 0, 0, 0, 0, height_m))):
            self.command(command, *params)
        self.wait(20.0)

    def command(self, command, *params, component=1):
        filled = [*params, *[0.0] * (7 - len(params))]
        self.link.send(self.writer.encode(m.MAVLink_command_long_message(1, component, command, 0, *filled)))

    def wait(self, seconds):
        self.simulation.run(limit_s=seconds)
        for message in self.heard():
            if type(message).id in (263, 350):
                self.assembler.add(message)
            if type(message).id == 263:
                self.images.append(message)

    def heard(self):
        reader = FrameReader()
        for frame in self.link.receive():
            yield from reader.feed(frame)

    def shot(self):
        """Take one image and return the cells that the ground has it from, and that it truly shows."""
        self.command(2000, 0, 0, 1, component=100)
        self.wait(1.0)
        seen = self.assembler.take()
        return list(zip(seen.x.tolist(), seen.y.tolist(), strict=True)), seen.values[:, :2].astype(
            int
        ).tolist()


def test_the_image_moves_with_the_gimbal_and_the_sky_shows_nothing():
    flight = Airborne()
    cell_m = FARM.cell_size_m
    x, y = FARM.cell_of(*FARM.frame.from_wgs84(LATITUDE, LONGITUDE))
    below = flight.shot()
    assert below[0] == [(x, y)]
    for pitch, heading in ((-45.0, 90.0), (-60.0, 0.0)):
        flight.command(PITCHYAW, pitch, heading, NAN, NAN, 16)
        flight.wait(5.0)
        where, truth = flight.shot()
        ahead = flight.images[-1].relative_alt / 1000.0 * math.tan(math.radians(90.0 + pitch)) / cell_m
        east, north = ahead * math.sin(math.radians(heading)), ahead * math.cos(math.radians(heading))
        assert where == [tuple(truth[0])], "the ground finds the cell that the camera has read"
        assert where[0] == pytest.approx((x + east, y + north), abs=1.0)
        assert flight.images[-1].lat == flight.images[0].lat, "the place told is the camera's"
    lost = flight.assembler.statistics.off_farm
    flight.command(PITCHYAW, 10.0, 0.0, NAN, NAN)
    flight.wait(5.0)
    assert flight.shot() == ([], [])
    assert flight.assembler.statistics.off_farm == lost + 1
    flight.command(PITCHYAW, 0, 0, 0, 0, m.GIMBAL_MANAGER_FLAGS_NEUTRAL)
    flight.wait(5.0)
    assert flight.shot() == below


def test_an_image_while_it_turns_looks_where_the_gimbal_was_then():
    flight = Airborne()
    flight.command(PITCHYAW, -30.0, 0.0, NAN, NAN, 16)
    flight.command(2000, 0, 0.25, 4, component=100)
    flight.wait(3.0)
    pitches = [
        math.degrees(math.asin(2.0 * (q[0] * q[2] - q[3] * q[1]))) for q in (i.q for i in flight.images)
    ]
    assert len(pitches) == 4
    assert all(later - sooner == pytest.approx(15.0, abs=3.1) for sooner, later in pairwise(pitches[1:]))
    seen = flight.assembler.take()
    assert seen.values[:, 1].astype(int).tolist() == seen.y.tolist()


def test_items_of_a_mission_turn_the_camera_and_its_end_turns_it_back():
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot("ardupilot"))
    peer = Peer()
    peer.vehicle = vehicle
    near = FARM.frame.to_wgs84(*FARM.cell_centre(50, 30))
    relative = Frame.GLOBAL_RELATIVE_ALT
    vehicle.pilot.load(
        (
            MissionItem(Command.NAV_TAKEOFF, relative, 0.0, 0.0, 0.0, None, LATITUDE, LONGITUDE, 10.0),
            MissionItem(MOUNT, Frame.MISSION, -40.0, 0.0, 25.0),
            MissionItem(Command.NAV_LOITER_TIME, relative, 8.0, 0.0, 0.0, None, LATITUDE, LONGITUDE, 10.0),
            MissionItem(PITCHYAW, Frame.MISSION, -20.0, 15.0),
            MissionItem(Command.NAV_LOITER_TIME, relative, 8.0, 0.0, 0.0, None, LATITUDE, LONGITUDE, 10.0),
            MissionItem(Command.DO_SET_ROI_LOCATION, relative, 0.0, 0.0, 0.0, 0.0, *near, 0.0),
            MissionItem(Command.NAV_LOITER_UNLIM, relative, 0.0, 0.0, 0.0, None, LATITUDE, LONGITUDE, 10.0),
        )
    )
    peer.tell(m.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    peer.tell(m.MAVLink_command_long_message(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0))
    told = []
    for _ in range(60):
        peer.wait(1.0)
        gimbal = gimbal_of(vehicle)
        told.append((int(gimbal.mode), *(round(math.degrees(angle)) for angle in gimbal.angles_rad[1:])))
    assert told.index((2, -40, 25)) < told.index((2, -20, 15))
    distance = 20 * FARM.cell_size_m
    assert told[-1][:2] == (4, round(math.degrees(math.atan2(-10.0, distance))))
    peer.result(176, 1, 4)
    peer.wait(5.0)
    assert gimbal_of(vehicle).angles_rad == (0.0, -math.pi / 2.0, 0.0)
