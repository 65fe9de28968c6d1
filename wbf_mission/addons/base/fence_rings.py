"""Outlines of a geofence, for drawing on a map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geo.frame import LocalFrame
from geo.linear_algebra import cos, sin
from mission.errors import MissionFileError
from mission.files.fence import geo_fence
from mission.model import MissionItem

CIRCLE_CORNERS = 48
"""Number of corners of a circle drawn as a polygon; the sides are within 0.2 % of the radius."""


def fence_rings(items: Sequence[MissionItem], frame: LocalFrame) -> list[tuple[NDArray[np.float64], bool]]:
    """Return each outline of a geofence (float64[n, 2], m in `frame`) and whether it is an inclusion zone.

    Circles become polygons of `CIRCLE_CORNERS` corners. Outlines outside the range of the frame are left out.
    Invalid fence items give an empty list.
    """
    try:
        fence = geo_fence(items)
    except MissionFileError:
        return []
    found = []
    for polygon in fence["polygons"]:
        latitude, longitude = np.array(polygon["polygon"]).T
        found.append((np.stack(frame.from_wgs84(latitude, longitude), 1), polygon["inclusion"]))
    around = np.linspace(0.0, 2.0 * np.pi, CIRCLE_CORNERS, endpoint=False)
    for circle in fence["circles"]:
        centre = np.array(frame.from_wgs84(*circle["circle"]["center"]))
        corners = centre + circle["circle"]["radius"] * np.stack([cos(around), sin(around)], 1)
        found.append((corners, circle["inclusion"]))
    return [(ring, inclusion) for ring, inclusion in found if np.isfinite(ring).all()]
