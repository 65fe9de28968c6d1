"""The camera component as a vehicle, a ground station and MAVSDK would talk to it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from geo import Farm, LocalFrame, get_farm
from mission.link.codec.dialect import mavlink
from sensors.camera.leaf_camera import LeafCamera, LeafCameraOptions
from sensors.camera.wire import ObservationAssembler
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.component import Component, SaysGoodbye

FARM = get_farm("miniberry-100")
GROUND = (255, 190)
VEHICLE = (1, 1)


class World:
    """Values that tell the cell exactly in float32."""

    def sample(self, day, ix, iy):
        return np.stack([ix, iy, np.full(len(ix), day)], axis=1).astype(np.float32)


def make(farm=FARM, options=None, **address):
    return LeafCameraComponent(LeafCamera(World(), farm.grid().shape, 6, options), farm, **address)


def wire(message, source=VEHICLE):
    receiver = mavlink.MAVLink(None)
    return receiver.parse_buffer(message.pack(mavlink.MAVLink(None, *source)))[0]


def sent(messages):
    return [wire(message, (1, 100)) for message in messages]


def position(time_s, x_m, y_m, farm=FARM, source=VEHICLE):
    e7 = [round(degrees * 1e7) for degrees in farm.frame.to_wgs84(x_m, y_m)]
    time_ms = round(time_s * 1000)
    told = mavlink.MAVLink_global_position_int_message(time_ms, *e7, 40_000, 10_000, 0, 500, 0, 9000)
    return wire(told, source)


def command(number, *p, source=GROUND, target=(1, 100), n=0):
    values = [*p, *([0.0] * (7 - len(p)))]
    return wire(mavlink.MAVLink_command_long_message(*target, number, n, *values), source)


def ask(camera, number, *p, **more):
    answer, *rest = sent(camera.receive(command(number, *p, **more), 0.0))
    assert answer.get_type() == "COMMAND_ACK"
    assert answer.command == number
    source = more.get("source", GROUND)
    assert (answer.target_system, answer.target_component) == source
    return answer.result, rest


def fly(camera, start_s=0.0, seconds=5.0, speed=5.0):
    messages = []
    for k in range(1, round(seconds * 10) + 1):
        t = start_s + k / 10
        messages += camera.receive(position(t, 1.0 + speed * t, 3.0), t)
    return sent(messages)


def ready(**more):
    camera = make(**more)
    camera.receive(position(0.0, 1.0, 3.0), 0.0)
    return camera


def images(messages):
    return [message for message in messages if message.get_type() == "CAMERA_IMAGE_CAPTURED"]


def test_it_is_a_component_with_a_heartbeat():
    camera = make(system_id=7, component_id=101)
    assert isinstance(camera, Component)
    assert (camera.system_id, camera.component_id) == (7, 101)
    beats = []
    now = 100.0
    for _ in range(50):
        if camera.next_deadline() <= now:
            beats += sent(camera.poll(now))
        now += 0.1
    assert len(beats) == 5
    assert (beats[0].type, beats[0].autopilot) == (mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID)
    assert camera.poll(now) == []
    camera.poll(500.0)
    assert camera.next_deadline() == 501.0


def test_the_last_heartbeat_is_that_of_a_camera_that_is_off():
    camera = ready()
    assert isinstance(camera, SaysGoodbye)
    (beat,) = camera.goodbye()
    assert (beat.type, beat.system_status) == (mavlink.MAV_TYPE_CAMERA, mavlink.MAV_STATE_POWEROFF)


def test_the_cell_read_is_that_of_the_reported_position():
    rotated = Farm(
        "r", LocalFrame(28.05, -82.15, 30.0, 33.0), 100, 100, FARM.patches, FARM.owner, FARM.home_m
    )
    for farm in (FARM, rotated):
        camera = make(farm)
        camera.receive(position(0.0, 1.0, 1.0, farm), 0.0)
        ask(camera, mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, 0.3048, 0, 1)
        assembler = ObservationAssembler(farm, day=6)
        shots = 0
        for k in range(1, 51):
            report = sent(camera.receive(position(k / 10, 1 + 0.5 * k, 1 + 0.37 * k, farm), k / 10))
            for message in report:
                assembler.add(message)
            for message in images(report):
                shots += 1
                x_m, y_m = farm.frame.from_wgs84(message.lat / 1e7, message.lon / 1e7)
                ix, iy = farm.cell_of(x_m, y_m)
                values = next(m for m in report if getattr(m, "array_id", -1) == message.image_index)
                assert values.data[3:6] == [ix, iy, 6.0]
                assert values.time_usec // 1000 == message.time_boot_ms
                assert values.data[0] == message.image_index
        seen = assembler.take()
        assert len(seen) == shots == assembler.statistics.images
        np.testing.assert_array_equal(seen.values[:, 0], seen.x)
        np.testing.assert_array_equal(seen.values[:, 1], seen.y)
        assert (np.diff(seen.time_s) > 0).all()


def test_distance_trigger():
    camera = ready()
    result, first = ask(camera, 206, 0.3048, 0, 1, source=VEHICLE)
    assert result == mavlink.MAV_RESULT_ACCEPTED
    assert [m.get_type() for m in first] == ["CAMERA_IMAGE_CAPTURED", "DEBUG_FLOAT_ARRAY"]
    assert camera.image_count == 1
    assert camera.trigger.active
    pictures = images(fly(camera))
    assert [m.image_index for m in pictures] == list(range(1, 83))
    told = {(m.alt, m.relative_alt, m.capture_result, m.time_utc) for m in pictures}
    assert told == {(40_000, 10_000, 1, 0)}
    assert ask(camera, 206, 0)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert images(fly(camera, 5.0)) == []
    assert ask(camera, 206, 1.0, 0, 0)[1] == [], "none at once unless it is asked for"


def test_start_and_stop_capture():
    camera = ready()
    assert ask(camera, 2000, 0, 0.5, 3, 0)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert [m.time_boot_ms for m in images(fly(camera, 0.0, 3.0))] == [0, 500, 1000]
    assert ask(camera, 2000, 0, 0.5, 0, 0)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert len(images(fly(camera, 3.0, 2.0))) == 5
    assert ask(camera, 2001)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert images(fly(camera, 5.0, 2.0)) == []


def test_digicam_control_takes_a_picture_with_its_shutter_alone():
    camera = ready()
    result, sent_images = ask(camera, 203, 0, 0, 0, 0, 1)
    assert (result, len(images(sent_images))) == (mavlink.MAV_RESULT_ACCEPTED, 1)
    assert ask(camera, 203, 0, 2) == (mavlink.MAV_RESULT_ACCEPTED, [])


@pytest.mark.parametrize(("command_id", "value"), [(206, 2.0), (214, 400.0)])
def test_a_repeated_command_does_not_begin_the_series_anew(command_id, value):
    seen = []
    for repeats in ((), (6, 11)):
        camera = ready()
        got = []
        for k in range(1, 31):
            got += sent(camera.receive(position(k / 10, 1.0 + k / 2, 3.0), k / 10))
            if k in (2, *repeats):
                got += ask(camera, command_id, value, 0, 1, n=k > 2)[1]
        seen.append([one.time_boot_ms for one in images(got)])
    assert seen[0] == seen[1]
    assert len(seen[0]) > 5


def test_a_repeated_request_takes_one_picture():
    camera = ready()
    for confirmation in range(3):
        result, _ = ask(camera, 2000, 0, 0, 1, 1, n=confirmation)
        assert result == mavlink.MAV_RESULT_ACCEPTED
    assert camera.image_count == 1
    assert len(images(ask(camera, 2000, 0, 0, 1, 2)[1])) == 1
    assert ask(camera, 2000, 0, 0, 1, 1, n=1)[1] == []
    assert len(ask(camera, 2000, 0, 0, 1, 1, source=(254, 1))[1]) == 2
    assert len(ask(camera, 2000, 0, 0, 1, 1)[1]) == 2
    ask(camera, 2000, 0, 1.0, 0)
    fly(camera, 0.0, 1.5)
    taken = camera.image_count
    ask(camera, 2000, 0, 1.0, 0, n=1)
    assert len(images(fly(camera, 1.5, 0.4))) == 0
    assert camera.image_count == taken


def test_no_position_no_picture() -> None:
    camera = make()
    assert ask(camera, 2000, 0, 0, 1, 1)[0] == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    camera.receive(wire(mavlink.MAVLink_global_position_int_message(5, 0, 0, 0, 0, 0, 0, 0, 0)), 0.0)
    assert ask(camera, 2000, 0, 0, 1, 1)[0] == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert ask(camera, 206, 1.0, 0, 1) == (mavlink.MAV_RESULT_ACCEPTED, [])
    assert len(images(fly(camera))) == 24


@pytest.mark.parametrize(
    ("number", "p"),
    [
        (206, (-1.0,)),
        (206, (math.inf,)),
        (206, (0.001,)),
        (206, (1.0, 0, 0, 102.0)),
        (214, (-5.0,)),
        (214, (math.nan,)),
        (214, (1.0,)),
        (214, (1e12,)),
        (2000, (0, 0.0, 0)),
        (2000, (0, math.inf, 0)),
        (2000, (0, 1.0, 1.5)),
        (2000, (99.0, 1.0, 1)),
        (2001, (99.0,)),
        (530, (0, 1.0)),
        (512, (263.0, 5.0)),
        (512, (263.0, math.nan)),
        (2002, (0.5,)),
    ],
)
def test_refusals(number, p):
    camera = ready()
    assert ask(camera, number, *p) == (mavlink.MAV_RESULT_DENIED, [])
    assert not camera.trigger.active
    assert ask(camera, 512, 148.0)[0] == mavlink.MAV_RESULT_UNSUPPORTED
    without_position = make()
    assert ask(without_position, 2000, 0, 0, 1, 1)[0] == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert ask(without_position, 206, 1.0, 0, 1) == (mavlink.MAV_RESULT_ACCEPTED, [])


def test_broadcast_commands_that_are_not_the_cameras_are_left_to_others():
    camera = ready()
    assert camera.receive(command(400, 1, target=(1, 0)), 0.0) == []
    assert camera.receive(command(512, 148, target=(0, 0)), 0.0) == []
    assert camera.receive(command(206, 1, target=(1, 1)), 0.0) == []
    assert camera.receive(command(206, 1, target=(2, 100)), 0.0) == []
    assert not camera.trigger.active
    assert len(camera.receive(command(206, 1, target=(1, 0)), 0.0)) == 1
    assert camera.trigger.active


def test_what_clients_ask_for():
    camera = ready(options=LeafCameraOptions(3))
    result, (information,) = ask(camera, 512, 259)
    assert result == mavlink.MAV_RESULT_ACCEPTED
    assert information.flags == 2 | 4 | 32
    assert bytes(information.model_name).rstrip(b"\0") == b"leaf camera"
    assert information.resolution_h == 3
    for number, old, p, kind in (
        (259, 521, (1,), "CAMERA_INFORMATION"),
        (260, 522, (1,), "CAMERA_SETTINGS"),
        (261, 525, (0, 1), "STORAGE_INFORMATION"),
        (262, 527, (1,), "CAMERA_CAPTURE_STATUS"),
    ):
        for order in ((512, number), (old, *p)):
            (message,) = ask(camera, *order)[1]
            assert message.get_type() == kind
    assert ask(camera, 530, 0, 0)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert ask(camera, 512, 260)[1][0].mode_id == mavlink.CAMERA_MODE_IMAGE
    ask(camera, 529, 1)
    assert ask(camera, 512, 260)[1][0].mode_id == mavlink.CAMERA_MODE_IMAGE_SURVEY
    ask(camera, 2000, 0, 2.0, 0)
    fly(camera, 0.0, 4.0)
    (status,) = ask(camera, 512, 262)[1]
    assert (status.image_status, status.image_interval, status.image_count) == (3, 2.0, 3)
    assert ask(camera, 512, 261)[1][0].used_capacity > 0.0
    ask(camera, 206, 1.0)
    assert ask(camera, 512, 262)[1][0].image_status == 1


def test_a_lost_picture_comes_again_with_its_readings():
    camera = ready(options=LeafCameraOptions(5))
    ask(camera, 206, 0.5)
    flown = fly(camera)
    first = [m for m in flown if 7 in (getattr(m, "image_index", None), getattr(m, "array_id", None))]
    assert len(first) == 3
    assembler = ObservationAssembler(FARM, day=6)
    for message in flown:
        if getattr(message, "array_id", -1) != 7:
            assembler.add(message)
    assert assembler.missing() == [7]
    for number, p in ((512, (263, 7)), (2002, (7,))):
        result, again = ask(camera, number, *p)
        assert result == mavlink.MAV_RESULT_ACCEPTED
        assert [m.get_payload() for m in again] == [m.get_payload() for m in first]
        for message in again:
            assembler.add(message)
    assert assembler.missing() == []
    assert len(assembler.take()) > 0


def test_old_pictures_are_forgotten_and_formatting_forgets_all(monkeypatch):
    monkeypatch.setattr("sim_vehicle.camera.image_memory.RING_IMAGES", 512)
    camera = ready()
    ask(camera, 206, 0.02)
    fly(camera, 0.0, 4.0)
    assert camera.image_count > 600
    assert ask(camera, 512, 263, 10)[0] == mavlink.MAV_RESULT_DENIED
    assert ask(camera, 512, 263, camera.image_count - 512)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert ask(camera, 512, 263, camera.image_count)[0] == mavlink.MAV_RESULT_DENIED
    ask(camera, 206, 0)
    taken = camera.image_count
    assert ask(camera, 526, 1, 0, 0)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert camera.image_count == taken
    assert ask(camera, 526, 1, 0, 1)[0] == mavlink.MAV_RESULT_ACCEPTED
    assert camera.image_count == 0
    assert ask(camera, 512, 263, 600)[0] == mavlink.MAV_RESULT_ACCEPTED, "a new count deletes nothing"
    result, (storage,) = ask(camera, 526, 1, 1, 0)
    assert (result, storage.used_capacity) == (mavlink.MAV_RESULT_ACCEPTED, 0.0)
    assert camera.image_count == 0
    assert ask(camera, 512, 263, 600)[0] == mavlink.MAV_RESULT_DENIED


def heartbeat(armed):
    return wire(mavlink.MAVLink_heartbeat_message(2, 12, 209 if armed else 81, 0, 4, 3))


def test_disarming_stops_the_camera():
    camera = ready()
    camera.receive(heartbeat(False), 0.0)
    ask(camera, 206, 0.5)
    camera.receive(heartbeat(False), 0.0)
    assert camera.trigger.active
    camera.receive(heartbeat(True), 0.0)
    assert images(fly(camera))
    camera.receive(heartbeat(False), 5.0)
    assert not camera.trigger.active


def test_only_its_own_autopilot_is_followed():
    camera = ready()
    ask(camera, 206, 0.5)
    for source in ((2, 1), (1, 191), (255, 190)):
        assert camera.receive(position(0.1, 9.0, 3.0, source=source), 0.0) == []
        trigger = wire(mavlink.MAVLink_camera_trigger_message(0, 1), source)
        assert camera.receive(trigger, 0.0) == []
    assert camera.trigger.position is not None
    assert camera.trigger.position.time_ms == 0


def test_the_triggers_of_a_px4():
    camera = ready()
    for time_us, seq in ((130_000, 1), (130_000, 1), (230_000, 2)):
        assert camera.receive(wire(mavlink.MAVLink_camera_trigger_message(time_us, seq)), 0.0) == []
        assert ask(camera, 2000, 0, 0, 1, seq, source=VEHICLE) == (mavlink.MAV_RESULT_ACCEPTED, [])
    assert [m.time_boot_ms for m in images(fly(camera, 0.0, 1.0))] == [130, 230]
    unix_us = 1_790_000_000_000_000
    camera.receive(wire(mavlink.MAVLink_system_time_message(unix_us, 1000)), 0.0)
    camera.receive(wire(mavlink.MAVLink_camera_trigger_message(unix_us + 55_000, 3)), 0.0)
    (picture,) = images(fly(camera, 1.0, 0.5))
    assert (picture.time_boot_ms, picture.time_utc) == (1055, unix_us + 55_000)
    without_clock = ready()
    without_clock.receive(wire(mavlink.MAVLink_camera_trigger_message(unix_us, 3)), 0.0)
    assert [m.time_boot_ms for m in images(fly(without_clock, 0.0, 0.5))] == [0]


def test_pictures_off_the_farm_hold_no_values():
    camera = make()
    camera.receive(position(0.0, -5.0, -5.0), 0.0)
    _, (_, values) = ask(camera, 206, 1.0, 0, 1)
    assert all(map(math.isnan, values.data[3:6]))


FLOATS = st.floats(width=32) | st.integers(0, 2100).map(float)
COMMANDS = st.sampled_from([206, 214, 512, 521, 526, 530, 2000, 2001, 2002, 400, 0, 65535])
TARGETS = st.sampled_from([(0, 0), (1, 0), (1, 100), (1, 1)])
INT32, UINT32, UINT64 = st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)


def anywhere(time_ms, latitude_e7, longitude_e7, height_mm):
    at = (abs(time_ms), latitude_e7, longitude_e7, height_mm, height_mm, 5, 5, 5, 7)
    return wire(mavlink.MAVLink_global_position_int_message(*at))


ARRIVALS = st.one_of(
    st.builds(
        lambda number, values, target: command(number, *values, target=target),
        COMMANDS,
        st.lists(FLOATS, min_size=7, max_size=7),
        TARGETS,
    ),
    st.builds(anywhere, INT32, INT32, INT32, INT32),
    st.builds(lambda k: position(k / 100, k / 50, 2.0), st.integers(0, 3000)),
    st.builds(lambda *p: wire(mavlink.MAVLink_camera_trigger_message(*p)), UINT64, UINT32),
    st.builds(lambda *p: wire(mavlink.MAVLink_system_time_message(*p)), UINT64, UINT32),
)


@given(st.lists(ARRIVALS, max_size=25))
@sweep(few=60, many=300)
def test_whatever_arrives_every_answer_can_be_sent(messages):
    camera = make()
    for message in messages:
        sent(camera.receive(message, 0.0))


def test_it_asks_for_the_positions_that_do_not_come():
    camera = make()

    def asked(now_s):
        orders = [m for m in sent(camera.poll(now_s)) if m.get_type() == "COMMAND_LONG"]
        assert all((m.target_system, m.target_component) == VEHICLE for m in orders)
        return [(m.command, int(m.param1), m.param2) for m in orders]

    assert asked(0.0) == asked(5.0) == [], "there is no autopilot yet"
    camera.receive(wire(heartbeat(False)), 6.0)
    assert asked(7.0) == []
    assert asked(9.0) == [(511, 33, 100_000.0), (511, 2, 1_000_000.0)]
    assert asked(10.0) == [], "it waits for what it asked for"
    assert asked(12.0) != []
    camera.receive(position(0, 1.0, 1.0), 13.0)
    assert asked(14.0) == asked(15.0) == []
