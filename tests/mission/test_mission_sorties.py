"""Parts of missions: together they fly what the whole does, each by the settings that hold there."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from geo.frame import LocalFrame
from mission.course import Course, Place, unrolled
from mission.errors import MissionError
from mission.model import GeoPoint, Mission, MissionItem
from mission.sorties import part_of, resumed_at

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
        MissionItem(218, param1=41.0, param2=2.0),
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


@pytest.mark.parametrize(
    ("place", "left"),
    # The series of 12 images begins at item 3 and ends after 11 s, with 4 m/s in the middle of its leg.
    [
        (Place(3), 12.0),
        (Place(3, 0.24), 7.0),
        (Place(3, 0.49), 2.0),
        (Place(3, 0.75), None),
        (Place(4, 0.5), None),
    ],
)
def test_a_series_of_n_images_goes_on_with_the_images_that_are_left(place, left):
    series = MissionItem(2000, param2=1.0, param3=12.0)
    items = (TAKEOFF, at(10.0, 0.0), series, at(90.0, 0.0), at(90.0, 50.0), RETURN)
    part = part_of(Course(Mission(items, HOME)), place, speed_m_s=4.0)
    ordered = [item.param3 for item in part.items if item.command == 2000]
    assert ordered == ([] if left is None else [left])
