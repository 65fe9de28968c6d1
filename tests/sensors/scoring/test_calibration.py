"""How far what an estimate states can be trusted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sensors.errors import EstimatorError
from sensors.fields import PAPER_FIELDS
from sensors.scoring.expected import calibration, of_classes
from sensors.scoring.information import HELD, InformationModel, least_sick

PROBABILITIES = hnp.arrays(np.float32, st.integers(1, 60), elements=st.floats(0.0, 1.0, width=32))


def model_of(sick, deviation=0.1, **given):
    """Return a model of two rows with these probabilities of being sick, of all of whom half is lost."""
    values = np.full((3, 2, len(sick)), 0.5, np.float32)
    classes = np.broadcast_to(np.stack([1.0 - sick, 0.5 * sick, 0.5 * sick])[:, None], (3, 2, len(sick)))
    probabilities = {name: classes.astype(np.float32) for name in ("tylcv", "ccr")}
    return InformationModel(values, np.full_like(values, deviation), probabilities=probabilities, **given)


@settings(max_examples=40, deadline=None)
@given(PROBABILITIES)
def test_the_plants_that_may_be_sick_hold_nine_tenths_of_the_expected_and_none_too_many(sick):
    least = least_sick(sick)
    doubtful = sick[(sick > 0.0) & (sick < 1.0 - 1e-6)].astype(np.float64)
    held = doubtful[doubtful >= np.float32(least)]
    assert held.sum() >= (HELD - 1e-5) * doubtful.sum()
    if len(doubtful):
        # Without the plants of the least probability in it, it held less.
        assert held[held > held.min()].sum() < HELD * doubtful.sum()
    assert (sick[sick >= 1.0] >= least).all()


@settings(max_examples=40, deadline=None)
@given(PROBABILITIES, st.integers(0, 2**32 - 1))
def test_the_measures_lie_in_their_ranges_and_do_not_depend_on_the_order(probability, seed):
    rng = np.random.default_rng(seed)
    sick = rng.random(len(probability)) < 0.5
    told = of_classes(probability, sick)
    assert all(0.0 <= told[name] <= 1.0 for name in ("brier", "ece"))
    assert told["log_loss"] >= 0.0
    order = rng.permutation(len(sick))
    again = of_classes(probability[order], sick[order])
    assert list(again) == list(told)
    np.testing.assert_allclose(list(again.values()), list(told.values()), atol=1e-9)
    # A forecast of what is has no error at all.
    right = of_classes(sick.astype(float), sick)
    assert right["brier"] == right["ece"] == right["log_loss"] == 0.0


def test_right_probabilities_are_calibrated_and_hold_nine_tenths_of_the_sick():
    rng = np.random.default_rng(3)
    probability = rng.beta(0.2, 2.0, 200_000)
    told = of_classes(probability, rng.random(200_000) < probability)
    assert told["ece"] < 0.005
    assert told["sick_held"] == pytest.approx(HELD, abs=0.01)
    assert told["healthy_held"] < 0.5
    wrong = of_classes(np.sqrt(probability), rng.random(200_000) < probability)
    assert wrong["ece"] > 0.1
    assert wrong["log_loss"] > told["log_loss"]


def test_only_the_cells_that_count_are_measured():
    sick = np.array([0.1, 0.9, 0.5, 0.5])
    truth = np.ones((3, 2, 4), np.float32)
    truth[:2, :, 1], truth[2] = 0.5, 0.55
    unseen = np.zeros((3, 2, 4), bool)
    unseen[:, 0, :2] = True
    told = calibration(model_of(sick), truth, unseen, PAPER_FIELDS)
    assert told["tylcv_brier"] == told["ccr_brier"] == pytest.approx(0.01, abs=1e-6)
    assert told["tylcv_sick_held"] == 1.0
    assert told["tylcv_healthy_held"] == 0.0
    assert told["soil_held"] == 1.0
    assert told["soil_error"] == pytest.approx(0.25, rel=1e-4)
    unseen[0] = False
    assert not any(
        key.startswith("tylcv") for key in calibration(model_of(sick), truth, unseen, PAPER_FIELDS)
    )


def test_without_probabilities_the_normal_distribution_counts_and_without_deviation_nothing():
    value = np.full((3, 1, 2), 0.75, np.float32)
    model = InformationModel(value, np.full_like(value, 0.2))
    truth, unseen = np.ones((3, 1, 2), np.float32), np.ones((3, 1, 2), bool)
    told = calibration(model, truth, unseen, PAPER_FIELDS)
    assert told["tylcv_brier"] == pytest.approx(0.25)
    assert "tylcv_sick_held" not in told
    assert calibration(model, truth, unseen, PAPER_FIELDS, states_deviation=False) == {}
    with pytest.raises(EstimatorError, match=r"calibration: model .* differ in shape"):
        calibration(model, truth[:, :, :1], unseen, PAPER_FIELDS)


def test_a_model_marks_the_plants_that_may_be_sick():
    model = model_of(np.array([1.0, 0.6, 0.3, 0.06, 0.04, 0.0]))
    assert model.may_be_sick("ccr")[0].tolist() == [True, True, True, False, False, False]
    some = np.zeros((2, 6), bool)
    some[0, 3:] = True
    assert model.may_be_sick("ccr", some).tolist() == [[False] * 3 + [True, True, False], [False] * 6]
    with pytest.raises(EstimatorError, match="there are no class probabilities of 'soil'"):
        model.may_be_sick("soil")
