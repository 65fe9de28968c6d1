"""The pure steps against the authors' published environments (one value a lattice point)."""

from pathlib import Path

import numpy as np
import pytest

from sensors.dynamics.epidemic import CCR, IMMUNE, NEVER, NO_HOST, TYLCV, status_table, step, value_table
from sensors.dynamics.soil import SoilCourse, SoilParameters, draw_weather

GOLDEN = Path(__file__).parents[2] / "data" / "golden"
DAYS = range(1, 16)
DISEASES = {"tylcv": (TYLCV, 2), "ccr": (CCR, 1)}
FILES = ["env_Miniberry-10_mrem", "env_Miniberry-30_mrem", "env_Miniberry-30_wbf"]
CASES = [(file, disease) for file in FILES for disease in DISEASES]


def authors_start(type_map, crop, parameters, rng, lose_seeds):
    """Day 0 as the authors draw it: seeds on cells without the crop take root (mrem) or are lost (wbf)."""
    status = np.where(type_map == crop, 0, IMMUNE).astype(np.int8)
    width, height = status.shape
    for _ in range(parameters.seed_count((width, height))):
        x, y = rng.integers(0, width - 1), rng.integers(0, height - 1)
        if not (lose_seeds and status[x, y] == IMMUNE):
            status[x, y] = parameters.seed_duration_days
    return status


@pytest.mark.parametrize(("file", "disease"), CASES)
def test_every_day_of_the_authors_epidemics_is_reproduced(file, disease):
    parameters, crop = DISEASES[disease]
    golden = np.load(GOLDEN / f"{file}.npz", allow_pickle=False)
    rng = np.random.default_rng(10)
    status = authors_start(golden["type_map"], crop, parameters, rng, lose_seeds=file.endswith("wbf"))
    rule = parameters.infection_rule(golden["type_map"].shape)
    for day in DAYS:
        status = step(status, rng.random(status.shape), rule)
        np.testing.assert_array_equal(status, golden[f"{disease}_status_{day:02d}"], err_msg=f"day {day}")


@pytest.mark.parametrize(("file", "disease"), CASES)
def test_onset_and_tables_give_the_golden_status_and_value(file, disease):
    parameters, crop = DISEASES[disease]
    golden = np.load(GOLDEN / f"{file}.npz", allow_pickle=False)
    hosts = golden["type_map"] == crop
    onset = np.where(hosts, NEVER, NO_HOST).astype(np.int8)
    rng = np.random.default_rng(10)
    start = authors_start(golden["type_map"], crop, parameters, rng, lose_seeds=file.endswith("wbf"))
    onset[start == parameters.seed_duration_days] = 0
    for day in DAYS:
        onset[golden[f"{disease}_status_{day:02d}"] == parameters.duration_days] = day
    onset[start == parameters.seed_duration_days] = 0
    for day in DAYS:
        status = status_table(parameters, day)[onset.view(np.uint8)]
        np.testing.assert_array_equal(status, golden[f"{disease}_status_{day:02d}"])
    value = value_table(parameters, 6)[onset.view(np.uint8)]
    # The older code gives 0 to cells without the crop; ours and the newer code give 1.
    crop_cells = hosts if file.endswith("mrem") else np.ones_like(hosts)
    np.testing.assert_array_equal(value[crop_cells], golden[disease][crop_cells])


@pytest.mark.parametrize("file", ["env_Miniberry-10_mrem", "env_Miniberry-30_mrem"])
def test_every_day_of_the_authors_soil_is_reproduced(file):
    golden = np.load(GOLDEN / f"{file}.npz", allow_pickle=False)
    shape = golden["type_map"].shape
    parameters = SoilParameters(square_humps=file.startswith("env_Miniberry-10"))
    weather = draw_weather(shape, 15, parameters, np.random.default_rng(1))
    course = SoilCourse(shape, weather, parameters, max(DAYS))
    level = np.empty(shape, np.float32)
    for day in DAYS:
        course.compute(day, level)
        np.testing.assert_allclose(level, golden[f"soil_value_{day:02d}"], rtol=0, atol=2e-6)
    course.compute(6, level)
    np.testing.assert_allclose(level, golden["soil"], rtol=0, atol=2e-6)
