"""Errors of PX4's estimate: their size and memory, and that a seed decides them."""

import math

import numpy as np
import pytest

from sim_vehicle.airframe.navigation_errors import (
    CLIMB_M_S,
    DRIFT_M,
    GRID_S,
    SETTLED_S,
    VELOCITY_M_S,
    EstimateErrors,
    carried_aside_m,
    recur,
)

SETTLED = round(SETTLED_S / GRID_S)


def test_errors_of_the_height_have_the_recorded_size():
    flights = np.array([EstimateErrors(seed).first(6000)[:, 0] for seed in range(60)])
    early, late = flights[:, 100:SETTLED], flights[:, SETTLED + 300 :]
    assert 0.45 < np.std(early) < 0.8
    assert np.std(late) == pytest.approx(DRIFT_M, rel=0.1)
    assert abs(np.mean(late)) < 0.05
    # Recorded: 0.97 and 0.96 over one second, 0.65 and 0.60 over five, 0.40 and 0.19 over ten.
    for seconds, correlation in ((1, 0.965), (5, 0.625), (10, 0.3)):
        shift = round(seconds / GRID_S)
        seen = np.mean(late[:, shift:] * late[:, :-shift]) / np.var(late)
        assert seen == pytest.approx(correlation, abs=0.06)


def test_jumps_are_as_large_and_frequent_as_recorded():
    steps = np.concatenate([np.diff(EstimateErrors(seed).first(SETTLED)[:, 0]) for seed in range(20)])
    jumps = np.abs(steps[np.abs(steps) > 0.5])
    assert np.percentile(jumps, 10) == pytest.approx(1.05, abs=0.1)
    assert np.median(jumps) == pytest.approx(1.24, abs=0.1)
    # Recorded 0.8 to 1.1 s between two of them.
    assert SETTLED_S * 20 / len(jumps) == pytest.approx(1.0, abs=0.25)
    late = np.diff(EstimateErrors(3).first(6000)[SETTLED + 1 :, 0])
    assert np.abs(late).max() < 0.1


def test_errors_of_the_velocity_have_the_recorded_size_and_memory():
    flights = np.array([EstimateErrors(seed).first(6000)[300:, 1:4] for seed in range(60)])
    east, north, up = np.moveaxis(flights, 2, 0)
    for one, deviation in ((east, VELOCITY_M_S), (north, VELOCITY_M_S), (up, CLIMB_M_S)):
        assert np.std(one) == pytest.approx(deviation, rel=0.05)
        assert abs(np.mean(one)) < 0.05 * deviation
    assert abs(np.corrcoef(east.ravel(), north.ravel())[0, 1]) < 0.05
    # Recorded: 0.75, 0.56, 0.23 and 0.02 in both axes of six flights, without what changes within a second.
    for seconds, correlation in ((2, 0.74), (3, 0.54), (5, 0.21), (8, 0.0)):
        shift = round(seconds / GRID_S)
        seen = np.mean(east[:, shift:] * east[:, :-shift]) / np.var(east)
        assert seen == pytest.approx(correlation, abs=0.04)


def test_the_vehicle_is_pushed_against_the_error_of_its_velocity_and_its_change():
    errors = np.concatenate([EstimateErrors(seed).first(6000)[300:] for seed in range(6)])
    change = np.gradient(errors[:, 1], GRID_S)
    pull, unseen = np.linalg.lstsq(np.stack([errors[:, 1], change], axis=1), errors[:, 4], rcond=None)[0]
    # Recorded: 0.48 to 0.53 1/s, and 0.22 to 0.38.
    assert -pull == pytest.approx(0.5, abs=0.05)
    assert -unseen == pytest.approx(0.3, abs=0.05)
    assert abs(np.corrcoef(errors[:, 4], errors[:, 5])[0, 1]) < 0.1


@pytest.mark.parametrize("gain_1_s", [0.5, 0.95, 2.0])
def test_a_position_loop_is_carried_aside_as_far_as_told(gain_1_s):
    errors = EstimateErrors(2).first(400_000)[:, 1]
    keeps = math.exp(-gain_1_s * GRID_S)
    aside = recur(errors, keeps, 0.0, (1.0 - keeps) / gain_1_s)
    assert carried_aside_m(gain_1_s) == pytest.approx(aside[1000:].std(), rel=0.03)
    assert carried_aside_m(0.0) == math.inf
