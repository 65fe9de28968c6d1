"""After ``wbf-mission warm-up`` neither flights nor steps of training wait for the compiler."""

import os

import pytest
from processes import compiled_by, copy_compiled

FLIGHTS = """
import json
import numpy as np
from geo.compiled import compile_notices
from wbf_mission import Scenario, fly
from geo.farms import get_farm
from sensors.fields import PAPER_FIELDS
from sensors.scoring.information import InformationModel
from wbf_mission.addons.warmup.command import fly_all
from wbf_mission.events import DayBegun, Estimated, RunBegun
from wbf_mission.addons.rl.vector_env import SurveyVectorEnv
from wbf_mission.addons.rl import vector_env as training
from wbf_mission.addons.web import layers
from wbf_mission.addons.web.view import View

first, later = [], []
with compile_notices(first.append):
    fly_all(lambda what: None)
    layers.warm_up(lambda what: None)
    training.warm_up(lambda what: None)
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
    view, farm = View(longest=30), get_farm("miniberry-100")
    view.take(RunBegun("", farm, PAPER_FIELDS))
    view.take(DayBegun(0.0, 1, np.zeros((3, *farm.grid().shape), np.float32)))
    view.take(Estimated(1.0, 1, 0, InformationModel.unknown(farm.grid().shape, PAPER_FIELDS), None))
    assert len(view.update(None)[0].tiles) > 5
print(json.dumps([first, [one for one in later if not one.startswith("sim_vehicle.")]]))
"""


@pytest.mark.slow
def test_nothing_is_left_to_compile(tmp_path):
    if os.environ.get("NUMBA_DISABLE_JIT"):
        pytest.skip("nothing is compiled")
    # Functions of vehicle motion are left out below, and take long to compile.
    copy_compiled(tmp_path, "sim_vehicle.*")
    first, later = compiled_by(FLIGHTS, tmp_path)
    expected = ("cell_posterior.take_observations", "tile.solve_tiles", "route_search.search_tour")
    for compiled in (*expected, "rl.kernels.advance", "block_means"):
        assert any(compiled in one for one in first), compiled
    assert later == []
