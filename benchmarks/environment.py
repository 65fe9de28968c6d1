"""Time the generation of environments against the reference method, side by side in one process.

The reference is the method of the published benchmark code, written out below: a convolution of the whole
farm and a random number for every cell on each day of a disease, and for the soil every hump of rain
evaluated and added on its own. On the same draws both give the same epidemics, which this script checks day
by day, and the same soil up to the rounding of float32.

Ours runs before and after the reference; it also writes its days to disk on large farms, the reference keeps
none. With ``--reference-days N`` the reference works on the first N days only (of the soil: on the warm-up
and one day) and its time is scaled to all days, as its cost a day is constant; "~" marks such times.

    python benchmarks/environment.py --sizes 30 100 1000
    python benchmarks/environment.py --sizes waterberry --reference-days 1
"""

from __future__ import annotations

import statistics
import time

import numpy as np
from common import options_of, print_table, scratch_folder
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


def ours(size: str, days: int) -> float:
    """Return the seconds of one generation, all days kept."""
    grid = make_grid(size)
    with scratch_folder() as folder:
        kept = folder / "environment" if grid.crop.size >= ON_DISK_FROM_CELLS else None
        begin_s = time.perf_counter()
        generate_environment(grid, days=days, seed=1, keep_days=range(1, days + 1), directory=kept)
        return time.perf_counter() - begin_s


def measure(size: str, days: int, reference_days: int, repeats: int) -> list[str]:
    """Measure one size, ours before and after the reference, and return a row of the table."""
    grid = make_grid(size)
    generate_environment(make_grid("10"), days=1, seed=1)  # Loads what is loaded at the first use
    own_s = [ours(size, days) for _ in range(repeats)]
    measured = min(days, reference_days)
    diseases_s = sum(
        reference_disease(grid.of_crops([crop]), parameters, days, measured)
        for crop, parameters in ((Crop.TOMATO, TYLCV), (Crop.STRAWBERRY, CCR))
    )
    soil_s, difference = reference_soil(grid.shape, days, measured)
    own_s += [ours(size, days) for _ in range(repeats)]
    middle_s, reference_s = statistics.median(own_s), diseases_s + soil_s
    mark = "~" if measured < days else ""
    theirs = [f"{mark}{seconds:.2f}" for seconds in (reference_s, diseases_s, soil_s)]
    return [size, f"{middle_s:.3f}", *theirs, f"{mark}{reference_s / middle_s:.0f}", f"{difference:.1e}"]


def main() -> None:
    """Print the table."""
    parser = options_of(__doc__)
    parser.add_argument("--sizes", nargs="+", default=["30", "100", "1000"], help="N, WxH or a farm's name")
    parser.add_argument("--days", type=int, default=15)
    parser.add_argument(
        "--reference-days", type=int, default=1000, help="days that the reference really works on"
    )
    parser.add_argument(
        "--repeats", type=int, default=2, help="runs of ours before, and as many after, the reference"
    )
    options = parser.parse_args()
    reference_days, repeats = max(1, options.reference_days), max(1, options.repeats)
    rows = [measure(size, options.days, reference_days, repeats) for size in options.sizes]
    heads = ["cells", "ours, s", "reference, s", "diseases, s", "soil, s", "ratio", "soil, difference"]
    print_table(heads, rows, f"Three fields, {options.days} days, all kept")


if __name__ == "__main__":
    main()
