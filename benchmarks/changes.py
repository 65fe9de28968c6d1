"""Measure missions that are changed in flight: the time lost by a change to the same path, and the delay.

A quadrotor flies legs of 120 m at 7 m/s with a camera every 5 m, on the virtual clock, over links of several
delays. Its mission is replaced by one with the same path, 85, 40, 20 and 5 m before a corner: what the flight
takes longer is the time lost (bars: 0.5 s under PX4, 1.5 s under ArduCopter, over links with a round trip of
up to 400 ms). Then by another path, at every few seconds of the flight: how long from the first message to
the turn, and how long ArduCopter is aside from its mission. Last what the price of a path of 40 legs costs,
many in one call.

First the changes that a real ArduCopter was recorded with are flown again, with the same orders at the same
times: lowest speed guided and after it, when 90 % of the speed is back, when the second new point is passed,
and how much later that is than as an ordinary mission, recorded and simulated (bar: 10 %).

    python benchmarks/changes.py [--autopilots px4,ardupilot] [--recorded FOLDER]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from recordings import ChangedFlight, fly_changed

from geo.frame import LocalFrame
from mission.ground.items import revised_mission
from mission.ground.station import GroundStation
from mission.ground.vehicle_state import VehicleState
from mission.model import Command, GeoPoint, Mission, MissionItem
from mission.outcome import Phase
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot, with_autopilot
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.host.simulation import Impairment, Simulation
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.prediction.onward import InFlight, OnwardPredictor

RECORDED = Path(__file__).parents[1] / "tests" / "data" / "flights" / "changes"
RECORDED_BAR = 0.1
BARS_S = {"px4": 0.5, "ardupilot": 1.5}
HOME = GeoPoint(28.05, -82.15)
FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg)
PATH = [(0, 30), (120, 30), (120, 60), (0, 60), (0, 90), (120, 90)]
OTHER = [(60, 120), (-30, 120), (-30, 40)]
HEIGHT_M, SPEED_M_S, RADIUS_M, IMAGES_M = 20.0, 7.0, 1.0, 5.0
LINKS_S = (0.0, 0.05, 0.2)
WORST_S = 0.2


def degrees(points: list[tuple[int, int]]) -> list[tuple[float, float]]:
    """Return latitudes and longitudes."""
    return [FRAME.to_wgs84(float(x), float(y)) for x, y in points]


def mission() -> Mission:
    """Return the mission that is changed."""
    through = [MissionItem.waypoint(*one, HEIGHT_M, acceptance_radius_m=RADIUS_M) for one in degrees(PATH)]
    camera = Command.DO_SET_CAM_TRIGG_DIST
    items = (
        MissionItem(Command.NAV_TAKEOFF, 3, 0, 0, 0, None, HOME.latitude_deg, HOME.longitude_deg, HEIGHT_M),
        MissionItem(Command.DO_CHANGE_SPEED, param1=1.0, param2=SPEED_M_S, param3=-1.0),
        through[0],
        MissionItem(camera, param1=IMAGES_M, param3=1.0),
        *through[1:],
        MissionItem(camera),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH),
    )
    return Mission(items, HOME)


class Flight:
    """A flight, undisturbed or with one change."""

    def __init__(
        self,
        autopilot: str,
        delay_s: float,
        when: Callable[[VehicleState, float], bool] | None = None,
        path: list[tuple[int, int]] = PATH,
    ) -> None:
        spec = with_autopilot(get_vehicle("quad"), autopilot)
        self.vehicle = SimVehicle(spec, HOME, autopilot=get_autopilot(autopilot))
        self.station = station = GroundStation(mission())
        self.aside_s = 0.0
        self._since_s: float | None = None
        receive, asked = station.receive, False

        def receive_and_ask(message: object, now_s: float) -> list[object]:
            nonlocal asked
            out = receive(message, now_s)
            state = station.vehicle_state
            if asked or when is None or station.phase is not Phase.FLIGHT or state.item is None:
                return out
            if station.started_s is not None and when(state, now_s - station.started_s):
                asked = True
                new, resume_at = revised_mission(
                    station.mission,
                    state.item,
                    degrees(path),
                    altitude_m=HEIGHT_M,
                    acceptance_radius_m=RADIUS_M,
                )
                out = out + station.change(new, resume_at, now_s)
            return out

        station.receive = receive_and_ask
        impairment = Impairment(delay_s=delay_s) if delay_s else None
        simulation = Simulation([self.vehicle, station], impairment=impairment, remote=[station])
        simulation.run(until=self._look, limit_s=900.0)

    def _look(self, now_s: float) -> bool:
        aside = self.vehicle.pilot.mode is Mode.GUIDED
        if aside and self._since_s is None:
            self._since_s = now_s
        elif not aside and self._since_s is not None:
            self.aside_s, self._since_s = max(self.aside_s, now_s - self._since_s), None
        return self.station.done


def before_corner(distance_m: float) -> Callable[[VehicleState, float], bool]:
    """Return when to change: so far before the end of the first long leg."""

    def when(state: VehicleState, _: float) -> bool:
        return state.item == 4 and PATH[1][0] - state.position_m(FRAME)[0] <= distance_m

    return when


def time_lost(autopilot: str) -> bool:
    """Print what changes to the same path cost; tell whether all are within the bar."""
    bar_s, good = BARS_S[autopilot], True
    for delay_s in LINKS_S:
        undisturbed_s = Flight(autopilot, delay_s).station.flight_time_s
        lost = []
        for distance_m in (85.0, 40.0, 20.0, 5.0):
            flight = Flight(autopilot, delay_s, before_corner(distance_m), PATH[1:])
            outcome = flight.station.changes[0].outcome.value
            lost.append((distance_m, flight.station.flight_time_s - undisturbed_s, outcome))
        if delay_s <= WORST_S:
            good &= all(late_s <= bar_s for _, late_s, _ in lost)
        told = ", ".join(f"{late_s:+.2f} s at {distance:g} m ({how})" for distance, late_s, how in lost)
        print(f"{autopilot:9} {2e3 * delay_s:3.0f} ms round trip, same path: {told}; bar {bar_s} s")
    return good


def delays(autopilot: str) -> None:
    """Print how soon another path is turned to, and how long the vehicle is aside from its mission."""
    for delay_s in LINKS_S:
        turns, asides = [], []
        for moment_s in range(14, 120, 8):
            flight = Flight(autopilot, delay_s, lambda _, s, at=moment_s: s >= at, OTHER)
            turns += [one.delay_s for one in flight.station.changes if one.delay_s is not None]
            asides.append(flight.aside_s)
        print(
            f"{autopilot:9} {2e3 * delay_s:3.0f} ms round trip, another path: median delay to the turn "
            f"{statistics.median(turns):.2f} s, most {max(turns):.2f} s; aside from the mission median "
            f"{statistics.median(asides):.1f} s, most {max(asides):.1f} s"
        )


def prices(autopilot: str) -> None:
    """Print what the price of a path costs."""
    spec = with_autopilot(get_vehicle("quad"), autopilot)
    predictor = OnwardPredictor(spec, FRAME, (0.0, 0.0), altitude_m=HEIGHT_M, speed_m_s=5.0)
    random = np.random.default_rng(1)
    paths = [np.cumsum(random.normal(0.0, 8.0, (40, 2)), axis=0) for _ in range(200)]
    state = InFlight((0.0, 0.0), HEIGHT_M, (5.0, 0.0))
    predictor.rest(state, paths[:2])
    best = np.inf
    for _ in range(3):
        begin = time.process_time()
        predictor.rest(state, paths)
        best = min(best, time.process_time() - begin)
    print(f"{autopilot:9} {5.0 * best:.2f} ms for the price of a path of 40 legs, 200 in one call")


def recorded(folder: Path) -> bool:
    """Print recorded changes beside the same orders to the simulated vehicle; tell whether all are near."""
    flights = {
        path.stem.removeprefix("ardupilot-"): (loaded := ChangedFlight.load(path), fly_changed(loaded))
        for path in sorted(folder.glob("*.json"))
    }
    good = True
    print("| recorded / simulated | lowest, guided | lowest after it | 90 % back | 2nd point | lost | mean |")
    print("|---|---|---|---|---|---|---|")
    for name, pair in flights.items():
        plain = flights.get(name.replace("change-", "unchanged-")) if name.startswith("change-") else None
        cells = [
            [one.lowest_m_s(guided=True) for one in pair],
            [one.lowest_m_s(guided=False) for one in pair],
            [one.back_s for one in pair],
            [one.took_s for one in pair],
            [one.took_s - other.took_s for one, other in zip(pair, plain, strict=True)] if plain else [],
            [one.mean_m_s for one in pair],
        ]
        good &= all(near(*cell) for cell in cells if cell)
        units = "m/s", "m/s", "s", "s", "s", "m/s"
        told = [
            f"{cell[0]:.2f} / {cell[1]:.2f} {unit}" if cell and cell[0] == cell[0] else "-"
            for cell, unit in zip(cells, units, strict=True)
        ]
        print(f"| {name} | " + " | ".join(told) + " |")
    return good


def near(was: float, now: float) -> bool:
    """Tell whether a number is as recorded, within the bar or what a recording at 10 Hz shows of it."""
    return not abs(was - now) > max(RECORDED_BAR * abs(was), 0.1)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--autopilots", default=",".join(BARS_S))
    parser.add_argument("--recorded", type=Path, default=RECORDED, help="folder of recorded changes")
    options = parser.parse_args()
    names = options.autopilots.split(",")
    good = [recorded(options.recorded)]
    good += [time_lost(name) for name in names]
    for name in names:
        delays(name)
    for name in names:
        prices(name)
    print("within the bars" if all(good) else "NOT within the bars")


if __name__ == "__main__":
    main()
