"""Moving pictures of runs: what each frame shows, and that the estimates are made again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sensors.environment import Environment
from sensors.estimators import make_estimator
from wbf_mission.addons.animation import animation
from wbf_mission.addons.animation.animation import AnimationError, moments
from wbf_mission.cli.app import main
from wbf_mission.flight import fly
from wbf_mission.results.result import Result, load_result
from wbf_mission.results.writing import ResultFolder
from wbf_mission.scenario import Scenario


@pytest.fixture(scope="module")
def result() -> Result:
    options = {"planner": "random-waypoint", "budget": "20steps", "estimator": "adaptive-disk", "seed": 2}
    return fly(Scenario(farm="miniberry-10", vehicle="ideal", vehicles=2, day=4, days=2, **options))


def test_frames_cover_all_flights_and_know_what_was_known(result: Result) -> None:
    shown = moments(result, 12)
    assert [one.day for one in shown] == [4] * 6 + [5] * 6
    seen = [one.seen for one in shown]
    assert seen == sorted(seen) and seen[0] <= 2 and seen[-1] == len(result.observations)
    assert shown[5].seen == result.flights[2].seen_before == np.count_nonzero(result.observations.day == 4)
    for one in shown[1:5]:
        part = result.observations[: one.seen]
        assert part.time_s.max() <= one.time_s < result.observations.time_s[one.seen]


def test_a_gif_has_the_frames_and_the_last_estimate_is_the_run_s(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = []
    show = animation._Sheet.show

    def noted(self, moment, truth, value, uncertainty):  # type: ignore[no-untyped-def]
        shown.append((moment, truth, value, uncertainty))
        show(self, moment, truth, value, uncertainty)

    monkeypatch.setattr(animation._Sheet, "show", noted)
    path = result.animate(tmp_path / "run.gif", frames=8)
    with Image.open(path) as picture:
        assert picture.n_frames == 8
        first = picture.convert("RGB")
        picture.seek(7)
        last = picture.convert("RGB")
    assert first.size == last.size and np.any(np.asarray(first) != np.asarray(last))
    assert len(shown) == 8
    assert result.model is not None and result.truth is not None
    _, truth, value, _ = shown[-1]
    for k, field in enumerate(result.fields):
        mask = field.mask(result.farm.grid())
        np.testing.assert_allclose(value[k][mask], result.model.value[k][mask], atol=1e-6)
        np.testing.assert_allclose(truth[k][mask], result.truth[k][mask], atol=1e-6)
        assert np.isnan(value[k][~mask]).all()


@pytest.mark.parametrize(
    ("name", "frames", "why"),
    [
        ("run.avi", 10, r"run\.avi: an animation must be a \.gif or \.mp4 file"),
        ("run.gif", 301, "301 frames; give 2 to 300"),
    ],
)
def test_what_cannot_be_written_is_told(
    result: Result, tmp_path: Path, name: str, frames: int, why: str
) -> None:
    with pytest.raises(AnimationError, match=why):
        result.animate(tmp_path / name, frames=frames)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_fly_animates_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "fly --farm miniberry-10 --vehicle ideal --estimator point --budget 20steps"
    options = [*words.split(), "--planner", "random-waypoint", "-q"]
    assert main([*options, "--animate", "--no-files"]) == 2
    assert "--animate writes a file, but --no-files forbids files" in capsys.readouterr().err
    assert main([*options, "--animate", "--no-plots", "--out", str(tmp_path / "run")]) == 0
    with Image.open(tmp_path / "run" / "run.gif") as picture:
        assert 2 <= picture.n_frames <= 300


def test_a_truth_that_was_let_go_is_read_again_in_strips(
    result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    estimator, shown = make_estimator("point"), moments(result, 8)
    whole = [
        truth for _, (truth, _, _) in animation._estimates(result, estimator.fit(result.farm.grid()), shown)
    ]
    lean = replace(
        result, truth=None, model=None, days=tuple(replace(one, truth=None) for one in result.days)
    )
    widths = []
    window = Environment.window

    def noted(self: Environment, day: int, x: slice, y: slice) -> np.ndarray:
        widths.append(x.stop - x.start)
        return window(self, day, x, y)

    monkeypatch.setattr(Environment, "window", noted)
    monkeypatch.setattr(animation, "_STRIP_CELLS", 4)
    again = [
        truth for _, (truth, _, _) in animation._estimates(lean, estimator.fit(result.farm.grid()), shown)
    ]
    assert widths == [4, 4, 2] * 2
    for one, other in zip(whole, again, strict=True):
        np.testing.assert_array_equal(one, other)


def test_truth_and_estimate_leave_the_result_before_the_animation_if_wanted(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = []

    def noted(record: Result, path: Path, **_: object) -> None:
        held.append((record.truth, record.model))
        path.touch()

    monkeypatch.setattr(animation, "animate", noted)
    for release in (False, True):
        given = replace(result)
        with ResultFolder(tmp_path / f"run{release}") as folder:
            folder.write(given, products=["run.gif"], release=release)
        loaded = load_result(tmp_path / f"run{release}")
        assert loaded.truth is not None and loaded.model is not None
        np.testing.assert_array_equal(loaded.truth, result.truth)
    assert held == [(result.truth, result.model), (None, None)]
