"""Comparison of recorded flights of real autopilots with simulated ones: times, paths, phases, turns, plots.

    python benchmarks/side_by_side.py [--folder tests/data/flights] [--only rover] [--seeds 8] [--out PLOTS]

The folder holds ``<autopilot>-<mission>.json`` and ``.csv.gz`` files (see `benchmarks/recordings.py`). Each
mission is flown by the corresponding simulated vehicle, with the recorded parameters and wind. Vehicles with
estimate errors (PX4's multirotors) fly once for each seed. Times and phases are then means with standard
deviations; all other figures are those of the flight with the median time.
"""

from __future__ import annotations

import sys
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from common import options_of, print_table
from flight_measures import phases, turns
from recordings import START_S, Comparison, Flight, Recording, compare, fly_recording, load_recording

from sim_vehicle.airframe.navigation_errors import EstimateErrors
from sim_vehicle.autopilot import estimate_errs
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sim_vehicle.airframe.spec import VehicleSpec

FOLDER = Path(__file__).parents[1] / "tests" / "data" / "flights"
FIRMWARE = {
    ("ardupilot", "multirotor"): "ArduCopter",
    ("ardupilot", "fixed-wing"): "ArduPlane",
    ("ardupilot", "rover"): "ArduRover",
    ("px4", "multirotor"): "PX4 multirotor",
    ("px4", "fixed-wing"): "PX4 fixed wing",
    ("px4", "rover"): "PX4 rover",
}


