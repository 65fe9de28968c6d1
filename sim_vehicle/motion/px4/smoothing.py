"""PX4's trajectory shaping: speeds from which the vehicle can brake, and jerk-limited profiles of speed.

The formulas are from PX4 v1.17: ``src/lib/mathlib/math/TrajMath.hpp`` (speeds), ``src/lib/motion_planning``:
``VelocitySmoothing`` (profiles), ``TrajectoryConstraints`` and ``PositionSmoothing`` (waypoints). Lengths are
in metres, positions are east-north-up relative to the start.
"""

from __future__ import annotations

from math import sqrt

from geo.compiled import compiled

# Sign of the speed change, and durations of its phases: with jerk, without jerk, with opposite jerk.
Profile = tuple[float, float, float, float]
Vector = tuple[float, float, float]

_TINY = 1e-7


@compiled(allocates=False)
def brakeable_speed(jerk: float, accel: float, distance: float, final: float) -> float:
    """Return the highest speed that can be reduced to `final` within a distance.

    PX4's formula assumes full speed for ``2 accel / jerk`` before the braking, which is longer than needed.
    """
    b = 4.0 * accel * accel / jerk
    v = 0.5 * (sqrt(b * b + 8.0 * accel * distance + 4.0 * final * final) - b)
    return max(v, final)


@compiled(allocates=False)
def turn_speed(cosine: float, accel: float, radius: float) -> float:
    """Return the speed on a circle that touches both legs of a corner at `radius` from the corner.

    `cosine` is the cosine of the angle between the paths back and ahead; -1 means straight ahead.
    """
    c = min(max(cosine, -1.0 + 1e-12), 1.0)
    return sqrt(accel * radius * sqrt((1.0 - c) / (1.0 + c)))


@compiled(allocates=False)
def profile(v: float, a: float, wanted: float, limit: float, jerk: float) -> Profile:
    """Return the fastest profile from speed `v` and acceleration `a` to a steady speed `wanted`."""
    gap = wanted - v - 0.5 * a * abs(a) / jerk
    sign = 1.0 if gap > 0.0 else -1.0
    if gap == 0.0:
        if a == 0.0:
            return 0.0, 0.0, 0.0, 0.0
        sign = 1.0 if a > 0.0 else -1.0
    a *= sign
    change = sign * (wanted - v)
    square = 0.5 * a * a + jerk * change
    t1 = 0.0
    if square > 0.0:
        t1 = max((min(sqrt(square), limit) - a) / jerk, 0.0)
    t3 = max(a / jerk + t1, 0.0)
    return sign, t1, _plateau(t1, t3, a, change, jerk), t3


@compiled(allocates=False)
def _plateau(t1: float, t3: float, a: float, change: float, jerk: float) -> float:
    top = a + jerk * t1
    if abs(top) <= _TINY:
        return 0.0
    rest = change - t1 * (a + 0.5 * jerk * t1) - t3 * (top - 0.5 * jerk * t3)
    return max(rest / top, 0.0)


@compiled(allocates=False)
def stretched(
    p: Profile, v: float, a: float, wanted: float, limit: float, jerk: float, total: float
) -> Profile:
    """Return the profile, stretched to a total time so that the profiles of all axes end together."""
    sign, t1, t2, t3 = p
    if sign == 0.0 or t1 + t2 + t3 >= total:
        return p
    a *= sign
    change = sign * (wanted - v)
    b = jerk * total - a
    square = total * jerk * (total * jerk + 2.0 * a) - a * a - 4.0 * jerk * change
    t1 = 0.0
    if square >= 0.0:
        t1 = max((b - sqrt(square)) / (2.0 * jerk), 0.0)
        if a / jerk + t1 < 0.0 or a / jerk + 2.0 * t1 > total:
            t1 = 0.0
    t1 = max(min(t1, (limit - a) / jerk), 0.0)
    t3 = max(a / jerk + t1, 0.0)
    return sign, t1, max(total - t1 - t3, 0.0), t3


@compiled(allocates=False)
def follow(p: Profile, x: float, v: float, a: float, jerk: float, t: float) -> Vector:
    """Return position, speed and acceleration on a profile after time `t`."""
    sign, t1, t2, t3 = p
    j = sign * jerk
    s = min(t, t1)
    x += s * (v + s * (0.5 * a + j * s / 6.0))
    v += s * (a + 0.5 * j * s)
    a += j * s
    t -= s
    if t > 0.0:
        s = min(t, t2)
        x += s * (v + 0.5 * a * s)
        v += a * s
        t -= s
    if t > 0.0:
        s = min(t, t3)
        x += s * (v + s * (0.5 * a - j * s / 6.0))
        v += s * (a - 0.5 * j * s)
        a -= j * s
        t -= s
    if t > 0.0:
        a = 0.0
        x += v * t
    return x, v, a


