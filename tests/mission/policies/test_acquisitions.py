from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from policy_observations import observation
from shapely import box
from sweeps import sweep

from geo import get_farm
from mission.errors import PlanningError
from mission.policies.acquisition import (
    ACQUISITIONS,
    Balanced,
    CountedCells,
    SummedMap,
    WithCorrelationLength,
    WithCoverage,
    expected_loss,
    make_acquisition,
    variance,
)
from mission.policies.observation import Event
from mission.policies.planning_grid import PlanningGrid
from sensors.observations import Observations
from sensors.scoring.information import InformationModel

TOMATO, STRAWBERRY = (5, 8), (5, 2)
SEEN = Observations([5], [8], [0.0], [6], [[1.0, 1.0, 0.4]])


def _observation(model, seen=None):
    return observation(farm="miniberry-10", event=Event.PERIOD, model=model, seen=seen)


def _believed(healthy, infected, lost, value):
    shape = get_farm("miniberry-10").grid().shape
    model = InformationModel.uniform(shape, value=(value, value, 0.4), uncertainty=0.0)
    classes = np.empty((3, *shape), np.float32)
    classes[:] = np.array([healthy, infected, lost], np.float32)[:, None, None]
    return replace(model, probabilities={"tylcv": classes, "ccr": classes})


@pytest.mark.parametrize("name", sorted(ACQUISITIONS))
def test_an_acquisition_is_a_map_not_negative_by_weight_of_field(name):
    shape = get_farm("miniberry-10").grid().shape
    model = InformationModel.uniform(shape, value=(0.8, 0.8, 0.4), uncertainty=0.3)
    values = make_acquisition(name)(_observation(model))[:]
    assert values.dtype == np.float32 and values.shape == shape and (values >= 0).all()
    assert values[TOMATO] > values[STRAWBERRY] > 0


def test_expected_loss_is_that_of_the_score():
    values = expected_loss(_observation(_believed(0.5, 0.3, 0.2, 0.6)))
    loss = 0.5 * 0.4**2 + 10 * (0.3 * 0.1**2 + 0.2 * 0.6**2)
    assert values[TOMATO] == pytest.approx(1.0 * loss) and values[STRAWBERRY] == pytest.approx(0.2 * loss)


@sweep(few=40, many=200)
@given(st.data())
def test_a_sum_is_the_same_whatever_part_is_read(data):
    shape = data.draw(st.tuples(st.integers(1, 9), st.integers(1, 9)), "shape")
    number = st.floats(0, 10, width=32)
    parts = tuple(
        (
            np.float32(data.draw(number)),
            data.draw(arrays(np.bool_, shape)),
            data.draw(arrays(data.draw(st.sampled_from([np.float32, np.float64])), shape, elements=number)),
        )
        for _ in range(data.draw(st.integers(0, 3)))
    )
    whole = np.zeros(shape, np.float32)
    for weight, mask, values in parts:
        whole += mask * (weight * values)
    counted = tuple((weight, CountedCells.of(mask), values) for weight, mask, values in parts)
    summed, start = SummedMap(counted, shape), data.draw(st.integers(0, 9), "start")
    columns = slice(start, start + data.draw(st.integers(1, 9), "columns"))
    assert summed[columns].tobytes() == whole[columns].tobytes()
    assert np.asarray(summed).tobytes() == whole.tobytes()
    assert summed[0, 0] == whole[0, 0] and summed[0, 0].dtype == np.float32
    block = PlanningGrid(np.ones([-(-side // 2) for side in shape], np.bool_), 2.0, 2, True, box(0, 0, 9, 9))
    assert block.pooled(summed).tobytes() == block.pooled(whole).tobytes()


def test_nothing_is_worth_anything_where_all_is_known():
    model = _believed(1.0, 0.0, 0.0, 1.0)
    for acquisition in ACQUISITIONS.values():
        assert acquisition(_observation(model))[:].max() == pytest.approx(0.0, abs=1e-6)


def test_coverage_grows_with_the_distance_from_what_was_seen_today():
    nothing = WithCoverage(lambda observation: np.zeros(observation.model.shape, np.float32), 0.5, reach=2.0)
    model = _believed(1.0, 0.0, 0.0, 1.0)
    values = nothing(_observation(model, SEEN))
    assert values[TOMATO] == 0.0
    assert values[7, 8] == pytest.approx(0.5 * (1 - np.exp(-1.0))) and values[9, 8] > values[7, 8]
    assert nothing(_observation(model))[TOMATO] == pytest.approx(0.5)
    yesterday = Observations([5], [8], [0.0], [5], [[1.0, 1.0, 0.4]])
    assert nothing(_observation(model, yesterday))[TOMATO] == pytest.approx(0.5)


def test_a_pass_over_a_smooth_field_saves_the_loss_of_a_swath():
    shape = get_farm("miniberry-10").grid().shape
    model = InformationModel.uniform(shape, value=(1.0, 1.0, 0.4), uncertainty=0.5)
    model.uncertainty[2] *= 2.0
    told = _observation(model)
    plain = variance(told)[:]
    diseases = variance(replace(told, weights=replace(told.weights, field=(*told.weights.field[:2], 0.0))))[:]

    def values(reach, strip=2.0, beyond=9):
        model = replace(told.model, correlation_length=reach)
        return WithCorrelationLength(variance, strip, beyond)(replace(told, model=model))[:]

    swath = np.sqrt(np.pi) * 5.0 / 2.0
    assert np.allclose(values((3.0, 3.0, 5.0)), diseases + swath * (plain - diseases))
    assert np.allclose(values((3.0, 3.0, 500.0)), diseases + 10.0 / 2.0 * (plain - diseases))
    for same in (values((3.0, 3.0, 0.1)), values((0.0, 0.0, 5.0), beyond=10), values(None)):
        assert np.array_equal(same, plain)


def test_unknown_names_are_refused():
    with pytest.raises(PlanningError, match="unknown acquisition 'luck': choose expected-loss"):
        make_acquisition("luck")


def test_a_light_disease_counts_at_least_a_part_of_the_weightiest():
    told = _observation(InformationModel.uniform((10, 10), value=(1.0, 1.0, 0.4), uncertainty=1.0))
    plain, balanced = (Balanced(variance, least)(told)[:] for least in (0.0, 0.5))
    tomatoes, strawberries = (field.mask(told.farm.grid()) for field in told.fields.diseases)
    assert np.array_equal(plain, variance(told))
    assert np.allclose(balanced[tomatoes], plain[tomatoes])
    soil = told.weights.field[2]
    assert np.allclose(plain[strawberries], 0.2 + soil) and np.allclose(balanced[strawberries], 0.5 + soil)
