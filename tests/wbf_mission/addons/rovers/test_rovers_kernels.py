"""Short drives through the kernels of rovers, also as plain Python."""

import pytest
from short_flights import GUSTS, flying, item

from mission.model import Command

pytestmark = pytest.mark.kernel


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_rover_is_steered_turned_and_comes_home(autopilot):
    executor = flying("rover", autopilot, [item(Command.NAV_WAYPOINT, 30.0, 0.0, 0.0)], GUSTS)
    executor.advance(5.0)
    executor.goto(0.0, 12.0, 0.0)
    executor.advance(15.0)
    executor.steer((0.0, -1.0, 0.0))
    executor.advance(22.0)
    assert executor.motion.snapshot().velocity_m_s[1] == pytest.approx(-1.0, abs=0.3)
    executor.return_home()
    executor.advance(80.0)
    assert executor.motion.position_m[:2] == pytest.approx((0.0, 0.0), abs=3.0)
