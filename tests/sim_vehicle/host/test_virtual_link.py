"""Ground software on the virtual clock of a simulation."""

import pytest

from mission.errors import LinkError
from mission.link import MavlinkEndpoint
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, Mission, MissionItem
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle

HOME = GeoPoint(28.05, -82.15, 20.0)


def simulation(**options):
    return Simulation([SimVehicle(get_vehicle("quad"), HOME)], **options)


def test_waiting_costs_no_real_time():
    link = simulation().open_link()
    link.sleep(120.0)
    assert link.clock() == 120.0
    beats = [x for x in MavlinkEndpoint(link, 255, 190).receive() if x.get_type() == "HEARTBEAT"]
    assert len(beats) == pytest.approx(121, abs=2)


def test_a_blocking_driver_runs_on_it():
    host = simulation()
    link = host.open_link()
    driver = TransferDriver(MavlinkEndpoint(link, 255, 190), clock=link.clock, wait=link.wait)
    items = tuple(MissionItem.waypoint(28.05 + 1e-6 * k, -82.15, 10.0) for k in range(300))
    driver.upload(Mission(items, home=HOME))
    assert driver.download()[0].items == items


def test_two_links_hear_each_other_and_bytes_may_come_in_pieces():
    host = simulation()
    one, two = host.open_link("one"), host.open_link("two")
    frame = m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(m.MAVLink(None, 255, 190))
    one.send(b"garbage" + frame[:7])
    one.send(frame[7:])
    assert two.receive() == [frame]
    assert one.receive() == []


def test_a_closed_link_is_closed():
    host = simulation()
    link = host.open_link()
    link.close()
    link.sleep(3.0)
    assert link.receive() == []
    with pytest.raises(LinkError, match="closed"):
        link.send(b"x")
    assert link.fileno() is None


def test_the_tap_sees_what_a_link_sends():
    seen = []
    host = simulation(tap=lambda frame, now_s: seen.append(frame))
    link = host.open_link()
    frame = m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(m.MAVLink(None, 255, 190))
    link.send(frame)
    assert seen == [frame]
