"""A camera by its sensor and lens in a plan."""

import numpy as np
import pytest

from geo import get_farm
from mission.model import Command
from sensors.camera.optics import Imaging, get_camera
from sensors.errors import CameraError
from wbf_mission import fly
from wbf_mission.cli.app import main
from wbf_mission.planning.imaging import shown_share
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, ScenarioError

SURVEY = {
    "farm": "miniberry-100",
    "planner": "survey:angle=0",
    "budget": "unlimited",
    "camera_model": "sentera-6x",
}


def test_height_speed_and_images_follow_from_the_camera():
    done = plan(Scenario(**SURVEY, gsd_cm=0.5, side_overlap=0.4, front_overlap=0.8))
    assert done.camera is not None
    height = get_camera("sentera-6x").height_m(0.005)
    assert done.mission.items[0].z == pytest.approx(height)
    (trigger,) = [
        one for one in done.mission.items if one.command == Command.DO_SET_CAM_TRIGG_DIST and one.param1
    ]
    assert trigger.param1 == pytest.approx(0.2 * done.camera["footprint_along_m"])
    rows = np.unique(np.round(done.path_m[:, 1], 3))
    assert np.diff(rows).max() <= done.camera["row_spacing_m"] + 0.01
    assert done.coverage > 0.99
    assert done.camera["images"] > 0.9 * done.length_m / trigger.param1 - 50
    assert "camera" in done.summary()


def test_a_slow_camera_slows_the_flight_and_refuses_what_is_asked():
    slow = {**SURVEY, "camera_model": "dji-mavic-3m-ms", "altitude_m": 30.0}
    slow["front_overlap"] = 0.8
    done = plan(Scenario(**slow))
    assert done.camera is not None
    assert done.camera["speed_m_s"] == pytest.approx(done.camera["interval_speed_m_s"])
    assert done.camera["speed_m_s"] < 3.0
    with pytest.raises(ScenarioError, match=r"cruise speed 5 m/s: at 30\.0 m camera dji-mavic-3m-ms takes"):
        plan(Scenario(**slow, cruise_speed_m_s=5.0))


def test_gsd_and_altitude_may_agree_but_not_contradict_each_other():
    height = get_camera("sentera-6x").height_m(0.05)
    with pytest.raises(ScenarioError, match=r"this gsd at 115\.9 m, not at the altitude of 50 m \(2.16 cm\)"):
        plan(Scenario(**SURVEY, gsd_cm=5.0, altitude_m=50.0))
    with pytest.raises(ScenarioError, match=r"but flights are 2 to 120 m high"):
        plan(Scenario(**SURVEY, gsd_cm=9.0))
    with pytest.raises(ScenarioError, match="front overlap sets the distance"):
        Scenario(camera_model="sentera-6x", camera_spacing_m=3.0)
    assert plan(Scenario(**SURVEY, gsd_cm=5.0, altitude_m=round(height, 1))).camera is not None


def test_simulated_flights_have_the_leaf_camera(capsys):
    with pytest.raises(ScenarioError, match="a run flies with the leaf camera"):
        fly(Scenario(farm="miniberry-10", camera_model="sentera-6x"))
    assert main(["plan", "--farm", "miniberry-10", "--gsd", "3"]) == 2
    assert "--gsd has an effect only with --camera" in capsys.readouterr().err


def test_images_are_rectangles_along_the_course():
    """One pass along x through the middle of a square farm shows a strip as wide as the image."""
    farm = get_farm("miniberry-100")
    side = farm.width_cells * farm.cell_size_m
    over = Imaging(get_camera("sentera-6x"), 10.0, 0.5, 0.5)
    along = np.arange(-5.0, side + 5.0, 1.0)
    passes = np.column_stack((along, np.full_like(along, 0.5 * side)))
    wanted = farm.scouted_cells
    inside = np.abs((np.arange(wanted.shape[1]) + 0.5) * farm.cell_size_m - 0.5 * side) < 0.5 * over.across_m
    assert shown_share(farm, passes, over) == pytest.approx(wanted[:, inside].sum() / wanted.sum())
    assert shown_share(farm, passes[:1], over) == 0.0


def test_a_mapping_camera_needs_a_height_and_one_image_shows_something():
    with pytest.raises(ScenarioError, match=r"camera dji-p1-35: give the ground sampling distance \(--gsd"):
        plan(Scenario(planner="survey", camera_model="dji-p1-35", budget="unlimited"))
    with pytest.raises(CameraError, match="unknown camera 'dji-p1'"):
        plan(Scenario(planner="survey", camera_model="dji-p1", budget="unlimited"))
    farm = get_farm("miniberry-30")
    imaging = Imaging(get_camera("dji-p1-35"), 50.0, 0.75, 0.7, False)
    assert shown_share(farm, np.array([(4.5, 4.5)]), imaging) == 1.0
    assert shown_share(farm, np.empty((0, 2)), imaging) == 0.0
