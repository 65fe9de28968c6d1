"""Each finding in a plan: a mission that has it, and one like it that has not."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from preflight_plans import (
    CAMERA_OFF,
    HOME,
    RTL,
    at,
    box,
    camera,
    checked,
    farm_with_obstacle,
    fence,
    fenced,
    findings,
    good,
    speed,
    takeoff,
)

from mission.model import Command, Frame, Mission, MissionItem
from sim_vehicle.weather.wind import Wind
from wbf_mission.preflight import flight_rules
from wbf_mission.preflight.finding import Severity
from wbf_mission.preflight.flight_rules import check_battery
from wbf_mission.preflight.subject import Circumstances

JUMP = Command.DO_JUMP
PATTERN = (
    MissionItem(Command.DO_LAND_START),
    at(-400, 80, 30.0, Command.NAV_LOITER_TO_ALT, param1=1.0, param2=80.0, param4=1.0),
    at(0, 0, 0.0, Command.NAV_LAND),
)
WING_START = (at(0, 150, 40.0, Command.NAV_TAKEOFF, param1=10.0),)
WING = {"vehicle": "fixed-wing"}


def wing(*middle, end=PATTERN, airspeed=15.0):
    order = MissionItem(Command.DO_CHANGE_SPEED, param1=0.0, param2=airspeed, param3=-1.0)
    return Mission((*WING_START, order, *middle, *end), HOME)


# Rows of 60 m, six metres apart.
NARROW = tuple(at(200 + 60 * ((k + 1) // 2 % 2), 200 - 6 * (k // 2), 40.0) for k in range(12))
WIDE = (at(0, 500, 40.0), at(500, 500, 40.0), at(500, 0, 40.0))
LAST = (at(40, 0), at(40, 40))
# Short legs that lie within one acceptance radius, and such that lie in a line.
CURL = (at(40, 1.5), at(38.5, 1.5), at(38.5, 0.3), at(39.7, 0.3))
LINE = (at(41, 0), at(42, 0), at(43, 0), at(44, 0))


def jumps(target, times):
    return MissionItem(JUMP, param1=float(target), param2=float(times))


def waits(seconds):
    return at(40, 0, command=Command.NAV_LOITER_TIME, param1=seconds)


LONG = good(at(400, 0), at(0, 0), jumps(3, 2))


def case(severity, item, bad, fine=None, **options):
    return bad, good() if fine is None else fine, severity, item, options


# code: severity, item, mission with it, mission without (by default a good one), options of the check
CASES = {
    "empty": case("error", None, Mission((), HOME)),
    "no-position": case("error", None, Mission((speed(5.0),), HOME)),
    "no-takeoff": case("error", 3, good(start=()), autopilot="ardupilot"),
    "altitude": case("error", 4, good(at(40, 0, -5.0))),
    "far-from-home": case("error", 4, good(at(0, 25_000))),
    "frame": case("error", 5, good(at(40, 0), at(40, 40, frame=4))),
    "time": case("error", 4, good(at(40, 0, param1=-5.0)), good(at(40, 0, param1=5.0))),
    "radius": case("error", 4, good(at(40, 0, param2=-1.0))),
    "turns": case(
        "error",
        4,
        good(at(40, 0, command=18, param1=0.0)),
        good(at(40, 0, command=18, param1=1.0, param3=10.0)),
    ),
    "distance": case(
        "error",
        4,
        good(MissionItem(Command.CONDITION_DISTANCE, param1=-1.0), *LAST),
        good(MissionItem(Command.CONDITION_DISTANCE, param1=1.0), *LAST),
    ),
    "autopilot-refuses": case("error", 6, good(*LAST, jumps(40, 1)), good(*LAST, jumps(3, 1))),
    "autopilot-changes": case("warning", 6, good(*LAST, at(9, 9, command=82))),
    "autopilot-ignores": case("note", 6, good(*LAST, at(9, 9, param3=5.0))),
    "jump-loop": case("error", 6, good(*LAST, jumps(5, -1)), good(*LAST, jumps(3, 1))),
    "approach": case(
        "error",
        7,
        wing(*WIDE, at(60, 0, 40.0), end=PATTERN[2:]),
        wing(*WIDE, at(600, 0, 40.0), end=PATTERN[2:]),
        **WING,
    ),
    "no-prediction": case("note", None, good(at(40, 0, -5.0))),
    "stops": case("error", 4, good(), wind=(30.0, 0.0)),
    "not-predicted": case("warning", 6, good(*LAST, at(20, 20, command=94))),
    "terrain-heights": case(
        "warning", 6, good(*LAST, at(20, 20, frame=10)), good(*LAST, at(20, 20)), autopilot="ardupilot"
    ),
    "unreachable": case("warning", 7, good(*LAST, end=(RTL, at(0, 0), at(0, 9)))),
    # A day is over after few rounds of a vehicle that waits long in each.
    "endless": case(
        "warning",
        7,
        good(*LAST, waits(20_000.0), jumps(3, -1), end=()),
        good(*LAST, waits(20.0), jumps(3, 2)),
        vehicle="rover",
    ),
    "mixed-frames": case("warning", 6, good(*LAST, at(20, 20, 30.0, frame=0))),
    "late-takeoff": case(
        "warning",
        1,
        Mission((at(5, 0), takeoff(), *LAST, RTL), HOME),
        Mission((takeoff(), at(5, 0), *LAST, RTL), HOME),
    ),
    "climbs-by-itself": case("warning", 3, good(start=())),
    "low-takeoff": case("warning", 1, good(start=(takeoff(1.0),))),
    "no-landing": case("warning", 6, good(end=(CAMERA_OFF,))),
    "lands-elsewhere": case(
        "warning",
        8,
        good(end=(CAMERA_OFF, at(90, 40, 0.0, Command.NAV_LAND))),
        good(end=(CAMERA_OFF, at(0, 0, 0.0, Command.NAV_LAND))),
    ),
    "bad-fence": case(
        "error", None, fenced(good(), box(-9, -9, 60, 60), (at(0, 0),)), fenced(good(), box(-9, -9, 60, 60))
    ),
    "home-outside-fence": case(
        "error", None, fenced(good(), box(10, -20, 60, 60)), fenced(good(), box(-20, -20, 60, 60))
    ),
    "rally-outside-fence": case(
        "warning",
        1,
        fenced(replace(good(), rally=(at(0, 90, 20.0, Command.NAV_RALLY_POINT),)), box(-20, -20, 60, 60)),
        fenced(replace(good(), rally=(at(0, 50, 20.0, Command.NAV_RALLY_POINT),)), box(-20, -20, 60, 60)),
    ),
    "outside-fence": case(
        "error",
        6,
        fenced(good(), box(-20, -20, 60, 60), box(15, 35, 25, 45, inside=False)),
        fenced(good(), box(-20, -20, 60, 60), box(15, 15, 25, 25, inside=False)),
    ),
    "near-fence": case(
        "warning", 5, fenced(good(), box(-20, -20, 41.5, 60)), fenced(good(), box(-20, -20, 44, 60))
    ),
    "obstacle": case(
        "error", 6, good(), farm=(farm_with_obstacle(10, 35, 20, 45), farm_with_obstacle(10, 10, 20, 20))
    ),
    "near-obstacle": case(
        "warning", 6, good(), farm=(farm_with_obstacle(10, 41.5, 20, 45), farm_with_obstacle(10, 44, 20, 46))
    ),
    "too-high": case("warning", 5, good(at(40, 0), at(40, 40, 130.0))),
    "unseen": case(
        "warning", None, Mission((takeoff(), *LAST, RTL), HOME), farm=farm_with_obstacle(150, 150, 160, 160)
    ),
    "with-permission": case("note", 5, good(at(40, 0), at(40, 40, 130.0)), max_altitude_m=(150.0, 150.0)),
    "too-low": case("warning", 5, good(at(40, 0), at(40, 40, 1.0))),
    "far-start": case("warning", 5, good(at(1200, 0), at(1100, 0)), good(at(1200, 0), at(900, 0))),
    "zero-leg": case("warning", 5, good(at(40, 0), at(40, 0)), good(at(40, 0), at(40, 1, param2=0.5))),
    "short-leg": case("warning", 7, good(at(40, 0), *CURL), good(at(40, 0), *LINE)),
    "long-leg": case("warning", 4, good(at(10_500, 0)), good(at(900, 0))),
    "small-radius": case("warning", 4, good(at(40, 0, param2=0.5)), good(at(40, 0, param2=0.0))),
    "too-fast": case("warning", 4, good(speed(20.0), *LAST), good(speed(8.0), *LAST)),
    "too-slow": case("warning", 2, wing(*WIDE, airspeed=6.0), wing(*WIDE), **WING),
    "tight-turn": case("warning", 13, wing(*NARROW), wing(*WIDE, at(900, 0, 40.0), at(920, 0, 40.0)), **WING),
    "steep-leg": case("warning", 6, wing(*WIDE, at(500, -50, 120.0)), wing(*WIDE), **WING),
    "too-windy": case("error", None, good(), wind=(25.0, 5.0)),
    "too-gusty": case("warning", None, LONG, LONG, wind=5.0, gust=(2.5, 1.0)),
    "battery": case("error", None, good(waits(1800.0)), good(waits(300.0))),
    "battery-close": case("note", None, good(waits(1200.0)), good(waits(300.0))),
    "camera-too-fast": case("warning", 4, good(camera(0.02), *LAST), good(camera(0.5), *LAST)),
    "camera-left-on": case("note", 3, good(end=(RTL,))),
    "no-camera": case("note", None, Mission((takeoff(), *LAST, RTL), HOME)),
    "flight": case("note", None, good(), Mission((), HOME)),
}


@pytest.mark.parametrize("code", CASES)
def test_a_plan_that_has_it_and_one_that_has_not(code):
    bad, fine, severity, item, options = CASES[code]
    with_it = {name: value[0] if isinstance(value, tuple) else value for name, value in options.items()}
    without = {name: value[1] if isinstance(value, tuple) else value for name, value in options.items()}
    found = findings(bad, **with_it)
    assert code in found, list(found)
    finding = found[code]
    assert (finding.severity, finding.item) == (Severity(severity), item), str(finding)
    assert finding.text
    assert finding.fix or severity == "note" or code == "autopilot-changes"
    if finding.measure is not None:
        assert math.isfinite(finding.measure.value)
    assert code not in findings(fine, **without)


def test_a_good_plan_has_only_the_note_of_its_flight():
    assert set(findings(good())) == {"flight"}
    told = findings(good(), autopilot="ardupilot")
    assert set(told) == {"flight", "autopilot-ignores"}
    assert "does not store the acceptance radius" in told["autopilot-ignores"].text
    assert set(findings(wing(*WIDE), **WING)) == {"flight", "no-camera"}


def test_the_path_that_is_flown_counts_not_the_straight_legs():
    """The legs pass the zone at 0.8 m; ArduCopter's curve leads through its corner."""
    mission = fenced(good(), box(30, 30, 39.2, 39.2, inside=False))
    found = findings(mission, autopilot="ardupilot")["outside-fence"]
    assert (found.item in (5, 6), found.measure.value) == (True, pytest.approx(-0.4, abs=0.3))
    assert findings(mission, autopilot="px4")["near-fence"].measure.value > 0.0


