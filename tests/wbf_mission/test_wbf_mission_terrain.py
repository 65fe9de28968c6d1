"""Plans that follow the ground of a raster, from the options to the mission's altitudes."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import from_origin

from geo import get_farm
from geo.errors import GroundError
from geo.farm import Obstacle
from mission.files import read_mission, write_mission
from mission.model import Command, Frame
from wbf_mission.cli.app import main
from wbf_mission.flight import fly
from wbf_mission.planning import MissionBuilder
from wbf_mission.planning.terrain import FarmGround
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, ScenarioError

AROUND_M = 400.0


def raster(path, farm, height_m):
    """Write hills over a farm, in pixels of about 5 m."""
    ends = np.array([-AROUND_M, farm.width_cells * farm.cell_size_m + AROUND_M])
    latitude, longitude = farm.frame.to_wgs84(ends, ends)
    size = 400
    row, column = np.mgrid[:size, :size]
    heights = 80.0 + height_m * np.sin(column / 25.0) * np.cos(row / 18.0)
    pixel = np.ptp(longitude) / size, np.ptp(latitude) / size
    transform = from_origin(longitude.min(), latitude.max(), *pixel)
    with rasterio.open(
        path, "w", "GTiff", size, size, 1, crs="EPSG:4326", transform=transform, dtype="float32"
    ) as out:
        out.write(heights.astype(np.float32), 1)
    return str(path)


def above_ground(farm, mission, ground):
    """Return the heights over the ground along the straight legs between home and the waypoints."""
    waypoints = [one for one in mission.items if one.command == Command.NAV_WAYPOINT]
    xy = np.column_stack(farm.frame.from_wgs84(*np.array([(one.x, one.y) for one in waypoints]).T))
    xy, z = np.vstack((farm.home_m, xy)), np.array([mission.items[0].z, *(one.z for one in waypoints)])
    share = np.linspace(0.0, 1.0, 101)[:, None]
    places = np.vstack([a + share * (b - a) for a, b in itertools.pairwise(xy)])
    heights = np.concatenate([a + share[:, 0] * (b - a) for a, b in itertools.pairwise(z)])
    return heights + ground(np.array([farm.home_m]))[0] - ground(places)


def test_a_plan_keeps_its_height_above_the_ground_and_the_prediction_sees_it(tmp_path):
    farm = get_farm("miniberry-100")
    file = raster(tmp_path / "hills.tif", farm, 6.0)
    options = {"farm": "miniberry-100", "planner": "lawnmower", "budget": "600m"}
    hilly = plan(Scenario(**options, height_above_ground_m=20.0, terrain=(file,)))
    heights = above_ground(farm, hilly.mission, FarmGround.read(farm, farm.home_m, (file,)))
    assert np.abs(heights - 20.0).max() <= 1.0
    flat = plan(Scenario(**options, altitude_m=20.0))
    assert np.array_equal(hilly.path_m, flat.path_m)
    track = hilly.prediction.track_m
    assert np.ptp(track[len(track) // 4 : len(track) // 2, 2]) > 0.2
    assert hilly.prediction.feasible
    written = tmp_path / "hills.plan"
    write_mission(hilly.mission, written)
    assert [one.z for one in read_mission(written).items] == pytest.approx(
        [one.z for one in hilly.mission.items]
    )


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_what_is_flown_follows_the_ground(tmp_path, autopilot):
    """By an exact estimate, while images are taken, after a PX4 has swung over the height of its take-off."""
    farm = get_farm("miniberry-100")
    file = raster(tmp_path / "hills.tif", farm, 6.0)
    options = {"planner": "lawnmower:min_spacing_m=3", "budget": "600m", "estimator": "point"}
    result = fly(
        Scenario(
            farm="miniberry-100",
            **options,
            autopilot=autopilot,
            estimate_errors=False,
            height_above_ground_m=20.0,
            terrain=(file,),
        )
    )
    track, seen = result.flights[0].track, result.observations.time_s
    imaging = (track.time_s >= seen.min() + 10.0) & (track.time_s <= seen.max())
    ground = FarmGround.read(farm, farm.home_m, (file,))
    over = track.altitude_m + ground(np.array([farm.home_m]))[0]
    over = over - ground(np.column_stack((track.x_m, track.y_m)))
    assert np.ptp(track.altitude_m[imaging]) > 1.0
    assert np.abs(over[imaging] - 20.0).max() <= 1.0


def test_an_obstacle_is_flown_over_only_where_the_ground_allows(tmp_path):
    """A shed of 14 m under a flight of 20 m: over flat ground it is passed, on a slope it may be too near."""
    plain = get_farm("waterberry")
    shed = Obstacle(shapely.box(600.0, 600.0, 680.0, 680.0), height_m=14.0, name="shed")
    farm = replace(plain, name="sheds", obstacles=(shed,))
    for height_m, barred in ((0.1, ()), (14.0, (shed,))):
        file = raster(tmp_path / f"{height_m}.tif", plain, height_m)
        options = Scenario(farm="waterberry", height_above_ground_m=20.0, terrain=(file,))
        assert MissionBuilder.of(options, farm).barred == barred
    assert MissionBuilder.of(Scenario(farm="waterberry", altitude_m=20.0), farm).barred == ()


def test_an_autopilot_that_follows_the_terrain_gets_heights_above_it():
    done = plan(Scenario(farm="miniberry-100", budget="600m", height_above_ground_m=20.0, terrain_frame=True))
    waypoints = [one for one in done.mission.items if one.command == Command.NAV_WAYPOINT]
    assert {(one.frame, one.z) for one in waypoints} == {(Frame.GLOBAL_TERRAIN_ALT, 20.0)}
    assert done.prediction.feasible


def test_heights_above_ground_need_a_ground_and_one_vehicle(tmp_path):
    given = {"farm": "miniberry-30", "height_above_ground_m": 20.0}
    with pytest.raises(ScenarioError, match="give either --terrain"):
        Scenario(**given)
    with pytest.raises(ScenarioError, match="give either --terrain"):
        Scenario(**given, terrain=("a.tif",), terrain_frame=True)
    with pytest.raises(ScenarioError, match="plan for one vehicle"):
        from wbf_mission.run.plan import plan_fleet

        plan_fleet(Scenario(**given, terrain_frame=True, vehicles=2))
    with pytest.raises(GroundError, match="cannot be read"):
        plan(Scenario(**given, terrain=(str(tmp_path / "none.tif"),)))


def test_sorties_from_another_ground_height_are_refused(tmp_path, capsys):
    farm = get_farm("miniberry-100")
    ground = FarmGround.read(farm, farm.home_m, (raster(tmp_path / "hills.tif", farm, 6.0),))
    x, y = np.meshgrid(np.arange(-50.0, 150.0), np.arange(-50.0, 150.0))
    places = np.column_stack((x.ravel(), y.ravel()))
    rise_m = ground(places) - ground(np.array([farm.home_m]))
    higher, level = places[rise_m.argmax()], places[np.abs(rise_m - 0.9).argmin()]
    options = ["plan", "--farm", "miniberry-100", "--planner", "lawnmower", "--budget", "300m"]
    options += ["--height-above-ground", "20", "--terrain", str(tmp_path / "hills.tif")]
    for (east, north), code in ((higher, 2), (level, 0)):
        home = ",".join(map(str, farm.frame.to_wgs84(float(east), float(north))))
        out = tmp_path / f"{code}.plan"
        assert main([*options, "--home", home, "--out", str(out)]) == code and out.exists() == (code == 0)
        refused = f"--home {home}: the plan's heights over the terrain count from the mission's home"
        assert (refused in capsys.readouterr().err) == (code == 2)
