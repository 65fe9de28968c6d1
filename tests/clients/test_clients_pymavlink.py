"""Scripts as people write them with pymavlink's mavutil: loops around recv_match, no library in between."""

import time

import pytest
from sweeps import autopilots

from mission.link.codec.dialect import mavlink


@pytest.fixture
def master(fly, tools):
    """A vehicle and mavutil's connection to it."""
    from pymavlink import mavutil

    connections = []

    def connect(autopilot, **options):
        port = tools.free_port()
        ardupilot = autopilot == "ardupilot"
        flying = fly(
            autopilot, ("tcpin:127.0.0.1:0" if ardupilot else f"udpout:127.0.0.1:{port}",), **options
        )
        address = f"tcp:127.0.0.1:{tools.port_of(flying.urls[0])}" if ardupilot else f"udpin:127.0.0.1:{port}"
        connection = mavutil.mavlink_connection(address)
        connections.append(connection)
        heartbeat = connection.wait_heartbeat(timeout=10)
        assert heartbeat is not None
        while heartbeat.get_srcComponent() != 1:
            heartbeat = connection.recv_match(type="HEARTBEAT", blocking=True, timeout=5)
        connection.target_system, connection.target_component = 1, 1
        if ardupilot:  # it sends what it is asked for
            connection.mav.request_data_stream_send(1, 1, 0, 10, 1)
        return flying, connection

    yield connect
    for connection in connections:
        connection.close()


def receive(connection, kind, condition=None, timeout=5.0):
    message = connection.recv_match(type=kind, condition=condition, blocking=True, timeout=timeout)
    assert message is not None, f"no {kind} ({condition}) came"
    return message


def ordered(connection, command, *params):
    """Send a command and return the result of its acknowledgement."""
    connection.mav.command_long_send(1, 1, command, 0, *params, *[0.0] * (7 - len(params)))
    return receive(connection, "COMMAND_ACK", f"COMMAND_ACK.command=={command}").result


def upload(connection, items, mission_type=0, *, integer=True):
    """The loop of a thousand scripts: count, answer each request, take the acknowledgement."""
    mav = connection.mav
    mav.mission_count_send(1, 1, len(items), mission_type)
    asked = []
    sequences: list[int] = []
    while True:
        message = receive(connection, ["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"])
        if message.get_type() == "MISSION_ACK":
            # A slow machine answers a repeated request twice: ArduPilot says so by 13 and carries on.
            if message.type == mavlink.MAV_MISSION_INVALID_SEQUENCE and len(set(sequences)) < len(sequences):
                continue
            return message.type, asked
        asked.append(message.get_type())
        seq = message.seq
        sequences.append(seq)
        item = items[seq]
        head = (1, 1, seq, item.frame, item.command, int(seq == 0), 1)
        params = [
            float("nan") if p is None else p for p in (item.param1, item.param2, item.param3, item.param4)
        ]
        if integer:
            mav.mission_item_int_send(*head, *params, item.wire_x(), item.wire_y(), item.z, mission_type)
        else:
            mav.mission_item_send(*head, *params, item.x, item.y, item.z, mission_type)


def download(connection, mission_type=0):
    connection.mav.mission_request_list_send(1, 1, mission_type)
    count = receive(connection, "MISSION_COUNT").count
    items = []
    for seq in range(count):
        connection.mav.mission_request_int_send(1, 1, seq, mission_type)
        items.append(receive(connection, "MISSION_ITEM_INT", f"MISSION_ITEM_INT.seq=={seq}"))
    connection.mav.mission_ack_send(1, 1, 0, mission_type)
    return items


@autopilots()
def test_all_three_plans_up_and_down(autopilot, master, tools):
    flying, connection = master(autopilot, speed=2.0)
    ardupilot = autopilot == "ardupilot"
    plans = (flying.mission, tools.fence_about(flying.home), tools.rally_about(flying.home))
    for mission_type, items in enumerate(plans):
        result, asked = upload(connection, items, mission_type)
        assert result == 0
        assert set(asked) == {"MISSION_REQUEST" if ardupilot else "MISSION_REQUEST_INT"}
    for mission_type, items in enumerate(plans):
        back = download(connection, mission_type)
        assert [(i.command, i.x, i.y) for i in back] == [(i.command, i.wire_x(), i.wire_y()) for i in items]
        assert {i.mission_type for i in back} == {mission_type}
    connection.mav.mission_clear_all_send(1, 1, 0)
    assert receive(connection, "MISSION_ACK").type == 0
    connection.mav.mission_request_list_send(1, 1, 0)
    assert receive(connection, "MISSION_COUNT").count <= 1
    assert len(download(connection, 1)) == 5, "clearing the mission leaves the fence"