def test_which_gusts_a_vehicle_cannot_hold_its_path_against():
    found = findings(LONG, wind=5.0, gust=2.5)["too-gusty"]
    assert "quad holds its path in at most 9.81 m/s" in found.text
    assert found.measure.value > found.measure.limit
    assert "too-gusty" in findings(LONG, wind=5.0, turbulence="severe")
    assert "too-gusty" not in findings(LONG, wind=5.0, gust=2.5, vehicle="mapping-quad")  # has less drag
    assert "too-gusty" not in findings(LONG, wind=5.0, gust=2.5, vehicle="rover")


def test_inside_one_area_or_all_of_them_as_the_autopilot_has_it():
    zones = fenced(good(), box(-20, -20, 60, 60), box(-20, -20, 20, 60))
    assert "outside-fence" not in findings(zones, autopilot="px4")
    assert "outside-fence" in findings(zones, autopilot="ardupilot")


def test_the_margin_is_the_callers():
    mission = fenced(good(), box(-20, -20, 48, 60))
    assert "near-fence" not in findings(mission)
    assert findings(mission, margin_m=10.0)["near-fence"].measure.limit == 10.0


def test_the_cameras_shortest_interval_is_the_callers():
    found = findings(good(), image_interval_s=1.2)["camera-too-fast"]
    assert found.measure.value == pytest.approx(1.0)
    assert found.command == "DO_SET_CAM_TRIGG_DIST"
    assert "camera-too-fast" not in findings(good(), image_interval_s=0.9)


