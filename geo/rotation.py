"""Attitudes as angles and as quaternions, in aerospace order: yaw, then pitch, then roll.

Formulas: J. Diebel, "Representing Attitude" (2006), section 8.12 (sequence 3, 2, 1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["Quaternion", "angles_of", "quaternion_of"]

Quaternion = tuple[float, float, float, float]


def quaternion_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Return the quaternion (w, x, y, z) of an attitude.

    Examples
    --------
    >>> quaternion_of(0.0, 0.0, math.pi)[3]
    1.0
    """
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def angles_of(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw (rad) of a quaternion (w, x, y, z) of length 1.

    Examples
    --------
    >>> [round(angle, 9) for angle in angles_of(quaternion_of(0.3, -0.2, 2.0))]
    [0.3, -0.2, 2.0]
    """
    w, x, y, z = quaternion
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0)),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )
