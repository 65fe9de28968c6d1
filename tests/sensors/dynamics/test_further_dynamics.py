"""A kind of field in a package of its own, from generation to score; smooth static fields."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from packages import install

from geo.farms import get_farm
from sensors.dynamics.continuous import SmoothParameters
from sensors.environment import generate_environment, load_environment
from sensors.errors import EnvironmentDataError, FieldError
from sensors.estimators import advance_estimator, make_estimator
from sensors.estimators.gp import prior
from sensors.field_files import field_from_table, field_to_table, load_field_set
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.score import RunningScore

HAZE = {"name": "spray", "kind": "haze", "crops": ["tomato"], "default": 0.0, "dynamics": {"speed": 0.05}}
FIELD_FILE = """\
[[field]]
name = "spray"
kind = "haze"
crops = ["tomato", "strawberry"]
default = 0.0
dynamics = { width = 0.15 }
"""
GRID = get_farm("miniberry-30").grid()


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of installed packages with the third kind's."""
    shutil.copy(Path(__file__).parent / "further" / "haze.py", tmp_path)
    install(tmp_path, "haze", "[wbf_mission.dynamics]\nhaze = haze:Haze\n")
    (tmp_path / "spray.toml").write_text(FIELD_FILE)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    sys.modules.pop("haze", None)


@pytest.fixture
def fields(site):
    return load_field_set(["tylcv", "spray.toml"], site)


def test_a_field_of_it_is_read_and_written(fields):
    assert (fields["spray"].kind, fields["spray"].dynamics.width) == ("continuous", 0.15)
    assert field_from_table(field_to_table(fields["spray"]), "here") == fields["spray"]
    with pytest.raises(FieldError, match="dynamics of a haze field: unknown parameter 'evaporation'"):
        field_from_table({**HAZE, "dynamics": {"evaporation": 0.1}}, "here")


def test_it_moves_and_is_stored(fields, tmp_path):
    stored = generate_environment(GRID, days=4, seed=7, fields=fields, directory=tmp_path / "e")
    one_day = generate_environment(GRID, days=3, seed=7, fields=fields, keep_days=[3])
    levels = [stored.level("spray", day) for day in stored.days]
    assert all(0.9 < level.max() <= 1.0 for level in levels) and not np.allclose(levels[0], levels[3])
    np.testing.assert_array_equal(one_day.level("spray", 3), levels[3])
    assert load_environment(tmp_path / "e").fields == fields
    # Another field beside it changes nothing.
    alone = generate_environment(GRID, days=4, seed=7, fields=load_field_set(["tylcv"]))
    np.testing.assert_array_equal(alone.onset("tylcv"), stored.onset("tylcv"))


@pytest.mark.parametrize("name", ["gp", "adaptive-disk", "point"])
def test_it_is_estimated_and_carried_to_the_next_day(fields, name, tmp_path, monkeypatch):
    for few in ("_MOST_SIMULATIONS", "_LINK_SIMULATIONS", "_SOIL_SIMULATIONS"):
        monkeypatch.setattr(prior, few, 20)
    environment = generate_environment(GRID, days=3, seed=7, fields=fields)
    x, y = (part.ravel() for part in np.meshgrid(np.arange(1, 30, 4), np.arange(1, 30, 4)))
    values = environment.sample(2, x, y)
    seen = Observations(x, y, np.arange(len(x)), np.full(len(x), 2), values, fields.names)
    cache = {"cache": tmp_path} if name == "gp" else {}
    estimator = make_estimator(name, fields=fields, **cache).fit(GRID, seen)
    score = RunningScore(environment.values(2), fields.masks(GRID), fields=fields)
    empty = make_estimator(name, fields=fields, **cache).fit(GRID).predict()
    before = score.evaluate(estimator.predict()).field_mse[1]
    assert before < score.evaluate(empty).field_mse[1]
    advance_estimator(estimator, 3)
    score.advance(environment.values(3))
    assert np.isfinite(score.evaluate(estimator.predict()).loss)


@pytest.mark.parametrize(
    ("entry_point", "text"),
    [
        ("haze = nowhere_at_all:Haze", "cannot be loaded"),
        ("haze = pathlib:Path", "is not a dataclass of Continuous"),
        ("haze = sensors.dynamics.soil:SoilParameters", "is not a dataclass of Continuous"),
    ],
)
def test_a_broken_package_is_told_in_one_line(tmp_path, monkeypatch, entry_point, text):
    install(tmp_path, "broken", f"[wbf_mission.dynamics]\n{entry_point}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(FieldError, match=rf"^here: dynamics 'haze' \(.*\) {text}") as told:
        field_from_table(HAZE, "here")
    assert "\n" not in str(told.value)


BAD = [[], [None], [np.zeros((3, 3))], *([np.full((30, 30), value)] for value in (1.5, np.nan))]


@pytest.mark.parametrize("bad", BAD)
def test_days_that_are_no_field_are_told(fields, monkeypatch, bad):
    monkeypatch.setattr(type(fields["spray"].dynamics), "days", lambda *_: iter(bad))
    with pytest.raises(EnvironmentDataError, match=r"haze: .* 30 x 30 values in 0..1 for day 0"):
        generate_environment(GRID, days=1, seed=7, fields=fields)


SMOOTH = {"name": "haze", "kind": "smooth", "crops": ["all"], "default": 0.5}


@pytest.mark.parametrize("length", [0.08, 0.15, 0.3])
def test_mean_spread_and_correlation_are_those_of_the_covariance(length):
    smooth = SmoothParameters(length, mean=0.4, spread=0.1)
    fields = np.array([next(smooth.days((30, 20), np.random.default_rng(k))) for k in range(1000)]) - 0.4
    assert fields.mean() == pytest.approx(0.0, abs=0.01)
    assert np.sqrt(np.square(fields).mean(axis=0)) == pytest.approx(0.1, rel=0.12)
    for axis, cells in ((1, 30), (2, 20)):
        moved = fields.swapaxes(1, axis)
        lag = max(1, round(length * cells))
        found = (moved[:, :-lag] * moved[:, lag:]).mean() / np.square(fields).mean()
        assert found == pytest.approx(np.exp(-((lag / (length * cells)) ** 2) / 2.0), abs=0.05)


def test_a_smooth_field_is_static_and_each_seed_has_its_own():
    fields = FieldSet((field_from_table(SMOOTH, "here"),))
    grid = get_farm("miniberry-10").grid()
    one, other = (generate_environment(grid, days=6, seed=seed, fields=fields) for seed in (1, 2))
    np.testing.assert_array_equal(one.level("haze", 0), one.level("haze", 6))
    assert not np.allclose(one.level("haze", 0), other.level("haze", 0))


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"correlation_length": 0.0}, "correlation_length 0.0 is not in 0.001..2"),
        ({"mean": 1.5}, "mean 1.5 is not in 0..1"),
        ({"spread": 0.0}, "spread 0.0 is not above 0"),
    ],
)
def test_impossible_smooth_fields_are_refused(values, text):
    with pytest.raises(EnvironmentDataError, match=text):
        SmoothParameters(**values)