@pytest.mark.parametrize(
    "photo",
    [
        MissionItem(203, x=1.0),
        MissionItem(Command.IMAGE_START_CAPTURE, param3=1.0),
        MissionItem(Command.IMAGE_START_CAPTURE, param2=2.0, param3=5.0),
    ],
)
def test_single_images_are_a_camera_that_stops_by_itself(photo):
    found = findings(Mission((takeoff(), at(0, 40), photo, at(40, 40), RTL), HOME))
    assert not {"camera-left-on", "no-camera"} & found.keys()


def test_a_vehicle_that_nobody_named_gives_no_errors_of_its_own():
    long = CASES["battery"][0]
    found = findings(long)["battery"]
    assert found.severity is Severity.ERROR
    assert found.measure.value == 0.0, "no less than nothing is left in a battery"
    assert findings(long, assumed=True)["battery"].severity is Severity.WARNING


def test_findings_of_several_items_are_one_with_the_worst():
    found = findings(good(at(40, 0), *CURL))["short-leg"]
    assert (found.item, found.count) == (7, 4)
    assert found.measure.value == pytest.approx(1.2, abs=0.02)
    assert found.where == "mission item 7 (NAV_WAYPOINT) and 3 more"


def test_what_a_fixed_wing_leaves_out_is_measured():
    found = findings(wing(*NARROW), **WING)["tight-turn"]
    assert found.measure.limit == 90.0
    assert found.measure.value < 80.0
    assert "at least 39 m apart" in found.fix
    # Whoever knows no flight judges by the legs.
    unflown = findings(wing(*NARROW, at(200, 0, -1.0)), **WING)["tight-turn"]
    assert (unflown.measure.name, unflown.measure.value) == ("length of the leg", pytest.approx(6.0, abs=0.1))


