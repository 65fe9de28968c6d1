"""The fence alone: what it holds, how far its edge is, what it tells."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely.geometry import MultiPoint, Point, Polygon

from geo.frame import LocalFrame
from mission.model import MissionItem
from sim_vehicle.pilot.fence import Bounds, Breach, Fence, FenceWatch

FRAME = LocalFrame(28.05, -82.15, 10.0)


def polygon(points, *, inclusion=True):
    command = 5001 if inclusion else 5002
    return [
        MissionItem(command, 0, float(len(points)), x=a, y=b) for a, b in (FRAME.to_wgs84(*p) for p in points)
    ]


def circle(x, y, radius, *, inclusion=True):
    latitude, longitude = FRAME.to_wgs84(float(x), float(y))
    return [MissionItem(5003 if inclusion else 5004, 0, radius, x=latitude, y=longitude)]


SQUARE = [(0.0, 0.0), (100.0, 0.0), (100.0, 50.0), (0.0, 50.0)]
COORDINATE = st.floats(-120.0, 120.0)


@given(
    st.lists(st.tuples(COORDINATE, COORDINATE), min_size=3, max_size=9, unique=True), COORDINATE, COORDINATE
)
def test_polygons_are_those_of_shapely(points, x, y):
    hull = MultiPoint(points).convex_hull
    assume(hull.geom_type == "Polygon" and hull.area > 1.0)
    corners = list(hull.exterior.coords)[:-1]
    fence = Fence.of(polygon(corners), FRAME)
    expected = hull.exterior.distance(Point(x, y)) * (1.0 if hull.contains(Point(x, y)) else -1.0)
    # Places travel as 1e-7 degrees, a centimetre.
    assert fence.margin_m(x, y) == pytest.approx(expected, abs=0.05)


def test_concave_polygons():
    corners = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (30.0, 10.0), (0.0, 60.0)]
    shape = Polygon(corners)
    fence = Fence.of(polygon(corners), FRAME)
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-20, 80, (2, 500))
    margins = fence.margins_m(x, y)
    for px, py, margin in zip(x, y, margins, strict=True):
        distance = shape.exterior.distance(Point(px, py))
        assert abs(margin) == pytest.approx(distance, abs=0.05)
        if distance > 0.05:
            assert (margin > 0.0) == shape.contains(Point(px, py))


def test_exclusions_and_several_inclusions():
    items = polygon(SQUARE) + circle(150, 25, 60) + circle(50, 25, 10, inclusion=False)
    some = Fence.of(items, FRAME)
    every = Fence.of(items, FRAME, any_inclusion=False)
    assert some.margin_m(20, 25) == pytest.approx(20.0, abs=0.05)
    assert every.margin_m(20, 25) == pytest.approx(-70.0, abs=0.05)
    assert every.margin_m(95, 25) == pytest.approx(5.0, abs=0.05)
    assert some.margin_m(50, 25) == pytest.approx(-10.0, abs=0.05)
    assert some.margin_m(-30, 25) == pytest.approx(-30.0, abs=0.05)
    only_out = Fence.of(circle(0, 0, 5, inclusion=False), FRAME)
    assert only_out.margin_m(1e5, 0) == pytest.approx(1e5 - 5.0)
    assert Fence().margin_m(3.0, 4.0) == math.inf


@given(st.tuples(COORDINATE, COORDINATE), st.tuples(COORDINATE, COORDINATE))
def test_a_margin_is_never_too_large(here, there):
    fence = Fence.of(polygon(SQUARE) + circle(150, 25, 60) + circle(60, 30, 15, inclusion=False), FRAME)
    margin = fence.margin_m(*here)
    # To places a hair apart both margins can round to the same.
    if math.dist(here, there) < margin - 1e-9:
        assert fence.margin_m(*there) > 0.0


def test_what_is_incomplete_is_left_out():
    items = polygon(SQUARE)[:3]
    assert Fence.of(items, FRAME).zones == ()
    assert Fence.of([*circle(0, 0, 0.0), MissionItem(5100, 3, x=1.0, y=1.0)], FRAME).zones == ()
    latitude, longitude = FRAME.to_wgs84(5.0, 6.0)
    fence = Fence.of([MissionItem(5000, 3, x=latitude, y=longitude, z=30.0)], FRAME)
    assert fence.return_point_m == pytest.approx((5.0, 6.0, 30.0), abs=0.02)


def test_degenerate_polygons_do_no_harm():
    for corners in ([(0.0, 0.0)] * 3, [(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)]):
        margin = Fence.of(polygon(corners), FRAME).margin_m(10.0, 5.0)
        assert math.isfinite(margin) and margin < 0.0
    bow_tie = Fence.of(polygon([(0.0, 0.0), (40.0, 40.0), (40.0, 0.0), (0.0, 40.0)]), FRAME)
    assert bow_tie.margin_m(5.0, 20.0) > 0.0 > bow_tie.margin_m(20.0, 5.0)


def test_bounds_say_what_was_broken():
    watch = FenceWatch(bounds=Bounds(ceiling_m=50.0, radius_m=100.0))
    assert watch.evaluate((0.0, 0.0, 60.0), (0.0, 0.0, 0.0))[:2] == (
        Breach.MAX_ALTITUDE,
        "60.0 m high, 50 m are allowed",
    )
    assert watch.evaluate((110.0, 0.0, 10.0), (0.0, 0.0, 0.0))[0] is Breach.BOUNDARY
    assert watch.evaluate((110.0, 0.0, 10.0), (20.0, 0.0, 0.0)) == (Breach.NONE, "", 10.0)


def test_a_breach_is_told_once_and_ends():
    watch = FenceWatch(Fence.of(polygon(SQUARE), FRAME))
    assert not watch.check((50.0, 25.0, 9.0), 0.0, (0.0, 0.0, 0.0), 1.0)
    assert not watch.check((500.0, 25.0, 9.0), 10.0, (0.0, 0.0, 0.0), 2.0), "10 m were flown, 25 m are free"
    assert watch.check((101.0, 25.0, 9.0), 60.0, (0.0, 0.0, 0.0), 3.0)
    assert (watch.breach, watch.count, watch.broken_s) == (Breach.BOUNDARY, 1, 3.0)
    assert not watch.check((102.0, 25.0, 9.0), 61.0, (0.0, 0.0, 0.0), 4.0)
    assert not watch.check((99.0, 25.0, 9.0), 65.0, (0.0, 0.0, 0.0), 5.0)
    assert watch.breach is Breach.NONE
    assert watch.check((103.0, 25.0, 9.0), 70.0, (0.0, 0.0, 0.0), 6.0)
    assert watch.count == 2
    watch.change(Fence())
    assert not watch.check((103.0, 25.0, 9.0), 70.0, (0.0, 0.0, 0.0), 7.0)


PLACES = st.tuples(COORDINATE, COORDINATE, st.floats(0.0, 60.0))
FENCES = st.sampled_from(
    [
        (polygon(SQUARE), Bounds()),
        (circle(0.0, 0.0, 60.0), Bounds(ceiling_m=40.0)),
        (circle(20.0, 20.0, 30.0, inclusion=False), Bounds(radius_m=80.0)),
        (polygon(SQUARE), Bounds(areas=False)),
        (polygon(SQUARE), Bounds(40.0, 80.0, areas=False)),
        ([], Bounds(40.0, 80.0)),
        ([], Bounds()),
    ]
)


@given(st.lists(st.tuples(PLACES, st.one_of(st.none(), FENCES)), min_size=2, max_size=12), FENCES)
def test_a_fence_that_looks_seldom_sees_what_one_that_always_looks_sees(steps, first):
    """Whatever way is flown, and whichever fence or bounds come meanwhile: they hold at once."""
    watch, flown_m, before_m, breached = FenceWatch(), 0.0, None, False
    for place_m, other in [(steps[0][0], first), *steps]:
        if other is not None:
            watch.change(Fence.of(other[0], FRAME), other[1])
        if before_m is not None:
            flown_m += math.dist(before_m, place_m)
        before_m = place_m
        told = watch.check(place_m, flown_m, (0.0, 0.0, 0.0), flown_m)
        breach, reason, _ = watch.evaluate(place_m, (0.0, 0.0, 0.0))
        assert (watch.breach, watch.reason) == (breach, reason)
        assert told is (breach is not Breach.NONE and not breached)
        breached = breach is not Breach.NONE


def test_zones_of_a_plan_that_are_switched_off_do_not_count():
    watch = FenceWatch(Fence.of(polygon(SQUARE), FRAME), Bounds(ceiling_m=40.0, areas=False))
    assert watch.evaluate((-50.0, 0.0, 10.0), (0.0, 0.0, 0.0)) == (Breach.NONE, "", 30.0)
