"""Missions longer than a battery: cut into sorties, each home with its reserve, and gone on with."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
from command_line import run

from geo import Obstacle, get_farm, save_farm
from mission.course import Course, Place
from mission.files import read_mission, write_mission
from mission.model import GeoPoint, Mission, MissionItem
from mission.outcome import Outcome
from sim_vehicle.prediction.predict import predict_flight
from wbf_mission import Scenario, Simulated, fly, load_result
from wbf_mission.addons.operate.resume import resume_place
from wbf_mission.cli.app import main
from wbf_mission.events import EventStream
from wbf_mission.planning.coverage import image_places
from wbf_mission.planning.sorties import SortieCosts, UncutError, sorties_of
from wbf_mission.preflight.run import check_plans
from wbf_mission.run.plan import plan

FARM = "miniberry-100"


def scenario(small, **more):
    return Scenario(**{"farm": FARM, "planner": "lawnmower", "budget": "1200m", "vehicle": small, **more})


def cut(one, **how):
    return sorties_of(plan(one), one, **how)


@pytest.fixture(scope="module")
def calm(small):
    return cut(scenario(small))


def test_each_sortie_is_within_a_battery_and_they_are_few(small, calm):
    usable = 0.8 * 12.0
    assert len(calm.sorties) >= 3
    for one in calm.sorties:
        assert one.plan.prediction.feasible and one.plan.prediction.most_wh <= usable
        assert one.plan.batteries == 1
    # One less would not do even if nothing were lost by cutting.
    assert (len(calm.sorties) - 1) * usable < sum(one.plan.prediction.most_wh for one in calm.sorties)
    ends = [one.end for one in calm.sorties]
    assert ends[-1] is None and [one.begin for one in calm.sorties[1:]] == ends[:-1]
    assert calm.total_s == pytest.approx(calm.flight_s + 180.0 * (len(calm.sorties) - 1))


def farthest_from(places, others):
    return max(float(np.min(np.hypot(*(others - place).T))) for place in places)


def on_land(places, farm):
    """Leave out where a vehicle swings beyond the border, as wide as it was fast before."""
    size = farm.cell_size_m * np.array([farm.width_cells, farm.height_cells])
    return places[((places > 0.0) & (places < size)).all(axis=1)]


def test_every_place_of_an_image_is_seen_by_a_sortie(small):
    made = cut(scenario(small, budget="600m"))
    farm, assumed = made.whole.farm, {"endless": True, "track_step_s": 0.1}
    planned, *parts = (
        image_places(farm, one.mission, predict_flight(one.mission, one.vehicle, **assumed))
        for one in (made.whole, *made.plans)
    )
    assert len(parts) > 1
    assert farthest_from(on_land(planned, farm), np.vstack(parts)) < 0.4 * made.whole.spacing_m


def test_gusts_and_a_wind_are_counted(small):
    windy = scenario(small, wind_speed_m_s=4.0, turbulence="light", autopilot="ardupilot", budget="700m")
    made = cut(windy)
    assert all(one.plan.prediction.most_wh <= 0.8 * 12.0 for one in made.sorties)
    assert any(one.plan.prediction.most_wh > one.plan.prediction.energy_wh for one in made.sorties)


def brute_force(costs, most):
    """Return the best of all cuts."""
    count = len(costs.places)
    seconds = np.where(costs.watt_hours <= most, costs.seconds + costs.midst, np.inf).min(axis=0)
    for sorties in range(1, count):
        best = min(
            sum(seconds[a, b] for a, b in itertools.pairwise((0, *inner, count - 1)))
            for inner in itertools.combinations(range(1, count - 1), sorties - 1)
        )
        if np.isfinite(best):
            return sorties, best
    return None


@pytest.mark.parametrize("seed", range(20))
def test_no_other_cuts_are_cheaper(seed):
    draw = np.random.default_rng(seed)
    count, homes = 8, 2
    way = np.cumsum(draw.uniform(1.0, 3.0, count))
    out, back = draw.uniform(0.5, 4.0, (2, homes, count))
    seconds = out[:, :, None] + (way[None, :] - way[:, None])[None] + back[:, None, :]
    places = (*(Place(k) for k in range(count - 1)), None)
    costs = SortieCosts(places, 0.5 * seconds, seconds, draw.random(count) < 0.5)
    most = draw.uniform(6.0, 14.0)
    found, expected = costs.cheapest(most, np.ones(count)), brute_force(costs, most)
    if expected is None:
        assert found is None
        return
    assert len(found.homes) == expected[0]
    taken = sum(
        costs.seconds[home, a, b] + costs.midst[b]
        for home, (a, b) in zip(found.homes, itertools.pairwise(found.ends), strict=True)
    )
    assert taken == pytest.approx(expected[1])
    # What is charged more is flown in more sorties, or not at all.
    dearer = costs.cheapest(most, np.full(count, 1.3))
    assert dearer is None or len(dearer.homes) >= len(found.homes)


@pytest.mark.slow
def test_from_several_homes_each_sortie_is_flown_from_the_cheapest(small):
    one = scenario(small, budget="1000m")
    whole = plan(one)
    farm = whole.farm
    width, height = farm.width_cells * farm.cell_size_m, farm.height_cells * farm.cell_size_m
    corners = [(0.0, 0.0), (width, height), (10.0 * width, 0.0)]
    homes = [GeoPoint(*map(float, farm.frame.to_wgs84(*corner)), farm.frame.altitude_m) for corner in corners]
    single, many = sorties_of(whole, one), sorties_of(whole, one, homes=homes)
    used = [homes.index(part.mission.home) for part in many.plans]
    assert set(used) == {0, 1}
    assert many.flight_s < single.flight_s
    assert all(part.prediction.most_wh <= 0.8 * 12.0 for part in many.plans)


def test_nothing_is_cut_that_no_battery_is_enough_for(small, calm):
    one, whole = scenario(small), calm.whole
    far = replace(
        whole.mission,
        items=(
            *whole.mission.items[:-2],
            MissionItem.waypoint(28.2, -82.15, 10.0),
            *whole.mission.items[-2:],
        ),
    )
    with pytest.raises(UncutError, match=r"no sorties: to fly 17\.67 km from the take-off place"):
        sorties_of(replace(whole, mission=far), one)
    ideal = scenario("ideal", budget="300steps")
    with pytest.raises(UncutError, match="vehicle ideal has no battery"):
        sorties_of(plan(ideal), ideal)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--vehicle", "quad", "--home", "28.5,-82.1"], "--home 28.5,-82.1: no sorties: to fly 51"),
        (["--vehicle", "ideal", "--resume", "3"], "--resume 3: vehicle ideal has no battery"),
    ],
)
def test_another_start_that_cannot_be_flown_is_an_error(tmp_path, capsys, options, reason):
    rows, out = tmp_path / "rows.plan", tmp_path / "new.plan"
    assert main(["plan", "--farm", "miniberry-10", "--budget", "2min", "--out", str(rows)]) == 0
    farm = ["--farm", "miniberry-10", "--mission", str(rows)]
    assert main(["plan", *farm, *options, "--out", str(out)]) == 2
    assert reason in capsys.readouterr().err
    assert not out.exists()


def test_a_mission_that_cannot_be_cut_says_why(small, tmp_path, capsys):
    far = tmp_path / "far.plan"
    items = (
        MissionItem(22, 3, z=10.0),
        MissionItem.waypoint(28.06, -82.15, 10.0),
        MissionItem.waypoint(28.061, -82.15, 10.0),
        MissionItem(20, 2),
    )
    write_mission(Mission(items, home=GeoPoint(28.038, -82.15, 30.0)), far)
    out = tmp_path / "out.plan"
    farm = ["--farm", "miniberry-10", "--vehicle", str(small)]
    assert main(["plan", *farm, "--mission", str(far), "--out", str(out)]) == 2
    assert "warning: no sorties: to fly " in capsys.readouterr().err
    assert not out.exists()


def test_a_mission_without_a_return_is_cut(small, tmp_path, capsys):
    ends = [(28.05 + 1e-4 * k, -82.15 + 2e-3 * ((k + side) % 2)) for k in range(5) for side in (0, 1)]
    first, *others = [MissionItem.waypoint(*end, 10.0) for end in ends]
    items = (MissionItem(22, 3, z=10.0), first, MissionItem(206, param1=2.0), *others)
    file, out = tmp_path / "rows.waypoints", tmp_path / "out.waypoints"
    write_mission(Mission(items, home=GeoPoint(28.05, -82.15, 30.0)), file)
    farm = ["--farm", FARM, "--mission", str(file), "--vehicle", small]
    code, said, _ = run(capsys, "plan", *farm, "--out", str(out), "--json")
    assert code == 0 and len(json.loads(said)["sorties"]) == 3
    made = [read_mission(path).items for path in sorted(tmp_path.glob("out*"))]
    assert [part[-1].command for part in made] == [20, 20, 16]


def test_obstacles_are_flown_round_on_the_ways(small, tmp_path):
    farm = get_farm(FARM)
    barn = Obstacle(shapely.box(8.0, 8.0, 14.0, 14.0))
    file = tmp_path / "barn.geojson"
    save_farm(replace(farm, name="barn", obstacles=(barn,)), file)
    one = scenario(small, farm=str(file), budget="1200m")
    made = cut(one)
    assert len(made.sorties) > 1
    check_plans([(part, one) for part in made.plans], "nothing", EventStream())
    # Straight from home some of the parts would have been flown to over it.
    home_m = np.asarray(farm.home_m)
    begins = [farm.frame.from_wgs84(*made.course.position(part.begin)[:2]) for part in made.sorties]
    assert any(shapely.LineString([home_m, begin]).intersects(barn.polygon) for begin in begins)


PLAN = ("plan", "--farm", FARM, "--planner", "lawnmower", "--budget", "1200m", "--vehicle")


def test_the_command_writes_a_file_for_each_sortie(small, tmp_path, capsys):
    out = tmp_path / "rows.plan"
    code, said, _ = run(capsys, *PLAN, small, "--out", str(out), "--json", "--change-time", "60")
    values = json.loads(said)
    files = sorted(tmp_path.glob("*.plan"))
    assert code == 0 and not out.exists()
    assert [one["file"] for one in values["sorties"]] == [str(file) for file in files]
    assert values["batteries"] == len(files) and values["feasible"] and values["file"] is None
    assert values["predicted_time_s"] == pytest.approx(
        sum(one["predicted_time_s"] for one in values["sorties"])
    )
    assert values["time_with_changes_s"] == pytest.approx(
        values["predicted_time_s"] + 60.0 * (len(files) - 1)
    )
    for file, one in zip(files, values["sorties"], strict=True):
        mission = read_mission(file)
        assert len(mission.items) == one["items"] and mission.items[0].command == 22
        # Each is a mission within a battery, for the check before the flight, too.
        checked, told, _ = run(capsys, "preflight", str(file), "--farm", FARM, "--vehicle", small, "--json")
        assert checked == 0 and '"battery"' not in told
    assert not any("no waypoint lies on the farm" in text for text in values["warnings"])


def test_the_whole_is_written_when_that_is_wanted(small, tmp_path, capsys):
    out = tmp_path / "rows.plan"
    code, _, said = run(capsys, *PLAN, small, "--out", str(out), "--whole")
    assert code == 2 and "it needs 3 batteries" in said and "sorties" in said and not out.exists()
    code, _, said = run(capsys, *PLAN, small, "--out", str(out), "--whole", "--force")
    assert code == 0 and out.exists() and "the vehicle cannot fly this mission" in said


def test_it_is_gone_on_with_at_an_item(small, tmp_path, capsys):
    whole = tmp_path / "whole.plan"
    run(capsys, *PLAN, small, "--out", str(whole), "--whole", "--force")
    mission = read_mission(whole)
    course = Course(mission)
    number = max(k for k in range(len(course.legs)) if course.lengths_m[k] > 10.0)
    item = course.legs[number].item
    rest = tmp_path / "rest.plan"
    plan_file = ("plan", "--farm", FARM, "--mission", str(whole), "--vehicle", small)
    where = f"{item + 1}+2m"
    code, _, _ = run(capsys, *plan_file, "--resume", where, "--overlap", "1", "--out", str(rest))
    left = read_mission(rest)
    assert code == 0 and len(left.items) < 12 and len(list(tmp_path.glob("rest*"))) == 1
    assert left.items[-3:] == mission.items[-3:]
    place = Course(mission).frame.from_wgs84(left.items[2].x, left.items[2].y)
    begin = Course(mission).frame.from_wgs84(*course.legs[number].begin[:2])
    assert np.hypot(place[0] - begin[0], place[1] - begin[1]) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--resume", "12"), "give the mission file with --mission"),
        (("--whole", "--overlap", "3"), "leave out --overlap"),
        (("--overlap", "-1"), "out of range"),
        (("--home", "28.05"), "give latitude and longitude"),
        (("--home", "100,200"), "give latitude and longitude"),
    ],
)
def test_what_makes_no_sense_is_told_in_a_line(small, tmp_path, capsys, options, text):
    code, _, said = run(capsys, *PLAN, small, *options, "--out", str(tmp_path / "rows.plan"))
    assert code == 2 and text in said and said.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("where", "text"),
    [
        ("99999", "give 1 to"),
        ("4+900m", "m long; give fewer metres"),
        ("nothing.tlog", "there is no such file"),
        (".", "has no flight.tlog"),
        ("", "has no flight.tlog"),
    ],
)
def test_places_that_are_not_on_the_mission_are_refused(small, calm, tmp_path, capsys, where, text):
    whole = tmp_path / "whole.plan"
    write_mission(calm.whole.mission, whole)
    where = str(tmp_path) if where == "." else where
    code, _, said = run(
        capsys, "plan", "--farm", FARM, "--mission", str(whole), "--vehicle", small, "--resume", where
    )
    assert code == 2 and text in said and said.count("\n") == 1


@pytest.mark.slow
def test_every_sortie_comes_home_with_its_reserve_in_gusts(small):
    windy = {"wind_speed_m_s": 3.0, "turbulence": "light", "seed": 1}
    result = fly(scenario(small, **windy, estimator="adaptive-disk", gps_noise_m=0.3))
    assert len(result.flights) >= 3 and result.outcome is Outcome.COMPLETED
    assert all(0.3 < one.battery_used < 0.8 for one in result.flights)
    # Each flight has gusts of its own.
    assert len({round(one.flight_time_s / one.plan.prediction.duration_s, 4) for one in result.flights}) > 1


@pytest.mark.slow
def test_a_mission_in_sorties_is_flown_as_one_run(small, calm, tmp_path):
    one = scenario(small, estimator="adaptive-disk")
    result = fly(one, by=Simulated(change_s=100.0, tlog=tmp_path / "flight.tlog"))
    sorties = len(calm.sorties)
    assert [flight.flight for flight in result.flights] == list(range(1, sorties + 1))
    missions = [one.mission for one in calm.plans]
    assert [flight.plan.mission for flight in result.flights] == missions
    assert len(result.days) == 1 and result.predicted_time_s == pytest.approx(calm.flight_s)
    seen = result.summary()
    assert seen["coverage"] == pytest.approx(seen["predicted_coverage"], abs=0.03)
    # The change of batteries is time that passes.
    without = fly(one, by=Simulated(change_s=0.0))
    assert result.simulated_s - without.simulated_s == pytest.approx(100.0 * (sorties - 1))
    result.save(tmp_path / "run", plots=False)
    loaded = load_result(tmp_path / "run")
    assert [flight.plan.mission for flight in loaded.flights] == missions


def test_a_flight_that_was_broken_off_is_gone_on_with_where_it_was(small, tmp_path, capsys):
    """What was flown by force until the battery sent it home, and the rest, show every place of an image."""
    one = scenario(small, estimator="adaptive-disk", budget="800m", estimate_errors=False)
    whole, log = plan(one), tmp_path / "flight.tlog"
    broken = fly(one, by=Simulated(force=True, tlog=log))
    assert len(broken.flights) == 1 and broken.outcome is not Outcome.COMPLETED
    course = Course(whole.mission)
    place = resume_place(str(log), course)
    assert place.fraction > 0.0 and 0.2 * course.length_m < course.metres(place) < 0.8 * course.length_m
    assert resume_place(str(tmp_path), course) == place
    file = tmp_path / "whole.plan"
    write_mission(whole.mission, file)
    arguments = ("--farm", FARM, "--mission", str(file), "--vehicle", small, "--resume", str(log))
    code, said, _ = run(capsys, "plan", *arguments, "--out", str(tmp_path / "rest.plan"), "--json")
    rest = json.loads(said)["sorties"]
    assert code == 0 and rest[0]["begin"]["at_m"] == pytest.approx(course.metres(place))
    broken.save(tmp_path / "run", plots=False)
    (tmp_path / "run" / "flight.tlog").write_bytes(log.read_bytes())
    code, said, _ = run(capsys, "plan", "--resume", str(tmp_path / "run"), "--json")
    assert code == 0 and json.loads(said)["sorties"][0]["begin"] == rest[0]["begin"]
    (tmp_path / "run" / "result.json").write_text('{"scenario": {"farms": 1}}')
    code, _, said = run(capsys, "plan", "--resume", str(tmp_path / "run"))
    assert code == 2 and "result.json: unknown key 'farms'" in said
    farm = whole.farm
    planned = predict_flight(whole.mission, whole.vehicle, endless=True, track_step_s=0.1)
    seen = [broken.observations]
    for part in rest:
        given = {"mission": part["file"], "estimate_errors": False}
        result = fly(Scenario(farm=FARM, vehicle=small, estimator="adaptive-disk", **given))
        assert result.outcome is Outcome.COMPLETED
        seen.append(result.observations)
    cells = np.vstack([np.column_stack((one.x, one.y)) for one in seen])
    centres = (np.unique(cells, axis=0) + 0.5) * farm.cell_size_m
    places = image_places(farm, whole.mission, planned)
    assert farthest_from(on_land(places, farm), centres) < 0.5 * whole.spacing_m
