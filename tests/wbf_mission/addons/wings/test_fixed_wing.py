import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flight_measures import phases, turns
from hypothesis import given
from hypothesis import strategies as st
from motion_limits import check_steps
from recordings import compare, fly_recording, load_recording
from sweeps import sweep

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import fixed_wing_procedures, with_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import check_mission
from sim_vehicle.execution.state import (
    BatteryDepleted,
    CannotFly,
    Disarmed,
    FlightPhase,
    ItemReached,
    LandedState,
)
from sim_vehicle.motion.columns import record_of
from sim_vehicle.motion.legs import Circle, Leg, LegKind, Route
from sim_vehicle.motion.model import MotionEvent
from sim_vehicle.prediction.predict import predict_flight
from sim_vehicle.weather.wind import Wind
from wbf_mission.addons.wings.motion.air import energy_rate
from wbf_mission.addons.wings.motion.layout import LIMITS, Wing
from wbf_mission.addons.wings.motion.model import FixedWing

HOME = LocalFrame(28.05, -82.15)
FLIGHTS = Path(__file__).parents[3] / "data" / "flights"
G = 9.80665
LOITER = LegKind.LOITER


def plane(autopilot="px4", *, endless=True, **parameters):
    spec = with_autopilot(get_vehicle("fixed-wing"), autopilot, parameters)
    return replace(spec, battery=None) if endless else spec


SPECS = {"px4": plane(), "ardupilot": plane("ardupilot")}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def motion_of(spec, wind=None, yaw_rad=0.0):
    procedures = fixed_wing_procedures(spec)
    return FixedWing(spec, procedures.limits, wind, yaw_rad)


def airborne(spec, wind=None, height=60.0, *then):
    """Return a motion that took off, and circles or flies on."""
    motion = motion_of(spec, wind)
    speed = spec.cruise_speed_m_s
    motion.fly(Route.through([Leg((0.0, 0.0, height), speed, kind=LegKind.TAKEOFF), *then]))
    while motion.arrivals[0] < 0:
        assert motion.advance(50_000) is MotionEvent.REACHED
    return motion


def record(motion, seconds, every=5):
    rows = []
    for _ in range(int(seconds / motion.step_s / every)):
        motion.advance(every)
        rows.append(motion.state.copy())
    return np.array(rows)


def circle(x, y, z, radius, speed, turns=0.0, pause=0.0):
    return Leg((x, y, z), speed, kind=LOITER, pause_s=pause, circle=Circle(radius, turns))


def item(command, x, y, z, *params):
    latitude, longitude = HOME.to_wgs84(x, y)
    return MissionItem(command, 3, *params, *[0.0] * (4 - len(params)), latitude, longitude, z)


def waypoint(x, y, z, hold=0.0, radius=0.0):
    return item(16, x, y, z, hold, radius)


TAKEOFF = item(22, 0.0, 150.0, 40.0, 10.0)
RETURN = MissionItem(20, 2)


def started(spec, items, home=HOME, wind=None):
    """Return an executor that has begun a mission."""
    executor = MissionExecutor(spec, home, wind=wind)
    executor.mission.load(items)
    executor.arm()
    executor.start()
    return executor


def fly(items, spec, wind=None, limit_s=20_000.0):
    executor = started(spec, items, wind=wind)
    return executor, executor.fly_through(limit_s)


# Recorded flights


@pytest.fixture(scope="module")
def recorded():
    """Recordings and the flights of their missions here."""
    pairs = {}
    for name in ("arduplane-lawnmower-60", "arduplane-random-8", "px4-plane-random-8-land"):
        recording = load_recording(FLIGHTS / f"{name}.json")
        pairs[name] = recording, fly_recording(recording)
    return pairs


