"""Coverage: the share of the land that somebody wants to see which the images of a flight show.

A plan, its check and the flown result mean the same by it: images are taken where the camera fires, each
shows the cells of its footprint, and those of the land to be seen (`geo.Farm.scouted_cells`) count once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.ground.items import shots_ordered
from mission.model import Mission
from mission.planners.path import Points
from sensors.camera.leaf_camera import footprint_offsets
from sensors.camera.optics import Imaging
from sim_vehicle.prediction.flight import Prediction, home_frame
from wbf_mission.planning.imaging import shown_share

_REPORT_S = 0.1
LEAST_OF_WHOLE = 0.95
"""A survey that shows a smaller part of the land says so."""


def seen_share(farm: Farm, x: NDArray[np.integer], y: NDArray[np.integer]) -> float:
    """Return the share of the cells to be seen that are among some cells, which may lie outside the farm."""
    wanted = farm.scouted_cells
    on_farm = (x >= 0) & (y >= 0) & (x < farm.width_cells) & (y < farm.height_cells)
    x, y = x[on_farm].astype(np.int64), y[on_farm].astype(np.int64)
    cells = np.unique(x * farm.height_cells + y)
    return float(np.count_nonzero(wanted.reshape(-1)[cells])) / max(farm.scouted_count, 1)


def predicted_coverage(
    farm: Farm,
    mission: Mission,
    prediction: Prediction,
    footprint: int,
    imaging: Imaging | None = None,
) -> float:
    """Return the coverage of a predicted flight.

    Its images show so many cells a side, or what a camera by its sensor and lens shows.
    """
    return coverage_from(farm, image_places(farm, mission, prediction), footprint, imaging)


def coverage_from(farm: Farm, places: Points, footprint: int, imaging: Imaging | None) -> float:
    """Return the coverage of images from several places, of one flight or of those of a fleet."""
    if not len(places):
        return 0.0
    if imaging is not None:
        return shown_share(farm, places, imaging)
    x, y = farm.cell_of(places[:, 0], places[:, 1])
    aside, along = footprint_offsets(footprint)
    return seen_share(farm, (x[:, None] + aside).ravel(), (y[:, None] + along).ravel())


def too_little_seen(coverage: float, *, whole: bool) -> str:
    """Return a warning if the coverage is below the one that was asked for, else an empty text.

    The `whole` land is asked for by a survey; of any other plan that something of it is seen.
    """
    if coverage <= 0.0:
        return "no image shows the land that is to be seen"
    if whole and coverage < LEAST_OF_WHOLE:
        return f"the images show {coverage:.1%} of the land to be seen, and the whole was asked for"
    return ""


def image_places(farm: Farm, mission: Mission, prediction: Prediction) -> Points:
    """Return where the images of a predicted flight are taken, float64[n, 2], metres of the farm's frame."""
    about_home = home_frame(mission)
    track_m = np.column_stack(farm.frame.from_wgs84(*about_home.to_wgs84(*prediction.track_m[:, :2].T)))
    orders = [
        (time_s, item, shots)
        for time_s, seq in prediction.camera_orders
        if (shots := shots_ordered(item := mission.items[seq])) is not None
    ]
    times_s = prediction.track_step_s * np.arange(1, len(track_m) + 1)
    # The camera knows where it is from reports: orders begin and end at the last one before them.
    begins_s = [math.floor(time_s / _REPORT_S + 1e-6) * _REPORT_S for time_s, *_ in orders]
    ends_s = [*begins_s[1:], float(times_s[-1])]
    places = [np.empty((0, 2))]
    for (_, item, shots), begin_s, end_s in zip(orders, begins_s, ends_s[: len(orders)], strict=True):
        if shots.is_off:
            continue
        within = times_s[(times_s > begin_s) & (times_s < end_s)]
        when_s = np.array((begin_s, *within, max(begin_s, end_s)))
        stretch = np.column_stack([np.interp(when_s, times_s, along) for along in track_m.T])
        if shots.distance_m > 0.0:
            reach = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(stretch, axis=0).T))))
            first = 0.0 if item.param3 == 1.0 else shots.distance_m
            places.append(_every(reach, stretch, first, shots.distance_m))
        else:
            places.append(_every(1000.0 * (when_s - begin_s), stretch, 0.0, shots.interval_ms))
    return np.vstack(places)


def _every(at: NDArray[np.floating[Any]], places: Points, first: float, step: float) -> Points:
    """Return the places at the first, one step more, two steps ... of a quantity that grows along them."""
    wanted = np.arange(first, at[-1] + 1e-9, step) if math.isfinite(step) else np.array([first])
    return np.column_stack([np.interp(wanted, at, along) for along in places.T])
