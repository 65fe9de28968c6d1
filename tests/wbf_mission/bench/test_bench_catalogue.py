"""Scenarios with versioned ids."""

from importlib.resources import files

import pytest

from wbf_mission.bench.meaning import meaning_of
from wbf_mission.scenario import (
    Scenario,
    ScenarioError,
    about_scenario,
    load_scenario,
    scenario_ids,
    scenario_with,
)

# A change of what a scenario means needs a new version: add the new one here, and leave the old one as it is.
MEANINGS = {
    "WBF/Field-Bays-v1": "41e6291c858f45704d54aae2",
    "WBF/Field-Bend-v1": "32f8c445579fb93c755211c5",
    "WBF/Field-Islands-v1": "09ffef20f2718379b20c6f25",
    "WBF/Field-Pair-v1": "bd03ffcbf458027f08764b02",
    "WBF/Field-Strip-v1": "07fbf1839a375743217646e8",
    "WBF/Field-Wing-v1": "7cb7fd625322c6a7024e8894",
    "WBF/Miniberry-10-v1": "df31dcc75e4af7c040b65815",
    "WBF/Miniberry-100-ArduCopter-Wind-v1": "7c3bb11771728abf9d3e917f",
    "WBF/Miniberry-100-Mixed-v1": "33fbda4fb1e37953a3124265",
    "WBF/Miniberry-100-PX4-Wind-v1": "e4225f74712c95cd2efc3ec0",
    "WBF/Miniberry-100-Radio-v1": "1672d7ffa34bc05ad808c06a",
    "WBF/Miniberry-100-Robots-1-v1": "811383c8de93200deb05c8e4",
    "WBF/Miniberry-100-Robots-10-v1": "0c8001a0832c0f545ba6377d",
    "WBF/Miniberry-100-Robots-3-v1": "928f50ba71e44d1969b37ae3",
    "WBF/Miniberry-100-v1": "5d8584d547787c98a2b15296",
    "WBF/Miniberry-30-ArduCopter-v1": "df8d8cfea7bbb6b7227281d5",
    "WBF/Miniberry-30-Days-v1": "053e77fcdc594203439bc4dc",
    "WBF/Miniberry-30-Drift-v1": "29e4c46511850ae7fbaae808",
    "WBF/Miniberry-30-Leaves-v1": "d8bc408a831a7879fbf50874",
    "WBF/Miniberry-30-Noisy-v1": "42f7ccb4cc4e1b74a9ef543b",
    "WBF/Miniberry-30-PX4-v1": "adcc93aef630aaf7f8252cb6",
    "WBF/Miniberry-30-Robots-2-v1": "cabd2f172a78e7d8654a8bc7",
    "WBF/Miniberry-30-Robots-3-v1": "91682874fe6331c175f2498f",
    "WBF/Miniberry-30-Robots-5-v1": "b45d68bde475db2afa8d96c5",
    "WBF/Miniberry-30-Sensors-v1": "2339ebebd928b69f662aae5f",
    "WBF/Miniberry-30-Smooth-Long-v1": "797eca0185c6659b0419afd3",
    "WBF/Miniberry-30-Smooth-Short-v1": "58b5588a277baa361321950d",
    "WBF/Miniberry-30-Smooth-v1": "f630222072e6087b22a4a38b",
    "WBF/Miniberry-30-Sweep-v1": "32aa95f094e9b8d9233b7d03",
    "WBF/Miniberry-30-Wide-v1": "f61748dde62d6b7331c9ef59",
    "WBF/Miniberry-30-Wrong-Kernel-v1": "3615815baf148dff7eeca580",
    "WBF/Miniberry-30-Wrong-Rates-v1": "edf8cef5a0f39048f6a53edf",
    "WBF/Miniberry-30-Wrong-Seeds-v1": "e83448230721b70f91540520",
    "WBF/Miniberry-30-Wrong-Soil-v1": "902ce446723a96c08c38e1dd",
    "WBF/Miniberry-30-v1": "6e23ad37c7a93b66db317104",
    "WBF/Waterberry-v1": "5f47b466520c8fb070ff41e6",
}


def test_every_id_means_what_it_always_meant():
    assert {one: meaning_of(load_scenario(one)) for one in scenario_ids()} == MEANINGS


@pytest.mark.parametrize("name", scenario_ids())
def test_a_catalogued_scenario_is_flown_by_an_exact_estimate(name):
    assert not load_scenario(name).vehicle.estimate_errors


@pytest.mark.parametrize("name", scenario_ids())
def test_a_catalogued_scenario_leaves_planner_estimator_and_seed_open(name):
    scenario = load_scenario(name)
    assert scenario.mission.planner == Scenario().mission.planner
    assert (scenario.mission.policy, scenario.estimate.estimator, scenario.seed) == (None, None, 0)
    assert len(about_scenario(name)) > 20


def test_what_changes_a_run_changes_the_meaning_and_nothing_else_does(tmp_path):
    base = load_scenario("WBF/Miniberry-10-v1")
    meaning = meaning_of(base)
    for same in ({"planner": "lawnmower"}, {"policy": "greedy"}, {"estimator": "gp"}, {"seed": 7}):
        assert meaning_of(scenario_with(base, same)) == meaning
    changes = [{"budget": "41steps"}, {"day": 7}, {"camera_noise": 0.1}, {"vehicle": "quad"}]
    changes += [
        {"farm": "miniberry-30"},
        {"fields": ("tylcv",)},
        {"score_points": 10},
        {"wind_speed_m_s": 1.0},
        {"vehicle": "quad", "estimate_errors": True},
    ]
    others = {meaning_of(scenario_with(base, one)) for one in changes}
    assert meaning not in others
    assert len(others) == len(changes)


def test_a_vehicle_file_counts_by_what_is_in_it(tmp_path):
    text = files("sim_vehicle.airframe").joinpath("vehicles/quad.toml").read_text()
    for name in ("one.toml", "two.toml"):
        (tmp_path / name).write_text(text)
    base = load_scenario("WBF/Miniberry-10-v1")

    def meaning(name):
        return meaning_of(scenario_with(base, {"vehicle": str(tmp_path / name)}))

    assert meaning("one.toml") == meaning("two.toml")
    changed = text.replace("cruise_speed_m_s = 8.0", "cruise_speed_m_s = 7.0")
    assert changed != text
    (tmp_path / "two.toml").write_text(changed)
    assert meaning("one.toml") != meaning("two.toml")


def test_an_unknown_id_is_told_with_the_nearest():
    with pytest.raises(
        ScenarioError, match=r"unknown scenario WBF/Miniberry30-v1; is WBF/Miniberry-30-v1 meant"
    ):
        load_scenario("WBF/Miniberry30-v1")
