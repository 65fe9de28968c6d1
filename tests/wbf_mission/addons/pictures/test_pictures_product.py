"""Pictures beside the results: which there are, and what each is made of."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from sensors.estimation import ScoreHistory
from wbf_mission.addons.pictures import product
from wbf_mission.addons.pictures.product import PICTURES
from wbf_mission.flight import fly
from wbf_mission.results.result import Result
from wbf_mission.scenario import Scenario

FIELDS = ["field_tylcv.png", "field_ccr.png", "field_soil.png"]


@pytest.fixture(scope="module")
def result() -> Result:
    options = {"planner": "random-waypoint", "budget": "20steps", "estimator": "point", "days": 2, "day": 4}
    return fly(Scenario(farm="miniberry-10", vehicle="ideal", **options))


def test_a_run_has_the_pictures_of_its_data(result: Result) -> None:
    assert PICTURES.files(result) == ["path.png", *FIELDS, "score.png"]
    unscored = dataclasses.replace(result, history=ScoreHistory())
    assert PICTURES.files(unscored) == ["path.png", *FIELDS]
    assert PICTURES.files(dataclasses.replace(result, maps=(), true_maps=())) == ["path.png"]


def test_a_sheet_has_its_field_and_the_path_of_the_last_day(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, Any] = {}
    monkeypatch.setattr(
        product, "plot_field", lambda _, estimate, path, **more: drawn.update(more, is_of=estimate)
    )
    for name in FIELDS:
        PICTURES.write(result, tmp_path / name, lambda *_: None)
        assert name == f"field_{drawn['is_of'].field.name}.png" == f"field_{drawn['truth'].field.name}.png"
    track = result.flights[-1].track
    assert (drawn["about"], len(drawn["flown_m"])) == ("miniberry-10, day 5, point", len(track.x_m))
    assert drawn["flown_m"][-1].tolist() == [track.x_m[-1], track.y_m[-1]]
