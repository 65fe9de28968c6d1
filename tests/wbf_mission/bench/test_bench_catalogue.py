"""Scenarios with versioned ids."""

from importlib.resources import files

import pytest

from wbf_mission.bench.digests import meaning_of
from wbf_mission.scenario import Scenario, about_scenario, load_scenario, scenario_ids, scenario_with

# A change of what a scenario means needs a new version: add the new one here, and leave the old one as it is.
MEANINGS = {
    "WBF/Field-Bays-v1": "9d394f66d1e0f8a3cae338c2",
    "WBF/Field-Bend-v1": "3984d304ae3fe355363ea791",
    "WBF/Field-Islands-v1": "22a87737552e40c7b5efb315",
    "WBF/Field-Pair-v1": "239d19110fc145f1952cbff6",
    "WBF/Field-Strip-v1": "b6cdbbc730dc9f0843e4803f",
    "WBF/Field-Wing-v1": "dd672713daebabacc134203f",
    "WBF/Miniberry-10-v1": "046ec5ba895891fd6fdfbc7b",
    "WBF/Miniberry-100-ArduCopter-Wind-v1": "8b61d60356aac35ccb7c15fa",
    "WBF/Miniberry-100-Mixed-v1": "f3fed20199392191eacea181",
    "WBF/Miniberry-100-PX4-Wind-v1": "14cda82aeece5461feb34551",
    "WBF/Miniberry-100-Radio-v1": "b4770e2a435d4cfc7fa81ab1",
    "WBF/Miniberry-100-Robots-1-v1": "3c0121a64f6249e8ccd669eb",
    "WBF/Miniberry-100-Robots-10-v1": "2b054833f0aed2f8eb5f62f1",
    "WBF/Miniberry-100-Robots-3-v1": "e8f4f2ef0e0cdae214c03382",
    "WBF/Miniberry-100-v1": "aa7225899378a7bae25aee60",
    "WBF/Miniberry-30-ArduCopter-v1": "26edef96ba7cdad85c7b7eec",
    "WBF/Miniberry-30-Days-v1": "d59dac2c85112b2af9b1fe20",
    "WBF/Miniberry-30-Drift-v1": "6df1e865ba57978a244b4b2c",
    "WBF/Miniberry-30-Leaves-v1": "c1f9167d7a0223940670f1a7",
    "WBF/Miniberry-30-Noisy-v1": "40e7fdfdf04a45df954a3fba",
    "WBF/Miniberry-30-PX4-v1": "b63e68fe919386bb1c1655ed",
    "WBF/Miniberry-30-Robots-2-v1": "80a872005c41d7a4d0985376",
    "WBF/Miniberry-30-Robots-3-v1": "878f5442bf4cd806ef1c42a8",
    "WBF/Miniberry-30-Robots-5-v1": "810f012cc3971f3a9a62f533",
    "WBF/Miniberry-30-Sensors-v1": "665aaa3b19274aea3dc0edbf",
    "WBF/Miniberry-30-Smooth-Long-v1": "d8d725b6561d7069b1be5511",
    "WBF/Miniberry-30-Smooth-Short-v1": "32d8e94932cd65de73c81f73",
    "WBF/Miniberry-30-Smooth-v1": "cec1a07c19ce454d5a32c540",
    "WBF/Miniberry-30-Sweep-v1": "8ce903ffa59fe41c456108c5",
    "WBF/Miniberry-30-Wide-v1": "c73a9b1221bede237eabbe5a",
    "WBF/Miniberry-30-Wrong-Kernel-v1": "140f30c6937abc87b4ce59fd",
    "WBF/Miniberry-30-Wrong-Rates-v1": "b8c2d19ea7921dbdd91d00ff",
    "WBF/Miniberry-30-Wrong-Seeds-v1": "9402f892acfd8172a5a673cb",
    "WBF/Miniberry-30-Wrong-Soil-v1": "e99a2803d596bb08cdebd015",
    "WBF/Miniberry-30-v1": "a0d956d4460a8814187f0556",
    "WBF/Waterberry-v1": "54b198bf24a43f8f146fe9c0",
}


# Options that no scenario names. A changed value needs new versions of the scenarios, a new option none.
DEFAULTS = {
    "farm": "miniberry-30",
    "day": 6,
    "days": 1,
    "flights_per_day": 1,
    "fields": ("tylcv", "ccr", "soil"),
    "world": None,
    "crop": None,
    "farm_crs": None,
    "repair": False,
    "budget": None,
    "mission": None,
    "partition": "strips",
    "altitude_m": None,
    "height_above_ground_m": None,
    "max_altitude_m": 120.0,
    "terrain": (),
    "terrain_frame": False,
    "cruise_speed_m_s": None,
    "acceptance_radius_m": None,
    "margin_m": 2.0,
    "fence_m": None,
    "vehicle": "quad",
    "vehicles": None,
    "autopilot": "px4",
    "parameters": {},
    "gps_noise_m": 0.0,
    "baro_noise_m": 0.0,
    "estimate_errors": True,
    "separation": "layers:2m",
    "radio_range_m": None,
    "wind_speed_m_s": 0.0,
    "wind_direction_deg": 0.0,
    "wind_gust_m_s": 0.0,
    "wind_height_m": 10.0,
    "wind_shear": None,
    "wind_roughness_m": 0.1,
    "wind_exponent": 0.14285714285714285,
    "turbulence": None,
    "camera_spacing_m": None,
    "camera_footprint": 1,
    "camera_noise": 0.0,
    "false_positive_rate": 0.0,
    "false_negative_rate": 0.0,
    "camera_fields": None,
    "camera_model": None,
    "gsd_cm": None,
    "front_overlap": 0.75,
    "side_overlap": 0.7,
    "camera_orientation": "landscape",
    "score_points": None,
}


def test_defaults_stay():
    now = Scenario().to_dict()
    assert {key: now[key] for key in DEFAULTS} == DEFAULTS


def test_a_new_option_at_its_default_changes_no_meaning(monkeypatch):
    base = load_scenario("WBF/Miniberry-30-PX4-v1")
    kept, to_dict = meaning_of(base), Scenario.to_dict
    monkeypatch.setattr(Scenario, "to_dict", lambda scenario: {**to_dict(scenario), "new": 7.0})
    assert meaning_of(base) == kept
    monkeypatch.setattr(
        Scenario, "to_dict", lambda scenario: {**to_dict(scenario), "new": 8.0 if scenario is base else 7.0}
    )
    assert meaning_of(base) != kept


def test_every_id_means_what_it_always_meant():
    assert {one: meaning_of(load_scenario(one)) for one in scenario_ids()} == MEANINGS


@pytest.mark.parametrize("name", scenario_ids())
def test_a_catalogued_scenario_is_exact_and_leaves_planner_estimator_and_seed_open(name):
    scenario = load_scenario(name)
    assert not scenario.vehicle.estimate_errors
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
