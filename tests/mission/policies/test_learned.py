"""The learned policy: its network, what it looks at, and where it leads."""

import numpy as np
import pytest

from geo import get_farm
from mission.errors import PlanningError
from mission.policies.learned import Learned
from mission.policies.network import Network, NetworkView
from sensors.fields import PAPER_FIELDS
from sensors.scoring.score import PAPER_WEIGHTS
from wbf_mission import fly, load_scenario


def written(path, **arrays):
    np.savez(path, **arrays)
    return path


def test_a_network_is_its_layers_with_rectifiers_between(tmp_path):
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(4, 3)), rng.normal(size=(2, 4))
    path = written(
        tmp_path / "net.npz", weight_0=first, bias_0=np.ones(4), weight_1=second, bias_1=np.array([0.0, -1.0])
    )
    network = Network.load(path, 3, 2)
    rows = rng.normal(size=(5, 3)).astype(np.float32)
    expected = [second @ np.maximum(first @ row + 1.0, 0.0) + [0.0, -1.0] for row in rows]
    assert np.allclose(network(rows), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        ({}, "it gives 3 numbers instead of 2"),
        ({"weight_0": np.ones((2, 4)), "bias_0": np.ones(2)}, "layer 1 does not take 3 numbers"),
        ({"weight_0": np.ones((2, 3)), "bias_0": np.ones(3)}, "layer 1 does not take 3 numbers"),
        ({"weight_0": np.full((2, 3), np.nan), "bias_0": np.ones(2)}, "is not finite"),
        ({"weight_0": np.ones((1, 3)), "bias_0": np.ones(1)}, "it gives 1 numbers instead of 2"),
        ({"weight_0": np.ones((2, 3)), "other": np.ones(2)}, "cannot be read"),
        ({"weight_0": np.array([[{}]], object), "bias_0": np.ones(1)}, "cannot be read"),
    ],
)
def test_what_is_no_such_network_is_refused_in_one_line(tmp_path, arrays, text):
    path = written(tmp_path / "net.npz", **arrays)
    with pytest.raises(PlanningError, match=text) as caught:
        Network.load(path, 3, 2)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_none_or_not_there_is_refused(tmp_path):
    (tmp_path / "text.npz").write_text("weights")
    for name in ("text.npz", "missing.npz"):
        with pytest.raises(PlanningError, match="cannot be read"):
            Learned(network=str(tmp_path / name))


def test_the_view_shows_what_is_near_far_and_left():
    farm = get_farm("miniberry-30")
    view = NetworkView(farm, PAPER_FIELDS, PAPER_WEIGHTS)
    value = np.ones((2, 3, 30, 30), np.float32)
    value[:, 2] = 0.0
    seen = np.zeros((2, 30, 30), np.float32)
    cells = np.array([[0, 0], [20, 10]])
    x, y = np.argwhere(PAPER_FIELDS.masks(farm.grid())[0])[0]
    value[1, 0, x, y], seen[1, 20, 12] = 0.0, 1.0
    shown = view(value, seen, cells, np.array([1.0, 0.25], np.float32))
    assert shown.shape == (2, NetworkView.size)
    near = shown[:, : 4 * 49].reshape(2, 4, 7, 7)
    far = shown[:, 4 * 49 : 4 * 130].reshape(2, 4, 9, 9)
    # The first stands in the corner: what lies beyond the farm counts as seen, and as beyond.
    assert near[0, 3, :3].all()
    assert near[0, 0, :3].all()
    assert not near[0, 3, 3:, 3:].any()
    assert near[1, 0, 3, 5] == 1.0
    assert near[1, 0].sum() == 1.0
    assert far[1, 0, 4, 5] == pytest.approx(1.0 / 9.0)
    whole = shown[:, 4 * 130 : -3].reshape(2, 3, 6, 6)
    assert whole[1, 1].sum() == pytest.approx(1.0 / 25.0)
    assert shown[:, -3:].tolist() == pytest.approx(
        np.array([[0.5 / 30, 0.5 / 30, 1.0], [20.5 / 30, 0.35, 0.25]])
    )
    alone = view(value[1:], seen[1:], cells[1:], np.array([0.25], np.float32))
    assert np.array_equal(alone[0], shown[1])


def test_its_flights_use_the_budget_and_are_the_same_again():
    scenario = load_scenario("WBF/Miniberry-10-v1")
    first, second = (fly(scenario, policy="learned", estimator="adaptive-disk") for _ in range(2))
    assert first.outcome.is_good
    assert len(first.observations) >= 38
    assert first.score == second.score
    assert np.array_equal(first.observations.x, second.observations.x)


def test_two_vehicles_share_the_farm():
    result = fly(load_scenario("WBF/Miniberry-30-Robots-2-v1"), policy="learned", estimator="adaptive-disk")
    assert all(one.outcome.is_good for one in result.flights)
    assert len(result.observations) > 330
