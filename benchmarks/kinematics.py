"""Speed of the vehicles' motion: each compiled law alone, in a batch, and as the same source in plain Python.

Run: ``python benchmarks/kinematics.py [--json]``
"""

from __future__ import annotations

import argparse
import functools
import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
import numpy as np

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.motion.batch import VehicleBatch
from sim_vehicle.motion.legs import KEEP, Leg, LegKind, Route
from sim_vehicle.motion.model import MotionModel
from sim_vehicle.prediction.predict import predict_flight, predict_flights

HOME = LocalFrame(28.05, -82.15)
LAWS = {
    "generic": ("quad", "generic"),
    "px4": ("quad", "px4"),
    "arducopter": ("quad", "ardupilot"),
    "fixed wing": ("fixed-wing", "px4"),
    "rover": ("rover", "px4"),
}
BATCH = 100
CHUNK = 50


def rows(width_m: float, count: int, spacing_m: float) -> list[tuple[float, float]]:
    """Return the corners of a lawnmower path."""
    points: list[tuple[float, float]] = []
    for k in range(count):
        ends = [(0.0, k * spacing_m), (width_m, k * spacing_m)]
        points += ends if k % 2 == 0 else ends[::-1]
    return points


def mission(points: list[tuple[float, float]], speed_m_s: float) -> Mission:
    """Return take-off, speed, the points, and the way home."""
    items = [MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0), MissionItem(178, 2, 1, speed_m_s, -1)]
    items += [MissionItem.waypoint(*HOME.to_wgs84(x, y), 10.0) for x, y in points]
    return Mission((*items, MissionItem(20, 2)), GeoPoint(28.05, -82.15))


def best_of(run: Callable[[], float], times: int) -> float:
    """Return the least of several measurements."""
    return min(run() for _ in range(times))


def vehicle_of(law: str) -> VehicleSpec:
    """Return the vehicle that is flown by a law."""
    name, autopilot = LAWS[law]
    return with_autopilot(get_vehicle(name), autopilot)  # type: ignore[arg-type]


def set_out(law: str, aside_m: float = 0.0) -> MotionModel:
    """Return a vehicle that begins a lawnmower flight."""
    spec = vehicle_of(law)
    motion = flight_procedures(spec).motion(spec, None, 0.0)
    far = 6.0 if law == "fixed wing" else 1.0
    legs = [Leg((0.0, 50.0, 30.0), 5.0, heading=KEEP, kind=LegKind.TAKEOFF)]
    legs += [
        Leg((far * x + aside_m, far * y, 30.0), 5.0, radius_m=1.0, kind=LegKind.WAYPOINT)
        for x, y in rows(150.0, 20, 8.0)
    ]
    motion.fly(Route.through(legs))
    return motion


def single_s_per_step(law: str, max_steps: int) -> float:
    """Return the time of one step of one vehicle."""
    motion = set_out(law)
    begin = time.perf_counter()
    motion.advance(max_steps, stop_each=False)
    return (time.perf_counter() - begin) / motion.step


def batch_s_per_step(law: str) -> float:
    """Return the time of one step of one of `BATCH` vehicles, in calls of `CHUNK` steps."""
    batch = VehicleBatch([set_out(law, 0.1 * k) for k in range(BATCH)])
    batch.advance(CHUNK, stop_each=False)
    before = int(batch.counters[:, 0].sum())
    begin = time.perf_counter()
    for _ in range(100):
        batch.advance(CHUNK, stop_each=False)
    return (time.perf_counter() - begin) / (int(batch.counters[:, 0].sum()) - before)


