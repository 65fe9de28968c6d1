from __future__ import annotations

import hashlib
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geo.farms import get_farm
from geo.grid import FarmGrid
from geo.seeds import child_seed
from geo.system import AvailableMemory, NotEnoughMemoryError
from sensors.dynamics.soil import SoilCourse, draw_weather, hump_factors, rain_factors
from sensors.environment import TYLCV, Environment, EpidemicParameters, SoilParameters, generate_environment
from sensors.environment.environment import grid_digest
from sensors.environment.generate import memory_needed
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS


def stripes(width: int, height: int) -> FarmGrid:
    """Strawberries, tomatoes and a gap, partly the neighbours'."""
    crop = np.ones((width, height), np.int8)
    crop[:, height // 2 :] = 2
    crop[width // 2 : width // 2 + 2] = 0
    owned = np.zeros((width, height), np.bool_)
    owned[: width // 2] = True
    return FarmGrid((width, height), 0.3048, crop, owned)


@pytest.fixture(scope="module")
def grid() -> FarmGrid:
    return get_farm("miniberry-30").grid()


@pytest.fixture(scope="module")
def environment(grid: FarmGrid) -> Environment:
    return generate_environment(grid, seed=7)


def digest(environment: Environment) -> str:
    sha = hashlib.sha256()
    for disease in ("tylcv", "ccr"):
        for day in environment.days:
            sha.update(np.ascontiguousarray(environment.status(disease, day)).tobytes())
    return sha.hexdigest()


def test_the_same_seed_gives_the_same_epidemics_on_every_machine(
    grid: FarmGrid, environment: Environment
) -> None:
    assert digest(environment) == "5120384d38e20f4e83dd4bb7bb1d05de9f72b5734a60f7705fcf082aa1717f7f"
    assert digest(generate_environment(grid, seed=7)) == digest(environment)
    wide = generate_environment(get_farm("miniberry-100").grid(), seed=7)
    assert digest(wide) == "1d2487ebc6deeddda14262c9a7c690b29a42df2d7d5d7f69a48557abf363a8eb"


def test_the_soil_is_the_same_up_to_rounding(environment: Environment) -> None:
    assert environment.level("soil", 6).dtype == np.float32
    cells = [
        environment.level("soil", 15)[3, 4],
        environment.level("soil", 6)[29, 29],
        environment.level("soil", 0)[0, 17],
    ]
    assert [float(cell) for cell in cells] == pytest.approx([0.996696, 0.963584, 0.347119], abs=1e-5)


def test_a_seed_sequence_and_its_integer_are_the_same_seed(grid: FarmGrid) -> None:
    a = generate_environment(grid, seed=np.random.SeedSequence(7), days=3)
    assert digest(a) == digest(generate_environment(grid, seed=7, days=3))
    b = generate_environment(grid, seed=child_seed(7, "environment"), days=3)
    assert digest(a) != digest(b)


def test_fields_do_not_depend_on_each_other(grid: FarmGrid, environment: Environment) -> None:
    model = PAPER_FIELDS.with_dynamics(tylcv=EpidemicParameters(0.9, 9), soil=SoilParameters(mean_rain=0.02))
    other = generate_environment(grid, seed=7, fields=model)
    np.testing.assert_array_equal(other.onset("ccr"), environment.onset("ccr"))
    assert (other.onset("tylcv") != environment.onset("tylcv")).any()


def test_the_two_diseases_have_their_own_streams() -> None:
    crop = np.ones((40, 40), np.int8)
    everywhere = FarmGrid((40, 40), 0.3048, crop, np.ones((40, 40), np.bool_))
    tomatoes = FarmGrid((40, 40), 0.3048, crop * 2, np.ones((40, 40), np.bool_))
    model = PAPER_FIELDS.with_dynamics(tylcv=TYLCV, ccr=TYLCV)
    ccr = generate_environment(everywhere, seed=1, fields=model).onset("ccr")
    tylcv = generate_environment(tomatoes, seed=1, fields=model).onset("tylcv")
    assert not (np.argwhere(ccr == 0)[:, None] == np.argwhere(tylcv == 0)[None]).all(axis=2).any()


def test_a_day_does_not_depend_on_later_or_kept_days(grid: FarmGrid, environment: Environment) -> None:
    alone = generate_environment(grid, seed=7, days=50, keep_days=[6])
    assert alone.days == (6,)
    np.testing.assert_array_equal(alone.values(6), environment.values(6))


def test_values_follow_from_the_status(environment: Environment) -> None:
    for day in environment.days:
        values = environment.values(day)
        assert values.dtype == np.float32
        assert values.shape == (3, *environment.shape)
        for index, disease in enumerate(("tylcv", "ccr")):
            status = environment.status(disease, day)
            wanted = np.select([status > 0, status == -1], [0.5, 0.0], 1.0)
            np.testing.assert_array_equal(values[index], wanted)
        np.testing.assert_array_equal(values[2], environment.level("soil", day))
        assert 0.0 <= values.min() <= values.max() <= 1.0


def test_values_can_fill_an_array_of_the_caller(environment: Environment) -> None:
    out = np.full((3, *environment.shape), np.nan, np.float32)
    assert environment.values(4, out=out) is out
    np.testing.assert_array_equal(out, environment.values(4))


def test_diseases_stay_on_their_crop_and_cross_the_border_of_the_owner() -> None:
    grid = stripes(60, 40)
    model = PAPER_FIELDS.with_dynamics(tylcv=EpidemicParameters(1.0, 30), ccr=EpidemicParameters(1.0, 30))
    environment = generate_environment(grid, days=60, seed=1, fields=model)
    for disease, crop in zip(("tylcv", "ccr"), (2, 1), strict=True):
        infected = environment.onset(disease) >= 0
        assert (grid.crop[infected] == crop).all()
        assert infected[~grid.owned].any()
        np.testing.assert_array_equal(environment.status(disease, 60) == -2, grid.crop != crop)


@given(st.lists(st.tuples(st.integers(0, 29), st.integers(0, 29)), max_size=40), st.integers(0, 15))
def test_samples_are_the_values_of_the_cells(
    environment: Environment, cells: list[tuple[int, int]], day: int
) -> None:
    ix = np.array([x for x, _ in cells], np.int32)
    iy = np.array([y for _, y in cells], np.int32)
    samples = environment.sample(day, ix, iy)
    assert samples.dtype == np.float32
    np.testing.assert_array_equal(samples, environment.values(day)[:, ix, iy].T)


def test_one_cell_can_be_sampled(environment: Environment) -> None:
    assert environment.sample(6, 3, 4).shape == (1, 3)
    assert environment.sample(6, np.arange(4), 4).shape == (4, 3)


def test_a_cell_alone_is_the_same_as_among_others(environment: Environment) -> None:
    ix, iy = (part.ravel() for part in np.indices(environment.shape))
    together = environment.sample(9, ix, iy)
    alone = [environment.sample(9, ix[k : k + 1], iy[k : k + 1]) for k in range(len(ix))]
    np.testing.assert_array_equal(np.concatenate(alone), together)
    with pytest.raises(EnvironmentDataError, match=r"cell \(30, 0\) is outside"):
        environment.sample(9, np.array([30]), np.array([0]))


@pytest.mark.parametrize(
    ("ix", "iy", "text"),
    [
        (-1, 0, r"\(-1, 0\)"),
        (0, 30, r"\(0, 30\)"),
        ([0, 31], [1, 2], r"\(31, 2\)"),
        (1.5, 2, "integers"),
        ("a", 1, "integers"),
    ],
)
def test_cells_outside_the_farm_are_refused(
    environment: Environment, ix: object, iy: object, text: str
) -> None:
    with pytest.raises(EnvironmentDataError, match=text):
        environment.sample(6, ix, iy)  # type: ignore[arg-type]


@given(st.integers(0, 29), st.integers(0, 29), st.integers(1, 30), st.integers(1, 30), st.integers(0, 15))
def test_a_window_is_a_part_of_the_values(
    environment: Environment, x: int, y: int, width: int, height: int, day: int
) -> None:
    part = slice(x, min(x + width, 30)), slice(y, min(y + height, 30))
    np.testing.assert_array_equal(environment.window(day, *part), environment.values(day)[:, *part])


@pytest.mark.parametrize("part", [slice(0, 31), slice(-1, 4), slice(4, 4), slice(0, 8, 2), slice(5, 2)])
def test_windows_outside_the_farm_are_refused(environment: Environment, part: slice) -> None:
    for x, y, name in ((part, slice(None), "x"), (slice(None), part, "y")):
        with pytest.raises(EnvironmentDataError, match=f"window {name} "):
            environment.window(6, x, y)


def test_days_that_are_not_kept_are_refused(grid: FarmGrid) -> None:
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
def test_bad_days_are_refused(grid: FarmGrid, arguments: dict[str, object]) -> None:
    with pytest.raises(EnvironmentDataError, match=r"days|day .* is not in 0\.\.126"):
        generate_environment(grid, seed=1, **arguments)  # type: ignore[arg-type]


def test_arrays_are_read_only(environment: Environment) -> None:
    for array in (environment.onset("ccr"), environment.level("soil", 6)):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1


def test_arrays_that_do_not_fit_are_refused(environment: Environment) -> None:
    onset = {disease: environment.onset(disease) for disease in ("tylcv", "ccr")}
    with pytest.raises(EnvironmentDataError, match="no day"):
        Environment.of_arrays(PAPER_FIELDS, [], onset, {"soil": {}})
    with pytest.raises(EnvironmentDataError, match="soil of day 1"):
        Environment.of_arrays(PAPER_FIELDS, [1], onset, {"soil": {1: np.zeros((3, 3), np.float32)}})
    with pytest.raises(EnvironmentDataError, match="onset of ccr"):
        wrong = {**onset, "ccr": onset["ccr"].astype(np.int16)}
        Environment.of_arrays(PAPER_FIELDS, [1], wrong, {"soil": {1: environment.level("soil", 1)}})  # type: ignore[dict-item]


def test_progress_ends_at_the_total_and_can_stop_the_work(grid: FarmGrid) -> None:
    calls: list[tuple[int, int]] = []
    generate_environment(grid, seed=1, progress=lambda done, total: calls.append((done, total)))
    assert [done for done, _ in calls] == list(range(1, calls[-1][1] + 1))

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, seed=1, progress=stop)


def test_too_little_memory_is_foreseen(
    grid: FarmGrid, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("geo.system.available_memory", lambda: AvailableMemory(1000, "the test"))
    with pytest.raises(NotEnoughMemoryError, match=r"16 days of 30 x 30 cells needs .* keep fewer days"):
        generate_environment(grid, seed=1)
    with pytest.raises(NotEnoughMemoryError, match=r"1 kB are free \(the test\); take a smaller farm$"):
        generate_environment(grid, seed=1, directory=tmp_path / "e")
    assert list(tmp_path.iterdir()) == []


def test_what_is_needed_on_disk_does_not_grow_with_the_days() -> None:
    few, many = (sum(memory_needed((6000, 5000), days, on_disk=True).values()) for days in (2, 126))
    assert few == many < 1.5e9
    assert sum(memory_needed((6000, 5000), 126).values()) > 126 * 120e6


def test_provenance_names_the_farm_and_the_seed(grid: FarmGrid) -> None:
    environment = generate_environment(grid, seed=child_seed(2**90, "x"), days=1, farm_name="m")
    assert environment.provenance.farm == "m"
    assert environment.provenance.entropy == (str(2**90),)
    assert len(environment.provenance.spawn_key) == 2
    assert environment.provenance.grid_sha256 == grid_digest(grid) != grid_digest(stripes(30, 30))


# Statistics over seeds. The reference numbers come from the published algorithm (whole-array convolution and
# draws) with seeds on host cells, over 200 seeds; the tolerances are at least three standard
# errors of our means.


@pytest.fixture(scope="module")
def many(grid: FarmGrid) -> list[Environment]:
    return [generate_environment(grid, seed=seed) for seed in range(200)]


def test_epidemics_grow_as_in_the_published_algorithm(many: list[Environment]) -> None:
    for disease, wanted in zip(("tylcv", "ccr"), ((6.0, 44.5, 185.0), (4.7, 20.8, 89.5)), strict=True):
        status = np.array([[e.status(disease, day) for day in (1, 6, 15)] for e in many])
        reached = np.mean(np.sum((status > 0) | (status == -1), axis=(2, 3)), axis=0)
        assert reached.tolist() == pytest.approx(wanted, rel=0.08)


def test_soil_becomes_wetter_as_in_the_published_model(many: list[Environment]) -> None:
    means = np.array([[e.level("soil", day).mean() for day in (0, 1, 6, 15)] for e in many])
    assert means.mean(axis=0).tolist() == pytest.approx([0.40, 0.43, 0.55, 0.68], abs=0.03)
    low, high = means.min(axis=0), means.max(axis=0)
    assert ((low < [1, 0.261, 0.442, 0.643]) & (high > [0, 0.261, 0.442, 0.643])).all()


def test_tylcv_and_ccr_are_independent(many: list[Environment]) -> None:
    sizes = np.array([[(e.onset(disease) >= 0).sum() for disease in ("tylcv", "ccr")] for e in many])
    assert abs(np.corrcoef(sizes.T)[0, 1]) < 0.25


def test_seeds_are_spread_evenly_over_the_hosts(grid: FarmGrid, many: list[Environment]) -> None:
    rows = np.concatenate([np.argwhere(e.onset("tylcv") == 0)[:, 0] for e in many])
    counts = np.histogram(rows, bins=6, range=(0, 30))[0]
    assert (
        (counts - rows.size / 6) ** 2 / (rows.size / 6)
    ).sum() < 20.5  # 0.1 % with five degrees of freedom


# Soil


@settings(max_examples=25)
@given(st.integers(2, 50), st.integers(2, 50), st.integers(0, 2**32), st.booleans())
def test_soil_in_blocks_is_the_formula_day_by_day(width: int, height: int, seed: int, square: bool) -> None:
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


def test_a_large_farm_is_computed_in_several_blocks() -> None:
    shape = (90, 4000)
    parameters = SoilParameters(warm_up_days=0, start_humps=40)
    course = parameters.course(shape, 2, np.random.default_rng(4))
    told: list[int] = []
    course.compute(2, np.empty(shape, np.float32), on_piece=lambda: told.append(len(told)))
    assert [rows.start for rows in course.blocks] == [0, 32, 64]
    assert len(told) == course.pieces == 3


def test_a_shower_has_its_mean_over_the_farm() -> None:
    shape = (40, 25)
    parameters = SoilParameters()
    weather = draw_weather(shape, 30, parameters, np.random.default_rng(4))
    rainy = [shower for shower in weather.showers if shower is not None]
    assert 20 < len(rainy) < 40
    for shower in rainy:
        factors = rain_factors(shower, shape, parameters)
        assert factors is not None
        rain = factors[0] @ factors[1]
        assert rain.min() >= 0
        assert rain.mean() == pytest.approx(shower.mean_rain)


def test_a_hump_has_the_covariance_of_the_paper() -> None:
    shape = (400, 240)
    along_x, along_y = hump_factors(np.array([[0, 0]]), shape, SoilParameters())
    for profile, side in ((along_x[:, 0], 400), (along_y[0], 240)):
        cells = np.arange(side)
        mean = (profile * cells).sum() / profile.sum()
        deviation = np.sqrt((profile * (cells - mean) ** 2).sum() / profile.sum())
        assert profile.sum() == pytest.approx(1.0, abs=0.01)
        assert mean == pytest.approx(side / 2, abs=1)
        assert deviation == pytest.approx(side / 8, rel=0.01)


def test_humps_beside_the_farm_bring_no_rain() -> None:
    parameters = SoilParameters(shower_humps=1)
    weather = draw_weather((10, 10), 400, parameters, np.random.default_rng(2))
    results = [rain_factors(s, (10, 10), parameters) for s in weather.showers if s is not None]
    dry = sum(result is None for result in results)
    assert 0.3 < dry / len(results) < 0.6  # 7 of 16 places


def test_without_rain_the_soil_dries() -> None:
    parameters = SoilParameters(rain_probability=0.0)
    environment = generate_environment(
        stripes(20, 20), days=3, seed=1, fields=PAPER_FIELDS.with_dynamics(soil=parameters)
    )
    np.testing.assert_allclose(
        environment.level("soil", 3), environment.level("soil", 0) * 0.96**3, rtol=1e-5
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"evaporation": 1.2},
        {"rain_probability": -0.1},
        {"mean_rain": -1},
        {"mean_rain": float("nan")},
        {"shower_humps": 0},
        {"start_humps": -1},
        {"warm_up_days": -1},
        {"spread": 0},
    ],
)
def test_bad_soil_parameters_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(EnvironmentDataError, match="soil: "):
        SoilParameters(**changes)  # type: ignore[arg-type]


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch, grid: FarmGrid, tmp_path: Path) -> None:
    alone = generate_environment(grid, seed=5, threads=1)
    monkeypatch.setattr("sensors.environment.generate._THREADS_FROM_CELLS", 0)
    calls: list[int] = []
    together = generate_environment(grid, seed=5, threads=4, progress=lambda done, _total: calls.append(done))
    stored = generate_environment(grid, seed=5, threads=2, directory=tmp_path / "e")
    for other in (together, stored):
        for disease in ("tylcv", "ccr"):
            np.testing.assert_array_equal(alone.onset(disease), other.onset(disease))
        for day in alone.days:
            np.testing.assert_array_equal(alone.level("soil", day), other.level("soil", day))
    assert calls == sorted(calls)
    assert calls[-1] == 2 * 15 + 16