@pytest.mark.parametrize("name", ["lawnmower-60", "random-8"])
def test_arduplane_flies_as_recorded(name, recorded):
    recording, flight = recorded[f"arduplane-{name}"]
    result = compare(recording, flight)
    assert abs(result.time_error) < 0.02
    assert result.mean_m < 3.0
    assert result.p95_m < 8.0
    both = turns((recording.flight, flight), recording.items, recording.frame)
    assert both[1].overshoot_m == pytest.approx(both[0].overshoot_m, rel=0.15)
    assert both[1].worst_overshoot_m == pytest.approx(both[0].worst_overshoot_m, rel=0.15)
    before, after = (
        phases(one, recording.items, start, flies=True)
        for one, start in ((recording.flight, 3.0), (flight, 0.0))
    )
    assert after.takeoff == pytest.approx(before.takeoff, rel=0.1)
    assert after.home == pytest.approx(before.home, rel=0.05)
    assert both[1].radius_m == pytest.approx(both[0].radius_m, rel=0.15)


def test_arduplane_comes_to_a_circle_of_a_mission_along_the_line(recorded):
    recording, flight = recorded["arduplane-random-8"]
    paths = []
    for one in (recording.flight, flight):
        _, last = one.window(recording.items)
        paths.append(one.position_m[(one.time_s >= last) & (one.time_s <= last + 20.0), :2])
    gap = np.hypot(*(paths[1][:, None] - paths[0][None]).transpose(2, 0, 1)).min(axis=1)
    # On the way to the circle itself it was 40 m off.
    assert gap.max() < 10.0


def test_px4_flies_as_recorded_with_a_weak_motor(recorded):
    recording, flight = recorded["px4-plane-random-8-land"]
    result = compare(recording, flight)
    assert abs(result.time_error) < 0.01
    assert result.mean_m < 1.6
    assert result.p95_m < 4.0
    # The integral of the throttle takes a minute to find what level flight takes.
    assert result.correlation > 0.65
    real, ours = (one.window(recording.items)[0] for one in (recording.flight, flight))
    assert ours == pytest.approx(real - 3.0, rel=0.03)


def test_px4_takes_off_and_lands_as_recorded(recorded):
    recording, flight = recorded["px4-plane-random-8-land"]
    real, ours = (
        phases(one, recording.items, start, flies=True)
        for one, start in ((recording.flight, 3.0), (flight, 0.0))
    )
    assert ours.takeoff == pytest.approx(real.takeoff, rel=0.1)
    assert ours.home == pytest.approx(real.home, rel=0.04)
    assert ours.landing == pytest.approx(real.landing, rel=0.1)
    assert flight.end_s == pytest.approx(recording.flight.end_s - 3.0, rel=0.02)
    # It touches down and stands beyond the landing point, as it follows the glide from above.
    ends = [one.position_m[one.time_s <= one.end_s][-1, :2] for one in (recording.flight, flight)]
    assert np.hypot(*(ends[1] - ends[0])) < 20.0


def test_px4_reaches_the_height_of_item_31_on_its_circle():
    items = (
        TAKEOFF,
        waypoint(0.0, 400.0, 70.0),
        item(31, 0.0, 1200.0, 30.0, 0.0, 90.0),
        waypoint(0.0, 2000.0, 30.0),
    )
    executor = started(SPECS["px4"], items)
    on_circle = []
    while executor.time_s < 600.0:
        events = executor.advance(executor.time_s + 0.2)
        if executor.mission.current_seq == 2:
            x, y, z = executor.motion.position_m
            on_circle.append((math.hypot(x, y - 1200.0), z))
        if any(isinstance(event, ItemReached) and event.seq == 2 for event in events):
            break
    far = [z for away, z in on_circle if away > 160.0]
    assert min(far) > 60.0
    # NAV_FW_ALT_RAD is 10 m.
    assert on_circle[-1][1] < 41.0


def test_arduplane_passes_a_waypoint_that_leads_on_to_zero_later():
    # Flying at 109 degrees there is no corner before a return, so the waypoint is reached on it.
    distance = {}
    for bearing in (109.4, 199.4):
        east, north = math.sin(math.radians(bearing)), math.cos(math.radians(bearing))
        items = (
            TAKEOFF,
            waypoint(0.0, 600.0, 60.0),
            waypoint(700.0 * east, 600.0 + 700.0 * north, 60.0),
            RETURN,
        )
        _, events = fly(items, SPECS["ardupilot"], limit_s=120.0)
        reached = next(event.time_s for event in events if isinstance(event, ItemReached) and event.seq == 2)
        first = next(event.time_s for event in events if isinstance(event, ItemReached) and event.seq == 1)
        distance[bearing] = reached - first
    assert distance[109.4] - distance[199.4] > 2.0


