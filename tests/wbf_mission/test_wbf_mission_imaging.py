"""A camera by its sensor and lens in a plan."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from geo import Farm, LocalFrame, Patch, get_farm, save_farm
from mission.model import Command
from sensors.camera.optics import Imaging, get_camera
from sensors.errors import CameraError
from wbf_mission import fly
from wbf_mission.cli.app import main
from wbf_mission.planning.imaging import shown_share
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, ScenarioError

SURVEY = {
    "farm": "waterberry",
    "planner": "survey:angle=0",
    "budget": "unlimited",
    "camera_model": "sentera-6x",
}


def test_height_speed_and_images_follow_from_the_camera() -> None:
    done = plan(Scenario(**SURVEY, gsd_cm=5.0, side_overlap=0.4, front_overlap=0.8))
    assert done.camera is not None
    height = get_camera("sentera-6x").height_m(0.05)
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


def test_a_slow_camera_slows_the_flight_and_refuses_what_is_asked() -> None:
    slow = {**SURVEY, "farm": "miniberry-100", "camera_model": "dji-mavic-3m-ms", "altitude_m": 30.0}
    slow["front_overlap"] = 0.8
    done = plan(Scenario(**slow))
    assert done.camera is not None
    assert done.camera["speed_m_s"] == pytest.approx(done.camera["interval_speed_m_s"])
    assert done.camera["speed_m_s"] < 3.0
    with pytest.raises(ScenarioError, match=r"cruise speed 5 m/s: at 30\.0 m camera dji-mavic-3m-ms takes"):
        plan(Scenario(**slow, cruise_speed_m_s=5.0))


def test_gsd_and_altitude_may_agree_but_not_contradict_each_other() -> None:
    height = get_camera("sentera-6x").height_m(0.05)
    with pytest.raises(ScenarioError, match=r"this gsd at 115\.9 m, not at the altitude of 50 m \(2.16 cm\)"):
        plan(Scenario(**SURVEY, gsd_cm=5.0, altitude_m=50.0))
    with pytest.raises(ScenarioError, match=r"but flights are 2 to 120 m high"):
        plan(Scenario(**SURVEY, gsd_cm=9.0))
    with pytest.raises(ScenarioError, match="front overlap sets the distance"):
        Scenario(camera_model="sentera-6x", camera_spacing_m=3.0)
    small = {**SURVEY, "farm": "miniberry-100"}
    assert plan(Scenario(**small, gsd_cm=5.0, altitude_m=round(height, 1))).camera is not None


def test_simulated_flights_have_the_leaf_camera(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ScenarioError, match="a run flies with the leaf camera"):
        fly(Scenario(farm="miniberry-10", camera_model="sentera-6x"))
    assert main(["plan", "--farm", "miniberry-10", "--gsd", "3"]) == 2
    assert "--gsd has an effect only with --camera" in capsys.readouterr().err


def test_images_are_rectangles_along_the_course() -> None:
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


def test_the_plan_tells_its_camera(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--farm", "miniberry-100", "--planner", "survey"]
    given += ["--camera", "parrot-sequoia", "--altitude", "10"]
    assert main(["plan", *given, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["camera"]["gsd_cm"] == pytest.approx(0.9375)
    assert told["coverage"] > 0.99
    assert main(["plan", *given]) == 0
    printed = capsys.readouterr().out
    assert "parrot-sequoia: 0.94 cm a pixel at 10.0 m" in printed
    assert "2.8 m/s (sharp images up to 9.4 m/s, no gaps up to 2.8 m/s)" in printed


def test_a_strip_along_a_creek_is_surveyed_within_its_border(tmp_path: Path) -> None:
    """The ways between rows turn at its bends; straight ones would leave it, which a plan refuses."""
    at = np.linspace(0.0, 1.0, 40)
    strip = shapely.LineString(np.column_stack((10 + 300 * at, 60 + 40 * np.sin(6 * at)))).buffer(
        5.0, quad_segs=4
    )
    patches = (Patch("bank", "grass", "me", strip),)
    creek = Farm("creek", LocalFrame(48.7, 9.2), 320, 120, patches, "me", (10.0, 60.0), 1.0)
    save_farm(creek, tmp_path / "creek.geojson")
    made = plan(
        Scenario(
            farm=str(tmp_path / "creek.geojson"),
            planner="survey:angle=0",
            camera_model="dji-mavic-3m-rgb",
            altitude_m=20.0,
            budget="unlimited",
        )
    )
    assert made.coverage > 0.95


def test_a_mapping_camera_needs_a_height_and_one_image_shows_something() -> None:
    with pytest.raises(ScenarioError, match=r"camera dji-p1-35: give the ground sampling distance \(--gsd"):
        plan(Scenario(planner="survey", camera_model="dji-p1-35", budget="unlimited"))
    with pytest.raises(CameraError, match="unknown camera 'dji-p1'"):
        plan(Scenario(planner="survey", camera_model="dji-p1", budget="unlimited"))
    farm = get_farm("miniberry-30")
    imaging = Imaging(get_camera("dji-p1-35"), 50.0, 0.75, 0.7, False)
    assert shown_share(farm, np.array([(4.5, 4.5)]), imaging) == 1.0
    assert shown_share(farm, np.empty((0, 2)), imaging) == 0.0
