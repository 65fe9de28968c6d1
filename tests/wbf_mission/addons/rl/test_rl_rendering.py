"""What is drawn of a run, and where it goes."""

import copy
import pickle
import sys
import warnings
from importlib.util import find_spec

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import env_checker
from gymnasium.vector import SyncVectorEnv

from wbf_mission.addons.rl import SurveyEnv, SurveyVectorEnv, TrainingError, parallel_env
from wbf_mission.addons.rl.rendering import Drawing, Scene
from wbf_mission.addons.rl.task import SurveyTask

NEEDS_PYGAME = pytest.mark.skipif(find_spec("pygame") is None, reason="pygame is not installed")
NAME = "WBF/Miniberry-10-v1"
SIDE = 30  # Pixels of a cell of Miniberry-10


def scene(**changes):
    shape = (3, 10, 10)
    plain = Scene(
        truth=np.ones(shape, np.float32),
        value=np.ones(shape, np.float32),
        uncertainty=np.zeros(shape, np.float32),
        paths=[np.array([[0, 0]])],
        flight=(6, 1),
        left=(1.0, 1.0),
        score=float("nan"),
    )
    return plain._replace(**changes)


def changed(drawing, one, other):
    """Return in which cells of which panels two scenes differ: panel, x, y."""
    rows, columns = np.nonzero((drawing.frame(one) != drawing.frame(other)).any(axis=2))
    found = set()
    for panel, (top, left) in enumerate(drawing._corners):
        inside = (rows >= top) & (rows < top + 300) & (columns >= left) & (columns < left + 300)
        x, y = (columns[inside] - left) // SIDE, 9 - (rows[inside] - top) // SIDE
        found |= {(panel, *cell) for cell in zip(x.tolist(), y.tolist(), strict=True)}
    return found


@pytest.fixture(scope="module")
def drawing():
    return Drawing(SurveyTask(NAME))


@pytest.mark.parametrize(("panel", "name"), list(enumerate(["truth", "value", "uncertainty"])))
def test_a_cell_of_a_map_is_drawn_in_its_panel_east_to_the_right_and_north_up(drawing, panel, name):
    maps = getattr(scene(), name).copy()
    maps[0, 7, 8] = 0.5  # The first field is of tomatoes, which grow in the north
    maps[0, 7, 2] = 0.5
    assert changed(drawing, scene(), scene(**{name: maps})) == {(panel, 7, 8)}


def test_only_the_field_that_is_asked_for_is_drawn():
    soil = Drawing(SurveyTask(NAME), "soil")
    maps = scene().value.copy()
    maps[0, 7, 8] = 0.0
    assert not changed(soil, scene(), scene(value=maps))
    maps[2, 7, 2] = 0.0
    assert changed(soil, scene(), scene(value=maps)) == {(1, 7, 2)}
    with pytest.raises(TrainingError, match="render_field 'rust': give one of tylcv, ccr, soil"):
        Drawing(SurveyTask(NAME), "rust")


def test_what_is_left_is_a_bar_that_becomes_shorter(drawing):
    full, half = (drawing.frame(scene(left=(part, part))) for part in (1.0, 0.5))
    columns = np.flatnonzero((full[50] != half[50]).any(axis=1))
    assert columns.min() == pytest.approx(drawing.shape[1] / 2, abs=2)
    assert columns.max() == drawing.shape[1] - 13


@pytest.mark.parametrize("name", [NAME, "WBF/Miniberry-30-Days-v1"])
def test_frames_are_as_gymnasium_wants_them(name):
    env = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(1)
    second = env.render()
    assert first.dtype == np.uint8
    assert first.shape == second.shape
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert not any(side % 2 for side in first.shape[:2])
    assert first.flags.writeable
    assert (first != second).any()
    assert env.metadata["render_fps"] > 0


def test_the_batched_environment_draws_what_single_ones_draw():
    batched = SurveyVectorEnv(2, NAME, render_mode="rgb_array")
    single = SyncVectorEnv([lambda: SurveyEnv(NAME, render_mode="rgb_array")] * 2)
    for envs in (batched, single):
        envs.reset(seed=4)
    for actions in ([1, 2], [1, 2], [2, 2], [2, 3]):
        for ours, theirs in zip(batched.render(), single.render(), strict=True):
            assert np.array_equal(ours, theirs)
        for envs in (batched, single):
            envs.step(np.array(actions))
    frames = [*batched.render(), *single.render()]
    assert np.array_equal(frames[0], frames[2])
    assert np.array_equal(frames[1], frames[3])
    assert (frames[0] != frames[1]).any()


def test_gymnasiums_checks_of_rendering_pass_without_a_warning(monkeypatch):
    monkeypatch.setattr(SurveyEnv, "metadata", SurveyEnv.metadata | {"render_modes": ["rgb_array"]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(NAME, render_mode="rgb_array")
        env_checker.check_env(env.unwrapped)


@NEEDS_PYGAME
def test_a_window_shows_the_frame_of_every_step_and_closes(monkeypatch):
    import pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env, other = (SurveyEnv(NAME, render_mode=mode) for mode in ("human", "rgb_array"))
    for one in (env, other):
        one.reset(seed=2)
        one.step(1)
    assert env.render() is None
    screen = pygame.surfarray.array3d(pygame.display.get_surface())
    assert np.array_equal(screen.swapaxes(0, 1), other.render())
    env.close()
    env.close()
    assert not pygame.display.get_init()


@NEEDS_PYGAME
def test_without_a_window_one_line_says_what_to_do(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pygame", None)
        with pytest.raises(TrainingError, match='render_mode="human" needs pygame: install with pip'):
            SurveyEnv(NAME, render_mode="human").reset()
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    with pytest.raises(TrainingError, match='render_mode="human" cannot open a window: '):
        SurveyEnv(NAME, render_mode="human").reset()


@pytest.mark.parametrize("make", [SurveyEnv, parallel_env, lambda **how: SurveyVectorEnv(1, NAME, **how)])
def test_an_unknown_mode_is_refused_in_one_line(make):
    with pytest.raises(TrainingError, match=r"render_mode 'ansi': give .*rgb_array"):
        make(render_mode="ansi")


def test_before_a_run_there_is_nothing_to_draw_and_without_a_mode_gymnasium_warns():
    env = SurveyEnv(NAME)
    with pytest.raises(TrainingError, match="call reset"):
        env.render()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match='make the environment with render_mode="rgb_array"'):
        assert env.render() is None


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_of_an_environment_goes_on_by_itself_and_draws_the_same(again):
    env = SurveyEnv(NAME, render_mode="rgb_array")
    env.reset(seed=3)
    for action in (1, 2, 2):
        env.step(action)
    other = again(env)
    assert np.array_equal(env.render(), other.render())
    ours, theirs = env.step(1), other.step(1)
    assert ours[1] == theirs[1]
    assert np.array_equal(ours[0]["value"], theirs[0]["value"])
    other.step(2)
    assert env._episode.moved == 4
    assert other._episode.moved == 5
