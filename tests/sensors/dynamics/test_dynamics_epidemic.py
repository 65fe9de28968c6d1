from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import convolve2d

from sensors.dynamics.epidemic import (
    CCR,
    TYLCV,
    EpidemicParameters,
    InfectionRule,
    age,
    draw_seeds,
    simulate_outbreak,
    status_table,
    step,
)
from sensors.dynamics.infection import DistanceKernel, InfectionFront, make_kernel
from sensors.errors import EnvironmentDataError

SIZES = st.sampled_from([1, 3, 5, 7, 9, 11])
SHAPES = st.tuples(st.integers(1, 24), st.integers(1, 24))


def random_status(shape: tuple[int, int], seed: int, longest: int = 10) -> NDArray[np.int8]:
    rng = np.random.default_rng(seed)
    return rng.choice(
        np.array([-2, -1, 0, 0, 0, 0, *range(1, longest + 1, 3)], np.int8), size=shape, replace=True
    )


def exact_count(infected: NDArray[np.bool_], kernel: DistanceKernel) -> NDArray[np.int64]:
    """Weighted counts by full convolution; integers below 2^53 are exact in float64."""
    weights = np.rint(kernel.weights() * kernel.unit)
    count: NDArray[np.int64] = np.rint(convolve2d(infected, weights, "same")).astype(np.int64)
    return count


@pytest.mark.parametrize("size", [1, 3, 5, 7, 9, 11])
def test_inverse_square_weights_are_exact(size: int) -> None:
    kernel = make_kernel("inverse-square", size)
    offsets = dict.fromkeys(kernel.offsets)
    assert len(offsets) == size * size - 1
    for weight, ring in kernel.rings:
        for dx, dy in ring:
            assert Fraction(weight, kernel.unit) == Fraction(1, dx * dx + dy * dy)


@pytest.mark.parametrize("shape", ["exponential", "gaussian", "inverse-square"])
def test_rounded_weights_follow_their_formula(shape: str) -> None:
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


@pytest.mark.parametrize(
    "arguments",
    [
        ("cubic", 3, 1.0),
        ("gaussian", 4, 1.0),
        ("gaussian", 53, 1.0),
        ("gaussian", 3, 0.0),
        ("exponential", -1, 1.0),
    ],
)
def test_bad_kernels_are_refused(arguments: tuple[str, int, float]) -> None:
    with pytest.raises(EnvironmentDataError, match="infection kernel"):
        make_kernel(*arguments)