def test_a_flight_that_ends_early_is_not_told_as_one_that_lands():
    found = findings(good(), wind=30.0)
    assert found["flight"].text.startswith("until it ends there, the flight is predicted to take ")
    assert found["flight"].measure is None
    endless = findings(good(waits(80_000.0), waits(80_000.0)), vehicle="rover")
    assert (endless["stops"].item, endless["stops"].text) == (5, "this item never ends")


@pytest.mark.parametrize("rounds", [15, 60])
def test_a_long_flight_is_checked_to_its_end(rounds):
    """After an hour and a half, and after six hours, for which the steps of its track are longer."""
    there = (at(0, 420), at(10, 420), at(10, 0), at(0, 0))
    mission = fenced(good(*there * rounds, at(60, 0), end=()), box(-20, -20, 55, 450))
    result = checked(mission, vehicle="rover")
    assert result.subject.prediction.duration_s > 360.0 * rounds
    found = {one.code: one for one in result.report.findings}["outside-fence"]
    assert (found.item, found.count) == (4 + 4 * rounds, 1)
    assert found.measure.value == pytest.approx(-5.0, abs=2.0)


def test_an_item_that_is_not_predicted_leaves_the_others_to_be_checked():
    found = findings(fenced(good(*LAST, at(20, 20, command=94)), box(-20, -20, 39, 60)))
    assert {"not-predicted", "outside-fence", "flight"} <= set(found)


