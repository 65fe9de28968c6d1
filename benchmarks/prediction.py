"""What `plan` predicts against whole flights over MAVLink: time and energy, by vehicle and wind.

    python benchmarks/prediction.py [--seeds 4] [--quick] [--json]

For each vehicle, farm, planner and wind a mission is planned and flown, in gusts with several seeds. The
table gives the greatest error of the prediction in calm, steady and sheared winds, and in gusts the error of
the prediction against the mean of the flights with their spread, in percent. The time of a flight ends with
its last fix in the air, that of a prediction when the autopilot has noticed the landing.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass

import numpy as np

from geo.errors import WbfMissionError
from mission.outcome import Outcome
from mission.planners import planner_names
from sim_vehicle.autopilot import DEFAULT_AUTOPILOT, autopilot_names
from wbf_mission.flight import fly
from wbf_mission.scenario import Scenario, scenario_with

VEHICLES = ("quad", "mapping-quad", "mini-quad", "rover", "wing", "fixed-wing", "ideal")
FARMS = ("miniberry-30", "miniberry-100")
WINDS: dict[str, dict[str, object]] = {
    "none": {},
    "steady": {"wind_speed_m_s": 4.0, "wind_direction_deg": 60.0},
    "sheared": {"wind_speed_m_s": 4.0, "wind_direction_deg": 200.0, "wind_shear": "log"},
    "turbulence": {"wind_speed_m_s": 4.0, "wind_direction_deg": 60.0, "turbulence": "wind"},
    "light": {"wind_speed_m_s": 4.0, "wind_direction_deg": 60.0, "turbulence": "light"},
    "moderate": {"wind_speed_m_s": 4.0, "wind_direction_deg": 60.0, "turbulence": "moderate"},
}
CALM = ("none", "steady", "sheared")

# Of those that use up the same budget.
PLANNERS = tuple(name for name in planner_names() if name != "survey")


@dataclass(frozen=True, slots=True)
class Comparison:
    """One prediction with the flights of its mission; percent of the flights' mean."""

    vehicle: str
    autopilot: str
    farm: str
    planner: str
    wind: str
    flights: int
    completed: int
    predicted_s: float
    time_error: float
    time_spread: float
    energy_error: float
    energy_spread: float


def compare(scenario: Scenario, wind: str, seeds: int) -> Comparison | None:
    """Plan and fly; None where nothing can be planned."""
    gusty = wind not in CALM
    scenario = scenario_with(scenario, WINDS[wind])
    times, energies, completed = [], [], 0
    for seed in range(seeds if gusty else 1):
        try:
            result = fly(scenario_with(scenario, {"seed": seed}))
        except WbfMissionError:
            return None
        if result.outcome is not Outcome.COMPLETED:
            continue
        completed += 1
        prediction = result.plan.prediction
        times.append((prediction.duration_s, result.flight_time_s))
        battery = result.plan.vehicle.battery
        used = (result.battery_used or 0.0) * (battery.capacity_wh if battery is not None else 0.0)
        energies.append((prediction.energy_wh, used))
    if not times:
        return None
    (predicted_s, flown_s), time_spread = np.mean(times, axis=0), float(np.std(times, axis=0)[1])
    (predicted_wh, flown_wh), energy_spread = np.mean(energies, axis=0), float(np.std(energies, axis=0)[1])
    return Comparison(
        scenario.vehicle.name,
        scenario.vehicle.autopilot,
        scenario.farm.name,
        scenario.mission.planner.name,
        wind,
        seeds if gusty else 1,
        completed,
        float(predicted_s),
        100.0 * float(predicted_s / flown_s - 1.0),
        100.0 * time_spread / float(flown_s),
        100.0 * float(predicted_wh / flown_wh - 1.0) if flown_wh else 0.0,
        100.0 * energy_spread / float(flown_wh) if flown_wh else 0.0,
    )


def comparisons(seeds: int, *, quick: bool) -> list[Comparison]:
    """Return all of them, in the order of the table."""
    found = []
    for vehicle in VEHICLES:
        circles = vehicle in ("wing", "fixed-wing")
        for autopilot in autopilot_names() if vehicle != "ideal" else (DEFAULT_AUTOPILOT,):
            for wind in WINDS if vehicle != "ideal" else ("none",):
                for farm in ("waterberry",) if circles else FARMS:
                    for planner in ("lawnmower",) if quick or circles else PLANNERS:
                        scenario = Scenario(
                            farm=farm,
                            planner=planner,
                            vehicle=vehicle,
                            autopilot=autopilot,
                            estimator="point",
                            budget=None if vehicle == "ideal" else "12min" if circles else "8min",
                        )
                        one = compare(scenario, wind, seeds)
                        if one is not None:
                            found.append(one)
                            print(
                                f"{vehicle} {autopilot} {wind} {farm} {planner}: {one.time_error:+.2f} % "
                                f"{one.energy_error:+.2f} %",
                                file=sys.stderr,
                                flush=True,
                            )
    return found


def table(found: list[Comparison]) -> str:
    """Return the Markdown table."""
    lines = [
        "| vehicle | autopilot | calm, steady, sheared: time, energy | turbulence | light | moderate |",
        "|---|---|---|---|---|---|",
    ]
    for vehicle, autopilot in dict.fromkeys((one.vehicle, one.autopilot) for one in found):
        mine = [one for one in found if (one.vehicle, one.autopilot) == (vehicle, autopilot)]
        calm = [one for one in mine if one.wind in CALM]
        cells = [
            f"{max(abs(one.time_error) for one in calm):.1f} %, "
            f"{max(abs(one.energy_error) for one in calm):.1f} % ({len(calm)})"
        ]
        for wind in WINDS:
            if wind in CALM:
                continue
            some = [one for one in mine if one.wind == wind]
            if not some:
                cells.append("")
                continue
            mean = [np.mean([getattr(one, name) for one in some]) for name in ("time_error", "energy_error")]
            spread = [
                np.mean([getattr(one, name) for one in some]) for name in ("time_spread", "energy_spread")
            ]
            flown = f"{sum(one.completed for one in some)}/{sum(one.flights for one in some)}"
            cells.append(f"{mean[0]:+.1f} ± {spread[0]:.1f} %, {mean[1]:+.1f} ± {spread[1]:.1f} % ({flown})")
        lines.append(f"| {vehicle} | {autopilot} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="flights in each gusty wind")
    parser.add_argument("--quick", action="store_true", help="the lawnmower only")
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    found = comparisons(arguments.seeds, quick=arguments.quick)
    print(json.dumps([asdict(one) for one in found], indent=2) if arguments.json else table(found))


if __name__ == "__main__":
    main()
