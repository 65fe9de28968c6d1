"""``wbf-mission warm-up`` compiles what the batched training environment needs, where that is installed."""

import importlib.util
import json

import pytest

from sim_vehicle.prediction import compile_ahead
from wbf_mission import flight
from wbf_mission.cli import warm_up
from wbf_mission.cli.app import main


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
