"""Both roles against MAVSDK, over loopback UDP: an implementation that is not ours."""

from __future__ import annotations

import math
import socket
import threading
import time
from contextlib import contextmanager

import pytest
from processes import wait_until

from mission.autopilots import ARDUPILOT, PX4
from mission.link import MavlinkEndpoint, open_link
from mission.link.codec.dialect import mavlink
from mission.model import Command, Frame, MissionItem, MissionType
from mission.transfer import MissionServer, PlanReplaced, VerifiedUpload
from mission.transfer.driver import TransferDriver, wait_readable
from mission.transfer.storage import as_stored

CAPABILITIES = 4 | 8 | 8192 | 16384 | 32768


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Vehicle(threading.Thread):
    """The least that MAVSDK takes for an autopilot: heartbeat, AUTOPILOT_VERSION, the mission server."""

    def __init__(self, port, server, autopilot):
        super().__init__(daemon=True)
        self.server, self.autopilot = server, autopilot
        self.endpoint = MavlinkEndpoint(open_link(f"udpout:127.0.0.1:{port}"), 1, 1)
        self.events = []
        self.stopped = threading.Event()

    def run(self):
        beat_s = 0.0
        while not self.stopped.is_set():
            now_s = time.monotonic()
            if now_s >= beat_s:
                beat_s = now_s + 0.5
                self.endpoint.send(mavlink.MAVLink_heartbeat_message(2, self.autopilot, 1, 0, 3, 3))
            outputs = [self.server.poll(now_s)]
            for message in self.endpoint.receive():
                outputs.append(self.server.receive(message, now_s))
                if message.get_type() == "COMMAND_LONG":
                    self.command(message)
            for output in outputs:
                self.events += output.events
                for message in output.messages:
                    self.endpoint.send(message)
            wait_readable(self.endpoint.link, 0.05)
        self.endpoint.close()

    def command(self, message):
        known = message.command == 512 and message.param1 == 148
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self.endpoint.send(
            mavlink.MAVLink_command_ack_message(message.command, 0 if known else 3, 0, 0, *sender)
        )
        if known:
            self.endpoint.send(
                mavlink.MAVLink_autopilot_version_message(
                    CAPABILITIES, 1, 1, 1, 1, [0] * 8, [0] * 8, [0] * 8, 0, 0, 1
                )
            )


@contextmanager
def connected(server, autopilot):
    """Yield MAVSDK's mission_raw, connected to a vehicle around the server."""
    import mavsdk
    from mavsdk.plugins.mission_raw import MissionRaw

    port = free_port()
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    client = mavsdk.Mavsdk(configuration)
    client.add_any_connection(f"udpin://127.0.0.1:{port}")
    vehicle = Vehicle(port, server, autopilot)
    vehicle.start()
    system = client.first_autopilot(5.0)
    assert system is not None, "MAVSDK found no autopilot"
    raw = MissionRaw(system)
    try:
        yield raw, vehicle
    finally:
        vehicle.stopped.set()
        vehicle.join(5.0)
        client.destroy()


def theirs(items, mission_type=0):
    from mavsdk.plugins.mission_raw import MissionItem as RawItem

    def number(value):
        return math.nan if value is None else value

    return [
        RawItem(
            index,
            item.frame,
            item.command,
            int(index == 0 and mission_type == 0),
            int(item.autocontinue),
            number(item.param1),
            number(item.param2),
            number(item.param3),
            number(item.param4),
            item.wire_x(),
            item.wire_y(),
            item.z,
            mission_type,
        )
        for index, item in enumerate(items)
    ]


def survey(number):
    return (
        MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, param4=None, x=28.05, y=-82.15, z=5.0),
        MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 5.0, -1.0),
        *(MissionItem.waypoint(28.05 + k * 1e-6, -82.15 - k * 1e-6, 5.0) for k in range(number)),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION),
    )


CORNERS = ((0, 0), (0, 0.01), (0.01, 0.01), (0.01, 0))
FENCE = tuple(MissionItem(5001, 3, 4.0, x=28.05 + dx, y=-82.15 + dy) for dx, dy in CORNERS)
RALLY = (MissionItem(5100, 3, x=28.051, y=-82.151, z=20.0),)