def test_threads_end_when_the_caller_stops(monkeypatch: pytest.MonkeyPatch, grid: FarmGrid) -> None:
    monkeypatch.setattr("sensors.environment.generate._THREADS_FROM_CELLS", 0)
    before = threading.active_count()

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, seed=5, threads=2, progress=stop)
    assert threading.active_count() == before


@settings(max_examples=8)
@given(st.lists(st.integers(0, 8), min_size=1, max_size=5), st.integers(0, 2**32))
def test_the_soil_is_the_same_in_any_portions(days: list[int], seed: int) -> None:
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


# The full farm


@pytest.mark.slow
def test_day_six_of_waterberry() -> None:
    grid = get_farm("waterberry").grid()
    environment = generate_environment(grid, days=6, seed=3, keep_days=[6])
    owned = environment.values(6)[0][grid.tomato]
    assert 0.9 < owned.mean() < 1.0
    assert 0.5 in owned


@pytest.mark.parametrize("shape", [(40, 40), (60, 25)])
def test_coarse_soil_of_a_day_does_not_depend_on_the_other_days(shape):
    def simulated(days):
        rngs = [np.random.default_rng(seed) for seed in range(3)]
        return SoilParameters().simulate_coarse(shape, days, 20, rngs)

    together = simulated((0, 3, 7))
    alone = np.concatenate([simulated((day,)) for day in (0, 3, 7)])
    np.testing.assert_array_equal(together, alone)
