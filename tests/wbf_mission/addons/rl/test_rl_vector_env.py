"""The batched environment is the single one to the bit."""

import copy
import pickle

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from sensors.estimators.adaptive_disk import AdaptiveDiskEstimator
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from wbf_mission.addons.rl import SurveyEnv, SurveyVectorEnv, TrainingError
from wbf_mission.addons.rl.batch import Batch
from wbf_mission.addons.rl.task import SurveyTask


def assert_same(one, other):
    if isinstance(one, tuple):
        for ours, theirs in zip(one, other, strict=True):
            assert_same(ours, theirs)
    elif isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    else:
        assert np.array_equal(np.asarray(one), np.asarray(other)), (one, other)


@pytest.mark.parametrize(
    ("name", "moves", "mode"),
    [
        ("WBF/Miniberry-10-v1", 90, AutoresetMode.NEXT_STEP),
        ("WBF/Miniberry-10-v1", 90, AutoresetMode.SAME_STEP),
        ("WBF/Miniberry-30-Sweep-v1", 120, AutoresetMode.NEXT_STEP),
        ("WBF/Miniberry-30-Noisy-v1", 120, AutoresetMode.NEXT_STEP),
        ("WBF/Miniberry-100-v1", 120, AutoresetMode.NEXT_STEP),
    ],
)
def test_all_that_gymnasiums_own_vector_environment_gives_is_the_same(name, moves, mode):
    number = 3
    batched = SurveyVectorEnv(number, name, autoreset_mode=mode)
    single = SyncVectorEnv([lambda: SurveyEnv(name)] * number, autoreset_mode=mode)
    assert batched.observation_space == single.observation_space
    assert batched.action_space == single.action_space
    assert_same(batched.reset(seed=7), single.reset(seed=7))
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(moves):
        # Rather on than back, so that much of the farm is seen.
        actions = rng.choice(5, size=number, p=[0.04, 0.3, 0.3, 0.18, 0.18])
        ours, theirs = batched.step(actions), single.step(actions)
        assert_same(ours[:4], theirs[:4])
        assert ours[4].keys() == theirs[4].keys()
        for key in ours[4]:
            if key == "final_obs":
                for one, other in zip(ours[4][key], theirs[4][key], strict=True):
                    assert_same(one, other) if one is not None else None
            else:
                assert_same(ours[4][key], theirs[4][key])
        ended += int(ours[2].sum())
    assert bool(ended) is (moves != 120)


@pytest.mark.kernel
@sweep(few=8, many=50)
@given(
    actions=st.lists(st.integers(0, 4), min_size=39, max_size=39),
    seed=st.integers(0, 2**40),
    name=st.sampled_from(["WBF/Miniberry-10-v1"]),
)
def test_any_walk_has_the_map_and_the_losses_of_the_estimator_and_the_score(actions, seed, name):
    task = SurveyTask(name)
    batch = Batch(task, 2)
    batch.begin(1, seed)
    truth = task.environment(seed).values(6)
    estimator = AdaptiveDiskEstimator().fit(task.grid)
    score = RunningScore(truth, task.fields.masks(task.grid))
    assert batch.loss_before[1] == score.evaluate(estimator.predict()).loss
    for number, action in enumerate(actions):
        homes = [batch.cells[1].copy()] if number == 0 else []
        batch.move(np.array([1]), np.array([0, action]))
        for x, y in [*homes, batch.cells[1]]:
            seen = Observations([x], [y], [0.0], [6], truth[:, x, y][None])
            score.add(estimator.partial_fit(seen).predict())
        model = estimator.predict()
        assert np.array_equal(batch.maps[1, :3], model.value)
        assert np.array_equal(batch.maps[1, 3:6], model.uncertainty)
        assert batch.losses[1, : number + 2].tolist() == score.losses
    assert batch.score(1) == score.score
    assert batch.counts.tolist() == [0, 40]


@pytest.mark.kernel
def test_seeds_of_each_run_and_runs_that_begin_anew_alone():
    envs = SurveyVectorEnv(3, "WBF/Miniberry-10-v1", autoreset_mode="Disabled")
    first, info = envs.reset(seed=[4, None, 4])
    assert info["environment"][0] == info["environment"][2] == 4
    for _ in range(39):
        shown, _, ended, _, _ = envs.step(np.array([1, 2, 2]))
    assert ended.all()
    with pytest.raises(TrainingError, match="call reset"):
        envs.step(np.zeros(3, int))
    again, info = envs.reset(options={"reset_mask": np.array([True, False, False])})
    assert info["_environment"].tolist() == [True, False, False]
    assert not again["seen"][0].any()
    assert np.array_equal(again["seen"][1], shown["seen"][1])
    assert np.array_equal(first["value"][0], first["value"][2])


@pytest.mark.kernel
def test_observations_stay_as_they_are_unless_that_is_not_wanted():
    kept, shared = (SurveyVectorEnv(2, "WBF/Miniberry-10-v1", copy=copy) for copy in (True, False))
    for envs, same in ((kept, False), (shared, True)):
        first, _ = envs.reset(seed=0)
        second, *_ = envs.step(np.array([1, 1]))
        assert np.shares_memory(first["seen"], second["seen"]) is same
        assert bool(first["seen"].any()) is same


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"num_envs": 0}, "give one or more"),
        ({"estimator": "gp"}, "is not batched"),
        ({"estimator": "adaptive-disk:radius=3"}, "is not batched"),
        ({"scenario": "WBF/Miniberry-30-Wide-v1"}, 'vectorization_mode="sync"'),
    ],
)
def test_what_cannot_be_batched_is_refused_in_one_line(options, text):
    with pytest.raises(TrainingError, match=text) as caught:
        SurveyVectorEnv(**options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda envs: pickle.loads(pickle.dumps(envs))])
def test_a_copy_goes_on_by_itself(again):
    envs = SurveyVectorEnv(2, "WBF/Miniberry-10-v1", copy=False)
    envs.reset(seed=1)
    envs.step(np.array([1, 2]))
    other = again(envs)
    assert_same(other.step(np.array([1, 1]))[:4], envs.step(np.array([1, 1]))[:4])
    ahead, *_ = other.step(np.array([1, 1]))
    assert ahead["seen"].sum() == envs._observation()["seen"].sum() + 2
    assert other.action_masks().tolist() == [[True, True, True, True, False], [True] * 5]


@pytest.mark.parametrize(
    "actions", [[0, 5], [0], [[0, 0]], [-1, 0], [1.0, 2.0], [np.nan, 0], [True, False], ["1", "2"], 1]
)
def test_wrong_actions_are_refused(actions):
    envs = SurveyVectorEnv(2, "WBF/Miniberry-10-v1")
    envs.reset(seed=0)
    for wrong in (actions, np.array(actions)):
        with pytest.raises(TrainingError, match=r"give a whole number from 0 .* to each of 2 runs"):
            envs.step(wrong)
    assert envs._batch.counts.tolist() == [0, 0]
    with pytest.raises(TrainingError, match="3 seeds"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(TrainingError, match=r"seed 1.5: give a whole number, or one for each environment"):
        envs.reset(seed=1.5)
    assert envs.reset(seed=np.array([4, 9]))[1]["environment"].tolist() == [4, 9]