# Turns and circles


@BOTH
@pytest.mark.parametrize("radius", [-90.0, 70.0])
def test_a_circle_has_its_radius_and_its_sense(autopilot, radius):
    spec = SPECS[autopilot]
    motion = airborne(spec, None, 60.0, circle(300.0, 200.0, 60.0, radius, 14.0))
    motion.advance(100_000)
    motion.advance(2000)
    states = record(motion, 60.0)
    distance = np.hypot(states[:, 0] - 300.0, states[:, 1] - 200.0)
    assert distance.mean() == pytest.approx(abs(radius), rel=0.02)
    assert np.ptp(distance) < 0.03 * abs(radius)
    assert np.all(np.sign(states[:, Wing.BANK]) == math.copysign(1.0, radius))
    # v^2 / (g tan bank)
    turn = states[:, Wing.AIRSPEED] ** 2 / (G * np.tan(np.abs(states[:, Wing.BANK])))
    assert turn.mean() == pytest.approx(abs(radius), rel=0.02)


# Lines, wind


@BOTH
@pytest.mark.parametrize("wind", [Wind(0.0, -6.0), Wind(4.0, 4.0)])
def test_a_leg_is_followed_in_a_steady_wind(autopilot, wind):
    spec = SPECS[autopilot]
    speed = spec.cruise_speed_m_s
    rows = [Leg((0.0, 600.0, 60.0), speed, radius_m=1.0), Leg((4000.0, 600.0, 60.0), speed, radius_m=1.0)]
    motion = airborne(spec, wind, 60.0, *rows)
    while motion.leg < 2:
        assert motion.advance(100_000) is MotionEvent.REACHED
    motion.advance(5000)
    states = record(motion, 40.0)
    assert np.abs(states[:, 1] - 600.0).max() < 1.0
    assert states[:, Wing.AIRSPEED] == pytest.approx(speed, abs=0.1)
    # The wind triangle: the nose points into the wind so far that the track stays.
    crab = np.arcsin(-wind.north_m_s / speed)
    assert states[:, 9] == pytest.approx(math.pi / 2.0 - crab, abs=0.02)
    along = math.sqrt(speed**2 - wind.north_m_s**2) + wind.east_m_s
    assert np.hypot(states[:, 3], states[:, 4]) == pytest.approx(along, abs=0.1)
    assert np.abs(states[:, Wing.BANK]).max() < 0.02


# Heights


