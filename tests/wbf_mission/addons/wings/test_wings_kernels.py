"""Short flights through the kernels of fixed wings, also as plain Python."""

import numpy as np
import pytest
from short_flights import GUSTS, HOME, flying, item

from mission.model import Command, MissionItem
from sim_vehicle.execution.state import BatteryDepleted, ItemReached, LandedState

pytestmark = pytest.mark.kernel


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_fixed_wing_turns_circles_and_lands(autopilot):
    items = [
        item(Command.NAV_TAKEOFF, 0.0, 80.0, 40.0),
        item(Command.NAV_WAYPOINT, 0.0, 220.0, 40.0),
        item(Command.NAV_WAYPOINT, 150.0, 220.0, 50.0),
        item(Command.NAV_WAYPOINT, 40.0, 180.0, 45.0),
        MissionItem(Command.NAV_LOITER_TURNS, 3, 1.0, 0.0, -60.0, 0.0, *HOME.to_wgs84(0.0, 60.0), 40.0),
        MissionItem(Command.DO_LAND_START, 3, 0, 0, 0, 0, *HOME.to_wgs84(0.0, -300.0), 20.0)
        if autopilot == "ardupilot"
        else MissionItem(Command.DO_LAND_START),
        MissionItem(Command.NAV_LOITER_TO_ALT, 3, 1.0, 60.0, 0.0, 1.0, *HOME.to_wgs84(60.0, -300.0), 20.0),
        item(Command.NAV_LAND, 0.0, 0.0, 0.0),
    ]
    executor = flying("fixed-wing", autopilot, items, GUSTS)
    events = executor.advance(400.0)
    reached = [event.seq for event in events if isinstance(event, ItemReached)]
    assert reached == sorted(reached) and {0, 1, 2, 3, 4, 6} <= set(reached)
    assert executor.flight.landed is LandedState.ON_GROUND
    assert np.hypot(*executor.motion.position_m[:2]) < 120.0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_fixed_wing_glides_when_its_battery_is_empty(autopilot):
    executor = flying("fixed-wing", autopilot, [item(Command.NAV_TAKEOFF, 0.0, 80.0, 30.0)])
    executor.advance(40.0)
    executor.goto(200.0, 100.0, 30.0)
    executor.advance(50.0)
    executor.flight.drain_battery(0.0)
    events = executor.advance(120.0)
    assert any(isinstance(event, BatteryDepleted) for event in events)
    assert executor.flight.landed is LandedState.ON_GROUND
