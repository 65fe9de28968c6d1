"""Time the generation of environments against the reference method, side by side in one process.

The reference is the method of the published benchmark code, written out below: a convolution of the whole
farm and a random number for every cell on each day of a disease, and for the soil every hump of rain
evaluated and added on its own. On the same draws both give the same epidemics, which this script checks day
by day, and the same soil up to the rounding of float32.

Examples::

    python benchmarks/environment.py --sizes 30 100 1000
    python benchmarks/environment.py --sizes waterberry --reference-days 1

With ``--reference-days N`` the reference works on the first N days only (of the soil: on the warm-up and one
day) and its time is scaled to all days, as its cost a day is constant; such times are marked with "~".
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import convolve2d

from geo.farms import get_farm
from geo.grid import STRAWBERRY, TOMATO, FarmGrid
from geo.units import FOOT_M
from sensors.environment import CCR, TYLCV, EpidemicParameters, SoilParameters, generate_environment
from sensors.environment.epidemic import InfectionRule, step
from sensors.environment.outbreak import draw_seeds
from sensors.environment.soil import Shower, draw_weather, write_soil

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

    def keep(_day: int, first_x: int, block: NDArray[np.float32]) -> None:
        ours[first_x : first_x + block.shape[0]] = block

    write_soil(shape, weather, parameters, [len(shown) - parameters.warm_up_days], keep)
    return seconds * all_humps / humps, float(np.abs(ours - humidity).max())


@dataclass(frozen=True)
class Result:
    """One line of the table."""

    size: str
    ours_s: float
    memory_gb: float
    diseases_s: float
    soil_s: float
    soil_difference: float
    scaled: bool

    def __str__(self) -> str:
        mark = "~" if self.scaled else " "
        reference = self.diseases_s + self.soil_s
        return (
            f"{self.size:>12} {self.ours_s:9.3f} {self.memory_gb:10.2f} {mark}{reference:10.2f} "
            f"{mark}{self.diseases_s:9.2f} {mark}{self.soil_s:9.2f} {mark}{reference / self.ours_s:9.0f} x "
            f"{self.soil_difference:9.1e}"
        )


def make_grid(size: str) -> FarmGrid:
    """Give the crop map of a farm's name, or of N x N or W x H cells, half strawberries and half tomatoes."""
    if not size[0].isdigit():
        return get_farm(size).grid()
    width, _, height = size.partition("x")
    shape = (int(width), int(height or width))
    crop = np.full(shape, STRAWBERRY, np.int8)
    crop[:, shape[1] // 2 :] = TOMATO
    return FarmGrid(shape, FOOT_M, crop, np.ones(shape, np.bool_))


def measure(size: str, days: int, reference_days: int, directory: Path) -> Result:
    """Measure one size."""
    grid = make_grid(size)
    shape = grid.shape
    start = time.perf_counter()
    folder = directory / "environment" if grid.crop.size >= ON_DISK_FROM_CELLS else None
    generate_environment(grid, days=days, seed=1, keep_days=range(1, days + 1), directory=folder)
    ours = time.perf_counter() - start
    # The peak of the process: right for the first size, and later an upper bound.
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    if folder is not None:
        shutil.rmtree(folder)
    measured = min(days, reference_days)
    diseases = sum(
        reference_disease(grid.crop == crop, parameters, days, measured)
        for crop, parameters in ((TOMATO, TYLCV), (STRAWBERRY, CCR))
    )
    soil, difference = reference_soil(shape, days, measured)
    return Result(size, ours, memory, diseases, soil, difference, measured < days)


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
        "--directory", type=Path, help="where our days are written (default: a temporary folder)"
    )
    arguments = parser.parse_args()
    place = f"in memory, from {ON_DISK_FROM_CELLS:.0e} cells on disk"
    print(f"three fields, {arguments.days} days, all kept ({place}); seconds")
    print(
        f"{'cells':>12} {'ours':>9} {'peak GB':>10} {'reference':>11} {'diseases':>10} {'soil':>10} "
        f"{'ratio':>12} {'soil diff':>9}"
    )
    with tempfile.TemporaryDirectory(dir=arguments.directory) as folder:
        for size in arguments.sizes:
            print(measure(size, arguments.days, max(1, arguments.reference_days), Path(folder)), flush=True)


if __name__ == "__main__":
    main()
