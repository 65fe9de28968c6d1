"""ArduCopter: recorded flights, S-curves, parameters; of both autopilots, that whatever is ordered ends."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from changed_flights import ChangedFlight, fly_changed
from hypothesis import example, given, settings
from hypothesis import strategies as st
from recordings import compare, fly_recording, load_recording
from short_flights import started
from sweeps import sweep

from geo.frame import LocalFrame
from mission.model import Command, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.autopilot.ardupilot import ARDUCOPTER
from sim_vehicle.autopilot.px4 import PX4_MULTIROTOR
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import ItemReached
from sim_vehicle.motion.arducopter import scurve
from sim_vehicle.motion.arducopter.model import ArduCopter
from sim_vehicle.motion.legs import KEEP, Leg, LegKind, Route
from sim_vehicle.weather.wind import Wind

FLIGHTS = Path(__file__).parents[2] / "data" / "flights"
FRAME = LocalFrame(28.05, -82.15)
QUAD = replace(with_autopilot(get_vehicle("quad"), "ardupilot"), battery=None)
SPEEDS, ACCELS = (5.0, 2.5, 1.5), (2.5, 1.0)
SNAP, JERK = 5.236, 1.0


QUADS = [replace(with_autopilot(get_vehicle("quad"), name), battery=None) for name in ("px4", "ardupilot")]


def quad(**parameters):
    return replace(with_autopilot(get_vehicle("quad"), "ardupilot", parameters), battery=None)


def place(command, x, y, z, hold=0.0, p3=0.0):
    latitude, longitude = FRAME.to_wgs84(x, y)
    return MissionItem(command, 3, hold, 0.0, p3, None, latitude, longitude, z)


def takeoff(z=10.0):
    return place(Command.NAV_TAKEOFF, 0.0, 0.0, z)


def way(x, y, z=10.0, hold=0.0):
    return place(Command.NAV_WAYPOINT, x, y, z, hold)


def speed(m_s, kind=1.0):
    return MissionItem(Command.DO_CHANGE_SPEED, 2, kind, m_s, -1.0, 0.0)


HOME = MissionItem(Command.NAV_RETURN_TO_LAUNCH, 2, 0.0, 0.0, 0.0, 0.0)


def fly(
    items,
    spec=QUAD,
    *,
    wind=None,
    cuts=None,
    limit_s=4000.0,
):
    executor = started(items, spec, FRAME, wind=wind)
    if cuts is None:
        return executor, executor.fly_through(limit_s)
    events = []
    now, turn = 0.0, 0
    while executor.flight.armed and now < limit_s:
        now += cuts[turn % len(cuts)]
        turn += 1
        events += executor.advance(now)
    return executor, events


def reached(events):
    times = {}
    for event in events:
        if isinstance(event, ItemReached):
            times.setdefault(event.seq, event.time_s)
    return times


def speeds(items, spec=QUAD, step_s=0.1):
    executor = started(items, spec, FRAME)
    rows = []
    while executor.flight.armed and executor.time_s < 2000.0:
        executor.advance(executor.time_s + step_s)
        rows.append((executor.time_s, *executor.motion.state[:6].tolist()))
    return np.array(rows)


@pytest.mark.parametrize("name", ["climbs-holds", "lawnmower-5", "random-10", "spiral-8"])
def test_flies_as_it_was_recorded(name):
    recording = load_recording(FLIGHTS / f"ardupilot-{name}.json")
    flight = fly_recording(recording, with_autopilot(get_vehicle("quad"), "ardupilot"))
    result = compare(recording, flight)
    assert abs(result.time_error) < 0.01
    assert result.mean_m < 0.1
    assert result.p95_m < 0.2
    assert result.correlation > 0.98
    was, now = recording.flight, flight
    home = (was.end_s - was.window(recording.items)[1], now.end_s - now.window(recording.items)[1])
    assert home[1] == pytest.approx(home[0], rel=0.025)


@pytest.mark.parametrize("name", ["ground-takeoff-rtl", "wind-5-from-270"])
def test_a_whole_flight_takes_as_long_as_recorded(name):
    recording = load_recording(FLIGHTS / f"ardupilot-{name}.json")
    was, now = recording.flight, fly_recording(recording)
    # Both count from arming, the recording's at 3 s.
    assert now.end_s == pytest.approx(was.end_s - 3.0, rel=0.02)
    lifts = [one.time_s[one.position_m[:, 2] > 0.05][0] for one in (was, now)]
    assert lifts[1] == pytest.approx(lifts[0] - 3.0, abs=0.25)
    first = [one.window(recording.items)[0] for one in (was, now)]
    assert first[1] == pytest.approx(first[0] - 3.0, abs=1.5)
    first, last = was.window(recording.items)
    assert now.end_s - now.window(recording.items)[1] == pytest.approx(was.end_s - last, rel=0.02)


def test_the_motors_of_a_vehicle_that_is_armed_for_long_spool_up_at_once():
    def lifts_after(armed_s):
        executor = MissionExecutor(QUAD, FRAME)
        executor.arm()
        executor.advance(armed_s)
        executor.takeoff(10.0)
        while executor.motion.position_m[2] <= 0.0:
            executor.advance(executor.time_s + 0.02)
        return executor.time_s - armed_s

    # ARMING_DELAY_SEC is two seconds.
    assert lifts_after(0.0) == pytest.approx(lifts_after(60.0) + 2.0, abs=0.05)
    assert lifts_after(1.0) == pytest.approx(lifts_after(60.0) + 1.0, abs=0.05)


@given(
    length=st.floats(0.002, 2000.0),
    top=st.floats(0.2, 20.0),
    accel=st.floats(0.5, 5.0),
    jerk=st.floats(1.0, 20.0),
    lag=st.floats(0.1, 1.0),
    changes=st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.2, 20.0)), max_size=4),
)
@example(42.0, 3.0, 0.5, 4.0, 0.5, [(0.25, 1.0), (0.0, 5.0)])
@settings(deadline=None, max_examples=150)
def test_a_profile_ends_at_the_end_whatever_its_speed_becomes(length, top, accel, jerk, lag, changes):
    head, curve = np.zeros(scurve.HEAD), np.zeros((scurve.SEGMENTS, scurve.COLUMNS))
    snap = 0.25 * math.pi * jerk / lag
    scurve.make_leg(head, curve, (length, 0.0, 0.0), (top, 1.0, 1.0), (accel, 1.0), snap, jerk)
    fastest = top
    for share, then in [*changes, (1.0, top)]:
        whole = scurve.end_time(head, curve)
        assert np.all(np.diff(curve[:, 0]) >= -1e-9)
        assert np.all(np.diff(curve[:, 5]) >= -1e-6 * length)
        assert curve[-1, 5] == pytest.approx(length, rel=1e-6)
        assert curve[-1, 4] < 1e-4
        times = np.linspace(head[scurve.TIME], whole, 50)
        rows = np.array([scurve.state_at(head, curve, t) for t in times])
        assert rows[:, 1].max() <= fastest * (1.0 + 1e-6)
        assert np.abs(rows[:, 2]).max() <= accel * (1.0 + 1e-6)
        head[scurve.TIME] += share * (whole - head[scurve.TIME])
        before = scurve.state_at(head, curve, head[scurve.TIME])
        scurve.change_speed(head, curve, then, 1.0, 1.0)
        assert np.allclose(before, scurve.state_at(head, curve, head[scurve.TIME]), atol=1e-6)
        fastest = max(fastest, then)


def test_the_profile_of_a_leg():
    head, curve = np.zeros(scurve.HEAD), np.zeros((scurve.SEGMENTS, scurve.COLUMNS))
    scurve.make_leg(head, curve, (0.0, 100.0, 0.0), SPEEDS, ACCELS, SNAP, JERK)
    place_m, v, a = zip(*(scurve.state_at(head, curve, t) for t in np.arange(0.0, 26.0, 0.01)), strict=True)
    assert np.allclose(np.gradient(place_m, 0.01)[1:-1], v[1:-1], atol=1e-4)
    assert np.allclose(np.gradient(v, 0.01)[1:-1], a[1:-1], atol=2e-3)
    assert np.abs(np.gradient(a, 0.01)).max() <= JERK + 1e-3
    assert max(v) == pytest.approx(5.0)
    # Slanted: the vertical speeds and accelerations limit the whole.
    scurve.make_leg(head, curve, (40.0, 0.0, 20.0), (6.0, 2.5, 1.5), ACCELS, SNAP, JERK)
    assert head[scurve.SPEED] == pytest.approx(2.5 * math.sqrt(5.0))
    assert head[scurve.ACCEL] == pytest.approx(math.sqrt(5.0))
    scurve.make_leg(head, curve, (0.0, 0.0, 0.0), SPEEDS, ACCELS, SNAP, JERK)
    assert scurve.end_time(head, curve) == 0.0


def test_an_order_changes_the_speed_without_a_stop():
    executor = started([takeoff(), speed(5.0), way(0.0, 400.0), HOME], QUAD, FRAME)
    executor.advance(25.0)
    executor.set_speed(9.0)
    slowest = 9.0
    for now in np.arange(25.1, 40.0, 0.1):
        executor.advance(float(now))
        slowest = min(slowest, executor.motion.snapshot().velocity_m_s[1])
    assert slowest > 4.9
    assert executor.motion.snapshot().velocity_m_s[1] == pytest.approx(9.0, abs=0.1)


def test_return_follows_its_parameters():
    def legs(spec, z=10.0, x=100.0):
        return flight_procedures(spec).return_legs(spec, (x, 0.0, z), 5.0, (0.0, 0.0, 0.0))

    assert [leg.kind for leg in legs(QUAD)] == [LegKind.CLIMB, LegKind.HOME, LegKind.LAND]
    assert legs(QUAD)[0].end_m[2] == 15.0
    assert legs(QUAD)[1].speed_m_s == 10.0
    assert legs(QUAD)[1].pause_s == 5.0
    assert legs(QUAD, x=2.0, z=4.0)[0].end_m[2] == 6.0
    assert legs(QUAD, z=25.0)[0].end_m[2] == 25.0
    other = quad(RTL_ALT=3000, RTL_SPEED=400, RTL_LOIT_TIME=0, RTL_CLIMB_MIN=500, RTL_CONE_SLOPE=0)
    assert legs(other, x=2.0, z=4.0)[0].end_m[2] == 30.0
    assert legs(other, z=28.0)[0].end_m[2] == 33.0
    assert legs(other)[1].speed_m_s == 4.0
    assert legs(other)[1].pause_s == 0.0


# What these do is not in a flight like this one.
ELSEWHERE = {
    *("LNDMC_Z_VEL_MAX", "MIS_YAW_ERR", "MPC_YAWRAUTO_ACC", "MPC_YAWRAUTO_MAX", "RTL_CONE_ANG"),
    *("RTL_DESCEND_ALT", "RTL_MIN_DIST", "ATC_ACCEL_P_MAX", "ATC_ACCEL_Y_MAX", "ATC_RATE_R_MAX"),
    *("PILOT_TKOFF_ALT", "PSC_ACCZ_FLTE", "PSC_ACCZ_FLTT", "PSC_ACCZ_IMAX", "PSC_JERK_XY", "RTL_CONE_SLOPE"),
}
# Those that limit nothing unless they are far from their defaults.
FAR = {"LAND_SPEED_HIGH": 300.0, "ATC_ACCEL_R_MAX": 3000.0, "ATC_RATE_P_MAX": 1.0, "WP_YAW_BEHAVIOR": 0.0}
TABLES = {"px4": PX4_MULTIROTOR.parameters, "ardupilot": ARDUCOPTER.parameters}
ACTING = [(name, parameter) for name, table in TABLES.items() for parameter in sorted(set(table) - ELSEWHERE)]


@pytest.mark.parametrize(("autopilot", "name"), ACTING)
def test_parameters_act(autopilot, name):
    """A flight with another value of the parameter, lower or higher, is another flight."""
    items = [takeoff(), speed(7.0), way(0.0, 50.0), way(35.0, 40.0, 16.0), way(35.0, 0.0, 10.0), HOME]
    row = TABLES[autopilot][name]

    def flown(value):
        spec = with_autopilot(get_vehicle("quad"), autopilot, {name: value})
        executor, events = fly(items, replace(spec, battery=None))
        assert not executor.flight.armed
        assert set(reached(events)) == set(range(len(items)))
        return executor.time_s, executor.motion.state[:13].tobytes()

    higher = FAR.get(name, row.default + 0.3 * (row.high - row.default))
    lower = row.default - 0.8 * (row.default - row.low)
    plain = flown(row.default)
    assert flown(higher) != plain or flown(lower) != plain


def test_settings_and_their_checks():
    assert all(row.low <= row.default <= row.high for row in ARDUCOPTER.parameters.values())
    spec = with_autopilot(get_vehicle("quad"), "ardupilot", {"WPNAV_SPEED": 600.0, "LAND_SPEED": 70.0})
    own = (spec.cruise_speed_m_s, spec.landing_speed_m_s, spec.acceptance_radius_m)
    assert own == pytest.approx((6.0, 0.7, 2.0))
    for name, value in (("WPNAV_SPEED", 5.0), ("MPC_XY_CRUISE", 5.0), ("WPNAV_RADIUS", math.nan)):
        with pytest.raises(VehicleError, match=name):
            with_autopilot(get_vehicle("quad"), "ardupilot", {name: value})


def test_the_nose_leads_unless_it_is_kept():
    items = [takeoff(), way(40.0, 0.0), way(40.0, -40.0), HOME]
    for behaviour, wanted in ((2.0, math.pi), (0.0, 0.0)):
        executor = started(items, quad(WP_YAW_BEHAVIOR=behaviour), FRAME)
        while executor.mission.current_seq < 3:
            executor.advance(executor.time_s + 1.0)
        assert math.remainder(
            executor.motion.snapshot().heading_rad - wanted, 2.0 * math.pi
        ) == pytest.approx(0.0, abs=0.1)


def test_attitude_and_throttle():
    vehicle = ArduCopter(QUAD, ARDUCOPTER.law)
    assert vehicle.attitude() is None
    vehicle.state[2] = 10.0
    vehicle.fly(Route.through([Leg((0.0, 300.0, 10.0), 9.0, heading=KEEP)]))
    vehicle.advance(900)
    attitude = vehicle.attitude()
    assert attitude is not None
    roll, pitch, airspeed, throttle = attitude
    # The nose points north and lies low against the drag; lift of the tilted airframe spares thrust.
    assert roll == pytest.approx(0.0, abs=0.01)
    assert -0.5 < pitch < -0.3
    assert airspeed == pytest.approx(9.0, abs=0.2)
    assert 0.25 < throttle < 0.45


ITEMS = st.one_of(
    st.builds(speed, st.floats(0.5, 12.0), st.sampled_from([1.0, 2.0, 3.0])),
    st.builds(
        place,
        st.sampled_from([16, 16, 16, 16, 82, 18, 19]),
        st.floats(-60.0, 60.0),
        st.floats(-60.0, 60.0),
        st.sampled_from([10.0, 10.0, 4.0, 22.0]),
        st.sampled_from([0.0, 0.0, 1.0]),
        st.floats(-15.0, 15.0),
    ),
)


@given(
    items=st.lists(ITEMS, max_size=12),
    scale=st.sampled_from([0.02, 0.2, 1.0]),
    gust=st.sampled_from([None, 0.0, 1.0]),
    cuts=st.lists(st.floats(0.02, 40.0), min_size=1, max_size=5),
    spec=st.sampled_from(QUADS),
)
@sweep(few=25, many=120)
def test_every_mission_ends_and_does_not_depend_on_the_cuts(items, scale, gust, cuts, spec):
    whole = [takeoff()]
    for item in items:
        if item.command == Command.DO_CHANGE_SPEED:
            whole.append(item)
            continue
        x, y = FRAME.from_wgs84(item.x, item.y)
        latitude, longitude = FRAME.to_wgs84(scale * x, scale * y)
        # In gusts a PX4 makes no progress on small circles and short splines.
        command = (
            Command.NAV_WAYPOINT if spec.autopilot == "px4" and item.command in (18, 82) else item.command
        )
        whole.append(replace(item, command=command, x=latitude, y=longitude))
    whole.append(HOME)
    wind = None if gust is None else Wind(2.0, -3.0, gust_m_s=gust, seed=3)
    straight, told = fly(whole, spec, wind=wind)
    assert not straight.flight.armed
    assert set(reached(told)) == set(range(len(whole)))
    assert np.isfinite(straight.motion.state[:14]).all()
    assert math.hypot(*straight.motion.position_m[:2]) < 3.0
    assert straight.motion.position_m[2] == 0.0
    cut, events = fly(whole, spec, wind=wind, cuts=cuts)
    assert events == told
    assert np.array_equal(cut.motion.state[:11], straight.motion.state[:11])


ORDERS = st.tuples(
    st.sampled_from(
        ["hold", "goto", "speed", "start", "home", "land", "jump", "steer", "update_spec", "orbit"]
    ),
    st.floats(0.5, 20.0),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
)


@given(st.lists(ORDERS, min_size=1, max_size=8), st.booleans(), st.sampled_from(QUADS))
@sweep(few=25, many=120)
def test_whatever_is_ordered_it_comes_home(orders, windy, spec):
    items = [takeoff(), way(0.0, 40.0), way(40.0, 40.0, 15.0), way(40.0, 0.0, 10.0, 2.0), HOME]
    executor = started(items, spec, FRAME, wind=Wind(3.0, 1.0, gust_m_s=0.7, seed=1) if windy else None)
    for order, wait_s, a, b in orders:
        executor.advance(executor.time_s + wait_s)
        calls = {
            "hold": executor.flight.hold,
            "goto": lambda a=a, b=b: executor.goto(40.0 * a, 40.0 * b, 11.0 + 9.0 * a),
            "speed": lambda a=a: executor.set_speed(6.5 + 6.0 * a),
            "start": executor.start,
            "home": executor.return_home,
            "land": executor.land,
            "jump": lambda a=a: executor.mission.set_current(round(2.0 + 1.9 * a)),
            "steer": lambda a=a, b=b: executor.steer((5.0 * a, 5.0 * b, 2.0 * a)),
            "update_spec": lambda a=a: executor.update_spec(
                replace(spec, cruise_speed_m_s=8.0 + 4.0 * a, climb_speed_m_s=2.0 + a)
            ),
            "orbit": lambda b=b: executor.orbit(0.0, 0.0, 10.0, 11.0 + 9.0 * b, 3.0),
        }
        try:
            calls[order]()
        except VehicleError:
            # A PX4 flies no faster than MPC_XY_VEL_MAX.
            is_fast = order == "speed" and spec.autopilot == "px4" and 6.5 + 6.0 * a > 12.0
            assert is_fast or not executor.flight.armed or executor.flight.landed.name == "ON_GROUND"
            executor.arm()
            executor.start()
    executor.advance(executor.time_s + 1.0)
    if executor.flight.landed.name == "ON_GROUND":
        return
    executor.return_home()
    executor.advance(executor.time_s + 600.0)
    assert not executor.flight.armed
    assert math.hypot(*executor.motion.position_m[:2]) < 1.0


CHANGES = sorted((FLIGHTS / "changes").glob("ardupilot-*.json"))


@pytest.mark.parametrize("path", CHANGES, ids=[path.stem for path in CHANGES])
def test_missions_are_changed_in_flight_as_recorded(path):
    was = ChangedFlight.load(path)
    now = fly_changed(was)
    assert now.lowest_m_s(guided=True) == pytest.approx(
        was.lowest_m_s(guided=True), rel=0.1, abs=0.05, nan_ok=True
    )
    assert now.lowest_m_s(guided=False) == pytest.approx(was.lowest_m_s(guided=False), rel=0.1, nan_ok=True)
    assert now.back_s == pytest.approx(was.back_s, rel=0.1, nan_ok=True)
    assert now.took_s == pytest.approx(was.took_s, rel=0.025, nan_ok=True)
    assert now.mean_m_s == pytest.approx(was.mean_m_s, rel=0.02)


@pytest.mark.parametrize("case", ["45-40", "90-15", "135-15"])
def test_changes_lose_as_much_time_as_recorded(case):
    lost = []
    for fly in (lambda one: one, fly_changed):
        changed, plain = (
            fly(ChangedFlight.load(FLIGHTS / "changes" / f"ardupilot-{kind}-{case}.json")).took_s
            for kind in ("change", "unchanged")
        )
        lost.append(changed - plain)
    assert lost[1] == pytest.approx(lost[0], rel=0.1)
