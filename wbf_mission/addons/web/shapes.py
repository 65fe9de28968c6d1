"""Converts farms and plans to the messages from which a page draws them."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from geo import Farm
from mission.model import Command, MissionItem
from wbf_mission.addons.base.plots import fence_rings
from wbf_mission.addons.web import schema
from wbf_mission.events import Planned

_SIMPLER = 5000
"""Outlines are precise to the farm's longer side divided by this number, a fraction of a pixel."""
_COMMANDS = {int(command): command.name.partition("_")[2].replace("_", " ").lower() for command in Command}
_MAX_ITEMS = 1000


def farm_shape(farm: Farm) -> schema.FarmShape:
    """Return the message from which a page draws a farm."""
    width_m, height_m = farm.width_cells * farm.cell_size_m, farm.height_cells * farm.cell_size_m
    # Degrees are not linear in metres; differences over the farm's full size fit best.
    lat, lon = farm.frame.to_wgs84(np.array([0.0, width_m, 0.0]), np.array([0.0, 0.0, height_m]))
    georeference = schema.Georeference(
        *(float(lat[0]), float(lon[0])),
        *(float(lat[1] - lat[0]) / width_m, float(lat[2] - lat[0]) / height_m),
        *(float(lon[1] - lon[0]) / width_m, float(lon[2] - lon[0]) / height_m),
    )
    simpler_m = max(width_m, height_m) / _SIMPLER
    patches = [
        schema.PatchShape(
            land.name, str(land.crop), land.owner == farm.owner, _rings(land.polygon, simpler_m)
        )
        for land in farm.patches
    ]
    obstacles = [
        schema.ObstacleShape(obstacle.name, obstacle.height_m, _rings(obstacle.polygon, simpler_m))
        for obstacle in farm.obstacles
    ]
    return schema.FarmShape(
        farm.name, georeference, width_m, height_m, farm.home_m, patches, obstacles, list(farm.rally_m)
    )


def plan_shape(planned: Planned, farm: Farm | None) -> schema.Plan:
    """Return the message from which a page draws a vehicle's plan."""
    return schema.Plan(
        *(planned.system_id, planned.day, planned.flight, planned.time_s),
        path=ring(planned.path_m),
        fence=[
            schema.FenceShape([ring(corners)], inclusion)
            for corners, inclusion in ([] if farm is None else fence_rings(planned.mission.fence, farm.frame))
        ],
        items=[_in_words(item) for item in planned.mission.items[:_MAX_ITEMS]],
        duration_s=planned.duration_s,
        length_m=planned.length_m,
        coverage=planned.coverage,
    )


def ring(points: Any) -> schema.Ring:
    """Return points, float64[n, 2], as alternating x and y, rounded to centimetres."""
    return np.round(np.asarray(points, np.float64).reshape(-1), 2).tolist()


def _rings(polygon: shapely.Polygon, simpler_m: float) -> list[schema.Ring]:
    """Return the simplified outline of a polygon, then its holes."""
    simple = shapely.simplify(polygon, simpler_m)
    return [ring(shapely.get_coordinates(line)) for line in (simple.exterior, *simple.interiors)]


def _in_words(item: MissionItem) -> str:
    """Return a mission item in words."""
    name = _COMMANDS.get(item.command, f"command {item.command}")
    if item.has_position or item.command == Command.NAV_TAKEOFF:
        return f"{name}, {item.z:g} m"
    if item.command == Command.DO_CHANGE_SPEED and item.param2 is not None:
        return f"{name}, {item.param2:g} m/s"
    return name
