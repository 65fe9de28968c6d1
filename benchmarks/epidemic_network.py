"""Compare the epidemic estimator's network with scikit-learn's `MLPClassifier` of the same layers.

Both learn from the same samples (float32, the same weights of samples, batches of 512, Adam, one BLAS thread)
and are judged on the same cells of other outbreaks. The classifier is fitted with its own defaults, with the
network's rate and moments, and pass by pass with `partial_fit`, the rate lowered along a cosine between,
for which its optimiser, a private attribute, is changed. A pass of one takes longer than a pass of the other:
both are also given more passes, so that times can be made equal. Times are of the process (CPU), in turn.

Run: ``python benchmarks/epidemic_network.py [--quick] [--json]``
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPClassifier
from threadpoolctl import threadpool_limits

from geo.farms import get_farm
from geo.seeds import stream
from sensors.estimators.epidemic.network import Network, train
from sensors.estimators.epidemic.training import LAYERS, TrainingTask, draw_looks, samples_of
from sensors.fields import PAPER_FIELDS
from sensors.scoring.expected import CLASS_VALUES, least_loss_value
from sensors.scoring.score import PAPER_WEIGHTS

DAY = 6
RATE = 2e-3
ROWS = (1, 289, 900, 3000, 9000)
"""Cells that are judged at once: one reading on a large farm touches 289, a small farm is judged whole."""
Samples = tuple[NDArray[np.float32], NDArray[np.int8], NDArray[np.float32]]
Judge = Callable[[NDArray[np.float32]], NDArray[np.floating]]


def fitted(samples: Samples, passes: int, seed: int, **settings: Any) -> Judge:
    """Fit the classifier in one call."""
    inputs, classes, weights = samples
    network = MLPClassifier(
        LAYERS[1:-1], batch_size=512, max_iter=passes, tol=0.0, n_iter_no_change=passes + 1, random_state=seed
    )
    network.set_params(**settings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        network.fit(inputs, classes, sample_weight=weights)
    return network.predict_proba


def fitted_by_passes(samples: Samples, passes: int, seed: int) -> Judge:
    """Fit the classifier pass by pass, with a lower rate each time."""
    inputs, classes, weights = samples
    network = MLPClassifier(
        LAYERS[1:-1], batch_size=512, learning_rate_init=RATE, beta_2=0.99, alpha=1e-5, random_state=seed
    )
    for number in range(passes):
        if number:
            network._optimizer.learning_rate_init = RATE * (0.5 + 0.5 * math.cos(math.pi * number / passes))
        network.partial_fit(inputs, classes, classes=np.arange(3), sample_weight=weights)
    return network.predict_proba


def trained(samples: Samples, passes: int, seed: int) -> Judge:
    """Train the estimator's network."""
    rng = np.random.default_rng(seed)
    return train(Network.draw(LAYERS, rng), *samples, epochs=passes, rng=rng).probabilities


def losses(judge: Judge, held_out: Samples) -> tuple[float, float]:
    """Return the log loss and the score's loss a cell."""
    inputs, classes, weights = held_out
    found = np.asarray(judge(inputs), np.float64)
    logarithms = -np.log(np.maximum(found[np.arange(len(classes)), classes], 1e-12))
    error = least_loss_value(found) - CLASS_VALUES[classes]
    cost = np.where(error > 0.0, PAPER_WEIGHTS.too_healthy[0], PAPER_WEIGHTS.too_sick[0]) * error**2
    return float(np.average(logarithms, weights=weights)), float(np.average(cost, weights=weights))