@dataclass(frozen=True, slots=True)
class Pair:
    """Recording and simulated flights of its mission."""

    stem: str
    recording: Recording
    spec: VehicleSpec
    flights: tuple[Flight, ...]

    @classmethod
    def of(cls, path: Path, seeds: int) -> Pair:
        """Load a recording and fly its mission."""
        recording = load_recording(path)
        spec = recording.spec()
        errors = [EstimateErrors(seed) for seed in range(seeds)] if estimate_errs(spec) else [None]
        return cls(path.stem, recording, spec, tuple(fly_recording(recording, spec, one) for one in errors))

    @property
    def times_s(self) -> list[float]:
        """Time of each simulated flight from the first to the last waypoint (s)."""
        return [last - first for first, last in (one.window(self.recording.items) for one in self.flights)]

    @property
    def flight(self) -> Flight:
        """Simulated flight with the median time."""
        times_s = self.times_s
        return self.flights[sorted(range(len(times_s)), key=times_s.__getitem__)[len(times_s) // 2]]

    @property
    def vehicle(self) -> str:
        """Firmware and kind of vehicle."""
        return FIRMWARE[self.recording.autopilot, self.spec.kind]


def main() -> None:
    """Fly all recordings and print the tables."""
    parser = options_of(__doc__)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    parser.add_argument("--seeds", type=int, default=8, help="flights of a vehicle whose estimate errs")
    parser.add_argument("--out", type=Path, help="write a page of plots for each vehicle into this folder")
    options = parser.parse_args()
    pairs, times, parts, corners = [], [], [], []
    for path in sorted(options.folder.glob("*.json")):
        if options.only not in path.stem:
            continue
        try:
            pair = Pair.of(path, options.seeds)
            pairs.append(pair)
            times.append(_times(pair, compare(pair.recording, pair.flight)))
            parts.append(_phases(pair))
            if pair.spec.kind != "multirotor":
                corners.append(_turns(pair))
        except VehicleError as error:
            print(f"{path.stem}: {error}", file=sys.stderr)
    print_table(times, "First to last waypoint")
    print_table(parts, "Phases, recorded / simulated")
    print_table(corners, "Corners, recorded / simulated, medians")
    if options.out is not None:
        for vehicle in sorted({pair.vehicle for pair in pairs}):
            path = options.out / f"{vehicle.lower().replace(' ', '-')}.png"
            _plot([pair for pair in pairs if pair.vehicle == vehicle], path)
            print(path)


def _times(pair: Pair, result: Comparison) -> dict[str, str]:
    mean_s = float(np.mean(pair.times_s))
    spread = f" (+-{np.std(pair.times_s, ddof=1):.1f})" if len(pair.times_s) > 1 else ""
    return {
        "recording": pair.stem,
        "vehicle": pair.vehicle,
        "recorded": f"{result.recorded_s:.1f} s",
        "simulated": f"{mean_s:.1f}{spread} s",
        "error": f"{100.0 * (mean_s / result.recorded_s - 1.0):+.1f} %",
        "path, mean": f"{result.mean_m:.2f} m",
        "path, 95 %": f"{result.p95_m:.2f} m",
        "speed, r": f"{result.correlation:.3f}",
    }


def _phases(pair: Pair) -> dict[str, str]:
    heads = "take-off", "to the first waypoint", "mission", "way home", "landing", "start to disarming"

    def lasted(flight: Flight, start_s: float) -> tuple[float, ...]:
        found = phases(flight, pair.recording.items, start_s, flies=pair.spec.kind != "rover")
        return (*astuple(found), flight.end_s - start_s)

    recorded = lasted(pair.recording.flight, START_S)
    simulated = np.array([lasted(flight, 0.0) for flight in pair.flights])
    cells = [_beside(values, "s") for values in zip(recorded, simulated.mean(axis=0).tolist(), strict=True)]
    if len(simulated) > 1:
        deviations = simulated.std(axis=0, ddof=1).tolist()
        cells = [
            cell if np.isnan(deviation) else cell.removesuffix(" s") + f" (+-{deviation:.1f}) s"
            for cell, deviation in zip(cells, deviations, strict=True)
        ]
    return {"recording": pair.stem} | dict(zip(heads, cells, strict=True))


def _turns(pair: Pair) -> dict[str, str]:
    heads = "passes at", "overshoot", "greatest overshoot", "radius", "rate of turning"
    recorded, simulated = pair.recording.flight, pair.flight
    both = [
        astuple(found) for found in turns((recorded, simulated), pair.recording.items, pair.recording.frame)
    ]
    units = "m", "m", "m", "m", "deg/s"
    cells = [_beside(values, unit) for values, unit in zip(zip(*both, strict=True), units, strict=True)]
    circles = pair.spec.kind == "fixed-wing" and np.isnan(recorded.end_s + simulated.end_s)
    apart = recorded.position_m[-1, :2] - simulated.position_m[-1, :2]
    ends = "-" if circles else f"{np.hypot(*apart):.1f} m"
    return {"recording": pair.stem, **dict(zip(heads, cells, strict=True)), "ends apart": ends}


def _beside(values: Iterable[float], unit: str) -> str:
    cells = ["-" if np.isnan(value) else f"{value:.1f}" for value in values]
    return "-" if set(cells) == {"-"} else f"{cells[0]} / {cells[1]} {unit}"


def _plot(pairs: list[Pair], path: Path) -> None:
    """Draw one row for each pair of one vehicle: ground tracks, heights and speeds."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(
        len(pairs), 3, figsize=(16, 5.0 * len(pairs)), layout="constrained", squeeze=False
    )
    for (way, height, speed), pair in zip(axes, pairs, strict=True):
        for (flight, start_s), name, style, width in zip(
            ((pair.recording.flight, START_S), (pair.flight, 0.0)),
            ("recorded", "simulated"),
            ("0.5", "C3"),
            (2.5, 1.0),
            strict=True,
        ):
            inside = flight.time_s >= start_s
            time_s = flight.time_s[inside] - start_s
            position, velocity = flight.position_m[inside], flight.velocity_m_s[inside]
            way.plot(position[:, 0], position[:, 1], color=style, lw=width, label=name)
            height.plot(time_s, position[:, 2], color=style, lw=width)
            speed.plot(time_s, np.linalg.norm(velocity, axis=1), color=style, lw=width)
        way.set(title=pair.stem, aspect="equal", adjustable="datalim", xlabel="east, m", ylabel="north, m")
        height.set(xlabel="time from the start of the mission, s", ylabel="height, m")
        speed.set(xlabel="time from the start of the mission, s", ylabel="speed over ground, m/s")
    axes.flat[0].legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=70)
    plt.close(figure)


if __name__ == "__main__":
    main()