@BOTH
def test_climbs_and_sinks_keep_their_limits(autopilot):
    spec = SPECS[autopilot]
    speed = spec.cruise_speed_m_s
    motion = airborne(spec, None, 40.0, circle(0.0, 300.0, 300.0, 80.0, speed))
    states = record(motion, 90.0)
    law = motion.law
    if autopilot == "px4":
        assert states[:, Wing.CLIMB].max() <= law.climb_max + 1e-6
    steady = states[len(states) // 5 : len(states) // 3]
    limits = record_of(motion._limits, LIMITS)
    most = [energy_rate(limits, 1.0, v, 1.0 / math.cos(b)) for v, b in
            steady[:, [Wing.AIRSPEED, Wing.BANK]]]  # fmt: skip
    expected = np.minimum(law.climb_rate, most)
    # What ArduPlane's throttle cannot give holds its demand back.
    share = 0.15 if autopilot == "px4" else 0.3
    assert steady[:, Wing.CLIMB].mean() == pytest.approx(expected.mean(), rel=share)
    motion.fly(Route.through([circle(0.0, 300.0, 50.0, 80.0, speed)]))
    states = record(motion, 60.0)
    assert states[:, Wing.CLIMB].min() >= -1.15 * law.sink_max - 1e-6
    glide = energy_rate(limits, 0.0, speed, 1.0)
    assert states[:, Wing.CLIMB].min() < -0.8 * min(law.sink_rate, -glide)
    assert states[:, Wing.AIRSPEED].max() <= law.airspeed_max + 0.5
    assert np.all((states[:, Wing.THROTTLE] >= 0.0) & (states[:, Wing.THROTTLE] <= 1.0))
    # Coming down it needs no throttle, and little power.
    sinking = states[states[:, Wing.CLIMB] < -1.5]
    assert sinking[:, Wing.THROTTLE].mean() < 0.2


def test_px4_reaches_a_height_on_a_circle_about_the_waypoint_before_it_goes_on():
    items = (TAKEOFF, waypoint(200.0, 200.0, 250.0), waypoint(600.0, 200.0, 250.0))
    executor, events = fly(items, SPECS["px4"])
    assert not any(isinstance(event, CannotFly) for event in events)
    reached = next(e.time_s for e in events if isinstance(e, ItemReached) and e.seq == 1)
    # 210 m at 3 m/s.
    assert reached > 65.0
    assert executor.motion.position_m[2] == pytest.approx(250.0, abs=10.5)
    _, events = fly(items, SPECS["ardupilot"])
    early = next(e.time_s for e in events if isinstance(e, ItemReached) and e.seq == 1)
    assert early < 40.0


def test_px4_turns_at_its_own_radius_arduplane_at_that_of_the_item():
    far = item(22, 0.0, 0.0, 60.0)
    items = (far, waypoint(0.0, 1500.0, 60.0, 0.0, 5.0), waypoint(1500.0, 1500.0, 60.0))
    for autopilot, distance in (("px4", 10.0), ("ardupilot", 5.0)):
        executor = started(SPECS[autopilot], items)
        while executor.mission.current_seq < 2:
            executor.advance(executor.time_s + 0.1)
        x, y, _ = executor.motion.position_m
        assert math.hypot(x, y - 1500.0) == pytest.approx(distance, abs=2.6)


# Switching


# Take-off and landing


@BOTH
def test_take_off_by_hand_and_from_a_runway(autopilot):
    runway = {"px4": {"RWTO_TKOFF": 1.0}, "ardupilot": {"TKOFF_ROTATE_SPD": 11.0}}[autopilot]
    thrown, rolled = motion_of(SPECS[autopilot]), motion_of(plane(autopilot, **runway))
    for motion in (thrown, rolled):
        motion.fly(Route.through([Leg((0.0, 150.0, 40.0), 15.0, kind=LegKind.TAKEOFF)]))
        assert motion.advance(10_000) is MotionEvent.REACHED
        assert 39.8 < motion.position_m[2] < 40.7
        assert abs(motion.position_m[0]) < 2.0
        assert motion.state[Wing.AIRSPEED] > 0.85 * motion.law.takeoff_airspeed
    assert rolled.position_m[1] > thrown.position_m[1] + 10.0


@BOTH
@pytest.mark.parametrize("wind", [None, Wind(4.0, -2.0)])
def test_a_landing_touches_down_at_its_place(autopilot, wind):
    spec = SPECS[autopilot]
    items = (TAKEOFF, waypoint(0.0, 500.0, 40.0), item(31, 80.0, -400.0, 30.0, 1.0, 80.0), item(21, 0, 0, 0))
    executor = started(spec, items, wind=wind)
    touched, before = None, (0.0, 0.0, 0.0)
    while executor.flight.armed and executor.time_s < 2000.0:
        executor.advance(executor.time_s + 0.1)
        x, y, z = executor.motion.position_m
        if z == 0.0 and before[2] > 0.0 and executor.flight.landed is LandedState.LANDING:
            touched = (x, y, executor.motion.snapshot().velocity_m_s[2], executor.motion.state[Wing.PITCH])
        before = (x, y, z)
    assert executor.flight.landed is LandedState.ON_GROUND
    assert touched is not None
    assert abs(touched[0]) < 6.0
    assert -30.0 < touched[1] < 60.0
    # Rolled out and at rest.
    assert math.hypot(*executor.motion.snapshot().velocity_m_s[:2]) == 0.0
    assert 0.0 <= before[1] - touched[1] < 60.0


def test_a_steep_approach_is_refused_before_arming_by_px4_only():
    items = (TAKEOFF, waypoint(0.0, -100.0, 50.0), item(21, 0.0, 0.0, 0.0))
    (problem,) = check_mission(items, HOME, SPECS["px4"])
    assert "item 3 (NAV_LAND): the approach of 26.6 degrees is steeper than FW_LND_ANG 5" in str(problem)
    assert check_mission(items, HOME, SPECS["ardupilot"]) == []
    assert check_mission(items[:1] + items[2:], HOME, SPECS["px4"]) == []
    (problem,) = check_mission((items[1],), HOME, SPECS["px4"])
    assert str(problem) == "item 1 (NAV_WAYPOINT): no take-off before it"


# Holds, returns, orders


@BOTH
def test_circle_items_last_as_long_as_they_say(autopilot):
    spec = SPECS[autopilot]
    turns = item(18, 300.0, 300.0, 50.0, 2.0, 0.0, 80.0)
    seconds = item(19, 0.0, 600.0, 50.0, 45.0, 0.0, -80.0)
    height = item(31, -300.0, 300.0, 90.0, 1.0, 80.0)
    _, events = fly((TAKEOFF, turns, seconds, height, waypoint(0.0, 0.0, 90.0)), spec)
    times = {event.seq: event.time_s for event in events if isinstance(event, ItemReached)}
    lap = 2.0 * math.pi * 80.0 / spec.cruise_speed_m_s
    assert times[1] - times[0] > 2.0 * lap
    assert times[1] - times[0] < 3.2 * lap + 500.0 / spec.cruise_speed_m_s
    assert times[2] - times[1] > 45.0
    assert {0, 1, 2, 3, 4} <= set(times)


@BOTH
def test_a_return_circles_over_home_or_lands(autopilot):
    ever = {"px4": {"RTL_LAND_DELAY": -1.0}, "ardupilot": {}}[autopilot]
    spec = plane(autopilot, **ever)
    executor = started(spec, (TAKEOFF, waypoint(500.0, 500.0, 50.0), waypoint(900.0, 900.0, 50.0)))
    executor.advance(40.0)
    executor.return_home()
    assert executor.flight.phase is FlightPhase.RETURN
    executor.advance(400.0)
    assert executor.flight.armed
    x, y, z = executor.motion.position_m
    assert math.hypot(x, y) == pytest.approx(abs(executor.motion.law.loiter_radius), rel=0.1)
    executor.land()
    executor.advance(900.0)
    assert executor.flight.landed is LandedState.ON_GROUND
    assert not executor.flight.armed
    assert z == pytest.approx({"px4": 30.0, "ardupilot": 60.0}[autopilot], abs=2.0)


@BOTH
def test_a_return_flies_the_landing_of_the_mission(autopilot):
    spec = plane(autopilot, **{"px4": {"RTL_TYPE": 1.0, "RTL_LAND_DELAY": -1.0}, "ardupilot": {}}[autopilot])
    landing = (MissionItem(189, 2), item(31, 80.0, -400.0, 30.0, 1.0, 80.0), item(21, 0.0, 0.0, 0.0))
    executor = started(spec, (TAKEOFF, waypoint(500.0, 500.0, 50.0), waypoint(900.0, 900.0, 50.0), *landing))
    executor.advance(40.0)
    executor.return_home()
    executor.advance(500.0)
    assert executor.flight.landed is LandedState.ON_GROUND
    assert math.hypot(*executor.motion.position_m[:2]) < 80.0


@BOTH
def test_orders_that_a_wing_cannot_obey(autopilot):
    executor = MissionExecutor(SPECS[autopilot], HOME)
    executor.arm()
    executor.takeoff(50.0)
    executor.advance(30.0)
    with pytest.raises(VehicleError, match="cannot hold a ground velocity"):
        executor.steer((3.0, 0.0, 0.0))
    executor.orbit(200.0, 200.0, 60.0, -100.0, 14.0)
    executor.advance(120.0)
    x, y, _ = executor.motion.position_m
    assert math.hypot(x - 200.0, y - 200.0) == pytest.approx(100.0, rel=0.05)
    executor.flight.fall()
    executor.advance(160.0)
    assert executor.flight.landed is LandedState.ON_GROUND


@BOTH
def test_without_a_battery_it_glides_down(autopilot):
    full = plane(autopilot, endless=False)
    spec = replace(full, battery=replace(full.battery, capacity_wh=3.0))
    executor = started(spec, (TAKEOFF, waypoint(0.0, 3000.0, 80.0), waypoint(3000.0, 3000.0, 80.0)))
    events = executor.advance(600.0)
    empty = next(event.time_s for event in events if isinstance(event, BatteryDepleted))
    down = next(event.time_s for event in events if isinstance(event, Disarmed))
    # A glide, not a fall.
    assert 15.0 < down - empty < 120.0


# Any mission

PLACE_PARTS = (st.floats(-600.0, 600.0), st.floats(-600.0, 600.0), st.floats(15.0, 120.0))
PLACE = st.tuples(*PLACE_PARTS)


@st.composite
def missions(draw):
    items = [item(22, *draw(PLACE), 10.0)]
    for place in draw(st.lists(PLACE, min_size=1, max_size=6)):
        kind = draw(st.sampled_from([16, 16, 16, 18, 19, 31, 178]))
        radius = draw(st.sampled_from([0.0, 0.3, 20.0, -60.0, 250.0]))
        if kind == 178:
            items.append(MissionItem(178, 2, 0.0, draw(st.floats(5.0, 25.0)), -1.0))
        elif kind == 16:
            items.append(item(16, *place, draw(st.sampled_from([0.0, 0.0, 10.0])), abs(radius)))
        elif kind == 31:
            items.append(item(31, *place, 1.0, radius))
        else:
            items.append(item(kind, *place, 1.0 if kind == 18 else 20.0, 0.0, radius))
    if not any(one.command == 16 for one in items):
        items.append(item(16, *draw(PLACE)))
    items.append(draw(st.sampled_from([RETURN, item(21, 0.0, 0.0, 0.0), waypoint(0.0, 0.0, 50.0)])))
    return tuple(items)


WINDS = st.builds(Wind, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.sampled_from([0.0, 1.0]))


@sweep(few=15, many=60)
@given(missions(), WINDS, st.sampled_from(["px4", "ardupilot"]))
def test_every_mission_ends_or_is_given_up_with_a_reason(items, wind, autopilot):
    spec = SPECS[autopilot]
    prediction = predict_flight(Mission(items, GeoPoint(28.05, -82.15)), spec, wind=wind)
    assert prediction.feasible or prediction.reason
    assert "never ends" not in prediction.reason
    if prediction.feasible:
        assert prediction.duration_s < 20_000.0
        assert prediction.track_m[:, 2].min() >= 0.0


LEG = st.builds(Leg, PLACE, st.floats(8.0, 25.0), st.sampled_from([0.0, 1.0, 1.0, 60.0]))


@sweep(few=10, many=40)
@given(
    st.lists(LEG, min_size=1, max_size=5), WINDS, st.sampled_from(["px4", "ardupilot"]), st.integers(2, 400)
)
def test_the_flight_does_not_depend_on_how_it_is_stepped(legs, wind, autopilot, chunk):
    rows = [Leg((0.0, 0.0, 30.0), 15.0, kind=LegKind.TAKEOFF), *legs]
    rows.append(Leg((0.0, 0.0, 0.0), 10.0, kind=LegKind.LAND))
    check_steps(lambda: motion_of(SPECS[autopilot], wind), rows, chunk, 6000)


@BOTH
def test_predictions_agree_with_the_flight(autopilot):
    spec = plane(autopilot, endless=False)
    items = (TAKEOFF, waypoint(400.0, 400.0, 60.0), item(18, 0.0, 800.0, 60.0, 1.0, 0.0, 90.0), RETURN)
    wind = Wind(4.0, -3.0)
    prediction = predict_flight(Mission(items, GeoPoint(28.05, -82.15)), spec, wind=wind)
    executor = started(spec, items, wind=wind)
    done = []
    while not done and executor.time_s < 3000.0:
        done = [e for e in executor.advance(executor.time_s + 0.1) if type(e).__name__ == "MissionComplete"]
    assert prediction.feasible
    assert done[0].time_s == pytest.approx(prediction.duration_s, abs=0.2)
    assert executor.motion.energy_j / 3600.0 == pytest.approx(prediction.energy_wh, rel=0.01)
