"""Mapping cameras in plans: flight height and speed, and the ground that the images cover."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely

from geo import Farm
from mission.planners.path import Points
from sensors.camera.optics import Imaging, get_camera
from sim_vehicle.airframe.spec import VehicleSpec
from wbf_mission.planning.conditions import FlightLevel
from wbf_mission.scenario import CameraOptions, MissionOptions, ScenarioError

_SAME_HEIGHT = 0.01
_LOWEST_M = 2.0  # Preflight warns below this height
_MOST_CELLS = 200_000


def require_height(camera: CameraOptions, mission: MissionOptions) -> None:
    """Raise ScenarioError if a mapping camera has neither flight height nor ground sampling distance.

    The vehicle's default height suits only the leaf camera. Raise CameraError for an unknown camera.
    """
    if camera.model is None:
        return
    model = get_camera(camera.model)
    if mission.file is None and not any((camera.gsd_cm, mission.altitude_m, mission.height_above_ground_m)):
        msg = f"camera {model.name}: give the ground sampling distance (--gsd, cm) or the height (--altitude)"
        raise ScenarioError(msg)


def imaging_of(camera: CameraOptions, mission: MissionOptions, level: FlightLevel) -> Imaging | None:
    """Return the mapping camera of a plan at its flight height, or None for the leaf camera.

    Raises
    ------
    CameraError
        If there is no such camera, or its file cannot be read.
    ScenarioError
        If ground sampling distance and height contradict each other, or the requested speed is too fast.
    """
    if camera.model is None:
        return None
    model, height = get_camera(camera.model), level.altitude_m
    asked = mission.height_above_ground_m or mission.altitude_m
    if camera.gsd_cm is not None:
        height = model.height_m(0.01 * camera.gsd_cm)
        if asked is not None and abs(asked - height) > _SAME_HEIGHT * height:
            raise ScenarioError(
                f"gsd {camera.gsd_cm:g} cm: camera {model.name} has this gsd at {height:.1f} m, not at the"
                f" altitude of {asked:g} m ({100.0 * model.gsd_m(asked):.3g} cm); give only one of the two"
            )
        low, high = (100.0 * model.gsd_m(end) for end in (_LOWEST_M, mission.max_altitude_m))
        if not _LOWEST_M <= height <= mission.max_altitude_m:
            raise ScenarioError(
                f"gsd {camera.gsd_cm:g} cm: camera {model.name} has this gsd at {height:.3g} m, but flights"
                f" are {_LOWEST_M:g} to {mission.max_altitude_m:g} m high; give {low:.2g} to {high:.3g} cm,"
                " or another camera"
            )
    made = Imaging(model, height, camera.front_overlap, camera.side_overlap, camera.orientation == "portrait")
    speed = mission.cruise_speed_m_s
    if speed is not None and speed > made.top_speed_m_s:
        raise ScenarioError(
            f"cruise speed {speed:g} m/s: at {height:.1f} m camera {model.name} takes every image up to"
            f" {made.interval_speed_m_s:.3g} m/s, and sharp images up to {made.blur_speed_m_s:.3g} m/s; fly"
            " slower or higher, or with less front overlap"
        )
    return made


def require_flight(camera: CameraOptions, vehicle: VehicleSpec) -> None:
    """Raise ScenarioError for a mapping camera on a ground vehicle."""
    if camera.model is not None and vehicle.drives:
        raise ScenarioError(
            f"camera {camera.model} takes images from the air, and vehicle {vehicle.name} drives:"
            " give a vehicle that flies, or leave the camera out"
        )


def level_of(imaging: Imaging | None, level: FlightLevel) -> FlightLevel:
    """Return the height and speed of a flight with a mapping camera, or `level` for the leaf camera."""
    if imaging is None:
        return level
    return FlightLevel(imaging.height_m, min(level.speed_m_s, imaging.top_speed_m_s))


def shown_share(farm: Farm, places: Points, imaging: Imaging) -> float:
    """Return the fraction of the scouted cells in images at `places`; images are aligned with the course.

    If there are more than `_MOST_CELLS` scouted cells, only an evenly spaced sample is checked.
    """
    x, y = np.nonzero(farm.scouted_cells)
    if not len(x) or not len(places):
        return 0.0
    if len(places) == 1:  # One image has no known course: assume north
        places = np.vstack((places, places + np.array((0.0, 1e-3))))
    some = slice(None, None, max(1, len(x) // _MOST_CELLS))
    centres = (np.column_stack((x[some], y[some])) + 0.5) * farm.cell_size_m
    steps = np.diff(places, axis=0, prepend=2.0 * places[:1] - places[1:2])
    along = steps / np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    across = np.column_stack((-along[:, 1], along[:, 0]))
    ahead, aside = 0.5 * imaging.along_m * along, 0.5 * imaging.across_m * across
    corners = np.stack((ahead + aside, ahead - aside, -ahead - aside, -ahead + aside), axis=1)
    images = shapely.union_all(shapely.polygons(places[:, None] + corners))
    shapely.prepare(images)
    return float(np.count_nonzero(shapely.contains_xy(images, *centres.T))) / len(centres)


def imaging_summary(imaging: Imaging, images: int, speed_m_s: float | None) -> dict[str, Any]:
    """Return plain values of a plan's mapping camera for JSON."""
    in_time = imaging.interval_speed_m_s
    return {
        "name": imaging.camera.name,
        "gsd_cm": 100.0 * imaging.gsd_m,
        "height_m": imaging.height_m,
        "footprint_across_m": imaging.across_m,
        "footprint_along_m": imaging.along_m,
        "front_overlap": imaging.front_overlap,
        "side_overlap": imaging.side_overlap,
        "row_spacing_m": imaging.row_spacing_m,
        "image_distance_m": imaging.image_distance_m,
        "interval_speed_m_s": in_time if math.isfinite(in_time) else None,
        "blur_speed_m_s": imaging.blur_speed_m_s,
        "speed_m_s": speed_m_s,
        "images": images,
    }
