"""After ``wbf-mission warm-up`` neither flights nor steps of training wait for the compiler."""

import os

import pytest
from processes import compiled_by

FLIGHTS = """
import json
import numpy as np
from geo.compiled import compile_notices
from wbf_mission import Scenario, fly
from wbf_mission.cli.warm_up import _step_batched, fly_all
from wbf_mission.rl.vector_env import SurveyVectorEnv

first, later = [], []
with compile_notices(first.append):
    fly_all(lambda what: None)
    _step_batched()
with compile_notices(later.append):
    fly(Scenario(farm="miniberry-30", policy="greedy", estimator="epidemic", budget="1min"))
    fly(Scenario(farm="miniberry-30", policy="rolling-horizon", estimator="gp", vehicle="ideal"))
    fly(Scenario(farm="miniberry-30", policy="orienteering", vehicles=2, vehicle="ideal"))
    fly(Scenario(farm="miniberry-30", planner="spiral", estimator="adaptive-disk", vehicle="ideal", seed=1))
    larger = {"farm": "miniberry-100", "budget": "6000steps"}
    fly(Scenario(**larger, planner="lawnmower", estimator="gp", vehicle="ideal"))
    for scenario in ("WBF/Miniberry-30-v1", "WBF/Miniberry-30-Noisy-v1"):
        envs = SurveyVectorEnv(3, scenario)
        envs.reset(seed=1)
        for action in (1, 2):
            envs.step(np.full(3, action))
print(json.dumps([first, [one for one in later if not one.startswith("sim_vehicle.")]]))
"""


@pytest.mark.slow
def test_nothing_is_left_to_compile(tmp_path):
    if os.environ.get("NUMBA_DISABLE_JIT"):
        pytest.skip("nothing is compiled")
    first, later = compiled_by(FLIGHTS, tmp_path)
    expected = ("cell_posterior.take_observations", "tile.solve_tiles", "tour_search.search_tour")
    for compiled in (*expected, "batch_kernel.advance"):
        assert any(compiled in one for one in first), compiled
    assert later == []
