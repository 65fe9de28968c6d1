import hashlib
import threading

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from geo.farms import get_farm
from geo.seeds import child_seed
from geo.system import AvailableMemory, NotEnoughMemoryError
from sensors.dynamics.soil import SoilCourse, draw_weather, hump_factors, rain_factors
from sensors.environment import Environment, EpidemicParameters, SoilParameters, generate_environment
from sensors.environment.environment import grid_digest
from sensors.environment.generate import memory_needed
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS


@pytest.fixture(scope="module")
def grid():
    return get_farm("miniberry-30").grid()


@pytest.fixture(scope="module")
def environment(grid):
    return generate_environment(grid, seed=7)


def digest(environment):
    sha = hashlib.sha256()
    for disease in ("tylcv", "ccr"):
        for day in environment.days:
            sha.update(np.ascontiguousarray(environment.status(disease, day)).tobytes())
    return sha.hexdigest()


def test_the_same_seed_gives_the_same_epidemics_on_every_machine(grid, environment):
    assert digest(environment) == "5120384d38e20f4e83dd4bb7bb1d05de9f72b5734a60f7705fcf082aa1717f7f"
    assert digest(generate_environment(grid, seed=7)) == digest(environment)
    wide = generate_environment(get_farm("miniberry-100").grid(), seed=7)
    assert digest(wide) == "1d2487ebc6deeddda14262c9a7c690b29a42df2d7d5d7f69a48557abf363a8eb"


def test_fields_do_not_depend_on_each_other(grid, environment):
    model = PAPER_FIELDS.with_dynamics(tylcv=EpidemicParameters(0.9, 9), soil=SoilParameters(mean_rain=0.02))
    other = generate_environment(grid, seed=7, fields=model)
    np.testing.assert_array_equal(other.onset("ccr"), environment.onset("ccr"))
    assert (other.onset("tylcv") != environment.onset("tylcv")).any()


def test_a_day_does_not_depend_on_later_or_kept_days(grid, environment):
    alone = generate_environment(grid, seed=7, days=50, keep_days=[6])
    assert alone.days == (6,)
    np.testing.assert_array_equal(alone.values(6), environment.values(6))


def test_values_follow_from_the_status(environment):
    out = np.full((3, *environment.shape), np.nan, np.float32)
    for day in environment.days:
        values = environment.values(day)
        assert environment.values(day, out=out) is out
        np.testing.assert_array_equal(out, values)
        assert values.dtype == np.float32
        assert values.shape == (3, *environment.shape)
        for index, disease in enumerate(("tylcv", "ccr")):
            status = environment.status(disease, day)
            wanted = np.select([status > 0, status == -1], [0.5, 0.0], 1.0)
            np.testing.assert_array_equal(values[index], wanted)
        np.testing.assert_array_equal(values[2], environment.level("soil", day))
        assert 0.0 <= values.min() <= values.max() <= 1.0
    for array in (environment.onset("ccr"), environment.level("soil", 6)):
        assert not array.flags.writeable


def test_a_cell_alone_is_the_same_as_among_others(environment):
    ix, iy = (part.ravel() for part in np.indices(environment.shape))
    together = environment.sample(9, ix, iy)
    assert together.dtype == np.float32
    np.testing.assert_array_equal(together, environment.values(9)[:, ix, iy].T)
    assert environment.sample(6, np.arange(4), 4).shape == (4, 3)
    alone = [environment.sample(9, ix[k : k + 1], iy[k : k + 1]) for k in range(len(ix))]
    np.testing.assert_array_equal(np.concatenate(alone), together)
    with pytest.raises(EnvironmentDataError, match=r"cell \(30, 0\) is outside"):
        environment.sample(9, np.array([30]), np.array([0]))


@pytest.mark.parametrize(
    ("ix", "iy", "text"),
    [(-1, 0, r"\(-1, 0\)"), ([0, 31], [1, 2], r"\(31, 2\)"), (1.5, 2, "integers"), ("a", 1, "integers")],
)
def test_cells_outside_the_farm_are_refused(environment, ix, iy, text):
    with pytest.raises(EnvironmentDataError, match=text):
        environment.sample(6, ix, iy)


