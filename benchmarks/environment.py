"""Time the generation of environments against the reference method, side by side in one process.

The reference is the method of the published benchmark code, written out below: a convolution of the whole
farm and a random number for every cell on each day of a disease, and for the soil every hump of rain
evaluated and added on its own. On the same draws both give the same epidemics, which this script checks day
by day, and the same soil up to the rounding of float32.

Examples::

    python benchmarks/environment.py --sizes 30 100 1000
    python benchmarks/environment.py --sizes waterberry --reference-days 1

Ours runs in processes of its own, on one core and on all, before and after the reference; it also writes its
days to disk on large farms, the reference keeps none. With ``--reference-days N`` the reference works on the
first N days only (of the soil: on the warm-up and one day) and its time is scaled to all days, as its cost a
day is constant; such times are marked with "~".
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from common import scratch_folder
from numpy.typing import NDArray
from scipy.signal import convolve2d

from geo.farms import get_farm
from geo.grid import Crop, FarmGrid
from geo.units import FOOT_M
from sensors.dynamics.epidemic import InfectionRule, draw_seeds, step
from sensors.dynamics.soil import Shower, SoilCourse, draw_weather
from sensors.environment import CCR, TYLCV, EpidemicParameters, SoilParameters, generate_environment

ON_DISK_FROM_CELLS = 10_000_000


def reference_disease_step(
    status: NDArray[np.int8], uniform: NDArray[np.float64], rule: InfectionRule
) -> NDArray[np.int8]:
    """One day of a disease over the whole farm."""
    after = status.copy()
    after[status == 1] = -1
    after[status > 1] -= 1
    count = np.asarray(convolve2d(after > 0, rule.kernel.weights(), "same"), np.float64)
    # Sums of 1/d^2 in floating point may fall just short of a whole number.
    probability = 1.0 - (1.0 - rule.likelihood) ** np.floor(count + 1e-9)
    after[(after == 0) & (probability > uniform)] = rule.duration_days
    return after


def reference_humps(corners: NDArray[np.int64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Sum humps one by one, each evaluated on its whole rectangle."""
    total = np.zeros(shape)
    width, height = shape
    for x, y in corners.tolist():
        grid_x = (np.linspace(0, width, width)[:, None] - width / 2) / (width / 8)
        grid_y = (np.linspace(0, height, height)[None, :] - height / 2) / (height / 8)
        hump = np.exp(-0.5 * (grid_x**2 + grid_y**2)) / (2 * np.pi * (width / 8) * (height / 8))
        x0, x1, y0, y1 = max(x, 0), min(x + width, width), max(y, 0), min(y + height, height)
        if x0 < x1 and y0 < y1:
            total[x0:x1, y0:y1] += hump[x0 - x : x1 - x, y0 - y : y1 - y]
    return total


def reference_soil_step(humidity: NDArray[np.float64], shower: Shower | None) -> NDArray[np.float64]:
    """One day of the soil over the whole farm."""
    humidity = humidity * 0.96
    if shower is not None:
        rain = reference_humps(shower.corners, (humidity.shape[0], humidity.shape[1]))
        if rain.sum() > 0:
            humidity = np.minimum(humidity + rain / rain.sum() * rain.size * shower.mean_rain, 1.0)
    return humidity


def reference_disease(
    hosts: NDArray[np.bool_], parameters: EpidemicParameters, days: int, measured_days: int
) -> float:
    """Time a disease by the reference method, in seconds for all days, and compare every day with ours."""
    rng = np.random.default_rng(10)
    shape = (hosts.shape[0], hosts.shape[1])
    rule = parameters.infection_rule(shape)
    status = np.where(hosts, np.int8(0), np.int8(-2))
    seeds = draw_seeds(hosts, parameters.seed_count(shape), rng)
    status.reshape(-1)[seeds] = parameters.seed_duration_days
    seconds = 0.0
    for _ in range(measured_days):
        start = time.perf_counter()
        uniform = rng.random(status.shape)
        after = reference_disease_step(status, uniform, rule)
        seconds += time.perf_counter() - start
        if not np.array_equal(after, step(status, uniform, rule)):
            raise SystemExit("the reference and ours differ in a day of a disease")
        status = after
    return seconds / measured_days * days


def reference_soil(shape: tuple[int, int], days: int, measured_days: int) -> tuple[float, float]:
    """Time the soil by the reference method, in seconds for all days, and give the difference to ours."""
    parameters = SoilParameters()
    weather = draw_weather(shape, days, parameters, np.random.default_rng(1))
    all_humps = len(weather.start_corners) + sum(len(s.corners) for s in weather.showers if s is not None)
    start = time.perf_counter()
    humidity = reference_humps(weather.start_corners, shape)
    shown = weather.showers if measured_days >= days else weather.showers[: parameters.warm_up_days + 1]
    for shower in shown:
        humidity = reference_soil_step(humidity, shower)
    seconds = time.perf_counter() - start
    humps = len(weather.start_corners) + sum(len(s.corners) for s in shown if s is not None)
    ours = np.empty(shape, np.float32)
    day = len(shown) - parameters.warm_up_days
    SoilCourse(shape, weather, parameters, day).compute(day, ours)
    return seconds * all_humps / humps, float(np.abs(ours - humidity).max())


