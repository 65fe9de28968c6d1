"""Short flights through every kernel, small enough to run uncompiled.

``NUMBA_DISABLE_JIT=1 python -m pytest -m kernel`` runs them as plain Python, for the coverage of the kernels.
"""

import pytest

from geo.frame import LocalFrame
from mission.model import Command, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import ItemReached, LandedState
from sim_vehicle.weather.wind import Wind

pytestmark = pytest.mark.kernel

HOME = LocalFrame(28.05, -82.15)


def item(command, x, y, z, first=0.0):
    latitude, longitude = HOME.to_wgs84(x, y)
    return MissionItem(int(command), 3, first, 0.0, 0.0, None, float(latitude), float(longitude), z)


@pytest.mark.parametrize("wind", [None, Wind(1.0, -0.5, gust_m_s=0.5, seed=1)], ids=["calm", "gusts"])
@pytest.mark.parametrize(
    ("vehicle", "autopilot", "far_m", "limit_s"),
    [
        ("quad", "generic", 15.0, 90.0),
        ("quad", "px4", 15.0, 120.0),
        ("quad", "ardupilot", 15.0, 120.0),
        ("rover", "px4", 8.0, 90.0),
        ("rover", "ardupilot", 8.0, 90.0),
    ],
)
def test_a_short_mission_is_flown_to_its_end(vehicle, autopilot, far_m, limit_s, wind):
    executor = MissionExecutor(with_autopilot(get_vehicle(vehicle), autopilot), HOME, wind=wind)
    corner = [item(Command.NAV_WAYPOINT, far_m, 0.0, 5.0), item(Command.NAV_WAYPOINT, far_m, far_m, 6.0, 1.0)]
    executor.load([item(Command.NAV_TAKEOFF, 0.0, 0.0, 5.0), *corner, item(Command.NAV_LAND, 5.0, 5.0, 0.0)])
    executor.arm()
    executor.start()
    events = executor.advance(limit_s)
    assert [event.seq for event in events if isinstance(event, ItemReached)] == [0, 1, 2, 3]
    x, y, z = executor.motion.position_m
    assert (x, y, z) == pytest.approx((5.0, 5.0, 0.0), abs=2.5)
    assert vehicle == "rover" or executor.landed is LandedState.ON_GROUND


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_fixed_wing_climbs_out_and_circles(autopilot):
    executor = MissionExecutor(with_autopilot(get_vehicle("fixed-wing"), autopilot), HOME)
    executor.load(
        [item(Command.NAV_TAKEOFF, 0.0, 80.0, 40.0), item(Command.NAV_LOITER_UNLIM, 0.0, 200.0, 40.0)]
    )
    executor.arm()
    executor.start()
    events = executor.advance(60.0)
    assert [event.seq for event in events if isinstance(event, ItemReached)][:1] == [0]
    assert executor.motion.position_m[2] == pytest.approx(40.0, abs=12.0)