@given(st.integers(0, 29), st.integers(0, 29), st.integers(1, 30), st.integers(1, 30), st.integers(0, 15))
def test_a_window_is_a_part_of_the_values(environment, x, y, width, height, day):
    part = slice(x, min(x + width, 30)), slice(y, min(y + height, 30))
    np.testing.assert_array_equal(environment.window(day, *part), environment.values(day)[:, *part])


@pytest.mark.parametrize("part", [slice(0, 31), slice(-1, 4), slice(4, 4), slice(0, 8, 2), slice(5, 2)])
def test_windows_outside_the_farm_are_refused(environment, part):
    for x, y, name in ((part, slice(None), "x"), (slice(None), part, "y")):
        with pytest.raises(EnvironmentDataError, match=f"window {name} "):
            environment.window(6, x, y)


def test_days_that_are_not_kept_are_refused(grid):
    environment = generate_environment(grid, seed=7, days=6, keep_days=[2, 6])
    calls = (lambda day: environment.level("soil", day), lambda day: environment.status("ccr", day))
    for call in (environment.values, *calls):
        with pytest.raises(EnvironmentDataError, match="day 3 is not kept; kept days: 2, 6"):
            call(3)
    with pytest.raises(EnvironmentDataError, match="unknown disease 'rust'"):
        environment.status("rust", 2)
    with pytest.raises(EnvironmentDataError, match="unknown continuous field 'ccr': choose soil"):
        environment.level("ccr", 2)


@pytest.mark.parametrize(
    "arguments", [{"days": -1}, {"days": 127}, {"keep_days": []}, {"keep_days": [16]}, {"keep_days": [-1, 2]}]
)
def test_bad_days_are_refused(grid, arguments):
    with pytest.raises(EnvironmentDataError, match=r"days|day .* is not in 0\.\.126"):
        generate_environment(grid, seed=1, **arguments)


def test_arrays_that_do_not_fit_are_refused(environment):
    onset = {disease: environment.onset(disease) for disease in ("tylcv", "ccr")}
    with pytest.raises(EnvironmentDataError, match="no day"):
        Environment.of_arrays(PAPER_FIELDS, [], onset, {"soil": {}})
    with pytest.raises(EnvironmentDataError, match="soil of day 1"):
        Environment.of_arrays(PAPER_FIELDS, [1], onset, {"soil": {1: np.zeros((3, 3), np.float32)}})
    with pytest.raises(EnvironmentDataError, match="onset of ccr"):
        wrong = {**onset, "ccr": onset["ccr"].astype(np.int16)}
        Environment.of_arrays(PAPER_FIELDS, [1], wrong, {"soil": {1: environment.level("soil", 1)}})


def test_progress_ends_at_the_total_and_can_stop_the_work(grid):
    calls = []
    generate_environment(grid, seed=1, progress=lambda done, total: calls.append((done, total)))
    assert [done for done, _ in calls] == list(range(1, calls[-1][1] + 1))

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, seed=1, progress=stop)


def test_too_little_memory_is_foreseen(grid, monkeypatch, tmp_path):
    monkeypatch.setattr("geo.system.available_memory", lambda: AvailableMemory(1000, "the test"))
    with pytest.raises(NotEnoughMemoryError, match=r"16 days of 30 x 30 cells needs .* keep fewer days"):
        generate_environment(grid, seed=1)
    with pytest.raises(NotEnoughMemoryError, match=r"1 kB are free \(the test\); take a smaller farm$"):
        generate_environment(grid, seed=1, directory=tmp_path / "e")
    assert list(tmp_path.iterdir()) == []


def test_what_is_needed_on_disk_does_not_grow_with_the_days():
    few, many = (sum(memory_needed((6000, 5000), days, on_disk=True).values()) for days in (2, 126))
    assert few == many < 1.5e9
    assert sum(memory_needed((6000, 5000), 126).values()) > 126 * 120e6


