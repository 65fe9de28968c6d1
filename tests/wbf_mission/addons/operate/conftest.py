"""A vehicle for ground stations that fly or command it in the process of a test."""

from functools import partial
from types import SimpleNamespace

import pytest
from lockstep import SharedClock, leading_driver, sharing
from stand_in import stand_in

from mission.ground import link
from sim_vehicle.host import server
from wbf_mission.addons.base import inquiry, links
from wbf_mission.addons.operate import telemetry_events
from wbf_mission.run import flight_events


@pytest.fixture
def clock(monkeypatch):
    """The time of all ground stations of this process: while they run, nobody waits in real time."""
    clock = SharedClock()
    monkeypatch.setattr(links, "LinkHost", sharing(links.LinkHost, clock, leads=True))
    leading = sharing(server.Server, clock, leads=True)
    for module in (server, inquiry):
        monkeypatch.setattr(module, "Server", leading)
    monkeypatch.setattr(link, "TransferDriver", leading_driver(clock))
    monkeypatch.setattr(flight_events, "_LEAST_WALL_S", 0.0)
    monkeypatch.setattr(telemetry_events, "time", SimpleNamespace(monotonic=clock.now))
    return clock


@pytest.fixture
def quick_stand_in(clock):
    """Return `stand_in` for ground stations of this process."""
    return partial(stand_in, server=sharing(server.Server.__base__, clock))
