"""The information model's form, and its tiles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.errors import EstimatorError
from sensors.scoring.information import (
    TILE_CELLS,
    InformationModel,
    LazyProbabilities,
    tile_shape,
    tiles_of_boxes,
)


def test_uniform_model():
    model = InformationModel.uniform((2, 3), value=(1.0, 0.5, 0.0), uncertainty=0.25)
    assert model.shape == (2, 3)
    assert model.of("ccr").tolist() == [[0.5] * 3] * 2
    assert model.value.dtype == model.uncertainty.dtype == np.float32
    assert (model.uncertainty == 0.25).all()
    model.of("soil")[0, 0] = 0.75  # a view
    assert model.value[2, 0, 0] == 0.75
    with pytest.raises(EstimatorError, match=r"unknown field 'rain': choose tylcv, ccr, soil"):
        model.of("rain")


@pytest.mark.parametrize(
    ("value", "uncertainty", "message"),
    [
        (np.zeros((2, 4, 4), np.float32), np.zeros((3, 4, 4), np.float32), r"value is float32\[2, 4, 4\]"),
        (np.zeros((3, 4, 4)), np.zeros((3, 4, 4), np.float32), "value is float64"),
        (np.zeros((3, 4, 4), np.float32), np.zeros((3, 4, 5), np.float32), "differ in shape"),
    ],
)
def test_wrong_arrays_are_refused(value, uncertainty, message):
    with pytest.raises(EstimatorError, match=message):
        InformationModel(value, uncertainty)


def test_changed_tiles_have_the_farms_tiles():
    model = InformationModel.uniform((130, 64), value=(1, 1, 0), uncertainty=1)
    InformationModel(model.value, model.uncertainty, np.zeros((3, 1), bool), 4)
    for changed in (np.zeros((2, 1), bool), np.zeros((3, 1), int)):
        with pytest.raises(EstimatorError, match=r"changed is .*expected bool\[3, 1\]"):
            InformationModel(model.value, model.uncertainty, changed)


def test_probabilities_are_of_fields_and_copied():
    zeros = np.zeros((3, 4, 5), np.float32)
    asked = []

    def compute(disease, columns):
        asked.append(disease)
        return zeros[:, columns] + len(asked)

    lazy = LazyProbabilities(("tylcv", "ccr"), compute)
    model = InformationModel(zeros, zeros, probabilities=lazy)
    assert (asked, len(lazy), "soil" in lazy, "ccr" in lazy) == ([], 2, False, True)
    copy = model.copy()
    assert [copy.probabilities[name][0, 0, 0] for name in ("tylcv", "ccr")] == [1.0, 2.0]
    assert model.probabilities["ccr"][0, 0, 0] == 3.0
    assert model.probabilities_in("ccr", slice(1, 3)).shape == (3, 2, 5) and asked[3:] == ["ccr"]
    assert (copy.probabilities_in("tylcv", slice(1, 3)) == 1.0).all()
    for of, name in ((model, "soil"), (InformationModel(zeros, zeros), "ccr")):
        with pytest.raises(EstimatorError, match=f"no class probabilities of '{name}'"):
            of.probabilities_in(name, slice(None))
    with pytest.raises(EstimatorError, match="probabilities: unknown field 'rust': choose tylcv, ccr, soil"):
        InformationModel(zeros, zeros, probabilities={"rust": zeros})


def test_the_expected_loss_is_made_when_asked_for_and_copied():
    zeros = np.zeros((3, 4, 5), np.float32)
    assert InformationModel(zeros, zeros).expected_loss is None
    asked = []
    model = InformationModel(zeros, zeros, loss_map=lambda: asked.append(1) or zeros + len(asked))
    assert asked == []
    copy = model.copy()
    assert [model.expected_loss[0, 0, 0], copy.expected_loss[0, 0, 0]] == [2.0, 1.0]
    assert copy.expected_loss is copy.expected_loss
    wrong = r"expected_loss is float32\[3, 4, 4\], expected float32\[3, 4, 5\]"
    with pytest.raises(EstimatorError, match=wrong):
        InformationModel(zeros, zeros, loss_map=zeros[..., 1:])
    with pytest.raises(EstimatorError, match=wrong):
        _ = InformationModel(zeros, zeros, loss_map=lambda: zeros[..., 1:]).expected_loss


shapes = st.tuples(st.integers(1, 300), st.integers(1, 300))
boxes = st.lists(st.tuples(*[st.integers(-100, 400)] * 4), max_size=6)


def painted(shape, corners):
    cells = np.zeros(shape, bool)
    for x0, x1, y0, y1 in corners:
        cells[max(x0, 0) : max(x1, 0), max(y0, 0) : max(y1, 0)] = True
    return cells


@given(shapes, boxes)
def test_the_tiles_are_those_that_hold_a_cell_of_a_box(shape, corners):
    cells = painted(shape, corners)
    tiles = tiles_of_boxes(shape, *np.array(corners, int).reshape(-1, 4).T)
    expected = np.zeros(tile_shape(shape), bool)
    for x, y in np.argwhere(cells):
        expected[x // TILE_CELLS, y // TILE_CELLS] = True
    np.testing.assert_array_equal(tiles, expected)
