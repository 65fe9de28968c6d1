"""Parts of missions: together they fly what the whole does, each by the settings that hold there."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import sweep

from geo.frame import LocalFrame
from mission.course import Course, Place, unrolled
from mission.errors import MissionError
from mission.model import GeoPoint, Mission, MissionItem
from mission.sorties import image_spacing_m, part_of, resumed_at

FRAME = LocalFrame(28.05, -82.15)
HOME = GeoPoint(28.05, -82.15)
TAKEOFF = MissionItem(22, 3, param4=None, x=28.05, y=-82.15, z=10.0)
ON, OFF, RETURN = MissionItem(206, param1=2.0, param3=1.0), MissionItem(206), MissionItem(20)
CLOSE_M = 0.05  # items count degrees in 1e-7


def at(x, y, z=10.0, command=16, **more):
    latitude, longitude = FRAME.to_wgs84(x, y)
    return replace(MissionItem.waypoint(latitude, longitude, z), command=command, **more)


def rows(count=6, width=100.0, spacing=10.0):
    items = [TAKEOFF, MissionItem(178, param1=1.0, param2=6.0, param3=-1.0)]
    for k in range(count):
        ends = (20.0, 20.0 + width) if k % 2 == 0 else (20.0 + width, 20.0)
        items += [at(ends[0], k * spacing)] + ([ON] if k == 0 else []) + [at(ends[1], k * spacing)]
    return Mission((*items, OFF, RETURN), HOME)


@dataclass(frozen=True)
class Stretch:
    """A straight way that is flown with the camera on."""

    begin: tuple
    end: tuple
    settings: tuple

    def covered_by(self, other):
        """The interval of this that another one covers; None if it lies elsewhere or is flown otherwise."""
        dx, dy = self.end[0] - self.begin[0], self.end[1] - self.begin[1]
        length = math.hypot(dx, dy)
        if length < CLOSE_M or other.settings != self.settings:
            return None
        marks = []
        for x, y, z in (other.begin, other.end):
            along = ((x - self.begin[0]) * dx + (y - self.begin[1]) * dy) / length
            aside = ((x - self.begin[0]) * dy - (y - self.begin[1]) * dx) / length
            height = self.begin[2] + along / length * (self.end[2] - self.begin[2])
            if abs(aside) > CLOSE_M or not -CLOSE_M < along < length + CLOSE_M or abs(z - height) > 0.2:
                return None
            marks.append(along)
        return tuple(sorted(marks))


def flown(mission):
    """Fly the items as an autopilot does, by the letter; return where images are taken, and how."""
    here = (0.0, 0.0, 0.0)
    state = {"speed": None, "camera": None, "roi": None, "video": False}
    stretches, shots = [], []
    for item in mission.items:
        if item.command == 178:
            state["speed"] = item.param2
        elif item.command in (206, 214):
            state["camera"] = (item.command, item.param1) if item.param1 else None
        elif item.command in (195, 197):
            state["roi"] = (item.x, item.y) if item.command == 195 else None
        elif item.command == 2000 and not item.param2:
            shots.append(here)
        elif item.command in (2000, 2001):
            state["camera"] = (2000, item.param2) if item.command == 2000 else None
        elif item.command in (20, 21):
            assert state["camera"] is None, "the camera is on the way home"
            break
        elif item.command in (16, 19, 82, 22):
            there = (*FRAME.from_wgs84(item.x, item.y), item.z)
            if state["camera"] is not None:
                stretches.append(Stretch(here, there, tuple(state.items())))
            here = there
    return stretches, shots


def check_union(whole, parts, overlap_m):
    stretches, shots = flown(whole)
    flown_in_parts = [flown(part) for part in parts]
    every = [one for part, _ in flown_in_parts for one in part]
    for one in every:
        lies = any(stretch.covered_by(one) is not None for stretch in stretches)
        assert lies or math.dist(one.begin[:2], one.end[:2]) < 2 * CLOSE_M, one
    for stretch in stretches:
        done = 0.0
        length = math.dist(stretch.begin[:2], stretch.end[:2])
        for low, high in sorted(filter(None, map(stretch.covered_by, every))):
            assert low < done + 3 * CLOSE_M, (stretch, done, low)
            done = max(done, high)
        assert length < CLOSE_M or done > length - 3 * CLOSE_M, stretch
    for shot in shots:
        assert any(math.dist(shot, one) < CLOSE_M for _, part in flown_in_parts for one in part)
    again_m = sum(math.dist(one.begin[:2], one.end[:2]) for one in every)
    again_m -= sum(math.dist(one.begin[:2], one.end[:2]) for one in stretches)
    return again_m


def parts_at(course, places, overlap_m=0.0, **more):
    ends = [course.start, *places, None]
    made = []
    for begin, end in pairwise(ends):
        first = resumed_at(course, begin, overlap_m)
        if first is None or (end is not None and end <= first):
            continue
        made.append(part_of(course, begin, end, overlap_m=overlap_m, **more))
    return made


numbers = st.floats(-200.0, 200.0, allow_nan=False, width=32)
waypoints = st.builds(at, numbers, numbers, st.sampled_from((10.0, 12.0, 20.0)))
camera = st.sampled_from(
    (
        ON,
        OFF,
        MissionItem(206, param1=5.0, param3=1.0),
        MissionItem(214, param1=500.0),
        MissionItem(214),
        MissionItem(2000, param2=1.0, param3=0.0),
        MissionItem(2001),
    )
)
orders = st.one_of(
    camera,
    camera,
    st.sampled_from((MissionItem(178, param1=1.0, param2=4.0), MissionItem(178, param1=1.0, param2=8.0))),
    st.builds(lambda x, y: at(x, y, 0.0, command=195), numbers, numbers),
    st.just(MissionItem(197)),
    st.just(MissionItem(2000, param3=1.0)),
)
others = st.one_of(
    st.builds(lambda x, y: at(x, y, command=19, param1=5.0), numbers, numbers),
    st.builds(lambda x, y: at(x, y, command=82), numbers, numbers),
)
END = (OFF, MissionItem(214), MissionItem(2001), RETURN)


@st.composite
def missions(draw, extra=others):
    body = draw(st.lists(st.one_of(waypoints, waypoints, orders, extra), min_size=3, max_size=25))
    start = [TAKEOFF, at(draw(numbers), draw(numbers))]
    return Mission((*start, *body, *END), HOME)


@sweep(few=60, many=300)
@given(missions(), st.lists(st.floats(0.0, 1.0), max_size=5), st.sampled_from((0.0, 3.0, 40.0)))
def test_the_parts_fly_what_the_whole_flies_wherever_it_is_cut(mission, cuts, overlap_m):
    course = Course(mission)
    places = [course.place(cut * course.length_m) for cut in sorted(cuts)]
    places = sorted({one for one in places if one is not None and one > course.start})
    parts = parts_at(course, places, overlap_m)
    again_m = check_union(mission, parts, overlap_m)
    if all(leg.straight for leg in course.legs):
        assert again_m <= overlap_m * len(places) + 10 * CLOSE_M
    for part in parts:
        assert part.items[0] == TAKEOFF and part.items[-1] == RETURN
        assert part.home == HOME


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 8), st.lists(st.floats(0.01, 0.99), min_size=1, max_size=6), st.floats(0.0, 60.0))
def test_rows_are_flown_again_by_the_overlap_and_no_more(count, cuts, overlap_m):
    whole = rows(count)
    course = Course(whole)
    places = sorted({course.place(cut * course.length_m) for cut in cuts})
    parts = parts_at(course, places, overlap_m)
    first_m = 20.0
    expected = sum(
        min(overlap_m, course.metres(one) - first_m) for one in places if course.metres(one) > first_m
    )
    kept = [one for one in places if course.metres(one) > first_m + CLOSE_M]
    if len(kept) == len(places) and len(parts) == len(places) + 1:
        assert check_union(whole, parts, overlap_m) == pytest.approx(expected, abs=0.5)


def test_a_part_is_a_mission_of_its_own():
    course = Course(rows())
    part = part_of(course, Place(6, 0.5), Place(8, 0.25))
    assert [item.command for item in part.items] == [22, 178, 16, 206, 16, 16, 16, 206, 20]
    assert part.items[3] == ON and part.items[7] == OFF
    stays = part_of(course, Place(6, 0.5), Place(8, 0.25), hold_s=2.0)
    assert stays.items == (*part.items[:2], replace(part.items[2], param1=2.0), *part.items[3:])
    place = FRAME.from_wgs84(part.items[2].x, part.items[2].y)
    assert place == (pytest.approx(70.0, abs=0.02), pytest.approx(10.0, abs=0.02))
    last = FRAME.from_wgs84(part.items[6].x, part.items[6].y)
    assert last == (pytest.approx(45.0, abs=0.02), pytest.approx(20.0, abs=0.02))


def test_a_row_end_is_not_gone_back_from_where_the_camera_is_off_behind_it():
    items = [TAKEOFF]
    for k in range(3):
        items += [at(20.0, 10.0 * k), ON, at(120.0, 10.0 * k), OFF]
    whole = Mission((*items, RETURN), HOME)
    course = Course(whole)
    between = Place(course.legs[2].item)  # from the end of the first row on
    part = part_of(course, between, overlap_m=5.0)
    assert [item.command for item in part.items] == [22, 16, 206, 16, 206, 16, 206, 16, 206, 20]
    assert part.items[1] == whole.items[course.legs[2].item]
    before = part_of(course, course.start, between)
    assert [item.command for item in before.items] == [22, 16, 206, 16, 206, 206, 20] or before.items[
        -2
    ] == OFF
    # A part that would end on a way without images ends where they end.
    assert part_of(course, course.start, Place(course.legs[2].item, 0.5)) == before


def test_the_frame_the_radius_and_the_heading_of_the_leg_are_kept():
    there = replace(at(50.0, 0.0, 30.0), frame=0, param2=3.0, param4=90.0)
    further = replace(at(150.0, 0.0, 50.0), frame=0, param2=4.0, param4=45.0)
    course = Course(Mission((TAKEOFF, ON, there, further, OFF, RETURN), HOME))
    part = part_of(course, Place(3, 0.5))
    resume = part.items[1]
    assert (resume.frame, resume.param2, resume.param4) == (0, 4.0, 45.0)
    assert resume.z == pytest.approx(40.0)
    # From the take-off, which counts its height from home, the height is the item's.
    assert part_of(course, Place(2, 0.5)).items[1].z == 30.0
    assert part_of(course, Place(3, 0.0), overlap_m=0.0).items[1] == replace(there, param1=0.0)


def test_speeds_of_each_kind_and_the_heading_are_set_again():
    climb, speed, yaw = (
        MissionItem(178, param1=2.0, param2=1.5),
        MissionItem(178, param1=0.0, param2=7.0),
        MissionItem(115, param1=30.0),
    )
    old = MissionItem(178, param1=1.0, param2=3.0)
    items = (TAKEOFF, old, climb, at(10.0, 0.0), speed, yaw, ON, at(90.0, 0.0), at(90.0, 50.0), OFF, RETURN)
    course = Course(Mission(items, HOME))
    part = part_of(course, Place(7, 0.5))
    assert part.items[:6] == (TAKEOFF, climb, speed, part.items[3], yaw, ON)
    # The heading holds until the next position.
    assert yaw not in part_of(course, Place(8, 0.5)).items


def test_a_fixed_wing_takes_off_and_lands_as_before_also_at_another_home():
    takeoff = at(0.0, 150.0, 40.0, command=22)
    landing = (MissionItem(189), at(-300.0, 80.0, 30.0, command=31), at(0.0, 0.0, 0.0, command=21))
    items = (takeoff, at(100.0, 0.0), ON, at(100.0, 900.0), at(160.0, 900.0), at(160.0, 0.0), OFF, *landing)
    whole = Mission(items, HOME)
    course = Course(whole)
    one, two = part_of(course, course.start, Place(5, 0.5)), part_of(course, Place(5, 0.5), overlap_m=30.0)
    for part in (one, two):
        assert part.items[0] == takeoff and part.items[-3:] == landing
    latitude, longitude = FRAME.to_wgs84(500.0, 200.0)
    other = GeoPoint(latitude, longitude)
    moved = part_of(course, Place(5, 0.5), home=other)
    assert moved.home == other
    for item, was in (
        (moved.items[0], takeoff),
        (moved.items[-2], landing[1]),
        (moved.items[-1], landing[2]),
    ):
        x, y = FRAME.from_wgs84(item.x, item.y)
        was_x, was_y = FRAME.from_wgs84(was.x, was.y)
        assert (x - was_x, y - was_y) == (pytest.approx(500.0, abs=0.1), pytest.approx(200.0, abs=0.1))


def test_fence_rally_and_speeds_of_the_plan_are_kept():
    fence, rally = (at(0.0, 0.0, command=5003, param1=500.0),), (at(5.0, 5.0, command=5100),)
    whole = replace(rows(), fence=fence, rally=rally, cruise_speed_m_s=6.5)
    part = part_of(Course(whole), Place(5, 0.5))
    assert (part.fence, part.rally, part.cruise_speed_m_s) == (fence, rally, 6.5)


def test_ways_lead_round_obstacles():
    def way(begin, end):
        return [tuple(0.5 * (a + b) for a, b in zip(begin, end, strict=True))]

    course = Course(rows())
    part = part_of(course, Place(6, 0.5), Place(8, 0.25), way=way)
    commands = [item.command for item in part.items]
    assert commands == [22, 178, 16, 16, 206, 16, 16, 16, 206, 16, 20]
    home, there = (28.05, -82.15), (part.items[3].x, part.items[3].y)
    assert (part.items[2].x, part.items[2].y) == pytest.approx(way(home, there)[0])


def test_jumps_are_written_out_or_refused():
    jump = MissionItem(177, param1=2.0, param2=2.0)
    whole = Mission((TAKEOFF, ON, at(10.0, 0.0), at(20.0, 0.0), jump, OFF, RETURN), HOME)
    with pytest.raises(MissionError, match="write out the jumps"):
        Course(whole)
    written = unrolled(whole)
    assert [item.command for item in written.items] == [22, 206, 16, 16, 16, 16, 16, 16, 206, 20]
    assert unrolled(written) is written
    for params, text in (
        ((2.0, -1.0), "without end"),
        ((70.0, 1.0), "is 71; give an item"),
        ((None, 1.0), "is unset; give an item"),
        ((2.0, 65000.0), "65535"),
    ):
        endless = replace(jump, param1=params[0], param2=params[1])
        with pytest.raises(MissionError, match=text):
            unrolled(replace(whole, items=(*whole.items[:4], endless, RETURN)))


def test_what_cannot_be_cut_is_refused():
    with pytest.raises(MissionError, match="no waypoint"):
        Course(Mission((TAKEOFF, RETURN), HOME))
    with pytest.raises(MissionError, match="lands before its last waypoint"):
        Course(
            Mission((TAKEOFF, at(1.0, 0.0), at(0.0, 0.0, command=21), TAKEOFF, at(9.0, 0.0), RETURN), HOME)
        )
    course = Course(rows())
    with pytest.raises(MissionError, match="nothing is left to fly from item 6 to item 5"):
        part_of(course, Place(5), Place(4))
    with pytest.raises(MissionError, match="nothing is left"):
        part_of(course, Place(len(course.mission.items) - 1))


def test_places_and_metres_are_each_others_inverse():
    course = Course(rows())
    for metres in (0.0, 10.0, 20.0, 75.5, 300.0, course.length_m - 0.01):
        place = course.place(metres)
        assert course.metres(place) == pytest.approx(metres, abs=1e-6) and 0.0 <= place.fraction < 1.0
    assert course.place(course.length_m) is None
    # Rows are projected onto the leg that is flown, not onto the nearest.
    east, north = [70.0, 70.0], [4.0, 4.0]
    along = course.along([4, 6], east, north)
    assert along == pytest.approx([70.0, 180.0], abs=0.1)
    assert course.along([99], [0.0], [0.0]) == pytest.approx([course.length_m])


def test_the_distance_between_images():
    assert image_spacing_m(rows(), 6.0) == 2.0
    assert image_spacing_m(Mission((MissionItem(214, param1=500.0),)), 6.0) == 3.0
    assert image_spacing_m(Mission((MissionItem(2000, param2=2.0),)), 6.0) == 12.0
    assert image_spacing_m(Mission((TAKEOFF,)), 6.0) is None


def test_which_legs_are_straight_and_on_which_images_are_taken():
    shot, wait = MissionItem(2000, param3=1.0), MissionItem(114, param1=5.0)
    loiter, spline = at(30.0, 0.0, command=19, param1=5.0), at(60.0, 0.0, command=82)
    items = (
        TAKEOFF,
        at(10.0, 0.0),
        ON,
        loiter,
        at(40.0, 0.0),
        spline,
        at(70.0, 0.0),
        wait,
        OFF,
        at(80.0, 0.0),
    )
    items = (*items, shot, at(90.0, 0.0), at(95.0, 0.0), shot, RETURN)
    course = Course(Mission(items, HOME))
    assert [leg.straight for leg in course.legs] == [True, False, False, False, True, False, True, True]
    assert [leg.works for leg in course.legs] == [False, True, True, True, True, True, False, True]
    # Nothing tells of images: every leg counts.
    assert all(leg.works for leg in Course(Mission((TAKEOFF, at(10.0, 0.0), RETURN), HOME)).legs)
    # What bends, stays or waits is flown as a whole, by both parts.
    bent = Place(5, 0.5)
    assert resumed_at(course, bent, 0.0) == Place(5)
    assert part_of(course, course.start, bent).items[:6] == items[:6]
    assert spline in part_of(course, bent).items
    # A single image is no state of the camera.
    assert part_of(course, Place(12)).items.count(shot) == 1


def test_the_way_back_ends_where_images_begin():
    items = (TAKEOFF, at(10.0, 0.0), at(20.0, 0.0), ON, at(120.0, 0.0), OFF)
    items = (*items, at(120.0, 5.0), at(110.0, 5.0), ON, at(20.0, 5.0), OFF, RETURN)
    whole = Mission(items, HOME)
    course = Course(whole)
    assert resumed_at(course, Place(4, 0.02), 5.0) == Place(4)
    assert resumed_at(course, Place(9, 0.02), 5.0) == Place(9)
    # Neither the ways without images behind the last row are flown, nor is the camera started there.
    first = part_of(course, course.start, Place(9))
    assert first.items == (*items[:5], OFF, RETURN)
    frames = (TAKEOFF, ON, at(20.0, 0.0, 12.0), replace(at(90.0, 0.0, 50.0), frame=0), OFF, RETURN)
    resume = part_of(Course(Mission(frames, HOME)), Place(3)).items[1]
    assert resume == frames[2]


def test_the_order_of_the_next_row_is_not_given_at_the_end():
    wider = replace(ON, param1=5.0)
    items = (TAKEOFF, at(10.0, 0.0), ON, at(90.0, 0.0), wider, at(90.0, 50.0), OFF, RETURN)
    first = part_of(Course(Mission(items, HOME)), Place(1), Place(5))
    assert first.items == (*items[:4], OFF, RETURN)


@pytest.mark.parametrize(("begin", "end"), [(179.999, -179.999), (-179.999, 179.999)])
def test_a_leg_over_the_date_line_is_cut_on_its_short_way(begin, end):
    takeoff, row = replace(TAKEOFF, y=begin), [MissionItem.waypoint(28.05, y, 10.0) for y in (begin, end)]
    course = Course(Mission((takeoff, ON, *row, OFF, RETURN), GeoPoint(28.05, begin)))
    places = [course.position(Place(3, part))[1] for part in (0.0, 0.25, 0.5, 0.75)]
    near = [begin, math.copysign(179.9995, begin), 180.0, math.copysign(179.9995, end)]
    assert [abs(place) for place in places] == pytest.approx([abs(place) for place in near], abs=1e-9)
    assert part_of(course, Place(3, 0.75)).items[1].y == near[3]


@pytest.mark.parametrize(
    "item",
    [
        MissionItem(207, param1=1.0),
        MissionItem(208, param1=1.0),
        MissionItem(218, param1=41.0, param2=2.0),
        MissionItem(204, param1=2.0),
        MissionItem(531, param1=2.0, param2=50.0),
        MissionItem(532, param1=2.0, param2=30.0),
    ],
    ids=lambda item: str(item.command),
)
def test_switches_of_the_vehicle_and_the_camera_are_set_again(item):
    items = (TAKEOFF, item, at(10.0, 0.0), ON, at(90.0, 0.0), OFF, RETURN)
    part = part_of(Course(Mission(items, HOME)), Place(4, 0.5))
    assert part.items[1] == item and [one.command for one in part.items[2:]] == [16, 206, 16, 206, 20]


def test_each_auxiliary_function_is_set_again_but_no_parachute_is_released():
    first, second, last = (
        MissionItem(218, param1=a, param2=b) for a, b in ((41.0, 2.0), (9.0, 2.0), (41.0, 0.0))
    )
    released = MissionItem(208, param1=2.0)
    items = (TAKEOFF, first, second, last, released, at(10.0, 0.0), at(90.0, 0.0), RETURN)
    part = part_of(Course(Mission(items, HOME)), Place(6, 0.5))
    assert part.items[1:3] == (second, last) and part.items[3].command == 16


def test_the_sprayer_is_on_between_the_places_only():
    on, off = MissionItem(216, param1=1.0), MissionItem(216)
    items = (TAKEOFF, at(10.0, 0.0), on, at(90.0, 0.0), at(90.0, 50.0), at(10.0, 50.0), off, RETURN)
    course = Course(Mission(items, HOME))
    first, second = part_of(course, course.start, Place(4, 0.5)), part_of(course, Place(4, 0.5))
    assert first.items[:4] == items[:4] and first.items[-2:] == (off, RETURN)
    assert [item.command for item in second.items] == [22, 16, 216, 16, 16, 216, 20]
    assert second.items[2] == on and second.items[5] == off
    # Where it begins at a place, the part that ends there does not switch it on.
    assert not any(item == on for item in part_of(course, course.start, Place(3)).items)
