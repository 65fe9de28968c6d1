"""Errors of PX4's estimated height: their size before and after they settle, and that a seed decides them."""

import numpy as np
import pytest

from sim_vehicle.airframe.height_errors import DRIFT_M, GRID_S, SETTLED_S, HeightErrors
from sim_vehicle.airframe.sensor_errors import SensorNoise

SETTLED = round(SETTLED_S / GRID_S)


def test_errors_have_the_recorded_size():
    flights = np.array([HeightErrors(seed).first(6000) for seed in range(60)])
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
    steps = np.concatenate([np.diff(HeightErrors(seed).first(SETTLED)) for seed in range(20)])
    jumps = np.abs(steps[np.abs(steps) > 0.5])
    assert np.percentile(jumps, 10) == pytest.approx(1.05, abs=0.1)
    assert np.median(jumps) == pytest.approx(1.24, abs=0.1)
    # Recorded 0.8 to 1.1 s between two of them.
    assert SETTLED_S * 20 / len(jumps) == pytest.approx(1.0, abs=0.25)
    late = np.diff(HeightErrors(3).first(6000)[SETTLED + 1 :])
    assert np.abs(late).max() < 0.1


def test_a_seed_decides_the_errors_however_many_are_drawn():
    few, many = HeightErrors(7).first(500), HeightErrors(7).first(4000)
    assert few.tolist() == many[:500].tolist()
    assert HeightErrors(8).first(500).tolist() != few.tolist()


def test_the_noise_of_a_vehicle_has_them_on_request():
    assert SensorNoise(seed=5).height_errors is None
    first = SensorNoise(seed=5, height_jumps=True)
    second = first.of_vehicle(2)
    assert first.is_off
    assert second.height_errors is not None
    assert first.height_errors is not None
    assert second.height_errors.first(300).tolist() != first.height_errors.first(300).tolist()