def make_grid(size: str) -> FarmGrid:
    """Give the crop map of a farm's name, or of N x N or W x H cells, half strawberries and half tomatoes."""
    if not size[0].isdigit():
        return get_farm(size).grid()
    width, _, height = size.partition("x")
    shape = (int(width), int(height or width))
    names = tuple(Crop)
    crop = np.full(shape, names.index(Crop.STRAWBERRY), np.int8)
    crop[:, shape[1] // 2 :] = names.index(Crop.TOMATO)
    return FarmGrid(shape, FOOT_M, crop, np.ones(shape, np.bool_))


@dataclass(frozen=True)
class Run:
    """One generation by ours, in a process of its own."""

    seconds: float
    memory_gb: float


def run_ours(size: str, days: int, cores: int, folder: Path) -> Run:
    """Generate in a new process that may use some cores only."""
    command = [sys.executable, __file__, "--ours", size, "--days", str(days), "--directory", str(folder)]
    usable = sorted(os.sched_getaffinity(0))[:cores]

    def limit() -> None:
        os.sched_setaffinity(0, usable)

    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        command, stdout=subprocess.PIPE, check=True, text=True, env=environment, preexec_fn=limit
    )
    seconds, memory_gb = map(float, done.stdout.split())
    return Run(seconds, memory_gb)


def ours(size: str, days: int, directory: Path) -> None:
    """Print seconds and the peak of memory in GB of one generation, all days kept."""
    grid = make_grid(size)
    generate_environment(make_grid("10"), days=1, seed=1)  # loads what is loaded at the first use
    folder = directory / "environment" if grid.crop.size >= ON_DISK_FROM_CELLS else None
    start = time.perf_counter()
    generate_environment(grid, days=days, seed=1, keep_days=range(1, days + 1), directory=folder)
    seconds = time.perf_counter() - start
    print(seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)
    if folder is not None:
        shutil.rmtree(folder)


def measure(size: str, days: int, reference_days: int, repeats: int, directory: Path) -> str:
    """Measure one size, ours before and after the reference, and give a line of the table."""
    grid = make_grid(size)
    cores = len(os.sched_getaffinity(0))
    runs: dict[int, list[Run]] = {1: [], cores: []}

    def repeat() -> None:
        for number, done in runs.items():
            done += [run_ours(size, days, number, directory) for _ in range(repeats)]

    repeat()
    measured = min(days, reference_days)
    diseases = sum(
        reference_disease(grid.of_crops([crop]), parameters, days, measured)
        for crop, parameters in ((Crop.TOMATO, TYLCV), (Crop.STRAWBERRY, CCR))
    )
    soil, difference = reference_soil(grid.shape, days, measured)
    repeat()
    one, all_cores = (statistics.median(run.seconds for run in runs[number]) for number in (1, cores))
    memory = max(run.memory_gb for done in runs.values() for run in done)
    mark = "~" if measured < days else " "
    reference = diseases + soil
    return (
        f"{size:>12} {one:9.3f} {all_cores:9.3f} {memory:8.2f} {mark}{reference:10.2f} {mark}{diseases:9.2f} "
        f"{mark}{soil:9.2f} {mark}{reference / one:8.0f} x {mark}{reference / all_cores:8.0f} x "
        f"{difference:9.1e}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", nargs="+", default=["30", "100", "1000"], help="N, WxH or a farm's name")
    parser.add_argument("--days", type=int, default=15)
    parser.add_argument(
        "--reference-days", type=int, default=1000, help="days that the reference really works on"
    )
    parser.add_argument(
        "--repeats", type=int, default=2, help="runs of ours before, and as many after, the reference"
    )
    parser.add_argument(
        "--directory", type=Path, help="where our days are written (default: a temporary folder)"
    )
    parser.add_argument("--ours", metavar="SIZE", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.ours is not None:
        ours(arguments.ours, arguments.days, arguments.directory)
        return
    cores = len(os.sched_getaffinity(0))
    place = f"in memory, from {ON_DISK_FROM_CELLS:.0e} cells on disk"
    print(f"three fields, {arguments.days} days, all kept ({place}); seconds, medians of ours; load {load()}")
    print(
        f"{'cells':>12} {'1 core':>9} {f'{cores} cores':>9} {'peak GB':>8} {'reference':>11} "
        f"{'diseases':>10} {'soil':>10} {'1 core':>11} {f'{cores} cores':>11} {'soil diff':>9}"
    )
    with scratch_folder(arguments.directory) as folder:
        for size in arguments.sizes:
            days = max(1, arguments.reference_days)
            print(measure(size, arguments.days, days, max(1, arguments.repeats), folder), flush=True)
    print(f"load at the end {load()}")


def load() -> str:
    """Give the load of the last minute: more than ours and the times are of a busy machine."""
    return f"{os.getloadavg()[0]:.1f}"


if __name__ == "__main__":
    main()
