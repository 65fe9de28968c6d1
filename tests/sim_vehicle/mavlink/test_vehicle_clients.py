"""The vehicle before real ground software: MAVSDK and pymavlink over sockets."""

import math
import os
import time
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from geo.frame import LocalFrame
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, GeoPoint, MissionItem, MissionType
from mission.outcome import Outcome
from mission.transfer import wire
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.host.server import Server
from sim_vehicle.mavlink import SimVehicle
from tests.support.peer import running

os.environ["MAVLINK20"] = "1"
HOME = GeoPoint(28.05, -82.15, 20.0)
FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)


def place(x_m, y_m):
    return FRAME.to_wgs84(float(x_m), float(y_m))


ITEMS = (
    MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, 0.0, 0.0, 0.0, None, *place(0, 0), 10.0),
    MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 5.0, -1.0),
    MissionItem.waypoint(*place(20, 0), 10.0),
    MissionItem.waypoint(*place(20, 15), 12.0, hold_s=1.0),
    MissionItem(Command.NAV_RETURN_TO_LAUNCH),
)


@contextmanager
def flying_at(url, speed, autopilot=PX4):
    """A vehicle behind a server in a thread."""
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=autopilot, epoch_unix_s=time.time())
    with running(Server([vehicle], [url], speed=speed)) as server:
        yield SimpleNamespace(vehicle=vehicle, url=server.urls[0])


def wait_until(condition, limit_s=60.0, what="condition"):
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, f"{what} took more than {limit_s} s"
        time.sleep(0.01)


@pytest.fixture
def sdk():
    from mavsdk import ComponentType, Configuration, Mavsdk

    instance = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    yield instance
    instance.destroy()


def connect(sdk, flying):
    """MAVSDK's system behind a TCP connection to the server."""
    port = flying.url.rsplit(":", 1)[1]
    kind = "tcpout" if flying.url.startswith("tcp") else "udpout"
    assert sdk.add_any_connection(f"{kind}://127.0.0.1:{port}") == 0
    system = sdk.first_autopilot(5.0)
    assert system is not None
    return system


def raw_items(items):
    from mavsdk.plugins.mission_raw import MissionItem as RawItem

    def value(parameter):
        return math.nan if parameter is None else parameter

    return [
        RawItem(
            seq, item.frame, item.command, int(seq == 0), 1,
            value(item.param1), value(item.param2), value(item.param3), value(item.param4),
            item.wire_x(), item.wire_y(), item.z, 0,
        )
        for seq, item in enumerate(items)
    ]  # fmt: skip


@pytest.mark.parametrize("url", ["tcpin:127.0.0.1:0", "udpin:127.0.0.1:0"])
def test_mavsdk_flies_a_mission(sdk, url):
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.mission_raw import MissionRaw
    from mavsdk.plugins.telemetry import Telemetry

    with flying_at(url, speed=20.0) as flying:
        system = connect(sdk, flying)
        telemetry, action, mission = Telemetry(system), Action(system), MissionRaw(system)
        wait_until(telemetry.health_all_ok, what="health all ok")
        assert telemetry.health().is_armable
        mission.upload_mission(raw_items(ITEMS))
        stored = mission.download_mission()
        assert [(i.command, i.x, i.y) for i in stored] == [(i.command, i.wire_x(), i.wire_y()) for i in ITEMS]
        action.arm()
        wait_until(telemetry.armed, what="armed")
        mission.start_mission()
        wait_until(telemetry.in_air, what="in air")
        wait_until(mission.is_mission_finished, what="mission finished")
        wait_until(lambda: not telemetry.armed(), what="disarmed")
        assert mission.mission_progress().total == len(ITEMS)
        position = telemetry.position()
        assert position.latitude_deg == pytest.approx(HOME.latitude_deg, abs=1e-5)
        assert position.relative_altitude_m == pytest.approx(0.0, abs=0.1)
        assert flying.vehicle.outcome is Outcome.COMPLETED


def test_mavsdk_takes_off_pauses_goes_and_lands(sdk):
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.telemetry import FlightMode, Telemetry

    with flying_at("udpin:127.0.0.1:0", speed=20.0) as flying:
        system = connect(sdk, flying)
        telemetry, action = Telemetry(system), Action(system)
        wait_until(telemetry.health_all_ok, what="health all ok")
        action.set_takeoff_altitude(7.0)
        assert action.get_takeoff_altitude() == 7.0
        action.arm()
        action.takeoff()
        wait_until(lambda: telemetry.position().relative_altitude_m > 6.8, what="takeoff")
        wait_until(lambda: telemetry.flight_mode() == FlightMode.HOLD, what="hold")
        latitude, longitude = place(10, 10)
        action.goto_location(latitude, longitude, HOME.altitude_m + 9.0, 90.0)
        wait_until(lambda: abs(telemetry.position().longitude_deg - longitude) < 1e-6, what="goto")
        wait_until(lambda: abs(telemetry.heading().heading_deg - 90.0) < 0.5, what="heading")
        action.hold()
        action.land()
        wait_until(lambda: telemetry.flight_mode() == FlightMode.LAND, what="land")
        wait_until(lambda: not telemetry.armed(), what="landing")
        wait_until(lambda: telemetry.flight_mode() == FlightMode.HOLD, what="the mode before")
        assert telemetry.position().relative_altitude_m == pytest.approx(0.0, abs=0.1)


