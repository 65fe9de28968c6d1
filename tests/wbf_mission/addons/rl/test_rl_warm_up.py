"""``wbf-mission warm-up`` compiles what the batched training environment needs, where that is installed."""

import json
import sys

import pytest

from wbf_mission import flight
from wbf_mission.addons.base import simulator
from wbf_mission.addons.rl import vector_env
from wbf_mission.cli.app import main


@pytest.fixture
def stepped(monkeypatch):
    steps = []
    monkeypatch.setattr(simulator, "compile_all", lambda _told: None)
    monkeypatch.setattr(flight, "fly", lambda _scenario: None)

    class Stepped:
        def __init__(self, *_given):
            self.reset = self.close = lambda **_given: None

        def step(self, actions):
            steps.append(len(actions))

    monkeypatch.setattr(vector_env, "SurveyVectorEnv", Stepped)
    return steps


def warmed_up(capsys):
    assert main(["warm-up", "--json", "--quiet"]) == 0
    return json.loads(capsys.readouterr().out)["seconds"]


def test_it_is_warmed_up_where_it_is_installed(stepped, capsys):
    assert "training environments" in warmed_up(capsys)
    assert stepped == [2]


def test_nothing_is_wrong_where_its_libraries_are_not_installed(stepped, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith("wbf_mission.addons.rl")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    assert "training environments" not in warmed_up(capsys)
    assert stepped == []
