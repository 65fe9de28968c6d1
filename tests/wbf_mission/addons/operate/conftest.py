"""A vehicle for ground stations that fly it in the process of a test."""

from functools import partial

import pytest
from lockstep import SharedClock, sharing
from stand_in import stand_in

from sim_vehicle.host.server import Server
from wbf_mission.addons.base import links
from wbf_mission.run import flight_events


@pytest.fixture
def quick_stand_in(monkeypatch):
    """Return `stand_in` for ground stations of this process: while they fly it, nobody waits in real time."""
    clock = SharedClock()
    monkeypatch.setattr(links, "LinkHost", sharing(links.LinkHost, clock, leads=True))
    monkeypatch.setattr(flight_events, "_LEAST_WALL_S", 0.0)
    return partial(stand_in, server=sharing(Server, clock))
