"""What was seen on earlier days is carried forward as the fields' dynamics have it."""

import numpy as np
import pytest

from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.environment import generate_environment
from sensors.estimators import advance_estimator, make_estimator
from sensors.estimators.days import transition
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations

GRID = get_farm("miniberry-10").grid()
TYLCV, CCR, SOIL = PAPER_FIELDS
CARRYING = ("gp", "adaptive-disk", "point")


def observed(cells, day, values):
    x, y = np.array(cells).T
    return Observations(x, y, np.arange(len(x), dtype=float), np.full(len(x), day), values)


def test_sick_plants_grow_old_and_lost_ones_stay_lost():
    for field in (TYLCV, CCR):
        soon, late = transition(field, GRID, 6, 7), transition(field, GRID, 6, 20)
        assert soon.means[0] == late.means[0] == 0.0 and soon.variances[0] == late.variances[0] == 0.0
        assert 0.0 <= late.means[1] <= soon.means[1] <= 0.5
        assert late.means[2] < soon.means[2] < 1.0
        assert soon.variances[2] < late.variances[2] <= late.spread + 0.25


@pytest.mark.parametrize("field", PAPER_FIELDS, ids=PAPER_FIELDS.names)
def test_transitions_are_those_of_environments_that_nothing_was_learned_from(field):
    grid, k = get_farm("miniberry-30").grid(), PAPER_FIELDS.names.index(field.name)
    before, after = [], []
    for seed in range(12):
        environment = generate_environment(grid, days=9, seed=9000 + seed, keep_days=[6, 9])
        where = field.mask(grid)
        before.append(environment.values(6)[k][where])
        after.append(environment.values(9)[k][where])
    before, after = (np.concatenate(part).astype(float) for part in (before, after))
    step = transition(field, grid, 6, 9)
    means, _ = step(before)
    assert np.mean((after - means) ** 2) < np.mean((after - before) ** 2)
    assert abs(np.mean(after - means)) < 0.05


@pytest.mark.parametrize("name", CARRYING)
def test_older_readings_are_less_certain_and_newer_ones_of_a_cell_hold(name):
    cells = [(2, 2), (7, 7)]
    more = {"radius": 2} if name == "adaptive-disk" else {}
    estimator = make_estimator(name, **more).fit(GRID, observed(cells, 4, [[1.0, 1.0, 0.8], [1.0, 1.0, 0.2]]))
    fresh = estimator.predict().copy()
    advance_estimator(estimator, 9)
    old = estimator.predict().copy()
    k = PAPER_FIELDS.names.index("soil")
    for x, y in cells:
        assert old.uncertainty[k, x, y] > fresh.uncertainty[k, x, y]
    apart = fresh.value[k, 2, 2] - fresh.value[k, 7, 7]
    assert 0.0 < old.value[k, 2, 2] - old.value[k, 7, 7] < apart
    # The same cells on the later day: what was seen there before tells nothing more.
    again = observed(cells, 9, [[0.0, 0.5, 0.3], [0.5, 1.0, 0.6]])
    both = estimator.partial_fit(again).predict().copy()
    alone = make_estimator(name, **more).fit(GRID, again).predict()
    # The smooth change of the soil leaves an older reading something to tell, if next to nothing.
    for found, expected in ((both.value, alone.value), (both.uncertainty, alone.uncertainty)):
        np.testing.assert_allclose(found[:k], expected[:k], atol=1e-5)
        np.testing.assert_allclose(found[k], expected[k], atol=0.005 if name == "gp" else 1e-5)


@pytest.mark.parametrize("name", CARRYING)
def test_days_learned_at_once_or_one_after_the_other_are_believed_alike(name):
    rng = np.random.default_rng(3)
    days = [
        observed(rng.integers(0, 10, (12, 2)), day, rng.choice([0.0, 0.5, 1.0], (12, 3))) for day in (3, 4, 6)
    ]
    step_by_step = make_estimator(name).fit(GRID)
    for one in days:
        advance_estimator(step_by_step, int(one.day[0]))
        for begin in range(0, 12, 4):
            step_by_step.partial_fit(one[begin : begin + 4]).predict()
    at_once = make_estimator(name).fit(GRID, Observations.concatenate(days))
    np.testing.assert_allclose(step_by_step.predict().value, at_once.predict().value, atol=1e-4)
    np.testing.assert_allclose(step_by_step.predict().uncertainty, at_once.predict().uncertainty, atol=1e-4)


def test_a_process_that_knows_no_dynamics_learns_how_fast_things_change():
    cells = [(x, y) for x in range(0, 10, 3) for y in range(0, 10, 3)]
    first = observed(cells, 4, np.tile([[1.0, 1.0, 0.8]], (len(cells), 1)))
    moved = observed(cells[:6], 6, np.tile([[1.0, 1.0, 0.2]], (6, 1)))
    still = observed(cells[:6], 6, np.tile([[1.0, 1.0, 0.8]], (6, 1)))
    k = PAPER_FIELDS.names.index("soil")
    means = []
    for later in (moved, still):
        estimator = make_estimator(
            "gp", learn_from="observations", optimise=False, prior_mean=(1.0, 1.0, 0.0)
        )
        estimator.learn_from = "observations"
        model = estimator.fit(GRID, Observations.concatenate([first, later])).predict()
        means.append(model.value[k, 9, 9])
    assert means[0] < means[1], "what changes fast is believed less"


def test_the_fewer_hosts_a_farm_has_the_more_seeds_fall_on_each():
    means = []
    for hosts in (100, 10):
        crop = np.zeros((100, 100), np.int8)
        crop[:hosts] = 2
        grid = FarmGrid((100, 100), 0.3048, crop, np.ones((100, 100), np.bool_))
        assert TYLCV.hosts(grid).sum() == 100 * hosts
        means.append(transition(TYLCV, grid, 6, 20).means[2])
    assert means[1] < means[0]
