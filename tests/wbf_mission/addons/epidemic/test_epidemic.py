"""The estimator that knows the score and the diseases, and its parts."""

import errno
import os
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from write_networks import DAYS, FARMS

from geo.farms import get_farm
from geo.grid import FarmGrid
from geo.system import CacheWarning
from sensors.dynamics.epidemic import simulate_outbreak
from sensors.environment import CCR, TYLCV, SoilParameters, generate_environment
from sensors.errors import EstimatorError
from sensors.estimators import make_estimator
from sensors.estimators.gp import prior
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from wbf_mission import check_estimator
from wbf_mission.addons.epidemic import belief as belief_module
from wbf_mission.addons.epidemic import store, training
from wbf_mission.addons.epidemic.belief import (
    CLASS_VALUES,
    expected_loss,
    least_loss_value,
    standard_deviation,
)
from wbf_mission.addons.epidemic.estimator import EpidemicEstimator
from wbf_mission.addons.epidemic.features import (
    N_CONTEXT,
    REACH,
    SEEN_SUSCEPTIBLE,
    UNKNOWN,
    cells_in_reach,
    context_features,
    inner,
    padded_codes,
)
from wbf_mission.addons.epidemic.network import FieldClassifier, Network
from wbf_mission.addons.epidemic.soil import SoilField
from wbf_mission.addons.epidemic.store import load_network, network_for
from wbf_mission.addons.epidemic.training import TrainingTask

SMALL = {"outbreaks": 15, "epochs": 1}
FAIR = {"outbreaks": 100, "epochs": 6}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("networks")


def observe(x, y, values, day=6):
    n = len(x)
    return Observations(
        np.asarray(x), np.asarray(y), np.arange(n, dtype=float), np.full(n, day), np.reshape(values, (n, 3))
    )


def rows_over(truth, gap=3, day=6):
    x, y = (
        part.ravel() for part in np.meshgrid(np.arange(truth.shape[1]), np.arange(0, truth.shape[2], gap))
    )
    return observe(x, y, truth[:, x, y].T, day)


def truth_of(grid, seed, day=6):
    return generate_environment(grid, days=day, seed=seed, keep_days=[day]).values(day)


probabilities = (
    st.tuples(*[st.floats(0.0, 1.0)] * 3).filter(lambda p: sum(p) > 1e-3).map(lambda p: np.array(p) / sum(p))
)


@given(probabilities, st.floats(0.1, 20.0))
@settings(deadline=None)
def test_no_value_has_a_smaller_expected_loss(p, asymmetry):
    def expected(value):
        error = value - CLASS_VALUES
        return float(p @ (np.where(error > 0, asymmetry, 1.0) * error**2))

    best = float(least_loss_value(p, asymmetry))
    assert 0.0 <= best <= 1.0
    assert expected(best) <= min(expected(value) for value in np.linspace(0, 1, 201)) + 1e-9


@given(probabilities, st.floats(0.0, 1.0), st.floats(0.1, 20.0), st.floats(0.1, 20.0))
@settings(deadline=None)
def test_the_expected_loss_is_the_mean_of_what_the_score_charges(p, value, above, below):
    error = value - CLASS_VALUES
    charged = float(p @ (np.where(error > 0, above, below) * error**2))
    assert float(expected_loss(p, np.float64(value), above, below)) == pytest.approx(charged, abs=1e-9)
    drawn = np.sqrt(p @ (CLASS_VALUES - p @ CLASS_VALUES) ** 2)
    assert float(standard_deviation(p)) == pytest.approx(drawn, abs=1e-7)


def test_only_what_was_touched_is_looked_at_anew():
    hosts = np.random.default_rng(4).random((26, 30)) < 0.8
    rng = np.random.default_rng(5)
    network = Network.draw(training.LAYERS, rng)
    network = replace(network, further=(Network.draw(training.FURTHER_LAYERS, rng),))
    codes = padded_codes(hosts)
    x, y = np.nonzero(hosts)
    classifier = FieldClassifier(network, codes, x, y, 3, 6)
    row = np.full(hosts.shape, -1)
    row[x, y] = np.arange(len(x))
    for place, code in (((4, 5), 2), ((20, 7), 1), ((21, 8), 3)):
        codes[place[0] + REACH, place[1] + REACH] = code
        near = cells_in_reach(np.array([place[0]]), np.array([place[1]]), hosts.shape)
        classifier.touch(row[near][row[near] >= 0])
    afresh = FieldClassifier(network, codes, x, y, 3, 6).probabilities()
    np.testing.assert_allclose(classifier.probabilities(), afresh, atol=1e-6)


