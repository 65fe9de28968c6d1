"""Training environments mean what the scenarios of the catalogue mean."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import env_checker
from pettingzoo.test import parallel_api_test, parallel_seed_test
from sweeps import slow

from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event
from mission.policies.policy import NEVER_AGAIN
from tests.support.ideal_robot import ideal_positions
from wbf_mission import Scenario, fly, load_scenario, scenario_with
from wbf_mission.addons.rl import SurveyEnv, TrainingError, parallel_env
from wbf_mission.addons.rl.episode import Episode
from wbf_mission.addons.rl.task import MOVES, SurveyTask


class Paths:
    """Flies given paths, one for each vehicle."""

    triggers = NEVER_AGAIN

    def __init__(self, paths):
        self.paths = paths

    def start(self):
        pass

    def decide(self, observation):
        if observation.event is not Event.START:
            return NO_CHANGE
        return Decision(
            {one.system_id: path for one, path in zip(observation.vehicles, self.paths, strict=True)}
        )


def walk(task, rng):
    """Moves that never stay, and the cells that they lead to: one more, which is flown but not seen."""
    actions, cells = [], []
    here = np.array(task.home)
    while len(actions) < task.steps:
        action = int(rng.integers(1, 5))
        there = here + MOVES[action]
        if (there >= 0).all() and (there < task.grid.shape).all() and task.allowed[tuple(there)]:
            here = there
            actions.append(action)
            cells.append(there)
    return actions[:-1], np.array(cells)


def flown(scenario, cells, seed=3, estimator="adaptive-disk"):
    size = 0.3048
    paths = [(one + 0.5) * size for one in cells]
    return fly(
        scenario_with(
            scenario_with(scenario, {"seed": seed}), {"policy": Paths(paths), "estimator": estimator}
        )
    )


@pytest.mark.parametrize(
    ("name", "estimator"),
    [
        ("WBF/Miniberry-10-v1", "adaptive-disk"),
        ("WBF/Miniberry-10-v1", "gp"),
        ("WBF/Miniberry-30-Noisy-v1", "adaptive-disk"),
        ("WBF/Miniberry-30-Wide-v1", "adaptive-disk"),
        slow("WBF/Miniberry-30-Days-v1", "adaptive-disk"),
    ],
)
def test_a_path_has_the_score_of_its_run_to_the_bit(name, estimator):
    env = SurveyEnv(name, estimator)
    actions, cells = walk(env.task, np.random.default_rng(1))
    run = flown(load_scenario(name), [cells], estimator=estimator)
    observation, _ = env.reset(seed=3)
    rewards, info = [], {}
    for action in actions * len(env.task.flights):
        observation, reward, ended, truncated, info = env.step(action)
        rewards.append(reward)
        assert not truncated
        assert env.observation_space.contains(observation)
        if env.task.flights == ((6, 1),):
            assert ended == (len(rewards) == len(actions))
    assert ended
    assert info["score"] == run.score
    assert info["final_score"] == run.final_score
    assert sum(rewards) == pytest.approx(info["loss_before"] + info["score"], abs=1e-12)
    assert np.array_equal(observation["value"], np.clip(run.model.value, 0.0, 1.0))
    with pytest.raises(TrainingError, match="call reset"):
        env.step(0)


@pytest.mark.parametrize("robots", [2, slow(5)])
def test_paths_of_several_robots_have_the_score_of_their_run_to_the_bit(robots):
    name = f"WBF/Miniberry-30-Robots-{robots}-v1"
    env = parallel_env(name)
    rng = np.random.default_rng(2)
    walks = [walk(env.task, rng) for _ in range(robots)]
    run = flown(load_scenario(name), [cells for _, cells in walks])
    observations, _ = env.reset(seed=3)
    total = 0.0
    for number in range(env.task.steps - 1):
        moves = {agent: one[number] for agent, (one, _) in zip(env.agents, walks, strict=True)}
        observations, rewards, ended, _, infos = env.step(moves)
        assert len(set(rewards.values())) == 1
        total += rewards["robot_1"]
    assert all(ended.values())
    assert not env.agents
    for agent, info in infos.items():
        assert info["score"] == run.score
        assert total == pytest.approx(info["loss_before"] + info["score"], abs=1e-12)
        assert np.array_equal(observations[agent]["value"], run.model.value)
        assert env.observation_space(agent).contains(observations[agent])


def test_staying_is_what_the_papers_robot_does_at_a_waypoint_where_it_is():
    task = SurveyTask("WBF/Miniberry-10-v1")
    episode = Episode(task, 0)
    actions = np.random.default_rng(4).integers(0, 5, task.steps - 1)
    cells = [np.array(task.home)]
    for action in actions:
        there = cells[-1] + MOVES[action]
        inside = (there >= 0).all() and (there < 10).all()
        cells.append(there if inside else cells[-1])
        episode.move([int(action)])
    points = np.array(cells[1:]) + 0.5
    expected = ideal_positions(points, len(points), start=(0.5, 0.5), repeat=False)
    assert np.array_equal(np.floor(expected[-1]), episode.cells[0])
    assert episode.ended
    assert len(episode._estimate.history.entries) == task.steps


@pytest.mark.parametrize("name", ["WBF/Miniberry-10-v1", "WBF/Miniberry-30-v1"])
def test_gymnasiums_own_checks_pass_without_a_warning(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env_checker.check_env(gymnasium.make(name).unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    "action", [5, -1, 1.0, np.float32(2), float("nan"), True, None, "east", [1], np.array([1]), [[1], [1, 2]]]
)
def test_an_action_that_is_none_is_refused_in_one_line_and_moves_nobody(action):
    env, robots = SurveyEnv("WBF/Miniberry-10-v1"), parallel_env("WBF/Miniberry-30-Robots-2-v1")
    env.reset(seed=0)
    robots.reset(seed=0)
    for step in (lambda: env.step(action), lambda: robots.step({"robot_1": 1, "robot_2": action})):
        with pytest.raises(TrainingError, match="give a whole number from 0") as caught:
            step()
        assert "\n" not in str(caught.value)
    assert env._episode.moved == robots._episode.moved == 0


def test_robots_that_are_none_are_refused():
    robots = parallel_env("WBF/Miniberry-30-Robots-2-v1")
    robots.reset(seed=0)
    with pytest.raises(TrainingError, match="there is no agent robot_3; the agents are robot_1, robot_2"):
        robots.step({"robot_1": 1, "robot_3": 1})
    robots.step({"robot_1": 1})
    assert robots._episode.cells.tolist() == [[1, 0], [0, 0]]


def test_masks_tell_which_moves_are_stays():
    env, robots = SurveyEnv("WBF/Miniberry-10-v1"), parallel_env("WBF/Miniberry-30-Robots-2-v1")
    for one in (env, robots):
        with pytest.raises(TrainingError, match="call reset"):
            one.action_masks()
        one.reset(seed=0)
    assert env.action_masks().tolist() == [True, True, True, False, False]
    rng = np.random.default_rng(0)
    for action in rng.integers(0, 5, 38):
        mask, before = env.action_masks(), env._episode.cells[0].copy()
        env.step(action)
        assert mask[action] == (action == 0 or (env._episode.cells[0] != before).any())
    robots.step({"robot_1": 1, "robot_2": 2})
    masks = robots.action_masks()
    assert masks["robot_1"].tolist() == [True, True, True, True, False]
    assert masks["robot_2"].tolist() == [True, True, True, False, True]


def test_pettingzoos_own_checks_pass():
    name = "WBF/Miniberry-30-Robots-3-v1"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(parallel_env(name), num_cycles=150)
        parallel_seed_test(lambda: parallel_env(name), num_cycles=60)


def test_seeds_are_those_of_benchmarks_and_drawn_ones_are_none_of_them():
    env = SurveyEnv("WBF/Miniberry-10-v1")
    _, info = env.reset(seed=5)
    assert info == {"environment": 5}
    drawn = [env.reset()[1]["environment"] for _ in range(3)]
    assert min(drawn) >= 2**32
    assert len(set(drawn)) == 3
    env.reset(seed=5)
    assert [env.reset()[1]["environment"] for _ in range(3)] == drawn


def test_maps_of_large_farms_are_in_blocks():
    env = SurveyEnv("WBF/Miniberry-100-v1")
    assert env.shown.block == 2
    observation, _ = env.reset(seed=0)
    for _ in range(3):
        observation, *_ = env.step(1)
    assert observation["value"].shape == (3, 50, 50)
    assert observation["seen"][:3, 0].tolist() == [0.5, 0.5, 0.0]
    value = env._episode.model().value
    assert np.allclose(observation["value"], value.reshape(3, 50, 2, 50, 2).mean(axis=(2, 4)))


@pytest.mark.parametrize(
    ("scenario", "options", "text"),
    [
        ("WBF/Miniberry-30-PX4-v1", {}, 'only "ideal" can be moved cell by cell'),
        ("WBF/Miniberry-30-Robots-2-v1", {}, "wbf_mission.addons.rl.parallel_env"),
        (Scenario(farm="miniberry-10", vehicle="ideal", budget="20m"), {}, "give two steps or more"),
        ("WBF/Miniberry-10-v1", {"block": 0}, "from 1 to 10"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(scenario, options, text):
    with pytest.raises(TrainingError, match=text) as caught:
        SurveyEnv(scenario, **options)
    assert "\n" not in str(caught.value)
