from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geo.farms import get_farm
from sensors.dynamics.epidemic import outbreak_of
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring import information
from sensors.scoring.information import InformationModel, least_sick
from wbf_mission.maps import block_sums, blocks
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import FieldMap, field_maps, pixel_sums
from wbf_mission.maps.report import brief, gamma_interval, report_of_maps

FARM = get_farm("miniberry-30")


def look(cells, values):
    """Return exact observations of cells."""
    x, y = np.array(cells, np.int32).reshape(-1, 2).T
    n = len(x)
    return Observations(x, y, np.arange(n), np.full(n, 6), np.array(values, np.float32).reshape(n, 3))


def model_of(value, uncertainty=0.1):
    value = np.asarray(value, np.float32)
    return InformationModel(value, np.full_like(value, uncertainty))


def farm_report(model, observations, **given):
    return report_of_maps(FARM, field_maps(FARM, model, observations, **given))


def healthy():
    value = np.ones((3, *FARM.grid().shape), np.float32)
    value[2] = 0.5
    return value


@pytest.mark.kernel
@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 9), st.integers(0, 2**31))
def test_sums_of_pixels_are_those_of_plain_loops(width, height, pixel, seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((width, height)) < 0.6
    value = rng.random((width, height), np.float32)
    shape = -(-width // pixel), -(-height // pixel)
    sums, least, squares = np.zeros((*shape, 4)), np.full(shape, np.inf), np.zeros(shape)
    block_sums.sum_pixels(mask, value, pixel, sums, least)
    block_sums.sum_squares(mask, value, pixel, squares)
    for i in range(shape[0]):
        for j in range(shape[1]):
            part = (slice(i * pixel, (i + 1) * pixel), slice(j * pixel, (j + 1) * pixel))
            v = value[part][mask[part]].astype(np.float64)
            expected = [len(v), (1 - v).sum(), (v * (1 - v)).sum(), (v < 0.75).sum()]
            np.testing.assert_allclose(sums[i, j], expected, atol=1e-9)
            assert least[i, j] == v.min(initial=np.inf)
            assert squares[i, j] == pytest.approx((v**2).sum())


def test_maps_from_strips_of_probabilities_are_those_of_the_whole_farm_to_the_last_bit(monkeypatch):
    """Strips are of 9 columns, as pixels are of 3 cells."""
    monkeypatch.setattr(information, "_STRIP_COLUMNS", 10)
    farm = get_farm("miniberry-100")
    grid = replace(MapGrid.of(farm), pixel=3)
    farm_x, farm_y = farm.grid().shape
    rng = np.random.default_rng(3)
    sick = (0.3 * rng.random((farm_x, farm_y))).astype(np.float32)
    classes = {"tylcv": np.stack([1.0 - sick, 0.5 * sick, 0.5 * sick])}
    value = np.stack([1.0 - sick, np.ones_like(sick), np.full_like(sick, 0.5)])
    mask = PAPER_FIELDS["tylcv"].mask(farm.grid())
    x, y = (int(cell[0]) for cell in np.nonzero(mask))
    model = InformationModel(value, np.full_like(value, 0.1), probabilities=classes)
    made = field_maps(farm, model, look([(x, y)], [(1.0, np.nan, np.nan)]), grid=grid)[0]
    sums, _ = pixel_sums(grid, mask, classes["tylcv"][0])
    np.testing.assert_array_equal(made.total, sums[..., blocks.ILLNESS])
    unseen = mask.copy()
    unseen[x, y] = False
    unseen &= sick >= least_sick(1.0 - classes["tylcv"][0][unseen])
    np.testing.assert_array_equal(made.may_be_sick, pixel_sums(grid, unseen, value[0])[0][..., blocks.COUNT])


@pytest.mark.kernel
@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**31))
def test_sums_of_single_cells_are_those_of_the_compiled_loops_to_the_last_bit(width, height, seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((width, height)) < 0.6
    value = rng.choice(np.array([0.0, 0.75, 1.0, np.nan, *rng.random(5)], np.float32), (width, height))
    begun, lowered = rng.random((width, height, 4)), rng.random((width, height))
    made = []
    for how in (block_sums, blocks):
        sums, least, squares = begun.copy(), lowered.copy(), lowered.copy()
        how.sum_pixels(mask, value, 1, sums, least)
        how.sum_squares(mask, value, 1, squares)
        made.append((sums, least, squares))
    for compiled, plain in zip(*made, strict=True):
        np.testing.assert_array_equal(plain, compiled)


@pytest.mark.parametrize("name", ["miniberry-10", "waterberry"])
def test_blocks_cover_the_farm_and_have_names_of_their_own(name):
    farm = get_farm(name)
    grid = MapGrid.of(farm)
    columns, rows = grid.blocks
    assert max(columns, rows) <= 24
    assert (columns - 1) * grid.block < farm.width_cells <= columns * grid.block
    assert (rows - 1) * grid.block < farm.height_cells <= rows * grid.block
    names = {grid.name(i, j) for i in range(columns) for j in range(rows)}
    assert len(names) == columns * rows
    pixels = np.arange(np.prod(grid.pixels), dtype=float).reshape(grid.pixels)
    by_block = grid.by_block(pixels)
    assert by_block.shape == grid.blocks
    assert by_block.sum() == pixels.sum()


def test_sick_plants_that_were_seen_are_counted_and_the_others_expected():
    tomato = np.argwhere(PAPER_FIELDS["tylcv"].mask(FARM.grid()))
    seen = look(tomato[:4], [[0.5, 1, 0.5], [0.0, 1, 0.5], [1, 1, 0.5], [1, 1, 0.5]])
    value = healthy()
    x, y = tomato[10:20].T
    value[0, x, y] = 0.4  # ten plants that are sick without doubt, by 0.6 each
    report = farm_report(model_of(value), seen)
    tylcv = report.fields[0]
    assert (tylcv.name, tylcv.cells, tylcv.seen, tylcv.seen_sick) == ("tylcv", len(tomato), 4, 2)
    # How far a sick plant lies below 1 is that of simulated outbreaks before, and 0.5 and 1 were seen.
    before = outbreak_of(PAPER_FIELDS["tylcv"].epidemic, FARM.grid().shape, 6).illness
    others = 10 * min(1.0, 0.6 / ((10 * before + 1.5) / 12.0))
    assert tylcv.expected * len(tomato) == pytest.approx(2 + others, rel=1e-5)
    assert 2 / len(tomato) <= tylcv.low < tylcv.expected < tylcv.high < 1


def test_probabilities_are_taken_as_they_are():
    probabilities = np.zeros((3, *FARM.grid().shape), np.float32)
    probabilities[0], probabilities[1] = 0.75, 0.25
    model = replace(model_of(healthy()), probabilities={"tylcv": probabilities, "ccr": probabilities})
    report = farm_report(model, look([], []))
    assert [field.expected for field in report.fields[:2]] == pytest.approx([0.25, 0.25])


def test_the_worst_block_is_told_with_its_name_and_place():
    grid = MapGrid.of(FARM)
    value = healthy()
    tomato = PAPER_FIELDS["tylcv"].mask(FARM.grid())
    i, j = next(
        (i, j)
        for i in range(grid.blocks[0])
        for j in range(grid.blocks[1])
        if tomato[i * grid.block : (i + 1) * grid.block, j * grid.block : (j + 1) * grid.block].all()
    )
    value[0, i * grid.block : (i + 1) * grid.block, j * grid.block : (j + 1) * grid.block] = 0.0
    report = farm_report(model_of(value), look([], []))
    worst = report.fields[0].blocks[0]
    assert worst.name == grid.name(i, j)
    assert worst.expected == 1.0
    x, y = FARM.frame.from_wgs84(worst.latitude_deg, worst.longitude_deg)
    assert (x, y) == pytest.approx((worst.x_m, worst.y_m), abs=1e-3)
    assert int(worst.x_m / FARM.cell_size_m) // grid.block == i
    assert int(worst.y_m / FARM.cell_size_m) // grid.block == j
    assert f"worst blocks {worst.name} (" in report.rows()["TYLCV (tomato)"]


def test_the_last_reading_of_a_cell_counts():
    cell = np.argwhere(PAPER_FIELDS["tylcv"].mask(FARM.grid()))[0]
    seen = look([cell, cell], [[1.0, 1, 0.3], [0.5, 1, 0.3]])
    assert farm_report(model_of(healthy()), seen).fields[0].seen_sick == 1
    assert farm_report(model_of(healthy()), seen[:1]).fields[0].seen_sick == 0


@given(st.floats(0, 1e6), st.floats(0, 1e6))
def test_intervals_of_counts_are_not_negative_and_hold_the_mean(mean, variance):
    low, high = gamma_interval(mean, variance)
    assert 0.0 <= low <= high
    assert low <= mean <= high
    if mean > 1 and mean < variance < mean**2:
        assert low < mean < high


def test_cells_that_err_as_one_are_no_more_than_there_are():
    cells = np.array([[4.0, 100.0]])
    one = FieldMap(
        PAPER_FIELDS["tylcv"],
        MapGrid.of(FARM),
        cells,
        total=cells / 2,
        least=np.zeros((1, 2)),
        variance=cells / 4,
        seen=np.zeros((1, 2)),
        seen_sick=np.zeros((1, 2)),
        finds=np.empty((0, 2), np.int32),
        together=25.0,
    )
    # A block of 4 cells is sick or healthy as a whole; in one of 100 there are four that differ.
    np.testing.assert_allclose(one.deviation, [[0.5, 0.25]])


@pytest.mark.parametrize("estimator", ["point", "adaptive-disk", "authors-ad"])
def test_who_does_not_say_how_sure_it_is_has_no_figure_of_what_nobody_saw(estimator):
    """None is healthy, and none sick, because nobody looked; a disk speaks of its neighbours."""
    tomatoes = np.argwhere(PAPER_FIELDS["tylcv"].mask(FARM.grid()))
    seen = look(tomatoes[:4], [[1.0, 1, 0.1], [0.5, 1, 0.2], [1.0, 1, 0.3], [1.0, 1, 0.8]])
    made = make_estimator(estimator).fit(FARM.grid(), seen)
    report = farm_report(made.predict(), seen, states_deviation=made.states_deviation)
    told = {field.name: field for field in report.fields}
    assert {name: field.cells for name, field in told.items()} == {"tylcv": 4, "soil": 4}
    assert told["tylcv"].expected == 0.25 and told["soil"].expected == pytest.approx(0.35)
    for field in report.fields:
        assert field.low is None and field.high is None
        assert sum(block.cells for block in field.blocks) <= field.seen == field.cells
        assert "looked at" in report.rows()[field.title] and "90 %" not in report.rows()[field.title]
        assert "in the observed cells" in brief(field)
    nothing = look([], [])
    assert not farm_report(made.predict(), nothing, states_deviation=False).fields


def test_readings_beyond_their_range_count_as_its_ends():
    tomatoes = np.argwhere(PAPER_FIELDS["tylcv"].mask(FARM.grid()))
    seen = look(tomatoes[:2], [[1.0, 1, 1.4], [1.0, 1, -0.4]])
    report = farm_report(model_of(healthy()), seen, states_deviation=False)
    assert report.fields[-1].expected == 0.5