def test_equal_lessons_give_equal_networks_to_the_bit():
    hosts = get_farm("miniberry-10").grid().tomato
    task = TrainingTask(TYLCV, hosts, 6, outbreaks=30, epochs=1)
    first, second = training.learn(task), training.learn(task)
    other = training.learn(replace(task, seed=1))
    pairs = list(zip(first.weights, second.weights, strict=True))
    assert all(np.array_equal(a, b) for a, b in pairs)
    assert not np.array_equal(first.weights[0], other.weights[0])


def test_what_was_learned_is_kept_and_damage_is_repaired(tmp_path, monkeypatch):
    hosts = get_farm("miniberry-10").grid().strawberry
    task = TrainingTask(CCR, hosts, 6, outbreaks=15, epochs=1, seed=5)
    monkeypatch.setattr(store, "_in_memory", {})
    learned = network_for(task, tmp_path)
    (path,) = tmp_path.glob("*.npz")
    kept = path.read_bytes()
    trained = []
    real = training.learn
    monkeypatch.setattr(store, "learn", lambda *given: trained.append(1) or real(*given))
    monkeypatch.setattr(store, "_in_memory", {})
    again = network_for(task, tmp_path)
    assert trained == []
    assert np.array_equal(learned.weights[1], again.weights[1])
    for damaged in (b"", kept[: len(kept) // 2], b"not a network"):
        path.write_bytes(damaged)
        monkeypatch.setattr(store, "_in_memory", {})
        repaired = network_for(task, tmp_path)
        assert np.array_equal(learned.weights[1], repaired.weights[1])
        assert load_network(path) is not None
    assert len(trained) == 3


@pytest.mark.parametrize("spoil", ["missing", "shape", "nan", "pickle"])
def test_a_file_that_is_no_network_is_not_used(tmp_path, spoil):
    sizes = list(zip(training.LAYERS[:-1], training.LAYERS[1:], strict=True))
    arrays = {f"weight{i}": np.zeros(size, np.float32) for i, size in enumerate(sizes)}
    arrays |= {f"bias{i}": np.zeros(size[1], np.float32) for i, size in enumerate(sizes)}
    np.savez(tmp_path / "good.npz", **arrays)
    assert load_network(tmp_path / "good.npz") is not None
    if spoil == "missing":
        del arrays["bias1"]
    elif spoil == "shape":
        arrays["weight0"] = np.zeros((2, 2), np.float32)
    elif spoil == "nan":
        arrays["bias0"][3] = np.nan
    else:
        arrays["bias0"] = np.array([{"a": 1}], dtype=object)
    np.savez(tmp_path / "bad.npz", **arrays)
    assert load_network(tmp_path / "bad.npz") is None


def test_context_sums_what_is_expected_in_each_ring():
    hosts = np.ones((20, 20), bool)
    codes = padded_codes(hosts)
    inner(codes)[5, 6] = 2
    inner(codes)[9, 9] = 3
    inner(codes)[5, 8] = 1
    x, y = np.nonzero(hosts)
    believed = np.tile(np.float32([0.7, 0.2, 0.1]), (400, 1))
    found = context_features(codes, x, y, believed, 3, np.array([5 * 20 + 7, 0]))
    assert found.shape == (2, N_CONTEXT)
    # Of the four neighbours one was seen infected and one healthy; the other two are expected to be.
    assert found[0, 0] == pytest.approx((1 + 0 + 2 * 0.2) / 2)
    assert found[0, 10] == pytest.approx(2 * 0.1 / 2)
    assert found[1, 0] == pytest.approx(2 * 0.2 / 2)
    assert found[:, 22] == pytest.approx((1 + 397 * 0.2) / 400)
    assert found[:, 23] == pytest.approx((1 + 397 * 0.1) / 3)
    assert found[:, 24] == pytest.approx(1 / 3)
    everything = context_features(codes, x, y, believed, 3)
    assert np.array_equal(everything[[107, 0]], found)


@pytest.mark.parametrize("is_full", [True, False])
def test_a_network_that_cannot_be_kept_is_said_once(tmp_path, monkeypatch, is_full):
    (tmp_path / "file").write_text("in the way")
    folder = tmp_path / "kept" if is_full else tmp_path / "file" / "cache"
    network = Network((np.ones((2, 1), np.float32),), (np.zeros(1, np.float32),))
    if is_full:
        monkeypatch.setattr(store, "atomic_write", Mock(side_effect=OSError(errno.ENOSPC, "full")))
    with pytest.warns(CacheWarning, match="cannot write this cache") as told:
        for name in ("a.npz", "b.npz"):
            store.save_network(network, folder / name)
    assert len(told) == 1
    assert load_network(folder / "a.npz") is None


def test_lessons_differ_in_their_names():
    hosts = np.ones((12, 12), bool)
    fewer = hosts.copy()
    fewer[0, 0] = False
    task = TrainingTask(TYLCV, hosts, 6)
    changes = ({"day": 8}, {"hosts": fewer}, {"parameters": CCR}, {"seed": 1}, {"epochs": 1})
    assert len({task.key, *(replace(task, **change).key for change in changes)}) == 6


@pytest.mark.parametrize("cells", [None, 50])
def test_it_keeps_the_promises_of_an_estimator_on_small_and_large_farms(cells, cache, monkeypatch):
    if cells is not None:
        monkeypatch.setattr(training, "WHOLE_FARM_CELLS", cells)
        monkeypatch.setattr(store, "_in_memory", {})
    for misreading_rate in (0.0, 0.05):
        check_estimator(EpidemicEstimator(**SMALL, cache=cache / str(cells), misreading_rate=misreading_rate))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("day", -1),
        ("day", 2.5),
        ("misreading_rate", 0.7),
        ("outbreaks", 0),
        ("epochs", 0),
        ("training_seed", -3),
    ],
)
def test_it_names_a_parameter_that_cannot_be(name, value):
    with pytest.raises(EstimatorError, match=name):
        EpidemicEstimator(**{name: value}).fit(get_farm("miniberry-10").grid())