@contextmanager
def plain_python() -> Iterator[None]:
    """Run the kernels' sources uncompiled."""
    modules = [module for name, module in sys.modules.items() if name.startswith("sim_vehicle.")]
    classes = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    compiled: list[tuple[Any, str, Any]] = []
    for holder in (*modules, *dict.fromkeys(classes)):
        for name, value in vars(holder).items():
            function = value.__func__ if isinstance(value, staticmethod) else value
            if isinstance(function, numba.core.dispatcher.Dispatcher):
                compiled.append((holder, name, value))
    try:
        for holder, name, value in compiled:
            if isinstance(value, staticmethod):
                setattr(holder, name, staticmethod(value.__func__.py_func))
            else:
                setattr(holder, name, value.py_func)
        yield
    finally:
        for holder, name, value in compiled:
            setattr(holder, name, value)


def executor_rate(plan: Mission, spec: VehicleSpec, look_s: float) -> float:
    """Return simulated over real seconds of a flight whose state is read every ``look_s`` seconds."""
    vehicle = MissionExecutor(spec, HOME)
    vehicle.mission.load(plan.items)
    vehicle.arm()
    vehicle.start()
    begin = time.perf_counter()
    while vehicle.flight.armed:
        vehicle.advance(vehicle.time_s + look_s)
        vehicle.state()
    return vehicle.time_s / (time.perf_counter() - begin)


def timed(run: Callable[[], Any]) -> float:
    """Return how long a call takes, seconds."""
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


def measure_law(law: str) -> dict[str, float]:
    """Return the figures of one law."""
    single = functools.partial(single_s_per_step, law)
    single(100)
    alone = best_of(lambda: single(10_000_000), 5)
    batched = best_of(lambda: batch_s_per_step(law), 3)
    with plain_python():
        plain = best_of(lambda: single(4_000), 2)
    return {
        "single_us_per_step": 1e6 * alone,
        "batched_us_per_step": 1e6 * batched,
        "batched_steps_per_s": 1.0 / batched,
        "plain_python_steps_per_s": 1.0 / plain,
        "batched_over_plain_python": plain / batched,
    }


def measure_predictions(autopilot: str) -> dict[str, float]:
    """Return the figures of executor and predictions under one autopilot."""
    spec = with_autopilot(get_vehicle("quad"), autopilot)  # type: ignore[arg-type]
    short = mission(rows(150.0, 20, 8.0), 5.0)
    angle = np.linspace(3.0, 55.0, 3000)
    dense = mission([(2.0 * a * math.cos(a), 2.0 * a * math.sin(a)) for a in angle.tolist()], 5.0)
    several = [mission(rows(150.0, 20 - k, 8.0), 5.0) for k in range(8)]
    flight = predict_flight(short, spec)
    predict_flights(several, spec)
    return {
        "executor_10_hz_times_real_time": 1.0 / best_of(lambda: 1.0 / executor_rate(short, spec, 0.1), 3),
        "prediction_40_waypoints_flight_s": flight.duration_s,
        "prediction_40_waypoints_ms": 1e3 * best_of(lambda: timed(lambda: predict_flight(short, spec)), 5),
        "prediction_3000_waypoints_ms": 1e3 * best_of(lambda: timed(lambda: predict_flight(dense, spec)), 3),
        "eight_predictions_ms": 1e3
        * best_of(lambda: timed(lambda: [predict_flight(one, spec) for one in several]), 3),
        "eight_predictions_together_ms": 1e3
        * best_of(lambda: timed(lambda: predict_flights(several, spec)), 3),
        "eight_predictions_two_threads_ms": 1e3
        * best_of(lambda: timed(lambda: predict_flights(several, spec, threads=2)), 3),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    laws = {law: measure_law(law) for law in LAWS}
    predictions = {name: measure_predictions(name) for name in ("generic", "px4", "ardupilot")}
    if arguments.json:
        print(json.dumps({"laws": laws, "predictions": predictions}, indent=2))
        return
    for table in (laws, predictions):
        print(f"{'':34s}" + "".join(f"{name:>13s}" for name in table))
        for figure in next(iter(table.values())):
            print(f"{figure:34s}" + "".join(f"{one[figure]:13,.2f}" for one in table.values()))
        print()


if __name__ == "__main__":
    main()
