import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import convolve2d

from sensors.dynamics.epidemic import (
    EpidemicParameters,
    age,
    draw_seeds,
    simulate_outbreak,
    status_table,
    step,
)
from sensors.dynamics.infection import make_kernel
from sensors.errors import EnvironmentDataError

SHAPES = st.tuples(st.integers(1, 24), st.integers(1, 24))


def random_status(shape, seed, longest=10):
    rng = np.random.default_rng(seed)
    return rng.choice(
        np.array([-2, -1, 0, 0, 0, 0, *range(1, longest + 1, 3)], np.int8), size=shape, replace=True
    )


@pytest.mark.parametrize("shape", ["exponential", "gaussian", "inverse-square"])
def test_rounded_weights_follow_their_formula(shape):
    size, length = 13, 1.7
    kernel = make_kernel(shape, size, length)
    offset = np.arange(size) - size // 2
    d2 = (offset[:, None] ** 2 + offset[None, :] ** 2).astype(float)
    d2[size // 2, size // 2] = np.inf
    wanted = {
        "exponential": np.exp(-np.sqrt(d2) / length),
        "gaussian": np.exp(-d2 / (2 * length**2)),
        "inverse-square": 1 / d2,
    }[shape]
    np.testing.assert_allclose(kernel.weights(), wanted, rtol=0, atol=2.0**-32)


@given(SHAPES, st.integers(0, 2**32))
def test_the_kernel_rule_is_a_convolution_without_rounding(shape, seed):
    parameters = EpidemicParameters(
        0.3, 4, kernel_size=7, kernel_shape="exponential", kernel_length_cells=1.2, rule="kernel"
    )
    rule = parameters.infection_rule(shape)
    status = random_status(shape, seed)
    uniform = np.random.default_rng(seed).random(shape)
    wanted = age(status)
    count = np.asarray(convolve2d(wanted > 0, rule.kernel.weights(), "same"), np.float64)
    probability = np.minimum(0.3 * count, 1.0)
    wanted[(wanted == 0) & (probability > uniform)] = 4
    np.testing.assert_array_equal(step(status, uniform, rule), wanted)


@settings(max_examples=30)
@given(
    st.integers(0, 2**32),
    st.sampled_from([3, 5, 11]),
    st.sampled_from(["count", "kernel"]),
    st.tuples(st.integers(5, 40), st.integers(5, 40)),
)
def test_an_outbreak_is_the_step_repeated(seed, size, rule, shape):
    parameters = EpidemicParameters(0.35, 4, seed_duration_days=6, kernel_size=size, rule=rule)
    hosts = random_status(shape, seed) != -2
    onset = simulate_outbreak(hosts, parameters, 10, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    status = np.where(hosts, np.int8(0), np.int8(-2))
    status.reshape(-1)[draw_seeds(hosts, 3, rng)] = 6
    for day in range(11):
        np.testing.assert_array_equal(status_table(parameters, day)[onset.view(np.uint8)], status)
        status = step(status, lambda cells: rng.random(cells.size), parameters.infection_rule(shape))


@given(SHAPES, st.integers(0, 2**32), st.integers(0, 30))
def test_seeds_fall_on_hosts_only(shape, seed, count):
    hosts = np.random.default_rng(seed).random(shape) < 0.3
    seeds = draw_seeds(hosts, count, np.random.default_rng(seed))
    assert hosts.reshape(-1)[seeds].all()
    assert (np.diff(seeds) > 0).all()
    assert (seeds.size > 0) == (hosts.any() and count > 0)


@pytest.mark.parametrize(
    "changes",
    [
        {"likelihood": 1.5},
        {"duration_days": 0},
        {"duration_days": 127},
        {"seed_duration_days": -1},
        {"seeds": -1},
        {"kernel_size": 4},
        {"kernel_shape": "square"},
        {"rule": "floor"},
        {"kernel_size": 53},
        {"kernel_shape": "gaussian", "kernel_length_cells": 0.0},
        {"kernel_shape": "gaussian", "kernel_length_cells": float("inf")},
    ],
)
def test_bad_parameters_are_refused_in_one_line(changes):
    with pytest.raises(EnvironmentDataError) as caught:
        EpidemicParameters(**{"likelihood": 0.2, "duration_days": 5, **changes})
    assert "\n" not in str(caught.value)
