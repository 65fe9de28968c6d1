"""Simulated against recorded flights of PX4 and ArduPilot: times, paths, speeds, and a plot.

    python benchmarks/recorded_flights.py [FOLDER] [--only px4] [--plot docs/images/recorded-flights.png]

The folder holds ``<autopilot>-<mission>.json`` and ``.csv.gz`` files (see `benchmarks/recordings.py`).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from recordings import Flight, Recording, compare, fly_recording, load_recording

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot

FOLDER = Path(__file__).parents[1] / "tests" / "data" / "flights"


def main() -> None:
    """Fly all recordings and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    parser.add_argument("--vehicle", default="quad")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    parser.add_argument("--plot", type=Path, help="write a picture here")
    parser.add_argument("--generic", action="store_true", help="fly the law of no autopilot, to compare")
    options = parser.parse_args()
    pairs: list[tuple[Recording, Flight]] = []
    print(
        f"{'recording':<26}{'recorded':>10}{'simulated':>10}{'error':>8}{'path mean':>11}{'95 %':>8}"
        f"{'speed r':>9}{'take-off':>16}{'way home':>16}{'took':>8}"
    )
    for path in sorted(options.folder.glob("*.json")):
        if options.only not in path.name:
            continue
        recording = load_recording(path)
        autopilot = "generic" if options.generic else recording.autopilot
        spec = with_autopilot(get_vehicle(options.vehicle), autopilot)
        begin = time.perf_counter()
        flight = fly_recording(recording, spec)
        took = time.perf_counter() - begin
        result = compare(recording, flight)
        pairs.append((recording, flight))
        before, after = zip(_outside(recording, recording.flight), _outside(recording, flight), strict=True)
        print(
            f"{path.stem:<26}{result.recorded_s:>8.1f} s{result.simulated_s:>8.1f} s"
            f"{result.time_error:>8.1%}{result.mean_m:>9.2f} m{result.p95_m:>6.2f} m"
            f"{result.correlation:>9.4f}"
            f"{before[0]:>7.1f} /{before[1]:>5.1f} s{after[0]:>7.1f} /{after[1]:>5.1f} s{took:>6.2f} s"
        )
    if options.plot is not None:
        _plot(pairs, options.plot)


def _outside(recording: Recording, flight: Flight) -> tuple[float, float]:
    """Return the time before the first waypoint, from the start of the mission, and that after the last."""
    first, last = flight.window(recording.items)
    begin = 3.0 if flight is recording.flight else 0.0
    return first - begin, flight.end_s - last


def _plot(pairs: list[tuple[Recording, Flight]], path: Path) -> None:
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(len(pairs), 3, figsize=(15, 3.4 * len(pairs)), layout="constrained")
    for (way, height, speed), (recording, flight) in zip(np.atleast_2d(axes), pairs, strict=True):
        for one, name, style in ((recording.flight, "recorded", "0.4"), (flight, "simulated", "C3")):
            first, last = one.window(recording.items)
            inside = (one.time_s >= first) & (one.time_s <= last)
            time_s = one.time_s[inside] - first
            width = 2.5 if style == "0.4" else 1.0
            position = one.position_m[inside]
            way.plot(position[:, 0], position[:, 1], color=style, lw=width, label=name)
            height.plot(time_s, position[:, 2], color=style, lw=width)
            speed.plot(time_s, np.linalg.norm(one.velocity_m_s[inside], axis=1), color=style, lw=width)
        way.set(
            title=f"{recording.autopilot} {recording.name}",
            aspect="equal",
            xlabel="east, m",
            ylabel="north, m",
        )
        height.set(xlabel="time from the first waypoint, s", ylabel="height, m")
        speed.set(xlabel="time from the first waypoint, s", ylabel="speed, m/s")
    axes.flat[0].legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=70)


if __name__ == "__main__":
    main()