def test_a_plan_that_cannot_be_flown_is_judged_from_position_to_position():
    mission = fenced(good(at(40, 0), at(40, 40, 0.0)), box(-20, -20, 39, 60))
    found = findings(mission)
    assert found["altitude"].severity is Severity.ERROR
    assert found["outside-fence"].item == 5
    assert "flight" not in found
    between = fenced(good(at(40, 0), at(40, 40, 0.0)), box(35, 15, 45, 25, inside=False))
    assert findings(between)["outside-fence"].item == 5


def test_a_landing_in_between_is_no_end_when_a_takeoff_follows():
    land = at(40, 0, 0.0, Command.NAV_LAND)
    found = findings(good(at(40, 0), land, at(40, 0, 10.0, Command.NAV_TAKEOFF), at(0, 40)))
    assert "unreachable" not in found
    found = findings(good(at(40, 0), land, at(0, 40)))
    assert found["unreachable"].item == 6


def test_a_landing_that_a_return_enters_is_reachable():
    assert "unreachable" not in findings(wing(*WIDE, RTL), **WING)


def test_without_home_the_first_position_stands_for_it():
    mission = replace(good(), home=None)
    assert set(findings(mission)) == {"flight"}
    assert findings(mission, farm=farm_with_obstacle(10, 35, 20, 45))["obstacle"].item == 6


@pytest.mark.parametrize(
    ("height_m", "margin_m", "code"),
    [
        (12.0, None, "obstacle"),
        (9.0, None, "near-obstacle"),
        (7.9, None, ""),
        (9.0, 0.5, ""),
        (7.9, 3.0, "near-obstacle"),
    ],
)
def test_obstacles_are_flown_over_with_their_margin(height_m, margin_m, code):
    shed = farm_with_obstacle(10, 35, 20, 45, height_m=height_m, margin_m=margin_m)
    found = [one for one in findings(good(), farm=shed) if "obstacle" in one]
    assert found == ([code] if code else [])


def test_heights_above_the_sea_count_from_home():
    rows = tuple(replace(one, frame=int(Frame.GLOBAL), z=30.0) for one in LAST)
    start = (replace(takeoff(), frame=int(Frame.GLOBAL), z=30.0),)
    assert set(findings(good(*rows, start=start))) == {"flight"}


def test_a_broken_polygon_is_told_once():
    report = checked(fenced(good(), box(-9, -9, 60, 60)[:3])).report
    assert [one.code for one in report.findings if one.severity is Severity.ERROR] == ["autopilot-refuses"]
    assert "bad-fence" not in findings(fenced(good(), fence([(-50, -50), (100, -50), (0, 150)])))


@pytest.mark.parametrize(
    ("above", "code"),
    [(0.11, "flight"), (0.09, "battery-close"), (0.03, "battery-close"), (-0.01, "battery")],
)
def test_a_tenth_of_the_battery_above_the_reserve_is_enough(above, code, monkeypatch):
    monkeypatch.setattr(flight_rules, "batteries_needed", lambda *_, **__: 2)
    takes = SimpleNamespace(
        duration_s=60.0, ground_length_m=100.0, energy_wh=80.0 - 100.0 * above, reason="low"
    )
    battery = SimpleNamespace(capacity_wh=100.0, reserve_fraction=0.2)
    subject = SimpleNamespace(
        prediction=takes,
        vehicle=SimpleNamespace(battery=battery),
        stopped=None,
        coverage=None,
        wind=Wind(),
        given=Circumstances(),
        mission=None,
        frame=None,
    )
    (told,) = check_battery(subject)
    assert told.code == code and ("it needs 2 batteries" in told.text) == (code == "battery")