@autopilots()
def test_old_scripts_with_float_items_and_the_waypoint_loader(autopilot, master, tmp_path, tools):
    from pymavlink import mavwp

    flying, connection = master(autopilot, speed=2.0)
    result, _ = upload(connection, flying.mission, integer=False)
    assert result == 0
    connection.waypoint_request_list_send()
    count = receive(connection, "MISSION_COUNT").count
    loader = mavwp.MAVWPLoader(1, 1)
    for seq in range(count):
        connection.waypoint_request_send(seq)
        loader.add(receive(connection, "MISSION_ITEM", f"MISSION_ITEM.seq=={seq}"))
    connection.mav.mission_ack_send(1, 1, 0)
    assert loader.count() == len(flying.mission)
    path = tmp_path / "saved.waypoints"
    loader.save(str(path))
    again = mavwp.MAVWPLoader(1, 1)
    assert again.load(str(path)) == count
    assert [w.command for w in again.wpoints] == [item.command for item in flying.mission]
    assert again.wpoints[-2].x == pytest.approx(flying.mission[-2].x, abs=2e-6)


@autopilots(slow_with=["px4"])
def test_a_mission_is_flown(autopilot, master, tools):
    flying, connection = master(autopilot, speed=20.0)
    ardupilot = autopilot == "ardupilot"
    assert upload(connection, flying.mission)[0] == 0
    connection.waypoint_set_current_send(0)
    receive(connection, "MISSION_CURRENT", "MISSION_CURRENT.seq<=1")
    mode = "AUTO" if ardupilot else "MISSION"
    connection.arducopter_arm()
    connection.motors_armed_wait()
    connection.set_mode(mode)
    reached, seen = [], set()
    end_s = time.monotonic() + 60.0
    last = len(flying.mission) - 1
    while not (seen and not connection.motors_armed()):
        assert time.monotonic() < end_s, f"still flying after {reached}"
        message = receive(connection, ["MISSION_ITEM_REACHED", "EXTENDED_SYS_STATE", "HEARTBEAT"])
        if message.get_type() == "MISSION_ITEM_REACHED" and message.seq not in reached:
            reached.append(message.seq)
        elif message.get_type() == "EXTENDED_SYS_STATE" and message.landed_state == 2:
            seen.add(connection.flightmode)
    assert mode in seen
    assert reached == sorted(reached) and reached[-1] == last
    assert flying.vehicle.outcome.value == "completed"


@autopilots(slow_with=["ardupilot"])
def test_guided_flight_by_commands(autopilot, master):
    flying, connection = master(autopilot, speed=20.0)
    ardupilot = autopilot == "ardupilot"
    assert set(connection.mode_mapping()) >= {"GUIDED", "RTL"} if ardupilot else {"LOITER", "RTL"}
    if ardupilot:
        connection.set_mode("GUIDED")
        receive(connection, "HEARTBEAT", "HEARTBEAT.custom_mode==4 and HEARTBEAT.autopilot==3")
    assert ordered(connection, 400, 1.0) == 0
    connection.motors_armed_wait()
    amsl = 0.0 if ardupilot else flying.home.altitude_m
    assert ordered(connection, 22, 0, 0, 0, float("nan"), *flying.place(0, 0), amsl + 5.0) == 0
    receive(connection, "GLOBAL_POSITION_INT", "GLOBAL_POSITION_INT.relative_alt>4900")
    # PX4 takes the order for a place when the take-off is over
    receive(connection, "GLOBAL_POSITION_INT", "abs(GLOBAL_POSITION_INT.vz)<5")
    latitude, longitude = (round(value * 1e7) for value in flying.place(8, 6))
    connection.mav.command_int_send(
        1, 1, 6, 192, 0, 0, -1.0, 1, 0, float("nan"), latitude, longitude, 7.0
    )  # fmt: skip
    assert receive(connection, "COMMAND_ACK", "COMMAND_ACK.command==192").result == 0
    receive(
        connection, "GLOBAL_POSITION_INT", f"abs(GLOBAL_POSITION_INT.lon-{longitude})<20"
        f" and abs(GLOBAL_POSITION_INT.lat-{latitude})<20 and abs(GLOBAL_POSITION_INT.relative_alt-7000)<200",
    )  # fmt: skip
    connection.set_mode_rtl()
    connection.motors_disarmed_wait()
    # PX4 goes back to the mode before its return.
    assert connection.flightmode in (("RTL", "LAND") if ardupilot else ("RTL", "LAND", "LOITER"))
    position = receive(connection, "GLOBAL_POSITION_INT")
    # PX4's own estimate of the height jumps by a metre and more.
    assert abs(position.relative_alt) < (100 if ardupilot else 2500)


