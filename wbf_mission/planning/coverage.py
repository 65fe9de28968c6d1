"""Coverage: the fraction of the scouted land that the images of a flight show.

Plan, preflight check and result use this definition. An image is taken wherever the camera triggers, and
shows the cells of the camera's footprint. Each scouted cell (`geo.Farm.scouted_cells`) counts only once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.ground.items import shots_ordered
from mission.model import DEGREES_E7, Mission
from mission.planners.path import Points
from sensors.camera.leaf_camera import footprint_offsets
from sensors.camera.optics import Imaging
from sim_vehicle.camera.trigger import CameraTrigger, Exposure, Fix
from sim_vehicle.prediction.flight import Prediction, home_frame
from wbf_mission.planning.imaging import shown_share

_REPORT_S = 0.1
LEAST_OF_WHOLE = 0.95
"""Least coverage of a survey; below it the plan has a warning."""


def seen_share(farm: Farm, x: NDArray[np.integer], y: NDArray[np.integer]) -> float:
    """Return the fraction of the scouted cells that are among the cells x, y (some may be off the farm)."""
    on_farm = (x >= 0) & (y >= 0) & (x < farm.width_cells) & (y < farm.height_cells)
    x, y = x[on_farm].astype(np.int64), y[on_farm].astype(np.int64)
    cells = np.unique(x * farm.height_cells + y)
    scouted = farm.scouted_in(np.divmod(cells, farm.height_cells))
    return float(np.count_nonzero(scouted)) / max(farm.scouted_count, 1)


def predicted_coverage(
    farm: Farm,
    mission: Mission,
    prediction: Prediction,
    footprint: int,
    imaging: Imaging | None = None,
) -> float:
    """Return the coverage of a predicted flight.

    An image shows `footprint` x `footprint` cells or, with `imaging`, the ground under a mapping camera.
    """
    return coverage_from(farm, image_places(farm, mission, prediction), footprint, imaging)


def coverage_from(farm: Farm, places: Points, footprint: int, imaging: Imaging | None) -> float:
    """Return the coverage of images at `places`, taken in one flight or by a fleet."""
    if not len(places):
        return 0.0
    if imaging is not None:
        return shown_share(farm, places, imaging)
    x, y = farm.cell_of(places[:, 0], places[:, 1])
    aside, along = footprint_offsets(footprint)
    return seen_share(farm, (x[:, None] + aside).ravel(), (y[:, None] + along).ravel())


def asks_whole(imaging: Imaging | None, planner: str | None) -> bool:
    """Return whether a plan aims at full coverage: it has a mapping camera, or the planner `survey`.

    Examples
    --------
    >>> asks_whole(None, "survey:angle=30"), asks_whole(None, "lawnmower"), asks_whole(None, None)
    (True, False, False)
    """
    return imaging is not None or (planner or "").partition(":")[0] == "survey"


def too_little_seen(coverage: float, *, whole: bool) -> str:
    """Return a warning if the coverage is too low, else an empty text.

    A plan for the `whole` land needs a coverage of `LEAST_OF_WHOLE`; other plans need any coverage above 0.
    """
    if coverage <= 0.0:
        return "no image shows the land that is to be seen"
    if whole and coverage < LEAST_OF_WHOLE:
        return f"the images show {coverage:.1%} of the land to be seen, but should show all of it"
    return ""


def image_places(farm: Farm, mission: Mission, prediction: Prediction) -> Points:
    """Return the image positions of a predicted flight, float64[n, 2], in metres of the farm frame."""
    track_deg = np.column_stack(home_frame(mission).to_wgs84(*prediction.track_m[:, :2].T))
    track_deg = np.unwrap(track_deg, period=360.0, axis=0)  # Longitudes may cross the date line
    orders = [
        (time_s, item, shots)
        for time_s, seq in prediction.camera_orders
        if (shots := shots_ordered(item := mission.items[seq])) is not None
    ]
    times_s = prediction.track_step_s * np.arange(1, len(track_deg) + 1)
    # The camera knows only reported positions, so an order takes effect at the last report before the order.
    begins = [math.floor(time_s / _REPORT_S + 1e-6) for time_s, *_ in orders]
    ends = [*begins[1:], math.floor(times_s[-1] / _REPORT_S + 1e-6)] if orders else []
    places = [np.empty((0, 2))]
    speeds = np.gradient(track_deg, prediction.track_step_s, axis=0) if len(times_s) > 1 else track_deg
    for (_, item, shots), begin, end in zip(orders, begins, ends[: len(orders)], strict=True):
        if shots.is_off or len(times_s) < 2:
            continue
        when_s = _REPORT_S * np.arange(begin, max(begin, end) + 1)
        if shots.distance_m > 0.0:
            reports = _smooth(when_s, times_s, track_deg, speeds)
            places.append(_by_distance(reports, shots.distance_m, at_once=item.param3 == 1.0))
        else:
            # The trigger fires at once, and then once per interval.
            span_ms = (when_s[-1] - when_s[0]) * 1000.0
            count = min(1 + math.floor(span_ms / shots.interval_ms + 1e-9), shots.images)
            fires_s = when_s[0] + np.arange(count) * (shots.interval_ms / 1000.0 if count > 1 else 0.0)
            places.append(np.column_stack([np.interp(fires_s, times_s, along) for along in track_deg.T]))
    return np.column_stack(farm.frame.from_wgs84(*np.vstack(places).T))


def _smooth(
    when_s: NDArray[np.floating[Any]], times_s: NDArray[np.floating[Any]], places: Points, speeds: Points
) -> Points:
    """Return a track's positions at times `when_s`, by cubic interpolation, as chords would be too short."""
    step_s, most = times_s[1] - times_s[0], len(times_s) - 1
    past = np.clip((when_s - times_s[0]) / step_s, 0.0, most)
    k = np.minimum(past.astype(np.int64), most - 1)
    u = (past - k)[:, None]
    leave, arrive = u * (1.0 - u) ** 2 * speeds[k], u**2 * (1.0 - u) * speeds[k + 1]
    between: Points = places[k] + u**2 * (3.0 - 2.0 * u) * (places[k + 1] - places[k])
    bent: Points = step_s * (leave - arrive)
    return between + bent


def _by_distance(reports_deg: Points, distance_m: float, *, at_once: bool) -> Points:
    """Return the positions at which a trigger by distance fires: degrees, float64[n, 2]."""
    trigger, exposures = CameraTrigger(), list[Exposure]()
    step_ms = round(1000.0 * _REPORT_S)
    reports_e7 = np.rint(DEGREES_E7 * reports_deg).astype(np.int64).tolist()
    first, *later = (
        Fix(number * step_ms, latitude_e7, longitude_e7, 0, 0, 0.0, 0.0, 0)
        for number, (latitude_e7, longitude_e7) in enumerate(reports_e7)
    )
    exposures += trigger.add(first)
    trigger.every_distance(distance_m)
    if at_once and (here := trigger.here()) is not None:
        exposures.append(here)
    for fix in later:
        exposures += trigger.add(fix)
    found = [(exposure.latitude_e7, exposure.longitude_e7) for exposure in exposures]
    return np.array(found, np.float64).reshape(-1, 2) / DEGREES_E7