def test_a_day_beyond_the_model_is_named(cache):
    estimator = EpidemicEstimator(**SMALL, cache=cache, day=200).fit(get_farm("miniberry-10").grid())
    with pytest.raises(EstimatorError, match="day 200"):
        estimator.predict()


def test_what_was_read_is_known_and_what_was_not_is_doubted(cache):
    grid = get_farm("miniberry-10").grid()
    truth = truth_of(grid, 3)
    seen = rows_over(truth)
    estimator = EpidemicEstimator(**SMALL, cache=cache).fit(grid, seen)
    model = estimator.predict()
    for k, crop in enumerate((grid.tomato, grid.strawberry)):
        read = np.zeros(grid.shape, bool)
        read[seen.x, seen.y] = True
        assert np.allclose(model.value[k][read & crop], truth[k][read & crop], atol=1e-6)
        assert (model.uncertainty[k][read & crop] < 1e-5).all()
        assert (model.uncertainty[k][~read & crop] > 0).all()
        assert (model.value[k][~crop] == 1).all()
        assert (model.uncertainty[k][~crop] == 0).all()
        assert (model.expected_loss[k][seen.x, seen.y] < 1e-6).all()
        assert (model.expected_loss[k][~crop] == 0).all()
        p = np.moveaxis(model.probabilities[("tylcv", "ccr")[k]], 0, -1)
        again = expected_loss(p, model.value[k].astype(float), 10.0, 1.0)
        np.testing.assert_allclose(model.expected_loss[k], again, atol=1e-5)
        assert np.allclose(p.sum(axis=-1), 1.0, atol=1e-5)
        assert np.allclose(least_loss_value(p)[crop], model.value[k][crop], atol=1e-5)
    np.testing.assert_allclose(model.expected_loss[2], model.uncertainty[2] ** 2, rtol=1e-6)
    found = model.probabilities["tylcv"]
    with pytest.raises(KeyError, match="soil"):
        model.probabilities["soil"]
    kept = model.copy()
    estimator.partial_fit(observe([4], [7], [0.0, 0.0, 0.2])).predict()
    np.testing.assert_array_equal(kept.probabilities["tylcv"], found)
    np.testing.assert_array_equal(kept.expected_loss, model.expected_loss)
    assert model.correlation_length == (0.0, 0.0, pytest.approx(np.sqrt(2.0) * 0.125 * 10))