def same(raw_items, items):
    assert len(raw_items) == len(items)
    for raw, item in zip(raw_items, theirs(items), strict=True):
        assert raw.frame in (item.frame, {0: 5, 3: 6}.get(item.frame))  # PX4 gives the INT frames
        kept = (
            ("autocontinue",) if raw.mission_type == 0 else ()
        )  # of fence and rally items no autopilot does
        for name in ("command", "x", "y", "z", "param1", "param2", *kept):
            assert getattr(raw, name) == pytest.approx(getattr(item, name), nan_ok=True), name


def test_mavsdk_uploads_to_us_and_downloads():
    server = MissionServer(1, profile=PX4)
    with connected(server, mavlink.MAV_AUTOPILOT_PX4) as (raw, vehicle):
        for items in (survey(20), survey(300)):
            raw.upload_mission(theirs(items))
            assert server.plan(MissionType.MISSION).items == items
            same(raw.download_mission(), items)
        raw.upload_geofence(theirs(FENCE, 1))
        raw.upload_rally_points(theirs(RALLY, 2))
        assert server.plan(MissionType.FENCE).items == FENCE
        assert server.plan(MissionType.RALLY).items == RALLY
        same(raw.download_geofence(), FENCE)
        same(raw.download_rallypoints(), RALLY)
        raw.clear_mission()
        assert server.plan(MissionType.MISSION).items == ()
        assert server.plan(MissionType.FENCE).items == FENCE
        assert sum(isinstance(event, PlanReplaced) for event in vehicle.events) == 4


def test_mavsdk_is_told_what_it_cannot_have():
    from mavsdk.plugins.mission_raw import MissionRawError

    server = MissionServer(
        1, profile=PX4, capacity={MissionType.MISSION: 50}, validator=lambda item: 3 * (item.command == 18)
    )
    old = survey(2)
    server.set_plan(MissionType.MISSION, old)
    with connected(server, mavlink.MAV_AUTOPILOT_PX4) as (raw, _):
        with pytest.raises(MissionRawError, match="TOO_MANY"):
            raw.upload_mission(theirs(survey(60)))
        circle = MissionItem(Command.NAV_LOITER_TURNS, 3, 3.0, x=28.05, y=-82.15, z=5.0)
        with pytest.raises(MissionRawError, match="UNSUPPORTED"):
            raw.upload_mission(theirs((*survey(3), circle)))
        assert server.plan(MissionType.MISSION).items == old


def test_mavsdk_and_the_ardupilot_profile():
    server = MissionServer(1, profile=ARDUPILOT)
    with connected(server, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA) as (raw, _):
        home = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, x=28.0, y=-82.0, z=10.0)
        items = survey(30)
        raw.upload_mission(theirs((home, *items)))
        kept = tuple(as_stored(item, ARDUPILOT) for item in items)
        assert server.plan(MissionType.MISSION).items == kept
        came = raw.download_mission()
        assert len(came) == len(items) + 1
        same(came[1:], kept)


def test_our_client_and_mavsdks_server():
    import mavsdk
    from mavsdk.plugins.mission_raw_server import MissionRawServer

    port = free_port()
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.AUTOPILOT)
    vehicle = mavsdk.Mavsdk(configuration)
    ours = open_link(f"udpin:127.0.0.1:{port}")
    vehicle.add_any_connection(f"udpout://127.0.0.1:{port}")
    server = MissionRawServer(vehicle.server_component())
    came = []
    server.subscribe_incoming_mission(lambda result, plan, _: came.append(plan.mission_items))
    try:
        with TransferDriver(MavlinkEndpoint(ours, 245, 190)) as driver:
            found = driver.wait_for_vehicle(5.0)
            items = survey(100)
            upload = VerifiedUpload(
                items,
                target=(found.system_id, found.component_id),
                source=(245, 190),
                profile=found.profile,
            )
            _, statistics = driver.run(upload)
            assert statistics.verified
            assert statistics.retries <= 2
            same(wait_until(lambda: came and came[-1], "the plan"), items)
    finally:
        vehicle.destroy()
