"""The picture of the paths: by day or vehicle, and where the mind was changed; obstacles on a farm."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from geo import Obstacle, get_farm
from wbf_mission.addons.pictures import path_plot
from wbf_mission.addons.pictures.path_plot import changes_flown, plot_run, rest_of_path
from wbf_mission.addons.pictures.sheets import plot_farm
from wbf_mission.flight import fly
from wbf_mission.replanning.record import DecisionRecord, PathChange
from wbf_mission.scenario import Scenario

OPTIONS = {"farm": "miniberry-10", "vehicle": "ideal", "budget": "20steps", "estimator": "point"}
OPTIONS |= {"planner": "random-waypoint"}


def change(system_id: int, outcome: str, *points: tuple[float, float]) -> PathChange:
    return PathChange(system_id, points[0], np.array(points), 1.0, outcome)


def test_only_what_was_flown_changes_a_path() -> None:
    records = [
        DecisionRecord(1, 1, 0.0, "start", 0, changes=[change(1, "planned", (0, 0), (5, 0))]),
        DecisionRecord(1, 1, 2.0, "period", 2, changes=[change(1, "given up", (2, 0), (2, 9))]),
        DecisionRecord(1, 1, 3.0, "period", 3, changes=[change(1, "flown", (3, 0), (3, 9))]),
        DecisionRecord(1, 2, 0.0, "start", 3, changes=[change(1, "planned", (0, 1), (5, 1))]),
        DecisionRecord(1, 2, 3.0, "period", 3, changes=[change(1, "flown", (1, 1), (3, 1))]),
    ]
    found = [(one.position_m, before[-1].tolist()) for one, before in changes_flown(records)]
    assert found == [((3, 0), [5, 0]), ((1, 1), [5, 1])]


def test_the_rest_of_a_path_begins_where_the_vehicle_is() -> None:
    path = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]])
    assert rest_of_path(path, (4.1, 3.0)).tolist() == [[4.1, 3.0], [4.0, 4.0]]
    assert rest_of_path(path[:1], (9.0, 9.0)).tolist() == [[9.0, 9.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("options", "labels"),
    [
        ({}, {"planned", "flown", "start"}),
        ({"days": 2, "day": 2, "vehicles": 2}, {"day 2", "day 3", "start"}),
        ({"vehicles": 2, "flights_per_day": 2}, {"vehicle 1", "vehicle 2", "start"}),
        ({"days": 9, "day": 1}, {"day 1", "day 9", "start"}),
    ],
)
def test_flights_are_told_apart(
    options: dict[str, int], labels: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    save = path_plot.save_figure
    monkeypatch.setattr(
        path_plot, "save_figure", lambda figure, path: drawn.append(figure) or save(figure, path)
    )
    result = fly(Scenario(**OPTIONS, **options))
    picture = plot_run(result, tmp_path / "path.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
    handles, found = drawn[0].axes[0].get_legend_handles_labels()
    assert set(found) == labels and len(handles) == len(labels)


def test_obstacles_are_in_the_picture_of_a_farm(tmp_path: Path) -> None:
    farm = replace(get_farm("miniberry-10"), obstacles=(Obstacle(shapely.box(1.0, 1.0, 1.6, 1.6)),))
    bare = plot_farm(get_farm("miniberry-10"), tmp_path / "bare.png").read_bytes()
    drawn = plot_farm(farm, tmp_path / "farm.png").read_bytes()
    assert drawn.startswith(b"\x89PNG")
    assert drawn != bare