def test_on_large_farms_probabilities_and_loss_are_made_when_asked_for(cache, monkeypatch):
    monkeypatch.setattr(training, "WHOLE_FARM_CELLS", 50)
    monkeypatch.setattr(store, "_in_memory", {})
    grid = get_farm("miniberry-10").grid()
    seen = rows_over(truth_of(grid, 3))
    estimator = EpidemicEstimator(**SMALL, cache=cache / "large").fit(grid, seen[:5])
    early = estimator.predict()
    assert early.expected_loss is not None
    estimator.partial_fit(seen[5:])
    for what in (lambda: early.probabilities["tylcv"], lambda: early.expected_loss):
        with pytest.raises(EstimatorError, match=r"can no longer be computed.*model\.copy\(\)"):
            what()
    late = estimator.predict()
    found = late.expected_loss
    for k, name in enumerate(("tylcv", "ccr")):
        p = np.moveaxis(late.probabilities[name], 0, -1)
        again = expected_loss(p, late.value[k].astype(float), 10.0, 1.0)
        np.testing.assert_allclose(found[k], again, atol=1e-5)
    # As many observations, but another day, or another fit.
    tomorrow = EpidemicEstimator(**SMALL, cache=cache / "large").fit(grid, seen[:5])
    old = tomorrow.predict()
    tomorrow.advance(tomorrow.day_ + 1)
    with pytest.raises(EstimatorError, match=r"of day 6 with 5 observations.* on to day 7 with 5"):
        old.probabilities["tylcv"]
    tomorrow.predict().expected_loss  # noqa: B018
    again = EpidemicEstimator(**SMALL, cache=cache / "large").fit(grid, seen[:5])
    old = again.predict()
    again.fit(grid, seen[5:10])
    with pytest.raises(EstimatorError, match=r"can no longer be computed.* fitted again"):
        old.expected_loss  # noqa: B018


def test_a_sick_plant_makes_its_neighbours_doubtful(cache):
    grid = get_farm("miniberry-10").grid()
    x, y = np.argwhere(grid.tomato)[22]
    assert grid.tomato[x + 1, y]
    estimator = EpidemicEstimator(**FAIR, cache=cache).fit(grid)
    nothing, sick, well = (
        estimator.fit(grid, seen).predict().value[0, x + 1, y]
        for seen in (None, observe([x], [y], [0.5, 1, 0.5]), observe([x], [y], [1.0, 1, 0.5]))
    )
    assert sick < nothing < well


def test_noise_on_the_readings_is_noticed(cache):
    grid = get_farm("miniberry-10").grid()
    rng = np.random.default_rng(4)
    losses = []
    for noise in (0.0, 0.2):
        truth = truth_of(grid, 3)
        seen = rows_over(truth)
        noisy = seen.values + noise * rng.standard_normal(seen.values.shape)
        model = EpidemicEstimator(**SMALL, cache=cache).fit(grid, observe(seen.x, seen.y, noisy)).predict()
        losses.append(RunningScore(truth, PAPER_FIELDS.masks(grid)).evaluate(model).loss)
    assert losses[0] <= losses[1] < 1.4 * losses[0]


def test_of_several_readings_of_a_plant_the_last_one_counts(cache):
    grid = get_farm("miniberry-10").grid()
    x, y = np.argwhere(grid.tomato)[20]
    for readings in ((1.0, 0.5), (0.5, 1.0), (0.5, 0.0, 0.5)):
        seen = observe([x] * len(readings), [y] * len(readings), [[value, 1, 0.5] for value in readings])
        model = EpidemicEstimator(**SMALL, cache=cache).fit(grid, seen).predict()
        assert model.value[0, x, y] == pytest.approx(readings[-1], abs=1e-6)