def seconds_a_call(judge: Judge, inputs: NDArray[np.float32], rounds: int) -> float:
    """Return the least time of a call of some rounds."""
    calls = max(1, 3000 // len(inputs))
    best = math.inf
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(calls):
            judge(inputs)
        best = min(best, (time.perf_counter() - start) / calls)
    return best


def compare(farm: str, outbreaks: int, seeds: Sequence[int], passes: int) -> dict[str, Any]:
    """Train all ways on the diseases of a farm; ratios are the classifier's by the network's."""
    ways: dict[str, Callable[[Samples, int], Judge]] = {
        "network": lambda samples, seed: trained(samples, passes, seed),
        "network, twice the passes": lambda samples, seed: trained(samples, 2 * passes, seed),
        "defaults": lambda samples, seed: fitted(samples, passes, seed),
        "same rate": lambda samples, seed: fitted(
            samples, passes, seed, learning_rate_init=RATE, beta_2=0.99, alpha=1e-5
        ),
        "same rate, twice the passes": lambda samples, seed: fitted(
            samples, 2 * passes, seed, learning_rate_init=RATE, beta_2=0.99, alpha=1e-5
        ),
        "same rate, half the passes": lambda samples, seed: fitted(
            samples, passes // 2, seed, learning_rate_init=RATE, beta_2=0.99, alpha=1e-5
        ),
        "cosine by half the passes": lambda samples, seed: fitted_by_passes(samples, passes // 2, seed),
        "cosine by passes": lambda samples, seed: fitted_by_passes(samples, passes, seed),
    }
    grid = get_farm(farm).grid()
    found: dict[str, Any] = {}
    judges: dict[str, Judge] = {}
    for field in PAPER_FIELDS.diseases:
        disease, hosts = field.epidemic, field.hosts(grid)
        others = TrainingTask(disease, DAY, outbreaks // 4)
        held_out = samples_of(draw_looks(others, hosts, stream(99, "held-out")))
        rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in ways}
        for seed in seeds:
            looks = draw_looks(TrainingTask(disease, DAY, outbreaks), hosts, stream(seed, "training"))
            samples = samples_of(looks)
            for name, way in ways.items():
                start = time.process_time()
                judges[name] = way(samples, seed)
                rows[name].append((time.process_time() - start, *losses(judges[name], held_out)))
        base = np.array(rows["network"])
        for name, values in rows.items():
            array = np.array(values)
            found[f"{field.name}, {name}"] = {
                "training_s": float(np.median(array[:, 0])),
                "log_loss": float(array[:, 1].mean()),
                "loss": float(array[:, 2].mean()),
                "ratios": np.median(array / base, axis=0).round(4).tolist(),
                "spread_of_loss_ratio": [
                    float((array / base)[:, 2].min()),
                    float((array / base)[:, 2].max()),
                ],
            }
    inputs = np.ascontiguousarray(samples[0][: max(ROWS)])
    for count in ROWS:
        pair = [seconds_a_call(judges[name], inputs[:count], 7) for name in ("network", "same rate")]
        found[f"{count} rows"] = {"network_us": 1e6 * pair[0], "classifier_us": 1e6 * pair[1]}
    return found


def main() -> int:
    """Run the comparison and print it."""
    parser = argparse.ArgumentParser(description="the estimator's network against scikit-learn's")
    parser.add_argument("--quick", action="store_true", help="fewer outbreaks and seeds")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with threadpool_limits(1, user_api="blas"):
        found = compare("miniberry-30", 100 if options.quick else 1000, range(2 if options.quick else 4), 6)
    if options.json:
        print(json.dumps(found))
        return 0
    print("classifier / network: ratios of training time, log loss, score's loss (its range over the seeds)")
    for name, row in found.items():
        if "ratios" in row:
            times, log_loss, loss = row["ratios"]
            low, high = row["spread_of_loss_ratio"]
            print(
                f"{name:36s} {row['training_s']:6.2f} s  {row['log_loss']:.4f}  {row['loss']:.4f}"
                f"   x{times:.2f}  x{log_loss:.4f}  x{loss:.4f} ({low:.3f}-{high:.3f})"
            )
        else:
            ratio = row["classifier_us"] / row["network_us"]
            print(f"{name:36s} {row['network_us']:8.0f} us  {row['classifier_us']:8.0f} us   x{ratio:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
