"""Worlds: how fields really develop, drawn for each seed."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from geo.farms import get_farm
from sensors.dynamics.epidemic import EpidemicParameters, draw_seeds
from sensors.dynamics.soil import SoilParameters
from sensors.environment import generate_environment
from sensors.environment.world import World, world_names
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS, FieldSet

SEEDS = st.integers(0, 2**64 - 1)


@pytest.mark.parametrize("name", world_names())
@settings(max_examples=20)
@given(seed=SEEDS)
def test_a_built_in_world_changes_dynamics_and_nothing_else(name, seed):
    world = World.load(name)
    true = world.fields(PAPER_FIELDS, seed)
    assert true == world.fields(PAPER_FIELDS, seed)
    assert true.with_dynamics(**{one.name: one.dynamics for one in PAPER_FIELDS}) == PAPER_FIELDS
    assert {one.name for one in true if one != PAPER_FIELDS[one.name]} == set(world.laws)


@given(seed=SEEDS, low=st.floats(0.1, 1.0), high=st.floats(1.0, 3.0))
def test_a_factor_stays_in_its_bounds_and_whole_numbers_stay_whole(seed, low, high):
    laws = {"likelihood": {"factor": [low, high]}, "duration_days": {"factor": [low, high]}}
    true = World.of_table({"ccr": laws}, "here").fields(PAPER_FIELDS, seed)["ccr"].epidemic
    assert low * 0.15 <= true.likelihood * (1 + 1e-12) and true.likelihood <= high * 0.15 * (1 + 1e-12)
    assert isinstance(true.duration_days, int)
    assert max(1, round(low * 10)) <= true.duration_days <= round(high * 10)


@given(seed=SEEDS)
def test_a_further_law_changes_none_of_the_others(seed):
    one = {"tylcv": {"likelihood": {"factor": [0.5, 2.0]}}}
    more = {
        "tylcv": {**one["tylcv"], "seeds": {"one_of": [1, 5]}},
        "soil": {"mean_rain": {"factor": [0.5, 2]}},
    }
    few, many = (World.of_table(laws, "here").fields(PAPER_FIELDS, seed)["tylcv"] for laws in (one, more))
    assert few.epidemic.likelihood == many.epidemic.likelihood
    assert many.epidemic.seeds in (1, 5)


def test_a_world_is_its_table():
    for name in world_names():
        world = World.load(name)
        assert World.of_table(world.to_table(), world.where) == world


def test_the_environment_is_of_the_world_and_the_other_fields_stay_as_they_are():
    grid = get_farm("miniberry-30").grid()
    true = World.of_table({"tylcv": {"seeds": 0}}, "here").fields(PAPER_FIELDS, 7)
    published, other = (
        generate_environment(grid, days=6, seed=7, fields=fields) for fields in (PAPER_FIELDS, true)
    )
    assert other.values(6)[0].min() == 1.0 > published.values(6)[0].min()
    np.testing.assert_array_equal(other.values(6)[1:], published.values(6)[1:])


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"tylcv": {}}, "here: no parameter is changed"),
        ({"tylcv": 3}, "here: tylcv is not a table; a world has a table for each field"),
        ({"rust": {"likelihood": 0.2}}, "here: no field 'rust'; the fields are tylcv, ccr, soil"),
        ({"tylcv": {"colour": 3}}, "here: tylcv: dynamics of a disease field: unknown parameter 'colour'"),
        ({"tylcv": {"likelihood": 1.5}}, "tylcv: dynamics: epidemic: likelihood 1.5 is not a probability"),
        ({"tylcv": {"likelihood": "much"}}, "tylcv: dynamics, likelihood: it is a text; give a number"),
        ({"tylcv": {"seeds": {"factor": [0.5, 2.0]}}}, "tylcv, seeds: a factor needs a numeric published"),
        ({"tylcv": {"likelihood": {"factor": [2.0, 0.5]}}}, "factor 2, 0.5: give two numbers from 0.001"),
        ({"ccr": {"likelyhood": {"factor": [0.5, 2.0]}}}, "'likelyhood' (is 'likelihood' meant?)"),
        ({"tylcv": {"likelihood": {"one_of": []}}}, "one_of has 0 values"),
        ({"tylcv": {"likelihood": {}}}, "give either factor = "),
        ({"tylcv": {"likelihood": {"times": 2}}}, "times is unknown"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(table, text):
    with pytest.raises(EnvironmentDataError) as caught:
        World.of_table(table, "here").fields(PAPER_FIELDS, 0)
    assert text in str(caught.value) and "\n" not in str(caught.value)


def test_a_world_without_any_field_of_the_run_is_refused():
    soil = FieldSet((PAPER_FIELDS["soil"],))
    with pytest.raises(EnvironmentDataError, match="wrong-rates: no table for soil; the fields are soil"):
        World.load("wrong-rates").fields(soil, 0)
    assert isinstance(World.load("wrong-soil").fields(soil, 0)["soil"].dynamics, SoilParameters)


def test_files_and_names(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[ccr]\nlikelihood = 0.3\n")
    assert World.load(file).fields(PAPER_FIELDS, 0)["ccr"].epidemic.likelihood == 0.3
    for name, text in (
        ("nowhere", "unknown world 'nowhere': choose wrong-kernel, wrong-rates,"),
        (tmp_path / "missing.toml", "cannot be read as a world: no such file"),
        (tmp_path / "broken.toml", "cannot be read as a world: it is not TOML"),
    ):
        (tmp_path / "broken.toml").write_text("[")
        with pytest.raises(EnvironmentDataError, match=text):
            World.load(name)


def test_seeds_with_a_spread_stand_together():
    land = np.ones((40, 50), bool)
    land[:, :5] = False
    spread = []
    for number in range(200):
        cells = draw_seeds(land, 6, np.random.default_rng(number), 2.0)
        assert land.reshape(-1)[cells].all() and 1 <= cells.size <= 6
        x, y = np.divmod(cells, 50)
        spread += [np.hypot(x - x.mean(), y - y.mean()).max()]
    assert 1.0 < np.mean(spread) < 5.0
    assert draw_seeds(land, 0, np.random.default_rng(0), 2.0).size == 0
    with pytest.raises(EnvironmentDataError, match="seed_spread_cells 0 is not a positive number"):
        EpidemicParameters(0.2, 5, seed_spread_cells=0)
