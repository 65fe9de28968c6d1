"""Time the generation of environments against the reference method in one process.

The reference is the method of the published benchmark code, reimplemented below. For a disease, each day
convolves the whole farm and draws a random number for every cell. For the soil, each hump of rain is
evaluated and added separately. With the same draws, both methods give the same epidemics, which this script
checks day by day, and the same soil up to the rounding of float32.

Our method runs before and after the reference. On large farms our method also writes its days to disk; the
reference keeps no days. ``--reference-days N`` limits the reference to the first N days (soil: warm-up and
one day). The measured time is then scaled to all days, as the cost per day is constant, and marked by "~".

    python benchmarks/environment.py --farms miniberry-30 miniberry-100
    python benchmarks/environment.py --farms waterberry --reference-days 1
"""

from __future__ import annotations

import statistics
import time

import numpy as np
from common import options_of, print_table, scratch_folder, seconds_of
from numpy.typing import NDArray
from scipy.signal import convolve2d

from geo.farms import get_farm
from geo.grid import Crop
from sensors.dynamics.epidemic import InfectionRule, draw_seeds, step
from sensors.dynamics.soil import Shower, SoilCourse, draw_weather
from sensors.environment import CCR, TYLCV, EpidemicParameters, SoilParameters, generate_environment

ON_DISK_FROM_CELLS = 10_000_000


def reference_disease_step(
    status: NDArray[np.int8], uniform: NDArray[np.float64], rule: InfectionRule
) -> NDArray[np.int8]:
    """Return the status of all cells after one day of a disease, by the reference method."""
    after = status.copy()
    after[status == 1] = -1
    after[status > 1] -= 1
    count = np.asarray(convolve2d(after > 0, rule.kernel.weights(), "same"), np.float64)
    # Rounding may leave a sum of 1/d^2 slightly below an integer.
    probability = 1.0 - (1.0 - rule.likelihood) ** np.floor(count + 1e-9)
    after[(after == 0) & (probability > uniform)] = rule.duration_days
    return after


def reference_humps(corners: NDArray[np.int64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the sum of humps, each evaluated on its whole rectangle."""
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
    """Return the soil humidity of all cells after one day, by the reference method."""
    humidity = humidity * 0.96
    if shower is not None:
        rain = reference_humps(shower.corners, (humidity.shape[0], humidity.shape[1]))
        if rain.sum() > 0:
            humidity = np.minimum(humidity + rain / rain.sum() * rain.size * shower.mean_rain, 1.0)
    return humidity


def reference_disease(
    hosts: NDArray[np.bool_], parameters: EpidemicParameters, days: int, measured_days: int
) -> float:
    """Return the reference time of a disease for all days (s); compare each day with our method."""
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
    """Return the reference time of the soil for all days (s), and the difference from our method."""
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


def ours(farm: str, days: int) -> float:
    """Return the time of one generation with all days kept (s)."""
    grid = get_farm(farm).grid()
    keep_days = range(1, days + 1)
    with scratch_folder() as folder:
        kept = folder / "environment" if grid.crop.size >= ON_DISK_FROM_CELLS else None
        return seconds_of(
            lambda: generate_environment(grid, days=days, seed=1, keep_days=keep_days, directory=kept),
            time.perf_counter,
        )


def measure(farm: str, days: int, reference_days: int, repeats: int) -> dict[str, str]:
    """Return the table row of one farm; our method is timed before and after the reference."""
    grid = get_farm(farm).grid()
    ours("miniberry-10", 1)  # Excludes imports and compilation from the time
    own_s = [ours(farm, days) for _ in range(repeats)]
    measured = min(days, reference_days)
    diseases_s = sum(
        reference_disease(grid.of_crops([crop]), parameters, days, measured)
        for crop, parameters in ((Crop.TOMATO, TYLCV), (Crop.STRAWBERRY, CCR))
    )
    soil_s, difference = reference_soil(grid.shape, days, measured)
    own_s += [ours(farm, days) for _ in range(repeats)]
    middle_s, reference_s = statistics.median(own_s), diseases_s + soil_s
    mark = "~" if measured < days else ""
    return {
        "farm": farm,
        "ours, s": f"{middle_s:.3f}",
        "reference, s": f"{mark}{reference_s:.2f}",
        "diseases, s": f"{mark}{diseases_s:.2f}",
        "soil, s": f"{mark}{soil_s:.2f}",
        "ratio": f"{mark}{reference_s / middle_s:.0f}",
        "soil, difference": f"{difference:.1e}",
    }


def main() -> None:
    """Print the table."""
    parser = options_of(__doc__)
    parser.add_argument("--farms", nargs="+", default=["miniberry-30", "miniberry-100"])
    parser.add_argument("--days", type=int, default=15)
    parser.add_argument("--reference-days", type=int, default=1000, help="days measured of the reference")
    parser.add_argument("--repeats", type=int, default=2, help="our runs before and after the reference")
    options = parser.parse_args()
    reference_days, repeats = max(1, options.reference_days), max(1, options.repeats)
    rows = [measure(farm, options.days, reference_days, repeats) for farm in options.farms]
    print_table(rows, f"Three fields, {options.days} days, all kept")


if __name__ == "__main__":
    main()
