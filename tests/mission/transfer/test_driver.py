"""The blocking driver: over memory with a clock that jumps."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mission.autopilots import PX4
from mission.errors import LinkError
from mission.link import MavlinkEndpoint, memory_pair, open_link
from mission.link.codec.dialect import mavlink
from mission.model import Mission, MissionItem, MissionType
from mission.transfer import MissionServer, Progress, RemoteTransferError, StatusText
from mission.transfer.driver import TransferDriver
from mission.transfer.vehicles import Vehicle

MISSION, FENCE, RALLY = MissionType
PLAN = Mission(
    tuple(MissionItem.waypoint(28 + k / 1e5, -82.0, 5.0) for k in range(12)),
    fence=(MissionItem(5003, 3, 50.0, x=28.0, y=-82.0),),
    rally=(MissionItem(5100, 3, x=28.0, y=-82.0, z=9.0),),
)


def current(state):
    return mavlink.MAVLink_mission_current_message(0, 12, state, 0)


class Bench:
    """A vehicle in memory that acts whenever the driver waits; the clock moves only then."""

    def __init__(self, profile=PX4, *, beats=True, **options):
        ours, theirs = memory_pair()
        self.now_s = 0.0
        self.server = MissionServer(1, profile=profile, **options)
        self.vehicle = MavlinkEndpoint(theirs, 1, 1)
        self.autopilot = profile.autopilot
        self.beats = beats
        self.deaf = False
        self.heard = []
        self.events = []
        self.interrupt_at = None
        self.texts = []
        self.driver = TransferDriver(
            MavlinkEndpoint(ours, 255, 190),
            clock=lambda: self.now_s,
            wait=self.wait,
            on_event=self.events.append,
            on_text=lambda message, now_s: self.texts.append((message.text, now_s)),
        )

    def wait(self, link, seconds):
        assert seconds >= 0.0
        self.now_s += min(seconds, 0.01)
        if self.beats:
            self.vehicle.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            self.vehicle.send(mavlink.MAVLink_heartbeat_message(2, self.autopilot, 1, 0, 3, 3))
        for message in self.vehicle.receive():
            self.heard.append(message)
            if self.interrupt_at == message.get_type():
                raise KeyboardInterrupt
            if not self.deaf:
                self.answer(self.server.receive(message, self.now_s))
        self.answer(self.server.poll(self.now_s))

    def answer(self, output):
        for message in output.messages:
            self.vehicle.send(message)
        for event in output.events:  # a vehicle's text follows its answer
            if isinstance(event, StatusText):
                text = event.text.encode()
                self.vehicle.send(mavlink.MAVLink_statustext_message(event.severity, text))


def test_upload_and_download():
    bench = Bench()
    found = bench.driver.wait_for_vehicle()
    assert found == Vehicle(1, 1, mavlink.MAV_AUTOPILOT_PX4, 2)
    costs = bench.driver.upload(PLAN)
    assert [cost.mission_type for cost in costs] == [FENCE, RALLY, MISSION]
    assert all(cost.verified for cost in costs)
    assert bench.server.plan(MISSION).items == PLAN.items
    came, costs = bench.driver.download()
    assert came.items == PLAN.items
    for kind in (FENCE, RALLY):  # as a real PX4 gives them back
        assert came.plan(kind) == tuple(replace(item, autocontinue=False) for item in PLAN.plan(kind))
    assert [cost.items for cost in costs] == [12, 1, 1]
    assert sum(isinstance(event, Progress) for event in bench.events) >= 28
    beats = [m for m in bench.heard if m.get_type() == "HEARTBEAT"]
    assert beats
    assert {m.type for m in beats} == {mavlink.MAV_TYPE_GCS}
    bench.driver.clear()
    assert bench.driver.download()[0].items == ()


def test_no_vehicle():
    bench = Bench(beats=False)
    with pytest.raises(RemoteTransferError, match=r"no vehicle was heard in 3 s; start the vehicle"):
        bench.driver.wait_for_vehicle(3.0)
    assert 3.0 <= bench.now_s < 3.1
    bench.beats = True
    with pytest.raises(RemoteTransferError, match="system id 7"):
        bench.driver.wait_for_vehicle(1.0, system_id=7)


def test_a_vehicle_without_a_fence_has_an_empty_one():
    bench = Bench()
    bench.server.set_plan(MISSION, PLAN.items)
    receive = bench.server.receive

    def without_fence(message, now_s):
        if message.get_type() == "MISSION_REQUEST_LIST" and message.mission_type == FENCE:
            bench.vehicle.send(mavlink.MAVLink_mission_ack_message(255, 190, 3, FENCE))
            return type(receive(message, now_s))()
        return receive(message, now_s)

    bench.server.receive = without_fence
    came, costs = bench.driver.download(types=[FENCE, MISSION])
    assert (came.items, came.fence, len(costs)) == (PLAN.items, (), 1)


def test_interrupt_tells_the_vehicle():
    bench = Bench()
    bench.driver.wait_for_vehicle()
    bench.interrupt_at = "MISSION_ITEM_INT"
    with pytest.raises(KeyboardInterrupt):
        bench.driver.upload(PLAN)
    bench.interrupt_at = None
    bench.wait(None, 0.0)
    assert bench.heard[-1].get_type() == "MISSION_ACK"
    assert bench.heard[-1].type == 15
    assert bench.server.plan(MISSION).items == ()


def test_a_broken_link_is_a_link_error():
    theirs = open_link("tcpin:127.0.0.1:0")
    driver = TransferDriver(MavlinkEndpoint(open_link(theirs.name.replace("tcpin", "tcp")), 255, 190))
    theirs.receive()
    theirs.close()
    with driver, pytest.raises(LinkError, match="closed the connection"):
        driver.wait_for_vehicle(5.0)


def test_what_the_vehicle_makes_of_its_mission():
    """The last word counts: PX4 judges a mission after it has confirmed it."""
    bench = Bench()
    states = iter([mavlink.MISSION_STATE_NOT_STARTED, mavlink.MISSION_STATE_NO_MISSION])

    def answer(_found):
        if bench.heard[-1].get_type() == "COMMAND_LONG" and (state := next(states, None)) is not None:
            bench.vehicle.send(current(state))

    bench.answer = answer
    assert bench.driver.mission_state() == mavlink.MISSION_STATE_NO_MISSION
    asked = [one for one in bench.heard if one.get_type() == "COMMAND_LONG"]
    assert {(one.command, one.param1) for one in asked} == {(512, 42.0)}


def test_plans_that_arrived_before_a_refusal_are_named():
    bench = Bench(validator=lambda item: 3 if item.command == 16 else 0)
    with pytest.raises(RemoteTransferError, match="the vehicle holds the new fence and rally"):
        bench.driver.upload(PLAN)