def test_mavsdk_hears_why_arming_is_refused(sdk):
    from mavsdk.plugins.action import Action, ActionError
    from mavsdk.plugins.telemetry import Telemetry

    with flying_at("udpin:127.0.0.1:0", speed=5.0) as flying:
        flying.vehicle.pilot.arming.block = "compass not calibrated"
        system = connect(sdk, flying)
        telemetry = Telemetry(system)
        texts = []
        telemetry.subscribe_status_text(lambda text, _: texts.append(text.text))
        wait_until(telemetry.health_all_ok, what="health all ok")
        wait_until(lambda: not telemetry.health().is_armable, what="not armable")
        with pytest.raises(ActionError):
            Action(system).arm()
        wait_until(lambda: "Preflight Fail: compass not calibrated" in texts, what="status text")
        assert flying.vehicle.outcome is Outcome.ARMING_REFUSED


def test_mavsdk_reads_and_sets_parameters(sdk):
    from mavsdk.plugins.param import Param

    with flying_at("udpin:127.0.0.1:0", speed=5.0) as flying:
        param = Param(connect(sdk, flying))
        assert param.get_param_float("MPC_XY_CRUISE") == pytest.approx(
            flying.vehicle.pilot.spec.cruise_speed_m_s
        )
        param.set_param_float("MPC_XY_CRUISE", 6.5)
        assert param.get_param_float("MPC_XY_CRUISE") == 6.5
        assert flying.vehicle.pilot.spec.cruise_speed_m_s == 6.5
        assert param.get_param_int("MAV_SYS_ID") == 1
        param.set_param_int("COM_LOW_BAT_ACT", 0)
        assert flying.vehicle.pilot.parameters.low_battery_action == 0
        everything = param.get_all_params()
        assert "RTL_RETURN_ALT" in {p.name for p in everything.float_params}


@pytest.fixture(params=[PX4, ARDUPILOT], ids=["px4", "ardupilot"])
def pymavlink_client(request):
    from pymavlink import mavutil

    with flying_at("tcpin:127.0.0.1:0", speed=20.0, autopilot=request.param) as flying:
        port = flying.url.rsplit(":", 1)[1]
        connection = mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", dialect="all", source_system=255)
        connection.wait_heartbeat(timeout=5)
        yield flying, connection
        connection.close()


def test_pymavlink_flies_a_mission(pymavlink_client):
    flying, connection = pymavlink_client
    ardupilot = flying.vehicle.autopilot is ARDUPILOT
    assert connection.target_system == 1
    items = (MissionItem.waypoint(*place(0, 0), 0.0), *ITEMS) if ardupilot else ITEMS
    connection.mav.mission_count_send(1, 1, len(items), 0)
    while True:
        message = connection.recv_match(
            type=["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], blocking=True, timeout=3
        )
        if message.get_type() == "MISSION_ACK":
            assert message.type == 0
            break
        connection.mav.send(
            wire.item_to_message(items[message.seq], message.seq, MissionType.MISSION, (1, 1))
        )
    connection.arducopter_arm()
    assert connection.recv_match(type="COMMAND_ACK", blocking=True, timeout=3).result == 0
    connection.set_mode("AUTO" if ardupilot else "MISSION")
    wait_until(
        lambda: connection.recv_match(type="EXTENDED_SYS_STATE", blocking=True, timeout=3).landed_state == 2
    )
    assert connection.flightmode == ("AUTO" if ardupilot else "MISSION")
    wait_until(lambda: flying.vehicle.outcome.is_over)
    assert flying.vehicle.outcome is Outcome.COMPLETED
    connection.motors_disarmed_wait()


def test_pymavlink_requests_and_refusals(pymavlink_client):
    flying, connection = pymavlink_client

    def ask(command, *params):
        connection.mav.command_long_send(1, 1, command, 0, *params, *[0] * (7 - len(params)))
        return connection.recv_match(
            type="COMMAND_ACK", condition=f"COMMAND_ACK.command=={command}", blocking=True, timeout=3
        ).result

    assert ask(512, 148) == 0
    version = connection.recv_match(type="AUTOPILOT_VERSION", blocking=True, timeout=3)
    assert version.capabilities & m.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert ask(512, 12345) == (2 if flying.vehicle.autopilot is PX4 else 4)
    assert ask(4242) == 3
    assert ask(511, 31, 50_000) == 0
    assert connection.recv_match(type="ATTITUDE_QUATERNION", blocking=True, timeout=3)
    assert ask(510, 31) == 0
    assert connection.recv_match(type="MESSAGE_INTERVAL", blocking=True, timeout=3).interval_us == 50_000
    assert ask(511, 31, -1) == 0
    assert ask(300) == (1 if flying.vehicle.autopilot is PX4 else 4)
    connection.mav.timesync_send(0, 42)
    assert (
        connection.recv_match(type="TIMESYNC", condition="TIMESYNC.ts1==42", blocking=True, timeout=3).tc1 > 0
    )
    connection.param_fetch_all()
    first = connection.recv_match(type="PARAM_VALUE", blocking=True, timeout=3)
    assert first.param_count > 5
    last = f"PARAM_VALUE.param_index=={first.param_count - 1}"
    assert connection.recv_match(type="PARAM_VALUE", condition=last, blocking=True, timeout=60)