def test_many_looks_outvote_a_misreading(cache):
    grid = get_farm("miniberry-10").grid()
    x, y = np.argwhere(grid.tomato)[20]
    seen = observe([x] * 5, [y] * 5, [[1, 1, 0.5]] * 2 + [[0.5, 1, 0.5]] + [[1, 1, 0.5]] * 2)
    trusting = EpidemicEstimator(**SMALL, cache=cache).fit(grid, seen).predict()
    careful = EpidemicEstimator(**SMALL, cache=cache, misreading_rate=0.1).fit(grid, seen).predict()
    assert trusting.value[0, x, y] == 1.0
    assert 0.9 < careful.value[0, x, y] < 1.0
    alone = observe([x], [y], [0.5, 1, 0.5])
    careful = EpidemicEstimator(**SMALL, cache=cache, misreading_rate=0.1).fit(grid, alone).predict()
    assert careful.uncertainty[0, x, y] > 0.01


def test_lost_plants_stay_lost_and_healthy_ones_are_looked_at_again(cache):
    grid = get_farm("miniberry-10").grid()
    (lost, ill, well) = np.argwhere(grid.tomato)[[3, 22, 45]]
    x, y = np.stack([lost, ill, well]).T
    first = observe(x, y, [[0, 1, 0.5], [0.5, 1, 0.5], [1, 1, 0.5]], day=6)
    estimator = EpidemicEstimator(**SMALL, cache=cache).fit(grid, first)
    assert estimator.day_ == 6
    estimator.predict()
    strawberry = np.argwhere(grid.strawberry)[:1].T
    later = observe(*strawberry, [1, 1, 0.5], day=8)
    model = estimator.partial_fit(later).predict()
    assert estimator.day_ == 8
    assert model.value[0, x[0], y[0]] == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < model.value[0, x[1], y[1]] <= 0.5
    assert model.value[0, x[2], y[2]] < 1.0
    assert model.uncertainty[0, x[2], y[2]] > 0.0
    at_once = EpidemicEstimator(**SMALL, cache=cache).fit(grid, Observations.concatenate([first, later]))
    assert np.array_equal(model.value, at_once.predict().value)


def test_a_farm_without_the_crops_needs_no_training(tmp_path):
    shape = (9, 7)
    grid = FarmGrid(shape, 0.3048, np.zeros(shape, np.int8), np.ones(shape, bool))
    model = EpidemicEstimator(cache=tmp_path).fit(grid, observe([1], [2], [0.5, 0.5, 0.25])).predict()
    assert (model.value[:2] == 1).all()
    assert (model.uncertainty[:2] == 0).all()
    assert list(tmp_path.iterdir()) == []


def test_windows_of_a_large_farm_stand_for_it(monkeypatch):
    monkeypatch.setattr(training, "WHOLE_FARM_CELLS", 1000)
    monkeypatch.setattr(training, "_WINDOW", 48)
    hosts = np.ones((240, 200), bool)
    hosts[:, 150:] = False
    task = TrainingTask(TYLCV, hosts, 6, outbreaks=150)
    _, classes, weights = training.samples_of(training.draw_looks(task, np.random.default_rng(3)))
    rng = np.random.default_rng(1)
    expected = np.mean([(simulate_outbreak(hosts, TYLCV, 6, rng)[hosts] >= 0).mean() for _ in range(8)])
    assert float(weights @ (classes > 0) / weights.sum()) == pytest.approx(expected, rel=0.4)
    assert weights.mean() == pytest.approx(1.0, rel=1e-4)


def soil_of(seed, shape=(30, 30), day=6):
    crop = np.zeros(shape, np.int8)
    return generate_environment(
        FarmGrid(shape, 0.3048, crop, np.ones(shape, bool)), days=day, seed=seed, keep_days=[day]
    ).level("soil", day)


def test_the_soil_is_a_smooth_field_with_true_deviations():
    rng = np.random.default_rng(1)
    scaled, errors = [], []
    for seed in range(12):
        truth = soil_of(seed)
        x, y = rng.integers(0, 30, (2, 80))
        field = SoilField((30, 30), SoilParameters(), 0)
        field.learn(x, y, np.full(80, 6), truth[x, y].astype(float))
        value, deviation = np.empty((2, 30, 30), np.float32)
        field.fill(6, value, deviation)
        assert (deviation > 0).all()
        errors.append(np.mean((value - truth) ** 2))
        scaled.append(np.mean(((value - truth) / deviation) ** 2))
    assert np.sqrt(np.mean(errors)) < 0.05
    assert 0.3 < np.mean(scaled) < 3.0


