"""Where a camera looks: the place on flat ground that the middle of its image shows."""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["NOWHERE_M", "ground_offset"]

NOWHERE_M = 1e7
"""Offset, east and north, of an image that shows no ground: beyond any farm."""
_FARTHEST_M = 10_000.0
# Single precision leaves straight down so far from it; hundredths of a degree are farther.
_STRAIGHT = 5e-5
_UNIT = 0.01


def ground_offset(quaternion: Sequence[float], height_m: float) -> tuple[float, float]:
    """Return how far east and north of the camera the axis of its lens meets flat ground.

    That is the height times the tangent of the angle from straight down, in the direction that the camera
    looks to. What is farther than 10 km counts as not seen, as by ArduPilot (``AP_MOUNT_POI_DIST_M_MAX``).

    Parameters
    ----------
    quaternion : sequence of 4 floats
        Attitude of the camera (w, x, y, z), forward along its lens, as CAMERA_IMAGE_CAPTURED tells it; one
        that is no rotation (zeros, NaN) tells nothing, and means straight down.
    height_m : float
        Of the camera above the ground.

    Returns
    -------
    east_m, north_m : float
        `NOWHERE_M` each if the lens meets no ground: it looks to the horizon or above, or too far.

    Examples
    --------
    >>> half = math.radians(-45.0) / 2.0
    >>> east_m, north_m = ground_offset((math.cos(half), 0.0, math.sin(half), 0.0), 30.0)
    >>> round(east_m, 9), round(north_m, 9)
    (0.0, 30.0)
    >>> ground_offset((1.0, 0.0, 0.0, 0.0), 30.0)
    (10000000.0, 10000000.0)
    """
    w, x, y, z = quaternion
    if not abs(w * w + x * x + y * y + z * z - 1.0) < _UNIT:
        return 0.0, 0.0
    north, east, down = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    if down > 0.0 and math.hypot(north, east) < _STRAIGHT:
        return 0.0, 0.0
    height_m = max(0.0, height_m)
    if not (down > 0.0 and down * _FARTHEST_M > height_m * math.hypot(north, east)):
        return NOWHERE_M, NOWHERE_M
    return height_m * east / down, height_m * north / down
