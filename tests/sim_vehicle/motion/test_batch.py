import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.batch import VehicleBatch
from sim_vehicle.motion.legs import KEEP, Leg, LegKind, Route
from sim_vehicle.prediction.predict import predict_flight, predict_flights
from sim_vehicle.weather.atmosphere import Turbulence, WindShear
from sim_vehicle.weather.wind import Wind

HOME = LocalFrame(28.05, -82.15)
WINDS = {
    "none": None,
    "steady": Wind(2.0, -1.0),
    "sheared": Wind(3.0, 1.0, shear=WindShear("log")),
    "gusts": Wind(2.0, 0.0, gust_m_s=0.7, seed=4),
    "dryden": Wind(2.0, 1.0, seed=5, turbulence=Turbulence(3.0, 15.0, 8.0)),
}
ROWS = ("state", "counters", "arrivals", "guide", "heads", "curves")


def fleet(name, autopilot, winds):
    spec = with_autopilot(get_vehicle(name), autopilot)
    return [flight_procedures(spec).motion(spec, wind, 0.3) for wind in winds]


def route(rng, legs):
    """A random way: a take-off, corners, one of them with a pause, and a stop."""
    rows = [Leg((0.0, 0.0, 12.0), 5.0, heading=KEEP, kind=LegKind.TAKEOFF)]
    for k in range(legs):
        place = (*rng.uniform(-60.0, 60.0, 2).tolist(), float(rng.uniform(8.0, 20.0)))
        speed, pause = float(rng.uniform(2.0, 7.0)), 1.5 if k == 1 else 0.0
        rows.append(Leg(place, speed, radius_m=1.5, near_m=4.0, pause_s=pause))
    return Route.through(rows)


def assert_same(ones, others):
    for one, other in zip(ones, others, strict=True):
        for name in ROWS:
            a, b = getattr(one, name, None), getattr(other, name, None)
            assert (a is None) == (b is None)
            if a is not None:
                np.testing.assert_array_equal(a, b, err_msg=name)
        assert one.snapshot() == other.snapshot()


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_orders_in_between_and_threads_change_nothing(autopilot):
    winds = [None, WINDS["steady"], WINDS["gusts"]]
    singles, many = fleet("quad", autopilot, winds), fleet("quad", autopilot, winds)
    batch = VehicleBatch(many, parallel=True)
    for group in (singles, many):
        rng = np.random.default_rng(3)
        for vehicle in group:
            vehicle.fly(route(rng, 4))

    def both(steps):
        events = batch.advance(steps, stop_each=False)
        assert events.tolist() == [vehicle.advance(steps, stop_each=False) for vehicle in singles]
        assert_same(singles, many)

    both(900)
    for group in (singles, many):
        group[0].steer((1.0, 2.0, 0.0))
        group[1].look_at((5.0, 5.0))
        group[1].set_climb(1.0, 0.5)
        group[2].update_spec(with_autopilot(get_vehicle("mini-quad"), autopilot))
        group[2].use_energy(100.0)
    both(300)
    for group in (singles, many):
        group[0].fly(Route.through([Leg((3.0, 4.0, 10.0), 3.0)]))
        group[1].touch_down()
        group[1].rest(50, armed=True)
        group[2].ignore_energy()
    both(500)


def test_a_batch_is_of_one_kind():
    quad, wing = fleet("quad", "px4", [None])[0], fleet("wing", "px4", [None])[0]
    for wrong in ([], [quad, wing], [quad, fleet("quad", "ardupilot", [None])[0]]):
        with pytest.raises(VehicleError, match="same kind"):
            VehicleBatch(wrong)
    one, other = fleet("quad", "px4", [None] * 2)
    one.track = np.zeros((3, 3))
    with pytest.raises(VehicleError, match="track"):
        VehicleBatch([one, other])


def test_robots_without_a_kernel_are_moved_one_by_one():
    robots = fleet("ideal", "px4", [None] * 3)
    for k, robot in enumerate(robots):
        robot.fly(Route.through([Leg((3.0 * k, 0.0, 1.0), 1.0)]))
    assert VehicleBatch(robots).advance(1000, stop_each=False).tolist() == [1, 1, 1]
    assert [robot.position_m[0] for robot in robots] == [0.0, 3.0, 6.0]


places = st.lists(st.tuples(st.floats(-80, 80), st.floats(-80, 80)), min_size=1, max_size=6)


@settings(max_examples=12, deadline=None)
@given(
    st.lists(places, min_size=1, max_size=4),
    st.sampled_from(["generic", "px4", "ardupilot"]),
    st.sampled_from(sorted(WINDS)),
)
def test_predictions_together_are_the_predictions_one_by_one(missions, autopilot, wind):
    spec = with_autopilot(get_vehicle("quad"), autopilot)
    plans = []
    for points in missions:
        items = [MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 12.0), MissionItem(178, 2, 1, 5.0, -1)]
        items += [MissionItem.waypoint(*HOME.to_wgs84(x, y), 12.0, hold_s=1.0 * (x > 0)) for x, y in points]
        plans.append(Mission((*items, MissionItem(20, 2)), GeoPoint(28.05, -82.15)))
    # One that cannot be flown at all: too high.
    plans.append(Mission((MissionItem(22, 3, x=28.05, y=-82.15, z=5000.0),), GeoPoint(28.05, -82.15)))
    together = predict_flights(plans, spec, wind=WINDS[wind])
    for plan, found in zip(plans, together, strict=True):
        single = predict_flight(plan, spec, wind=WINDS[wind])
        for name in ("duration_s", "energy_wh", "path_length_m", "reason"):
            assert getattr(found, name) == getattr(single, name), name
        np.testing.assert_array_equal(found.track_m, single.track_m)
    assert not together[-1].feasible