@pytest.mark.slow
def test_it_beats_disks_and_the_gaussian_process(cache):
    grid = get_farm("miniberry-30").grid()
    masks = PAPER_FIELDS.masks(grid)
    totals = dict.fromkeys(("epidemic", "adaptive-disk", "gp"), 0.0)
    for seed in range(12):
        truth = truth_of(grid, 700 + seed)
        seen = rows_over(truth)
        for name in totals:
            given = {"cache": cache} if name == "epidemic" else {}
            if name == "gp":  # as the paper fits it
                given = {"learn_from": "observations"}
            model = make_estimator(name, **given).fit(grid, seen).predict()
            totals[name] += RunningScore(truth, masks).evaluate(model).loss
    assert totals["epidemic"] < 0.25 * totals["adaptive-disk"]
    assert totals["epidemic"] < 0.5 * totals["gp"]


@pytest.mark.parametrize(
    ("name", "module", "quick"), [("epidemic", store, {"outbreaks": 20, "epochs": 1}), ("gp", prior, {})]
)
def test_what_was_kept_is_no_training(name, module, quick, tmp_path, monkeypatch):
    grid = get_farm("miniberry-10").grid()

    def told_by_a_new_process():
        monkeypatch.setattr(module, "_in_memory", {})
        told = []
        estimator = make_estimator(name, training_seed=78, cache=tmp_path, **quick).fit(grid)
        estimator.prepare([5], lambda *what: told.append(what))
        return told

    first = told_by_a_new_process()
    done = [part for _, part, _ in first]
    assert done == sorted(done)
    assert (done[0], done[-1]) == (0, first[-1][2])
    assert {what for what, _, _ in first} == {"training the estimator"}
    assert told_by_a_new_process() == []


def test_the_soil_is_the_same_in_whatever_parts_it_is_learned():
    """Readings one by one change the posterior; all at once, it is solved from their sums."""
    truth = soil_of(5)
    rng = np.random.default_rng(6)
    x, y = rng.integers(0, 30, (2, 140))
    days = np.where(np.arange(140) < 20, 5, 6)
    results = []
    for size in (1, 7, 140):
        field = SoilField((30, 30), SoilParameters(), 0)
        value, uncertainty = np.empty((2, 30, 30), np.float32)
        for start in range(0, 140, size):
            part = slice(start, start + size)
            field.learn(x[part], y[part], days[part], truth[x[part], y[part]].astype(float))
            noise = field.fill(int(days[part][-1]), value, uncertainty)
        results.append((value, uncertainty, noise))
    for value, uncertainty, noise in results[:2]:
        np.testing.assert_allclose(value, results[2][0], atol=1e-4)
        np.testing.assert_allclose(uncertainty, results[2][1], atol=1e-4)
        assert noise == pytest.approx(results[2][2], rel=1e-6)


@pytest.fixture
def two_tasks(monkeypatch):
    """Networks for two diseases that are small, but large enough for processes of their own."""
    grid = get_farm("miniberry-10").grid()
    monkeypatch.setattr(store, "_WORTH_A_PROCESS", 1)
    monkeypatch.setattr(store, "_in_memory", {})
    small = {"outbreaks": 15, "epochs": 1, "seed": 9}
    return [TrainingTask(TYLCV, grid.tomato, 7, **small), TrainingTask(CCR, grid.strawberry, 6, **small)]


def weights_of(wanted, folder):
    networks = [store.load_network(store.network_file(task, folder)) for task in wanted]
    return [one for network in networks for part in (network, *network.further) for one in part.weights]


