"""How many batteries a mission needs when the vehicle comes home to change them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.predict import predict_flight

if TYPE_CHECKING:
    from geo.frame import LocalFrame
    from mission.model import Mission
    from sim_vehicle.predict import Prediction
    from sim_vehicle.spec import VehicleSpec
    from sim_vehicle.wind import Wind

__all__ = ["batteries_needed"]


def batteries_needed(
    mission: Mission,
    spec: VehicleSpec,
    prediction: Prediction,
    *,
    wind: Wind | None = None,
    frame: LocalFrame | None = None,
) -> int | None:
    """Return how many full batteries, each used down to its reserve, fly a mission to its end.

    With more than one, the vehicle breaks off where what is left just takes it home, and comes back to that
    place with the next one. Ways home and back are counted at the mission's mean power: straight at the
    cruise speed, up at the climb speed, down at the descent speed.

    Parameters
    ----------
    mission, spec, wind, frame
        As for `predict_flight`.
    prediction : Prediction
        What `predict_flight` returned for them.

    Returns
    -------
    int or None
        0 for a vehicle without a battery; None when no number is enough: the mission cannot be flown, or one
        of its places is too far for a battery.

    Examples
    --------
    >>> from mission.model import GeoPoint, Mission, MissionItem
    >>> from sim_vehicle.spec import get_vehicle
    >>> takeoff = MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0)
    >>> rows = [MissionItem.waypoint(28.05 + 0.008 * (k % 2), -82.15, 10.0) for k in range(1, 21)]
    >>> long = Mission((takeoff, *rows, MissionItem(20, 2)), GeoPoint(28.05, -82.15))
    >>> quad = get_vehicle("quad")
    >>> batteries_needed(long, quad, predict_flight(long, quad))
    2
    """
    battery = spec.battery
    if battery is None:
        return 0 if prediction.feasible else None
    if prediction.feasible:
        return 1
    whole = predict_flight(mission, spec, wind=wind, frame=frame, endless=True)
    if not whole.feasible or whole.duration_s <= 0.0:
        return None
    usable_s = battery.capacity_wh * (1.0 - battery.reserve_fraction) * whole.duration_s / whole.energy_wh
    points = whole.track_m
    away = np.hypot(points[:, 0], points[:, 1]) / spec.cruise_speed_m_s
    out_s = away + points[:, 2] / spec.climb_speed_m_s
    home_s = away + points[:, 2] / spec.descent_speed_m_s
    time_s = np.append(np.arange(len(points) - 1) * whole.track_step_s, whole.duration_s)
    home_s[-1] = 0.0
    number, begin, spent_s = 0, 0, 0.0
    while begin < len(points) - 1:
        number += 1
        short = np.flatnonzero(spent_s + time_s[begin + 1 :] - time_s[begin] + home_s[begin + 1 :] > usable_s)
        if not len(short):
            return number
        if short[0] == 0:
            return None
        begin += int(short[0])
        spent_s = float(out_s[begin])
        if not math.isfinite(spent_s):
            return None
    return number
