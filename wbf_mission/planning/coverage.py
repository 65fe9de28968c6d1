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
from mission.ground.items import Shots, shots_ordered
from mission.model import Mission
from mission.planners.path import Points
from sensors.camera.leaf_camera import footprint_offsets
from sensors.camera.optics import Imaging
from sim_vehicle.prediction.flight import Prediction, home_frame
from wbf_mission.planning.imaging import shown_share


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


def image_places(farm: Farm, mission: Mission, prediction: Prediction) -> Points:
    """Return where the images of a predicted flight are taken, float64[n, 2], metres of the farm's frame."""
    about_home = home_frame(mission)
    track_m = np.column_stack(farm.frame.from_wgs84(*about_home.to_wgs84(*prediction.track_m[:, :2].T)))
    orders = [Shots()]
    for item in mission.items:
        now = shots_ordered(item)
        orders.append(orders[-1] if now is None else now)
    # Of each position what holds while its item is flown, by where that was ordered.
    begun = np.array([k if k and one is not orders[k - 1] else 0 for k, one in enumerate(orders)])
    since = np.maximum.accumulate(begun)[np.minimum(prediction.items, len(mission.items))]
    changes = np.flatnonzero(np.diff(since)) + 1
    places = [np.empty((0, 2))]
    for first, end in zip((0, *changes), (*changes, len(since)), strict=True):
        if end == first or (shots := orders[since[first]]).is_off:
            continue
        stretch = track_m[max(first - 1, 0) : end]
        if shots.distance_m > 0.0:
            steps = np.hypot(*np.diff(stretch, axis=0).T)
            places.append(_every(np.concatenate(([0.0], np.cumsum(steps))), stretch, shots.distance_m))
        else:
            times_ms = 1000.0 * prediction.track_step_s * np.arange(len(stretch))
            places.append(_every(times_ms, stretch, shots.interval_ms))
    return np.vstack(places)


def _every(at: NDArray[np.floating[Any]], places: Points, step: float) -> Points:
    """Return the places at 0, one step, two steps ... of a quantity that grows along them."""
    wanted = np.arange(0.0, at[-1] + 1e-9, step) if math.isfinite(step) else np.zeros(1)
    return np.column_stack([np.interp(wanted, at, along) for along in places.T])