def test_networks_trained_in_processes_are_those_trained_here(tmp_path, two_tasks, monkeypatch):
    monkeypatch.setattr(store.os, "cpu_count", lambda: 2)
    done = []
    store.learn_all([*two_tasks, two_tasks[0]], tmp_path / "several", done.append)
    assert done == [0.0, 0.5, 1.0]
    several = weights_of(two_tasks, tmp_path / "several")
    store._in_memory.clear()
    monkeypatch.setattr(store.os, "cpu_count", lambda: 1)
    store.learn_all(two_tasks, tmp_path / "one", done.append)
    one = weights_of(two_tasks, tmp_path / "one")
    assert all(np.array_equal(a, b) for a, b in zip(several, one, strict=True))
    store.learn_all(two_tasks, tmp_path / "one", lambda part: pytest.fail(f"trained again: {part}"))


def test_a_process_that_dies_costs_time_and_no_network(tmp_path, two_tasks, monkeypatch):
    monkeypatch.setattr(store.os, "cpu_count", lambda: 2)
    here = os.getpid()
    monkeypatch.setattr(
        store, "learn", lambda *given: training.learn(*given) if os.getpid() == here else os._exit(9)
    )
    store.learn_all(two_tasks, tmp_path, lambda part: None)
    assert len(weights_of(two_tasks, tmp_path)) == 18


@pytest.fixture(scope="module")
def beliefs(cache):
    """Beliefs of a disease that nothing was read of yet, with a network that learned little."""

    def made():
        hosts = np.ones((27, 27), bool)
        task = TrainingTask(TYLCV, hosts, 6, outbreaks=20, epochs=1)
        return belief_module.DiseaseBelief(
            task, too_healthy=10.0, too_sick=1.0, misreading_rate=0.0, cache=cache
        )

    return made


def codes_after(belief, readings, day=8):
    """Return what stands for each reading (x, y, day, value) in what the network looks at."""
    x, y, days, values = np.array(readings, float).T
    cells = np.stack([x, y], axis=1).astype(np.int32)
    belief.update(day, cells, days.astype(np.int32), values)
    return inner(belief._codes)[cells[:, 0], cells[:, 1]].tolist()


@settings(max_examples=25, deadline=None)
@given(dx=st.integers(-12, 12), dy=st.integers(-12, 12), ago=st.integers(0, 3), since=st.integers(0, 3))
@example(dx=2, dy=-1, ago=1, since=0)
@example(dx=0, dy=3, ago=1, since=0)
def test_it_is_doubted_where_the_disease_may_have_come_from_a_sick_plant(beliefs, dx, dy, ago, since):
    """The disease leaps as far as its kernel reaches each day, and once more on the day of the reading."""
    assume((dx, dy) != (0, 0))
    belief = beliefs()
    healthy, sick = codes_after(belief, [(13, 13, 8 - ago, 1.0), (13 + dx, 13 + dy, 8 - since, 0.5)])
    leap = TYLCV.infection_rule((27, 27)).kernel.radius
    near = max(abs(dx), abs(dy)) <= leap * (ago + 1)
    doubted = ago > 0 and (near or ago > 1)
    assert healthy == (UNKNOWN if doubted else SEEN_SUSCEPTIBLE) and sick > SEEN_SUSCEPTIBLE


@pytest.mark.parametrize("farm", FARMS)
def test_a_miniberry_farm_needs_no_training(farm, tmp_path):
    steps = []
    estimator = EpidemicEstimator(cache=tmp_path).fit(get_farm(farm).grid())
    estimator.prepare(range(DAYS[-1] + 8), lambda *step: steps.append(step))
    assert not steps and not list(tmp_path.iterdir())
    names = {path.name for path in store.INCLUDED.iterdir()}
    assert len(names) == len(FARMS) * len(PAPER_FIELDS.diseases) * len(DAYS) and all(
        name.endswith(f"-{store.SUMS}.npz") for name in names
    )


@pytest.mark.slow
def test_an_included_network_is_the_one_that_training_gives(tmp_path):
    estimator = EpidemicEstimator().fit(get_farm("miniberry-10").grid())
    (task,) = estimator._beliefs[1].wanted([8])
    included = load_network(store.INCLUDED / store.network_file(task, tmp_path).name)
    trained = training.learn(task)
    for one, other in zip((included, *included.further), (trained, *trained.further), strict=True):
        for here, there in zip((*one.weights, *one.biases), (*other.weights, *other.biases), strict=True):
            assert here.tobytes() == there.tobytes()
