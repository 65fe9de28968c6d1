"""What wind and position errors cost: one plan flown in several winds, and with worse and worse receivers.

Run ``python benchmarks/weather.py [--farm miniberry-30] [--seeds 3]``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from wbf_mission.flight import fly
from wbf_mission.results.result import Result
from wbf_mission.scenario import Scenario

WINDS: dict[str, dict[str, object]] = {
    "calm": {},
    "5 m/s at 10 m": {"wind_speed_m_s": 5.0},
    "5 m/s, log, high crops (0.25 m)": {"wind_speed_m_s": 5.0, "wind_shear": "log", "wind_roughness_m": 0.25},
    "5 m/s, log, turbulence of that wind": {
        "wind_speed_m_s": 5.0,
        "wind_shear": "log",
        "turbulence": "wind",
    },
    "5 m/s, log, light": {"wind_speed_m_s": 5.0, "wind_shear": "log", "turbulence": "light"},
    "5 m/s, log, moderate": {"wind_speed_m_s": 5.0, "wind_shear": "log", "turbulence": "moderate"},
    "8 m/s, log, moderate": {"wind_speed_m_s": 8.0, "wind_shear": "log", "turbulence": "moderate"},
}
RECEIVERS = (0.0, 0.02, 0.2, 0.5, 1.0, 2.0)


def wrong_cells(result: Result) -> float:
    """Return the fraction of pictures that were booked under another cell than the one that was seen."""
    if result.true_track is None:
        return 0.0
    true, believed = result.true_track.at(result.track.time_s), result.track
    cells = [result.farm.cell_of(track.x_m, track.y_m) for track in (true, believed)]
    return float(np.mean((cells[0][0] != cells[1][0]) | (cells[0][1] != cells[1][1])))


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--farm", default="miniberry-30")
    parser.add_argument("--vehicle", default="quad")
    parser.add_argument("--autopilot", default="px4")
    parser.add_argument("--seeds", type=int, default=3)
    args = parser.parse_args()
    base = Scenario(
        farm=args.farm, planner="lawnmower", vehicle=args.vehicle, autopilot=args.autopilot, budget="1200m"
    )
    print("| wind | time, s | battery, % |\n|---|---|---|")
    for name, changes in WINDS.items():
        runs = [
            fly(replace(base, seed=seed, wind_direction_deg=240.0, **changes)) for seed in range(args.seeds)
        ]
        times = np.mean([run.flight_time_s for run in runs])
        used = np.mean([100.0 * (run.battery_used or 0.0) for run in runs])
        print(f"| {name} | {times:.1f} | {used:.2f} |")
    print("\n| receiver, m | error, m (rms) | wrong cell, % | score at the end |\n|---|---|---|---|")
    for sigma_m in RECEIVERS:
        runs = [fly(replace(base, seed=seed, gps_noise_m=sigma_m)) for seed in range(args.seeds)]
        errors = [(run.summary()["position_error_m"] or {"rms": 0.0})["rms"] for run in runs]
        wrong = 100.0 * np.mean([wrong_cells(run) for run in runs])
        score = np.mean([run.history.entries[-1].score for run in runs])
        print(f"| {sigma_m:g} | {np.sqrt(np.mean(np.square(errors))):.2f} | {wrong:.0f} | {score:.4f} |")


if __name__ == "__main__":
    main()
