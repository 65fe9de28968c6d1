import math

import numpy as np
import pytest

from sim_vehicle.errors import VehicleError
from sim_vehicle.wind import BLOCK, GRID_S, Wind


def blocks(wind, count):
    series = wind.series()
    parts = []
    for k in range(count):
        assert series.first == k * BLOCK
        parts.append(series.block)
        series.forward()
    return np.vstack(parts)


def test_weather_reports():
    north = Wind.from_direction(4.0, 0.0)
    assert (north.east_m_s, north.north_m_s) == (pytest.approx(0.0), pytest.approx(-4.0))
    with pytest.raises(VehicleError, match="east_m_s nan"):
        Wind(math.nan)
    with pytest.raises(VehicleError, match="negative"):
        Wind(gust_m_s=-1.0)
    with pytest.raises(VehicleError, match="negative"):
        Wind(correlation_s=0.0)


def test_a_steady_wind_has_one_row():
    series = Wind(3.0, -1.0).series()
    assert series.block.tolist() == [[3.0, -1.0]]
    series.forward()
    assert (series.first, series.block.tolist()) == (0, [[3.0, -1.0]])


@pytest.mark.parametrize("seed", [1, np.random.SeedSequence(5), np.random.SeedSequence(5, spawn_key=(2,))])
def test_the_same_seed_gives_the_same_gusts_every_time(seed):
    wind = Wind(gust_m_s=1.5, seed=seed)
    np.testing.assert_array_equal(blocks(wind, 3), blocks(wind, 3))
    if not isinstance(seed, int):
        seed.spawn(2)
        np.testing.assert_array_equal(blocks(wind, 1), blocks(Wind(gust_m_s=1.5, seed=seed), 1))
    assert not np.array_equal(blocks(wind, 1), blocks(Wind(gust_m_s=1.5, seed=99), 1))


def test_statistics_of_the_gust():
    wind = Wind(2.0, -3.0, gust_m_s=1.5, correlation_s=5.0, seed=3)
    gust = blocks(wind, 100) - [2.0, -3.0]
    assert np.abs(gust.mean(axis=0)).max() < 0.15
    assert gust.std(axis=0) == pytest.approx([1.5, 1.5], rel=0.05)
    lag = round(5.0 / GRID_S)
    for k in range(2):
        correlation = np.mean(gust[:-lag, k] * gust[lag:, k]) / gust[:, k].var()
        assert correlation == pytest.approx(math.exp(-1.0), abs=0.06)
    assert abs(np.mean(gust[:, 0] * gust[:, 1])) < 0.15