@settings(max_examples=50)
@given(SHAPES, SIZES, st.integers(0, 2**32))
def test_the_front_stays_right_while_cells_come_and_go(shape: tuple[int, int], size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    status = random_status(shape, seed)
    status[status > 0] = 0
    kernel = make_kernel("inverse-square", size)
    front = InfectionFront(status == 0, kernel)
    for _ in range(6):
        susceptible, infected = np.flatnonzero(status == 0), np.flatnonzero(status > 0)
        new = susceptible[rng.random(susceptible.size) < 0.1]
        old = infected[rng.random(infected.size) < 0.5]
        front.infect(new)
        front.remove(old)
        status.reshape(-1)[new] = 3
        status.reshape(-1)[old] = -1
        cells, total = front.exposed()
        wanted = np.where(status == 0, exact_count(status > 0, kernel), 0).reshape(-1)
        np.testing.assert_array_equal(cells, np.flatnonzero(wanted))
        np.testing.assert_array_equal(total, wanted[cells])


def test_five_neighbours_of_a_fifth_count_as_one() -> None:
    rule = InfectionRule(make_kernel("inverse-square", 5), 0.25, 5)
    status = np.zeros((5, 5), np.int8)
    for dx, dy in [(-2, -1), (-2, 1), (2, -1), (2, 1), (1, 2)]:
        status[2 + dx, 2 + dy] = 9
    uniform = np.ones((5, 5))
    uniform[2, 2] = 0.2
    assert step(status, uniform, rule)[2, 2] == 5
    status[3, 4] = 0
    assert step(status, uniform, rule)[2, 2] == 0


@given(SHAPES, st.integers(0, 2**32), st.sampled_from([TYLCV, CCR]), SIZES)
def test_a_step_is_the_documented_formula(
    shape: tuple[int, int], seed: int, parameters: EpidemicParameters, size: int
) -> None:
    status = random_status(shape, seed)
    uniform = np.random.default_rng(seed).random(shape)
    rule = InfectionRule(make_kernel("inverse-square", size), parameters.likelihood, parameters.duration_days)
    before = status.copy()
    after = step(status, uniform, rule)
    np.testing.assert_array_equal(status, before)
    wanted = age(status)
    n = exact_count(wanted > 0, rule.kernel) // rule.kernel.unit
    probability = 1 - (1 - parameters.likelihood) ** n.astype(float)
    wanted[(wanted == 0) & (probability > uniform)] = parameters.duration_days
    np.testing.assert_array_equal(after, wanted)


@given(SHAPES, st.integers(0, 2**32))
def test_the_kernel_rule_is_a_convolution_without_rounding(shape: tuple[int, int], seed: int) -> None:
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
def test_an_outbreak_is_the_step_repeated(seed: int, size: int, rule: str, shape: tuple[int, int]) -> None:
    parameters = EpidemicParameters(0.35, 4, seed_duration_days=6, kernel_size=size, rule=rule)  # type: ignore[arg-type]
    hosts = random_status(shape, seed) != -2
    onset = simulate_outbreak(hosts, parameters, 10, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    status = np.where(hosts, np.int8(0), np.int8(-2))
    status.reshape(-1)[draw_seeds(hosts, 3, rng)] = 6
    for day in range(11):
        np.testing.assert_array_equal(status_table(parameters, day)[onset.view(np.uint8)], status)
        status = step(status, lambda cells: rng.random(cells.size), parameters.infection_rule(shape))


@given(SHAPES, st.integers(0, 2**32), st.integers(0, 30))
def test_seeds_fall_on_hosts_only(shape: tuple[int, int], seed: int, count: int) -> None:
    hosts = np.random.default_rng(seed).random(shape) < 0.3
    seeds = draw_seeds(hosts, count, np.random.default_rng(seed))
    assert hosts.reshape(-1)[seeds].all()
    assert (np.diff(seeds) > 0).all()
    assert (seeds.size > 0) == (hosts.any() and count > 0)


def test_every_host_is_equally_likely_to_be_a_seed() -> None:
    hosts = np.zeros((4, 5), np.bool_)
    hosts[0, 0] = hosts[1, 1:4] = hosts[3, 4] = True
    rng = np.random.default_rng(3)
    counts = np.zeros(20)
    for _ in range(5000):
        counts[draw_seeds(hosts, 1, rng)] += 1
    expected = 1000
    chi_square = ((counts[hosts.reshape(-1)] - expected) ** 2 / expected).sum()
    assert chi_square < 18.5  # 0.1 % of chances with four degrees of freedom
    assert counts[~hosts.reshape(-1)].sum() == 0


def test_a_farm_without_the_crop_has_no_disease() -> None:
    onset = simulate_outbreak(np.zeros((9, 7), np.bool_), TYLCV, 5, np.random.default_rng(1))
    assert (onset == -2).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"likelihood": 1.5},
        {"likelihood": float("nan")},
        {"duration_days": 0},
        {"duration_days": 127},
        {"seed_duration_days": -1},
        {"seeds": -1},
        {"kernel_size": 4},
        {"kernel_size": 0},
        {"kernel_shape": "square"},
        {"rule": "floor"},
        {"kernel_shape": "gaussian", "kernel_length_cells": float("inf")},
    ],
)
def test_bad_parameters_are_refused_in_one_line(changes: dict[str, object]) -> None:
    with pytest.raises(EnvironmentDataError) as caught:
        EpidemicParameters(**{"likelihood": 0.2, "duration_days": 5, **changes})  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
