"""Time the estimators against the reference methods, side by side in one process, and check their bars.

The references are the methods of the published benchmark code, written out below: every disk drawn again at
every estimate, field by field, and scikit-learn's Gaussian process fitted from scratch at every estimate
(times marked "~" are measured at a few numbers of observations and summed over all steps). The disks of both
methods are checked to be the same.

Examples::

    python benchmarks/estimators.py --quick
    OMP_NUM_THREADS=1 python benchmarks/estimators.py

The bars are whole processes, imports included: the paper's 500 steps on Miniberry-30, the map and the score
of three fields after every one.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.environment import generate_environment
from sensors.estimators import make_estimator
from sensors.estimators.disk.disks import adaptive_radius
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import RunningScore

STEPS = 500
BARS_S = {"adaptive-disk": 2.0, "gp": 10.0}


def lawnmower(grid: FarmGrid, n: int, gap: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the first n cells of a path in rows along x, again from the start when the farm is done."""
    width, height = grid.shape
    rows = [np.arange(width)[:: 1 if i % 2 == 0 else -1] for i in range(-(-height // gap))]
    x = np.concatenate(rows)
    y = np.repeat(np.arange(0, height, gap), width)
    times = -(-n // len(x))
    return np.tile(x, times)[:n].astype(np.int32), np.tile(y, times)[:n].astype(np.int32)


def run_of(farm: str, n: int, gap: int) -> tuple[FarmGrid, NDArray[np.float32], Observations]:
    """Return a farm, its truth on day 6 and n observations along a lawnmower."""
    grid = get_farm(farm).grid()
    truth = np.asarray(generate_environment(grid, days=7, seed=1, keep_days=[6]).values(6))
    x, y = lawnmower(grid, n, gap)
    whole = np.full(n, 6, np.int32)
    return grid, truth, Observations(x, y, np.arange(n, dtype=np.float64), whole, truth[:, x, y].T)


def invented(farm: str, n: int, gap: int) -> tuple[FarmGrid, Observations]:
    """Return a farm and n invented observations along a lawnmower."""
    grid = get_farm(farm).grid()
    x, y = lawnmower(grid, n, gap)
    rng = np.random.default_rng(0)
    sick = np.where(np.sin(x / 4) * np.cos(y / 5) > 0.6, 0.5, 1.0)
    values = np.stack([sick, rng.choice([0.5, 1.0], n, p=[0.05, 0.95]), 0.5 + 0.3 * np.sin(x / 30)], axis=1)
    return grid, Observations(
        x, y, np.arange(n, dtype=np.float64), np.full(n, 6, np.int32), values.astype(np.float32)
    )


def reference_disks(shape: tuple[int, int], seen: Observations) -> InformationModel:
    """Draw the disk of every observation on every field, one after the other."""
    model = InformationModel.uniform(shape, value=PAPER_FIELDS.defaults, uncertainty=1.0)
    radius = adaptive_radius(len(seen), shape)
    for k in range(len(PAPER_FIELDS)):
        for x, y, value in zip(seen.x.tolist(), seen.y.tolist(), seen.values[:, k].tolist(), strict=True):
            part = (
                slice(max(0, x - radius), min(shape[0], x + radius + 1)),
                slice(max(0, y - radius), min(shape[1], y + radius + 1)),
            )
            i, j = (np.arange(s.start, s.stop) - centre for s, centre in zip(part, (x, y), strict=True))
            disk = i[:, None] ** 2 + j**2 <= radius**2
            model.value[k][part][disk] = value
            model.uncertainty[k][part][disk] = 0.0
    return model


def clock(work: Callable[[], object]) -> float:
    """Return the seconds that the work takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def fly(
    estimator_name: str,
    grid: FarmGrid,
    truth: NDArray[np.float32],
    seen: Observations,
    steps: int,
    **params: Any,
) -> RunningScore:
    """Estimate and score after every step."""
    estimator = make_estimator(estimator_name, random_state=1, **params).fit(grid)
    running = RunningScore(truth, PAPER_FIELDS.masks(grid))
    for step in range(steps):
        running.add(estimator.partial_fit(seen[step : step + 1]).predict().value)
    return running


def report(what: str, ours_s: float, reference_s: float | None = None, mark: str = "") -> None:
    """Print one line of the table."""
    unit = " " if "milliseconds" in what else "s"
    line = f"{what:<66} {ours_s:9.2f} {unit}"
    if reference_s is not None:
        line += (
            f" {mark + format(reference_s, '.2f'):>10} s {mark + format(reference_s / ours_s, '.0f'):>7} x"
        )
    print(line, flush=True)


def disks_on_the_small_farm(steps: int) -> None:
    """The run that is scored at every step."""
    grid, truth, seen = run_of("miniberry-30", STEPS, 3)
    # The first call loads the compiled code, once in a process and whatever follows.
    first = clock(lambda: fly("adaptive-disk", grid, truth, seen, 1))
    report("adaptive disk, Miniberry-30, the first step in a process", first)
    ours = clock(lambda: fly("adaptive-disk", grid, truth, seen, steps))
    running = RunningScore(truth, PAPER_FIELDS.masks(grid))

    def reference() -> None:
        for step in range(1, steps + 1):
            running.add(reference_disks(grid.shape, seen[:step]).value)

    reference_s = clock(reference)
    assert running.losses == fly("adaptive-disk", grid, truth, seen, steps).losses
    report(f"adaptive disk, Miniberry-30, {steps} steps scored at each", ours, reference_s)


def disks_on_the_large_farm(n: int) -> None:
    """One battery's observations on the full farm."""
    grid, seen = invented("waterberry", n, 300)
    make_estimator("adaptive-disk").fit(*invented("miniberry-10", 20, 3)).predict()
    estimator = make_estimator("adaptive-disk")
    models: list[InformationModel] = []
    fresh = clock(lambda: models.append(estimator.fit(grid, seen).predict()))
    models.clear()
    ours = clock(lambda: models.append(estimator.fit(grid, seen).predict()))
    report("... memory taken for the first time", fresh)
    reference_s = clock(lambda: models.append(reference_disks(grid.shape, seen)))
    assert np.array_equal(models[0].value, models[1].value)
    assert np.array_equal(models[0].uncertainty, models[1].uncertainty)
    report(f"adaptive disk, Waterberry, {n} observations, one estimate", ours, reference_s)
    running = RunningScore(models[1].value, PAPER_FIELDS.masks(grid))
    report("score of three fields, Waterberry", clock(lambda: running.add(models[0].value)))
    updates_on_the_large_farm(grid, seen, running)


def updates_on_the_large_farm(grid: FarmGrid, seen: Observations, running: RunningScore) -> None:
    """A running flight: estimate and score after every 100 observations."""
    estimator = make_estimator("adaptive-disk").fit(grid)
    estimate_s: list[float] = []
    score_s: list[float] = []
    for start in range(0, len(seen), 100):
        begin = time.perf_counter()
        model = estimator.partial_fit(seen[start : start + 100]).predict()
        middle = time.perf_counter()
        score = running.add(model)
        estimate_s.append(middle - begin)
        score_s.append(time.perf_counter() - middle)
    assert score == running.evaluate(model.value)
    whole_s = clock(lambda: running.evaluate(model.value))
    for what, times in (("estimate", estimate_s), ("score", score_s)):
        report(f"adaptive disk, Waterberry, {what} after each 100 observations, sum", sum(times))
        report(f"... one of the {len(times)} times, milliseconds, median", 1e3 * float(np.median(times[1:])))
        report("... milliseconds, the slowest but the first", 1e3 * max(times[1:]))
    report("... all of the farm scored each time, sum (~)", whole_s * len(score_s))


def processes_on_the_small_farm(steps: int, samples: tuple[int, ...]) -> None:
    """The run that is scored at every step, scikit-learn sampled at some of the steps."""
    grid, truth, seen = run_of("miniberry-30", STEPS, 3)
    ours = clock(lambda: fly("gp", grid, truth, seen, steps, learn_from="observations"))
    times = []
    for n in samples:
        slow = make_estimator("gp-sklearn", random_state=1).fit(grid, seen[:n])
        times.append(clock(slow.predict))
    reference_s = float(np.interp(np.arange(1, steps + 1), samples, times).sum())
    report(f"Gaussian process, Miniberry-30, {steps} steps scored at each", ours, reference_s, "~")


def processes_on_large_farms(farm: str, n: int, gap: int, pieces: int) -> None:
    """Updates of a running flight."""
    grid, seen = invented(farm, n, gap)
    estimator = make_estimator("gp").fit(grid)
    step = n // pieces
    times = [
        clock(lambda start=start: estimator.partial_fit(seen[start : start + step]).predict())
        for start in range(0, n, step)
    ]
    report(f"Gaussian process, {farm}, {n} observations in {pieces} estimates", sum(times))
    report(f"Gaussian process, {farm}, the slowest of these estimates", max(times))


def bars(steps: int) -> bool:
    """Run each estimator in a process of its own and compare with its bar."""
    held = True
    for name, bar in BARS_S.items():
        command = [sys.executable, __file__, "--fly", name, "--steps", str(steps)]
        taken = clock(lambda command=command: subprocess.run(command, check=True, env={**os.environ}))
        held &= taken < bar
        verdict = "held" if taken < bar else "MISSED"
        print(f"whole process, {name}, {steps} steps: {taken:.2f} s, bar {bar:g} s: {verdict}", flush=True)
    return held


def main() -> int:
    """Run the benchmark; the exit code tells whether the bars are held."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer steps and no large farms")
    parser.add_argument("--fly", choices=sorted(BARS_S), help="only fly this estimator on Miniberry-30")
    parser.add_argument("--steps", type=int, default=STEPS, help="steps of the flight on Miniberry-30")
    options = parser.parse_args()
    if options.fly:
        grid, truth, seen = run_of("miniberry-30", STEPS, 3)
        fly(options.fly, grid, truth, seen, options.steps)
        return 0
    print(f"{'':<66} {'ours':>11} {'reference':>12} {'ratio':>9}")
    steps = min(options.steps, 100) if options.quick else options.steps
    disks_on_the_small_farm(steps)
    processes_on_the_small_farm(steps, (10, 50, 100) if options.quick else (10, 50, 100, 200, 350, 500))
    if not options.quick:
        disks_on_the_large_farm(25_000)
        processes_on_large_farms("miniberry-100", 4000, 3, 20)
        processes_on_large_farms("waterberry", 25_000, 300, 5)
    return 0 if bars(options.steps) else 1


if __name__ == "__main__":
    sys.exit(main())