@compiled(allocates=False)
def unit_dot(ax: float, ay: float, bx: float, by: float) -> float:
    """Return the cosine of the angle between two horizontal vectors; 0 if a vector has zero length."""
    size = sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
    return (ax * bx + ay * by) / size if size > _TINY * _TINY else 0.0


@compiled(allocates=False)
def level_speed(
    place: Vector,
    target: Vector,
    after: Vector,
    radius: float,
    cruise: float,
    accel: float,
    jerk: float,
    gain: float,
) -> float:
    """Return the horizontal speed that allows the turn at the target ahead, and a stop at the next waypoint.

    `gain` is the fraction of the acceleration that is used in corners.
    """
    far = sqrt((target[0] - after[0]) ** 2 + (target[1] - after[1]) ** 2)
    corner = 0.0
    if far > 0.001 and far >= radius:
        cosine = unit_dot(
            target[0] - place[0], target[1] - place[1], target[0] - after[0], target[1] - after[1]
        )
        corner = min(turn_speed(cosine, gain * accel, radius), brakeable_speed(jerk, accel, far, 0.0), cruise)
    left = sqrt((target[0] - place[0]) ** 2 + (target[1] - place[1]) ** 2)
    return min(cruise, brakeable_speed(jerk, accel, left, corner))


@compiled(allocates=False)
def climb_speed(
    place: Vector, target: Vector, after: Vector, radius: float, top: float, accel: float, jerk: float
) -> float:
    """Return the vertical speed that allows the vehicle to keep the heights of target and next waypoint.

    As in PX4, the angle between both legs is measured in the plane of height and distance from the origin.
    """
    arrival = 0.0
    if abs(target[2] - after[2]) > 0.001:
        here, there = sqrt(place[0] ** 2 + place[1] ** 2), sqrt(target[0] ** 2 + target[1] ** 2)
        then = sqrt(after[0] ** 2 + after[1] ** 2)
        cosine = unit_dot(there - here, target[2] - place[2], there - then, target[2] - after[2])
        arrival = min(turn_speed(cosine, accel, radius), top)
    return min(top, brakeable_speed(jerk, accel, abs(target[2] - place[2]), arrival))


@compiled(allocates=False)
def clamped(v: Vector, level: float, climb: float) -> Vector:
    """Return a velocity scaled down to the horizontal speed limit, and then to the vertical speed limit.

    If a component and its limit are below 0.5 m/s, only this component is scaled.
    """
    x, y, z = v
    size = sqrt(x * x + y * y)
    if size > level:
        scale = level / size
        x, y = x * scale, y * scale
        if level >= 0.5 or size >= 0.5:
            z *= scale
    size = abs(z)
    if size > climb:
        scale = climb / size
        z *= scale
        if climb >= 0.5 or size >= 0.5:
            x, y = x * scale, y * scale
    return x, y, z


@compiled(allocates=False)
def lookahead(place: Vector, begin: Vector, target: Vector, reach: float, endless: bool) -> Vector:
    """Return the point ahead on the line from `begin` to `target`, at the distance `reach` from the vehicle.

    This is PX4's L1 guidance in three dimensions. In PX4, the line goes on beyond the target (`endless`). A
    vehicle with an exact estimate would follow such a line forever, so its line ends at the target.
    """
    dx, dy, dz = target[0] - begin[0], target[1] - begin[1], target[2] - begin[2]
    size = sqrt(dx * dx + dy * dy + dz * dz)
    if size < _TINY:
        return begin
    dx, dy, dz = dx / size, dy / size, dz / size
    along = (place[0] - begin[0]) * dx + (place[1] - begin[1]) * dy + (place[2] - begin[2]) * dz
    if along > size and not endless:
        return target
    x, y, z = begin[0] + along * dx, begin[1] + along * dy, begin[2] + along * dz
    off2 = (x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2
    ahead = sqrt(reach * reach - off2) if reach * reach > off2 else 0.0
    return x + ahead * dx, y + ahead * dy, z + ahead * dz
