"""Vehicles at one height keep their distance in time: who would come too near to another starts later."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geo.frame import LocalFrame
from wbf_mission.deciding.spacing import MARGIN_M, Positions, least_apart_m
from wbf_mission.planning import PlanResult, home_of
from wbf_mission.scenario import ScenarioError

_LATEST_S = 7200
_STEP_S = 5


def departure_delays(plans: Sequence[PlanResult], distance_m: float, clearance_m: float = 0.0) -> list[int]:
    """Return how many seconds after the first start each vehicle starts.

    In their order each starts as soon as its predicted flight keeps the distance from those before it. The
    paper's robots, which have no size, start at once.

    Parameters
    ----------
    plans : sequence of PlanResult
    distance_m : float
    clearance_m : float
        How much nearer to each other two vehicles may be than they believe.

    Raises
    ------
    ScenarioError
        If a vehicle would have to wait for more than two hours.
    """
    flights: list[tuple[Positions, int]] = []
    delays = []
    for number, plan in enumerate(plans, start=1):
        delay = 0
        if not plan.vehicle.is_ideal:
            flight = _positions(plan)
            while any(
                least_apart_m(other, flight, delay - begin) < distance_m + clearance_m + MARGIN_M
                for other, begin in flights
            ):
                delay += _STEP_S
                if delay > _LATEST_S:
                    msg = (
                        f"separation distance: vehicle {number} would wait for more than two hours to keep"
                        f" {distance_m:g} m from the others; give a smaller distance, or layers"
                    )
                    raise ScenarioError(msg)
            flights.append((flight, delay))
        delays.append(delay)
    return delays


def _positions(plan: PlanResult) -> Positions:
    """Return where a vehicle is predicted to be at each full second of its flight, in the farm frame."""
    prediction, farm = plan.prediction, plan.farm
    home = home_of(plan.mission, farm)
    about_home = LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m)
    latitude, longitude = about_home.to_wgs84(prediction.track_m[:, 0], prediction.track_m[:, 1])
    places = np.column_stack(farm.frame.from_wgs84(latitude, longitude))
    times = np.minimum(np.arange(len(places)) * prediction.track_step_s, prediction.duration_s)
    seconds = np.arange(0.0, prediction.duration_s, 1.0)
    return np.column_stack([np.interp(seconds, times, places[:, axis]) for axis in range(2)])
