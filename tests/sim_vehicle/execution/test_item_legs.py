"""Shapes of flight: circles and splines as legs."""

import math

import pytest

from mission.model import Command, Frame, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.execution.item_legs import circle_legs, plan_item_legs, spline_legs
from sim_vehicle.execution.items import Settings
from sim_vehicle.motion.legs import ALONG, LegKind

QUAD = get_vehicle("quad")


@pytest.mark.parametrize("radius", [2.0, -6.0, 40.0, 0.0])
@pytest.mark.parametrize("speed", [1.0, 12.0])
def test_a_circle_is_no_faster_than_half_of_the_acceleration_allows(radius, speed):
    legs = circle_legs((0.0, 0.0, 10.0), (50.0, 0.0, 10.0), 1.0, radius, speed, QUAD)
    size = abs(radius) or 10.0
    limit = math.sqrt(0.5 * QUAD.acceleration_m_s2 * size)
    assert legs[0].speed_m_s == speed, "the way to the circle is no curve"
    assert [leg.speed_m_s for leg in legs[1:]] == pytest.approx([min(speed, limit)] * 36)
    assert all(leg.kind is LegKind.ARC for leg in legs[1:])
    assert [math.hypot(*leg.end_m[:2]) for leg in legs] == pytest.approx([size] * 37)
    turned = legs[0].end_m[0] * legs[1].end_m[1] - legs[0].end_m[1] * legs[1].end_m[0]
    assert (turned < 0.0) is (radius >= 0.0), "clockwise with a positive radius"


def test_a_spline_is_slow_in_its_curve_only():
    path = ((0.0, 0.0, 10.0), (40.0, 0.0, 10.0), (40.0, 40.0, 10.0))
    legs, arrive = spline_legs(path, (40.0, 0.0, 0.0), 12.0, ALONG, QUAD)
    speeds = [leg.speed_m_s for leg in legs]
    assert legs[-1].end_m == pytest.approx(path[1])
    assert arrive[0] == pytest.approx(arrive[1]), "towards the point after next"
    assert min(speeds) < 12.0
    straight, _ = spline_legs((path[0], path[1], None), (40.0, 0.0, 0.0), 12.0, ALONG, QUAD)
    assert {leg.speed_m_s for leg in straight} == {12.0}


@pytest.mark.parametrize(
    ("hold_s", "given_m", "radius_m"), [(0.0, 0.0, None), (2.0, 0.0, 0.0), (2.0, 3.0, 3.0)]
)
def test_a_waypoint_with_a_hold_is_reached_exactly_unless_it_has_a_radius(hold_s, given_m, radius_m):
    quad = get_vehicle("quad")
    item = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL_RELATIVE_ALT, param1=hold_s, param2=given_m)
    plan = plan_item_legs([item], [(50.0, 0.0, 10.0)], 0, Settings(5.0), quad, (0.0, 0.0, 10.0))
    assert [leg.radius_m for leg in plan.legs] == [quad.acceptance_radius_m if radius_m is None else radius_m]