def test_provenance_names_the_farm_and_the_seed(grid):
    environment = generate_environment(grid, seed=child_seed(2**90, "x"), days=1, farm_name="m")
    assert environment.provenance.farm == "m"
    assert environment.provenance.entropy == (str(2**90),)
    assert len(environment.provenance.spawn_key) == 2
    assert (
        environment.provenance.grid_sha256
        == grid_digest(grid)
        != grid_digest(get_farm("miniberry-10").grid())
    )


@example(40, 4000, 1, False)  # several blocks
@settings(max_examples=25)
@given(st.integers(2, 50), st.integers(2, 50), st.integers(0, 2**32), st.booleans())
def test_soil_in_blocks_is_the_formula_day_by_day(width, height, seed, square):
    shape = (width, height)
    parameters = SoilParameters(square_humps=square)
    weather = draw_weather(shape, 6, parameters, np.random.default_rng(seed))
    got = {day: np.empty(shape, np.float32) for day in (0, 3, 6)}
    course = SoilCourse(shape, weather, parameters, 6)
    for day, level in got.items():
        course.compute(day, level)
    along_x, along_y = hump_factors(weather.start_corners, shape, parameters)
    humidity = along_x @ along_y
    for index, shower in enumerate(weather.showers):
        humidity = humidity * (1.0 - parameters.evaporation)
        factors = None if shower is None else rain_factors(shower, shape, parameters)
        if factors is not None:  # The first days may be above 1 until it rains
            humidity = np.minimum(humidity + factors[0] @ factors[1], 1.0)
        day = index + 1 - parameters.warm_up_days
        if day in got:
            np.testing.assert_allclose(got[day], humidity, rtol=0, atol=5e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {"evaporation": 1.2},
        {"rain_probability": -0.1},
        {"mean_rain": -1},
        {"shower_humps": 0},
        {"warm_up_days": -1},
        {"spread": 0},
    ],
)
def test_bad_soil_parameters_are_refused(changes):
    with pytest.raises(EnvironmentDataError, match="soil: "):
        SoilParameters(**changes)


def test_threads_change_nothing(monkeypatch, grid, tmp_path):
    alone = generate_environment(grid, seed=5, threads=1)
    monkeypatch.setattr("sensors.environment.generate._THREADS_FROM_CELLS", 0)
    calls = []
    together = generate_environment(grid, seed=5, threads=4, progress=lambda done, _total: calls.append(done))
    stored = generate_environment(grid, seed=5, threads=2, directory=tmp_path / "e")
    for other in (together, stored):
        for disease in ("tylcv", "ccr"):
            np.testing.assert_array_equal(alone.onset(disease), other.onset(disease))
        for day in alone.days:
            np.testing.assert_array_equal(alone.level("soil", day), other.level("soil", day))
    assert calls == sorted(calls)
    assert calls[-1] == 2 * 15 + 16


def test_threads_end_when_the_caller_stops(monkeypatch, grid):
    monkeypatch.setattr("sensors.environment.generate._THREADS_FROM_CELLS", 0)
    before = threading.active_count()

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, seed=5, threads=2, progress=stop)
    assert threading.active_count() == before


@settings(max_examples=8)
@given(st.lists(st.integers(0, 8), min_size=1, max_size=5), st.integers(0, 2**32))
def test_the_soil_is_the_same_in_any_portions(days, seed):
    shape = (40, 4000)
    weather = draw_weather(shape, 8, SoilParameters(), np.random.default_rng(seed))
    course = SoilCourse(shape, weather, SoilParameters(), 8)
    at_once, earlier = np.empty(shape, np.float32), None
    for day in sorted(days):
        course.compute(day, at_once)
        in_portions = np.empty(shape, np.float32)
        course.compute(day, in_portions, earlier)
        np.testing.assert_array_equal(in_portions, at_once)
        earlier = day, in_portions
