"""Speed of the vehicle's motion: the kernel against the same source in plain Python, executor, prediction.

Run: ``python benchmarks/kinematics.py [--json]``
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable

import numpy as np

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem
from sim_vehicle.executor import MissionExecutor
from sim_vehicle.motion import kernel
from sim_vehicle.motion.model import Route
from sim_vehicle.motion.multirotor import Multirotor
from sim_vehicle.predict import predict_flight
from sim_vehicle.spec import get_vehicle

HOME = LocalFrame(28.05, -82.15)
QUAD = get_vehicle("quad")


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


def kernel_seconds_per_step(points: list[tuple[float, float]], *, plain: bool, max_steps: int) -> float:
    """Return the time of one step; ``plain`` runs the same source uncompiled."""
    vehicle = Multirotor(QUAD)
    vehicle.fly(Route.through([(x, y, 10.0, 1.0, 5.0, math.nan, 0.0) for x, y in points]))
    names = ("stopping_distance", "axis_acceleration", "multirotor_power", "advance")
    compiled = {name: getattr(kernel, name) for name in names}
    if plain:
        for name in names:
            setattr(kernel, name, compiled[name].py_func)
    try:
        begin = time.perf_counter()
        vehicle.advance(max_steps, stop_each=False)
        return (time.perf_counter() - begin) / vehicle.step
    finally:
        for name in names:
            setattr(kernel, name, compiled[name])


def executor_rate(plan: Mission, look_s: float) -> float:
    """Return simulated over real seconds of a flight whose state is read every ``look_s`` seconds."""
    vehicle = MissionExecutor(QUAD, HOME)
    vehicle.load(plan.items)
    vehicle.arm()
    vehicle.start()
    begin = time.perf_counter()
    while vehicle.armed:
        vehicle.advance(vehicle.time_s + look_s)
        vehicle.state()
    return vehicle.time_s / (time.perf_counter() - begin)


def prediction_ms(plan: Mission) -> tuple[float, float]:
    """Return the time of a prediction, milliseconds, and the predicted duration, seconds."""
    flight = predict_flight(plan, QUAD)

    def once() -> float:
        begin = time.perf_counter()
        predict_flight(plan, QUAD)
        return time.perf_counter() - begin

    return 1000.0 * best_of(once, 10), flight.duration_s


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    path = rows(150.0, 20, 8.0)
    angle = np.linspace(3.0, 55.0, 3000)
    dense = [(2.0 * a * math.cos(a), 2.0 * a * math.sin(a)) for a in angle.tolist()]
    executor_rate(mission(path, 5.0), 0.1)
    compiled = best_of(lambda: kernel_seconds_per_step(path, plain=False, max_steps=10_000_000), 5)
    plain = best_of(lambda: kernel_seconds_per_step(path, plain=True, max_steps=20_000), 2)
    short_ms, short_s = prediction_ms(mission(path, 5.0))
    dense_ms, dense_s = prediction_ms(mission(dense, 5.0))
    result = {
        "kernel_steps_per_s": 1.0 / compiled,
        "plain_python_steps_per_s": 1.0 / plain,
        "kernel_over_plain_python": plain / compiled,
        "executor_10_hz_times_real_time": 1.0
        / best_of(lambda: 1.0 / executor_rate(mission(path, 5.0), 0.1), 3),
        "prediction_40_waypoints_ms": short_ms,
        "prediction_40_waypoints_flight_s": short_s,
        "prediction_3000_waypoints_ms": dense_ms,
        "prediction_3000_waypoints_flight_s": dense_s,
    }
    if arguments.json:
        print(json.dumps(result, indent=2))
        return
    for name, value in result.items():
        print(f"{name:36s} {value:14,.1f}")


if __name__ == "__main__":
    main()
