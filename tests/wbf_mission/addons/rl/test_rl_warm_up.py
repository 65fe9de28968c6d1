"""``wbf-mission warm-up`` compiles what the batched training environment needs, where that is installed."""

import importlib.util
import json

import pytest

from sim_vehicle.prediction import compile_ahead
from wbf_mission import flight
from wbf_mission.addons.rl import vector_env
from wbf_mission.cli.app import main


@pytest.mark.parametrize("installed", [True, False])
def test_it_is_warmed_up_where_it_is_installed(installed, monkeypatch, capsys):
    stepped = []
    monkeypatch.setattr(compile_ahead, "compile_all", lambda _told: None)
    monkeypatch.setattr(flight, "fly", lambda _scenario: None)

    class Stepped:
        def __init__(self, *_given):
            self.reset = self.close = lambda **_given: None

        def step(self, actions):
            stepped.append(len(actions))

    monkeypatch.setattr(vector_env, "SurveyVectorEnv", Stepped)
    if not installed:
        monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    assert main(["warm-up", "--json", "--quiet"]) == 0
    assert ("training environments" in json.loads(capsys.readouterr().out)["seconds"]) == installed
    assert stepped == [2] * installed
