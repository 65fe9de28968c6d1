"""Every scenario of the catalogue is an environment, or says why it is none."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from page_tables import with_tables
from sweeps import slow

from wbf_mission.addons.rl import SurveyVectorEnv, TrainingError, interfaces, parallel_env
from wbf_mission.addons.rl.catalogue import interfaces_of
from wbf_mission.scenario import scenario_ids

# One id for each line of interfaces; the others are slow.
QUICK = {
    f"WBF/Miniberry-{name}-v1" for name in ("10", "30-Days", "30-Wide", "30-Robots-2", "30-PX4", "30-Drift")
}
IDS = [name if name in QUICK else slow(name) for name in scenario_ids()]
SHOWN = {"position", "left", "value", "uncertainty", "seen"}


def test_the_list_has_every_id_of_the_catalogue():
    assert tuple(one.name for one in interfaces()) == scenario_ids()
    assert all(one.name in gymnasium.registry for one in interfaces())
    lines = {one.name: str(one) for one in interfaces()}
    assert lines["WBF/Miniberry-30-v1"] == "WBF/Miniberry-30-v1: make, make_vec, parallel_env"
    assert lines["WBF/Miniberry-30-PX4-v1"] == (
        "WBF/Miniberry-30-PX4-v1: none (quad flies under an autopilot, but"
        ' only "ideal" can be moved cell by cell)'
    )


@pytest.mark.parametrize("name", IDS)
def test_every_id_does_what_the_list_says_of_it(name):
    found = interfaces_of(name)
    made = {
        "single": lambda: gymnasium.make(name),
        "batched": lambda: gymnasium.make_vec(name, num_envs=2),
        "parallel": lambda: parallel_env(name),
    }
    if found.parallel:
        for make in made.values():
            with pytest.raises(TrainingError) as caught:
                make()
            assert str(caught.value) == f"{name}: {found.parallel}"
        return
    robots = made["parallel"]()
    shown, infos = robots.reset(seed=3)
    shown, rewards, *_ = robots.step(dict.fromkeys(robots.agents, 1))
    assert len(rewards) == len(infos) == robots.task.robots
    for agent, one in shown.items():
        assert robots.observation_space(agent).contains(one)
        assert one["seen"].any()
    robots.close()
    if found.single:
        with pytest.raises(TrainingError) as caught:
            made["single"]()
        assert str(caught.value) == found.single
        return
    env = made["single"]()
    shown, info = env.reset(seed=3)
    assert info == {"environment": 3}
    assert shown.keys() == SHOWN
    shown, reward, ended, truncated, _ = env.step(1)
    assert env.observation_space.contains(shown)
    assert reward == rewards["robot_1"]
    assert not ended
    assert not truncated
    env.close()
    if not name.startswith("WBF/Waterberry"):
        envs = made["batched"]()
        assert isinstance(envs.unwrapped, SyncVectorEnv if found.batched else SurveyVectorEnv)
        envs.reset(seed=3)
        assert envs.step(np.array([1, 1]))[1][0] == reward
        envs.close()


def test_the_page_tells_what_the_list_tells(request):
    page = (request.config.rootpath / "docs" / "training.md").read_text(encoding="utf-8")
    told = [line for line in with_tables(page).splitlines() if line.startswith("WBF/")]
    assert told == [str(one) for one in interfaces()]