@autopilots()
def test_every_mode_is_entered_by_its_name(autopilot, master):
    _, connection = master(autopilot)
    if autopilot == "ardupilot":
        names = ["STABILIZE", "ALT_HOLD", "GUIDED", "LOITER", "POSHOLD"]
    else:
        names = ["MANUAL", "ALTCTL", "POSCTL", "LOITER"]
    for name in names:
        assert name in connection.mode_mapping()
        connection.set_mode(name)
        end_s = time.monotonic() + 30.0
        while connection.flightmode != name:
            receive(connection, "HEARTBEAT")
            assert time.monotonic() < end_s, f"{name}: still {connection.flightmode}"


@autopilots()
def test_parameters_are_fetched_read_and_set(autopilot, master):
    flying, connection = master(autopilot)
    name, value = ("WPNAV_SPEED", 650.0) if autopilot == "ardupilot" else ("MPC_XY_CRUISE", 6.5)
    connection.param_fetch_all()
    first = receive(connection, "PARAM_VALUE")
    parameters = {first.param_id: first}
    while len(parameters) < first.param_count:
        message = receive(connection, "PARAM_VALUE")
        parameters[message.param_id] = message
    assert sorted(m.param_index for m in parameters.values()) == list(range(first.param_count))
    connection.param_fetch_one(name)
    read = receive(connection, "PARAM_VALUE", f"PARAM_VALUE.param_id=='{name}'")
    assert read.param_index == parameters[name].param_index
    connection.param_set_send(name, value)
    assert receive(connection, "PARAM_VALUE", f"PARAM_VALUE.param_id=='{name}'").param_value == value
    assert flying.vehicle.pilot.spec.cruise_speed_m_s == 6.5
    connection.mav.param_request_read_send(1, 1, b"NO_SUCH_THING", -1)
    connection.param_fetch_one(3)
    message = receive(connection, "PARAM_VALUE")
    assert message.param_index == 3, "an unknown name has no answer"


@autopilots()
def test_requests_streams_and_refusals(autopilot, master):
    flying, connection = master(autopilot)
    assert ordered(connection, 512, 148) == 0
    version = receive(connection, "AUTOPILOT_VERSION")
    major, minor, patch = flying.vehicle.firmware.mavlink.identity.version
    assert version.flight_sw_version >> 8 == major << 16 | minor << 8 | patch
    assert (major, minor) == ((4, 7) if flying.is_ardupilot else (1, 17)), "those of the recordings"
    told = bytes(version.flight_custom_version)
    commit = told.decode() if flying.is_ardupilot else told[::-1].hex()
    assert commit == ("1511f271" if flying.is_ardupilot else "d6f12ad1c4f70ad3"), "the start of a git hash"
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert ordered(connection, 512, 12345) == (4 if flying.is_ardupilot else 2)
    assert ordered(connection, 511, 31, 50_000) == 0
    receive(connection, "ATTITUDE_QUATERNION")
    assert ordered(connection, 510, 31) == 0
    assert receive(connection, "MESSAGE_INTERVAL").interval_us == 50_000
    assert ordered(connection, 511, 31, -1) == 0
    connection.mav.timesync_send(0, 42)
    assert receive(connection, "TIMESYNC", "TIMESYNC.ts1==42").tc1 > 0
    assert ordered(connection, 511, 30, 20_000) == 0
    before = receive(connection, "ATTITUDE").time_boot_ms
    assert receive(connection, "ATTITUDE").time_boot_ms - before <= 100
    assert ordered(connection, 410) == 0
    home = receive(connection, "HOME_POSITION")
    assert home.latitude == round(flying.home.latitude_deg * 1e7)
    connection.mav.request_data_stream_send(1, 1, 0, 4, 1)
    for kind in ("GLOBAL_POSITION_INT", "VFR_HUD", "SYS_STATUS", "GPS_RAW_INT", "BATTERY_STATUS"):
        receive(connection, kind)
    assert ordered(connection, 4242) == 3
    assert ordered(connection, 300) == (4 if flying.is_ardupilot else 1), "there is no mission"
    text = receive(connection, "STATUSTEXT").text
    assert text.startswith(("Switching to Mission", "Mode change to AUTO failed"))
