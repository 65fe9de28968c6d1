"""Our client and commands before a vehicle that is not ours: MAVSDK's server plugins."""

from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from mission.link import MavlinkEndpoint, open_link
from mission.link.codec.dialect import mavlink
from mission.model import GeoPoint, Mission, MissionItem, MissionType
from mission.transfer.driver import TransferDriver, wait_readable

HOME = GeoPoint(47.397742, 8.545594, 488.0)


@pytest.fixture
def reference(tools):
    """MAVSDK as an autopilot that sends to a free UDP port of ours."""
    from mavsdk import ComponentType, Configuration, Mavsdk
    from mavsdk.plugins.action_server import ActionServer
    from mavsdk.plugins.mission_raw_server import MissionRawServer
    from mavsdk.plugins.param_server import ParamServer
    from mavsdk.plugins.telemetry_server import TelemetryServer

    port = tools.free_port()
    autopilot = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
    component = autopilot.server_component()
    plugins = SimpleNamespace(
        url=f"udpin:127.0.0.1:{port}",
        param=ParamServer(component),
        action=ActionServer(component),
        missions=MissionRawServer(component),
        telemetry=TelemetryServer(component),
        received=[],
        cleared=[],
    )
    plugins.missions.subscribe_incoming_mission(
        lambda result, plan, _: plugins.received.append((result, plan))
    )
    plugins.missions.subscribe_clear_all(lambda kind, _: plugins.cleared.append(kind))
    assert autopilot.add_any_connection(f"udpout://127.0.0.1:{port}") == 0
    yield plugins
    autopilot.destroy()


@contextmanager
def driver_on(url):
    with TransferDriver(MavlinkEndpoint(open_link(url), 255, 190)) as driver:
        driver.wait_for_vehicle(10.0)
        yield driver


def survey(number):
    return tuple(
        MissionItem.waypoint(47.397742 + 1e-6 * i, 8.545594 - 2e-6 * i, 10.0 + i % 7) for i in range(number)
    )


def test_driver_uploads_downloads_and_clears(reference, tools):
    items = (*tools.mission_about(HOME)[:1], *survey(300), *tools.mission_about(HOME)[-1:])
    fence, rally = tools.fence_about(HOME), tools.rally_about(HOME)
    with driver_on(reference.url) as driver:
        assert driver.vehicle.component_id == 1
        costs = driver.upload(Mission(items, home=HOME, fence=fence, rally=rally))
        assert [cost.retries for cost in costs] == [0, 0, 0], "each is read back and compared"
        tools.wait_until(lambda: len(reference.received) == 3, what="the plans")
        assert {result.name for result, _ in reference.received} == {"SUCCESS"}
        back, _ = driver.download()
        for mine, theirs in ((items, back.items), (fence, back.fence), (rally, back.rally)):
            assert [(i.command, i.wire_x(), i.wire_y()) for i in theirs] == [
                (i.command, i.wire_x(), i.wire_y()) for i in mine
            ]
        driver.clear([MissionType.MISSION])
        tools.wait_until(lambda: reference.cleared, what="the clearing")


def test_its_parameters_telemetry_and_actions_reach_our_endpoint(reference, tools):
    from mavsdk.plugins.telemetry_server import Heading, Position, VelocityNed

    reference.param.provide_param_float("SPEED", 7.5)
    reference.param.provide_param_int("COUNT", 3)
    reference.action.set_armable(True, True)
    endpoint = MavlinkEndpoint(open_link(reference.url), 255, 190)
    heard = {}

    def ask(message, kind):
        heard.pop(kind, None)

        def answered():
            for each in endpoint.receive():
                heard.setdefault(each.get_type(), []).append(each)
            if kind not in heard:
                if message is not None:
                    endpoint.send(message)
                wait_readable(endpoint.link, 0.2)
            return heard.get(kind)

        return tools.wait_until(answered, what=kind)

    assert ask(None, "HEARTBEAT")[0].get_srcComponent() == 1
    endpoint.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    read = mavlink.MAVLink_param_request_read_message(1, 1, b"SPEED", -1)
    assert ask(read, "PARAM_VALUE")[0].param_value == 7.5
    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    assert ask(arm, "COMMAND_ACK")[0].result == 0
    position = Position(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m, 0.0)

    def told():
        reference.telemetry.publish_position(position, VelocityNed(0.0, 0.0, 0.0), Heading(90.0))
        return any(each.get_type() == "GLOBAL_POSITION_INT" for each in endpoint.receive())

    tools.wait_until(told, what="a position")
    endpoint.close()
