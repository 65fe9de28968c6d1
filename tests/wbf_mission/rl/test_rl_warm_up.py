"""``wbf-mission warm-up`` compiles what the batched training environment needs, where that is installed."""

import importlib.util
import json
import os

import pytest
from processes import compiled_by

from sim_vehicle.prediction import compile_ahead
from wbf_mission import flight
from wbf_mission.cli import warm_up
from wbf_mission.cli.app import main

COMPILED = """
import json
import numpy as np
from geo.compiled import compile_notices
from wbf_mission.cli.warm_up import _step_batched
from wbf_mission.rl.vector_env import SurveyVectorEnv

first, later = [], []
with compile_notices(first.append):
    _step_batched()
with compile_notices(later.append):
    for scenario in ("WBF/Miniberry-30-v1", "WBF/Miniberry-30-Noisy-v1"):
        envs = SurveyVectorEnv(3, scenario)
        envs.reset(seed=1)
        for action in (1, 2):
            envs.step(np.full(3, action))
print(json.dumps([first, later]))
"""


@pytest.mark.slow
def test_nothing_is_left_to_compile(tmp_path):
    if os.environ.get("NUMBA_DISABLE_JIT"):
        pytest.skip("nothing is compiled")
    first, later = compiled_by(COMPILED, tmp_path)
    assert any("batch_kernel.advance" in one for one in first)
    assert later == []


@pytest.mark.parametrize("installed", [True, False])
def test_it_is_warmed_up_where_it_is_installed(installed, monkeypatch, capsys):
    stepped = []
    monkeypatch.setattr(compile_ahead, "compile_all", lambda _told: None)
    monkeypatch.setattr(flight, "fly", lambda _scenario: None)
    monkeypatch.setattr(warm_up, "_step_batched", lambda: stepped.append(True))
    if not installed:
        monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    assert main(["warm-up", "--json", "--quiet"]) == 0
    assert ("training environments" in json.loads(capsys.readouterr().out)["seconds"]) == installed
    assert stepped == [True] * installed
