"""An agent flies in a benchmark what it does in its training environment."""

from itertools import pairwise

import numpy as np
import pytest
from trained_agent import MOVES, Network, TrainedAgent, View, draws

from wbf_mission import fly, load_scenario, scenario_with
from wbf_mission.addons.rl import SurveyEnv


@pytest.fixture
def network(tmp_path):
    rng = np.random.default_rng(5)
    sizes = [View.size, 16, len(MOVES)]
    arrays = {}
    for number, (inputs, outputs) in enumerate(pairwise(sizes)):
        arrays[f"weight_{number}"] = rng.standard_normal((outputs, inputs)).astype(np.float32)
        arrays[f"bias_{number}"] = rng.standard_normal(outputs).astype(np.float32)
    np.savez(tmp_path / "agent.npz", **arrays)
    return tmp_path / "agent.npz"


@pytest.mark.parametrize(("estimator", "draw"), [("adaptive-disk", True), ("gp", False)])
def test_a_network_has_the_same_score_in_both(network, estimator, draw):
    name = "WBF/Miniberry-10-v1"
    env = SurveyEnv(name, estimator)
    view, preferred = View(env.task.farm, env.task.fields, env.task.allowed), Network(network)
    shown, _ = env.reset(seed=2)
    ended, cells, rng = False, set(), draws(2)
    while not ended:
        cell = np.floor(shown["position"] * np.array(env.task.grid.shape)).astype(int)[None]
        cells.add(tuple(cell[0].tolist()))
        maps = (shown[key][None] for key in ("value", "uncertainty", "seen"))
        numbers = view(*maps, cell, shown["left"][1:])
        wanted = np.where(view.possible(cell), preferred(numbers), -np.inf)
        wanted += rng.gumbel(size=len(MOVES)) if draw else 0.0
        assert (view.possible(cell)[0] == env.action_masks()[1:]).all()
        shown, _, ended, _, info = env.step(1 + np.argmax(wanted))
    flown = fly(
        scenario_with(load_scenario(name), {"seed": 2, "estimator": estimator}),
        policy=TrainedAgent(str(network), draw),
    )
    assert len(cells) > 2
    assert flown.score == info["score"]
    assert flown.final_score == info["final_score"]
