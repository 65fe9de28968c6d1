"""Scenarios and their files."""

from pathlib import Path

import pytest

from wbf_mission.scenario import Scenario, ScenarioError, load_scenario, scenario_with

REPOSITORY = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("day", -1),
        ("seed", -1),
        ("altitude_m", 0.0),
        ("altitude_m", float("nan")),
        ("cruise_speed_m_s", -3.0),
        ("wind_speed_m_s", 41.0),
        ("wind_direction_deg", 361.0),
        ("camera_footprint", 0),
        ("camera_noise", -0.1),
        ("false_positive_rate", 1.5),
        ("score_points", 0),
        ("camera_spacing_m", float("inf")),
    ],
)
def test_out_of_range_values_are_named(field: str, value: float) -> None:
    with pytest.raises(ScenarioError, match=field.split("_m")[0].replace("_", " ").split(" deg")[0]):
        Scenario(**{field: value})


def test_changes_leave_out_what_was_not_given() -> None:
    base = Scenario(planner="lawnmower", seed=3)
    changed = scenario_with(base, {"planner": None, "seed": 0})
    assert changed.mission.planner.name == "lawnmower"
    assert changed.seed == 0


@pytest.mark.parametrize("path", sorted((REPOSITORY / "missions").glob("*.toml")), ids=lambda path: path.stem)
def test_the_ready_scenarios_load(path: Path) -> None:
    assert isinstance(load_scenario(path), Scenario)


def test_a_farm_beside_the_scenario_is_found(tmp_path: Path) -> None:
    (tmp_path / "mine.geojson").write_text("{}")
    (tmp_path / "run.toml").write_text('farm = "mine.geojson"\nbudget = "10min"\n')
    assert load_scenario(tmp_path / "run.toml").farm.name == str(tmp_path / "mine.geojson")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('planer = "spiral"\n', "unknown key 'planer'"),
        ('seed = "one"\n', "seed"),
        ("seed = -4\n", "seed -4 is out of range"),
        ("= nonsense\n", "not TOML"),
    ],
)
def test_bad_files_are_one_line_with_their_name(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    assert str(path) in str(caught.value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_text(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="not UTF-8"):
        load_scenario(path)
    with pytest.raises(ScenarioError, match="No such file"):
        load_scenario(tmp_path / "absent.toml")
