"""Findings, reports, and the ways through a mission."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.model import Command, MissionItem
from wbf_mission.events import EventStream
from wbf_mission.preflight.finding import Against, Finding, Measure, PreflightError, Report, Severity
from wbf_mission.preflight.subject import followers, never_ends, reachable

ERROR = Finding(
    Severity.ERROR,
    "a",
    "is wrong",
    "change it",
    item=3,
    command="NAV_LAND",
    measure=Measure.at_most("height", 3, 2, "m"),
)
NOTE = Finding(Severity.NOTE, "b", "is so")


def test_the_worst_comes_first_and_is_counted():
    report = Report((NOTE, ERROR))
    assert report.findings == (ERROR, NOTE)
    assert report.counts == {"errors": 1, "warnings": 0, "notes": 1}
    assert report.has_errors
    assert not Report((NOTE,)).has_errors


def test_an_error_is_told_in_one_line_with_the_way_out():
    with pytest.raises(PreflightError) as caught:
        Report((NOTE, ERROR, ERROR)).require_no_errors("nothing was sent", EventStream())
    told = "mission item 3 (NAV_LAND): is wrong; height 3 m (at most 2 m); change it (and 1 more error)"
    assert str(caught.value) == f"{told}; preflight check: nothing was sent, --force does it nevertheless"
    Report((NOTE,)).require_no_errors("nothing was sent", EventStream())


@given(st.floats(-1e6, 1e6, allow_nan=False), st.floats(-1e6, 1e6, allow_nan=False), st.sampled_from(Against))
def test_a_limit_that_is_broken_looks_broken(value, limit, against):
    measure = Measure("height", value, limit, "m", against)
    shown, beside = re.fullmatch(
        r"height (\S+) m \((?:at least|at most|planned) (\S+) m\)", str(measure)
    ).groups()
    if measure.is_broken:
        assert shown != beside
    assert float(shown) == pytest.approx(value, rel=0.006, abs=0.5 if abs(value) >= 1000.0 else 0.0)


@st.composite
def missions(draw):
    """Missions of waypoints, jumps and endings; jumps also to nowhere."""
    count = draw(st.integers(1, 12))
    there = MissionItem.waypoint(28.05, -82.15, 10.0)
    one = st.one_of(
        st.just(there),
        st.just(MissionItem(Command.NAV_RETURN_TO_LAUNCH)),
        st.just(MissionItem(Command.NAV_LAND)),
        st.just(MissionItem(Command.NAV_TAKEOFF)),
        st.just(MissionItem(Command.DO_LAND_START)),
        st.builds(
            lambda target, times: MissionItem(Command.DO_JUMP, param1=float(target), param2=float(times)),
            st.integers(0, count + 2),
            st.integers(-1, 3),
        ),
    )
    return draw(st.lists(one, min_size=count, max_size=count))


@given(missions())
def test_what_is_reachable_is_what_following_leads_to(items):
    seen = reachable(items)
    assert 0 in seen
    for seq in seen - {len(items)}:
        assert set(followers(items, seq)) <= seen
    entries = {0, *(k for k, one in enumerate(items) if one.command == Command.DO_LAND_START)}
    led_to = {after for seq in seen - {len(items)} for after in followers(items, seq)}
    assert seen <= entries | led_to
    if never_ends(items):
        assert len(items) not in seen
