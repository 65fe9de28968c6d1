"""S-curves: snap-limited speed profiles along a straight leg, as in ArduPilot's navigation.

A profile has 23 segments: a start, seven for the acceleration, seven for a speed change in flight, one at
constant speed, and seven for braking to a stop. The jerk rises and falls along raised cosines, so the snap is
limited, too. The formulas are from ArduPilot, `libraries/AP_Math/SCurve.cpp` (4.7). As in ArduPilot, the next
leg may begin while the present leg still brakes, so that the path rounds the corner.

A leg consists of a row of `HEAD` numbers and a table of `SEGMENTS` x `COLUMNS` numbers, in SI units.
"""

from __future__ import annotations

from math import cos, inf, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

Floats = NDArray[np.float64]

# Head of a profile: time along the profile, whether a profile exists (MADE), length and direction of the leg,
# its horizontal length and rise, and the limits along the leg.
HEAD = 13
TIME, MADE, LENGTH, UX, UY, UZ, FLAT, RISE, SNAP, JERK, SPEED, ACCEL, ACCEL_Z = range(HEAD)
SEGMENTS, COLUMNS = 23, 6
(
    SEGMENT_TIME,  # Time, acceleration, speed and position are values at the end of the segment.
    SEGMENT_SHAPE,  # Shape of the jerk: 0 constant, 1 rising, -1 falling.
    SEGMENT_JERK,
    SEGMENT_ACCELERATION,
    SEGMENT_SPEED,
    SEGMENT_POSITION,
) = range(COLUMNS)
_START, _ACCEL_TOP, _ACCEL_END, _CHANGE_END, _CRUISE, _END = 0, 4, 7, 14, 15, 22
# Smallest number that counts as positive, as in the autopilot's single precision.
_TINY = 1.1920929e-7


# Loops replace slices here, because numba compiles each assignment to a slice slowly.
@compiled(inline="always")
def _copy(to: Floats, first: int, source: Floats, begin: int, count: int) -> None:
    """Copy `count` numbers from index `begin` of a row to index `first` of another row."""
    for k in range(count):
        to[first + k] = source[begin + k]


@compiled(allocates=False)
def kinematic_limit(flat: float, rise: float, level: float, up: float, down: float) -> float:
    """Return the limit along a direction, from the horizontal, upward and downward limits."""
    size = sqrt(flat * flat + rise * rise)
    limit = inf
    if flat > _TINY * size:
        limit = level * size / flat
    if abs(rise) > _TINY * size:
        limit = min(limit, (up if rise > 0.0 else down) * size / abs(rise))
    return float(limit)


@compiled(allocates=False)
def _speed_change(
    snap: float, jerk: float, v0: float, accel: float, v1: float, length: float
) -> tuple[float, float, float, float]:
    """Return jerk, ramp duration, time at full jerk and time at full acceleration of a speed change.

    The speed changes from `v0` to `v1`, or as far as `length` allows. The change is symmetric. With the peak
    acceleration A, ramp duration r and jerk J, each half lasts ``t = A / J + r``. If A lasts for the time m,
    the change needs the length ``(2 t + m) (v0 + A (t + m) / 2)``.
    """
    if v0 >= v1 or min(snap, jerk, accel, length) < _TINY:
        return 0.0, 0.0, 0.0, 0.0
    ramp = jerk * pi / (2.0 * snap)
    within = min(accel, (v1 - v0) / (2.0 * ramp), (length - 4.0 * v0 * ramp) / (4.0 * ramp * ramp))
    if within < _TINY:
        return 0.0, 0.0, 0.0, 0.0
    full = within >= jerk * ramp
    if not full:
        if v0 < _TINY:
            ramp = min(
                ramp,
                sqrt(sqrt(length * pi / (8.0 * snap))),
                (v1 * pi / (4.0 * snap)) ** (1.0 / 3.0),
                sqrt(accel * pi / (2.0 * snap)),
            )
            jerk = 2.0 * snap * ramp / pi
            accel = jerk * ramp
        else:
            accel = within
            jerk = accel / ramp
    t = accel / jerk + ramp
    middle = 0.0
    if v1 <= v0 + accel * t or length <= t * (2.0 * v0 + accel * t):
        if full:
            by_speed = 0.5 * jerk * (sqrt(ramp * ramp + 4.0 * (v1 - v0) / jerk) - ramp)
            accel = min(accel, by_speed, _peak_acceleration(jerk, ramp, v0, length))
    else:
        b = v0 + 1.5 * accel * t
        by_length = (sqrt(b * b + 2.0 * accel * (length - t * (2.0 * v0 + accel * t))) - b) / accel
        middle = max(0.0, min((v1 - v0) / accel - t, by_length))
    return jerk, ramp, max(accel / jerk - ramp, 0.0) if full else 0.0, middle


@compiled(allocates=False)
def _peak_acceleration(jerk: float, ramp: float, v0: float, length: float) -> float:
    """Return the peak acceleration of a speed change over `length` without a plateau (root of a cubic)."""
    peak = (length * jerk * jerk) ** (1.0 / 3.0)
    for _ in range(30):
        t = peak / jerk + ramp
        excess = t * (2.0 * v0 + peak * t) - length
        step = excess / (t * t + 2.0 * (v0 + peak * t) / jerk)
        peak -= step
        if abs(step) < 1e-12 * peak:
            break
    return float(peak)


@compiled(inline="always")
def _after(before: Floats, shape: float, jerk: float, whole: float, t: float) -> tuple[float, float, float]:
    """Return acceleration, speed and position at time `t` of a segment of duration `whole`."""
    a, v, p = before[SEGMENT_ACCELERATION], before[SEGMENT_SPEED], before[SEGMENT_POSITION]
    if shape == 0.0 or whole <= 0.0:
        return (a + jerk * t, v + t * (a + 0.5 * jerk * t), p + t * (v + t * (0.5 * a + jerk * t / 6.0)))
    half = 0.5 * jerk
    beta = pi / whole
    angle = beta * t
    bend = shape * half / beta
    sine = sin(angle)
    return (
        a + half * t - bend * sine,
        v + t * (a + 0.5 * half * t) + bend / beta * (cos(angle) - 1.0),
        p + t * (v + t * (0.5 * a + half * t / 6.0)) - bend / beta * (t - sine / beta),
    )


@compiled(allocates=False)
def _put(curve: Floats, i: int, shape: float, lasts: float, jerk: float) -> None:
    """Write segment `i` after the previous segment."""
    before, row = curve[i - 1], curve[i]
    if lasts < _TINY:
        shape, lasts = 0.0, 0.0
    row[SEGMENT_TIME], row[SEGMENT_SHAPE], row[SEGMENT_JERK] = before[SEGMENT_TIME] + lasts, shape, jerk
    row[SEGMENT_ACCELERATION], row[SEGMENT_SPEED], row[SEGMENT_POSITION] = _after(
        before, shape, jerk, lasts, lasts
    )


@compiled(allocates=False)
def _put_change(curve: Floats, i: int, jerk: float, ramp: float, full: float, middle: float) -> None:
    """Write the seven segments of a speed change, starting at segment `i`."""
    _put(curve, i, 1.0, ramp, jerk)
    _put(curve, i + 1, 0.0, full, jerk)
    _put(curve, i + 2, -1.0, ramp, jerk)
    _put(curve, i + 3, 0.0, middle, 0.0)
    _put(curve, i + 4, 1.0, ramp, -jerk)
    _put(curve, i + 5, 0.0, full, -jerk)
    _put(curve, i + 6, -1.0, ramp, -jerk)
    curve[i + 6, SEGMENT_ACCELERATION] = 0.0
    curve[i + 6, SEGMENT_SPEED] = max(curve[i + 6, SEGMENT_SPEED], 0.0)


@compiled(allocates=False)
def _put_nothing(curve: Floats, first: int, last: int, source: int) -> None:
    """Make segments `first` to `last` empty; they have the values at the end of segment `source`."""
    before = curve[source]
    for i in range(first, last + 1):
        row = curve[i]
        row[SEGMENT_SHAPE] = row[SEGMENT_JERK] = row[SEGMENT_ACCELERATION] = 0.0
        row[SEGMENT_TIME], row[SEGMENT_SPEED] = before[SEGMENT_TIME], before[SEGMENT_SPEED]
        row[SEGMENT_POSITION] = before[SEGMENT_POSITION]


@compiled(allocates=False)
def _put_end(head: Floats, curve: Floats, length: float) -> None:
    """Write the braking within a length, and lengthen the cruise so that the profile ends with the leg."""
    speed = curve[_CRUISE, SEGMENT_SPEED]
    jerk, ramp, full, middle = _speed_change(head[SNAP], head[JERK], 0.0, head[ACCEL], speed, length)
    _put_change(curve, _CRUISE + 1, -jerk, ramp, full, middle)
    left = max(0.0, head[LENGTH] - curve[_END, SEGMENT_POSITION])
    lasts = left / speed if speed > _TINY else 0.0
    for i in range(_CRUISE, _END + 1):
        curve[i, SEGMENT_TIME] += lasts
        curve[i, SEGMENT_POSITION] += left


@compiled(allocates=False)
def clear_leg(head: Floats) -> None:
    """Make a leg empty, so that it is complete before it begins."""
    head[TIME], head[MADE], head[LENGTH] = 0.0, 0.0, 0.0


@compiled(allocates=False)
def copy_leg(heads: Floats, curves: Floats, to: int, source: int) -> None:
    """Copy leg `source` of the three legs to leg `to`."""
    _copy(heads[to], 0, heads[source], 0, HEAD)
    for i in range(SEGMENTS):
        _copy(curves[to, i], 0, curves[source, i], 0, COLUMNS)


@compiled(allocates=False)
def make_leg(
    head: Floats,
    curve: Floats,
    delta: tuple[float, float, float],
    speeds: tuple[float, float, float],
    accels: tuple[float, float],
    snap: float,
    jerk: float,
) -> None:
    """Make the profile of a leg along the vector `delta`, from rest to rest.

    `speeds` are horizontal, up and down; `accels` are horizontal and vertical.
    """
    dx, dy, dz = delta
    flat = sqrt(dx * dx + dy * dy)
    length = sqrt(flat * flat + dz * dz)
    clear_leg(head)
    if length < 1e-6:
        return
    head[MADE], head[LENGTH], head[FLAT], head[RISE] = 1.0, length, flat, dz
    head[UX], head[UY], head[UZ] = dx / length, dy / length, dz / length
    head[SNAP], head[JERK] = snap, jerk
    head[SPEED] = kinematic_limit(flat, dz, speeds[0], speeds[1], speeds[2])
    head[ACCEL] = kinematic_limit(flat, dz, accels[0], accels[1], accels[1])
    head[ACCEL_Z] = accels[1]
    _make_profile(head, curve)


@compiled(allocates=False)
def _make_profile(head: Floats, curve: Floats) -> None:
    for k in range(COLUMNS):
        curve[_START, k] = 0.0
    half = 0.5 * head[LENGTH]
    jerk, ramp, full, middle = _speed_change(head[SNAP], head[JERK], 0.0, head[ACCEL], head[SPEED], half)
    _put_change(curve, _START + 1, jerk, ramp, full, middle)
    _put_nothing(curve, _ACCEL_END + 1, _CRUISE, _ACCEL_END)
    _put_end(head, curve, half)


@compiled(allocates=False)
def change_speed(head: Floats, curve: Floats, level: float, up: float, down: float) -> None:
    """Continue along a leg with new speed limits, as far as the rest of the leg allows."""
    if head[MADE] == 0.0:
        return
    speed = kinematic_limit(head[FLAT], head[RISE], level, up, down)
    if abs(speed - head[SPEED]) < _TINY or speed < _TINY:
        return
    head[SPEED] = speed
    time = head[TIME]
    if time >= curve[_CRUISE, SEGMENT_TIME]:
        return
    if time < _TINY:
        _make_profile(head, curve)
        return
    if curve[_ACCEL_END, SEGMENT_TIME] <= time <= curve[_CHANGE_END, SEGMENT_TIME]:
        # An earlier speed change still lasts, and takes the place of the initial acceleration.
        _put_nothing(curve, _START, _START, _ACCEL_END)
        for i in range(_START + 1, _ACCEL_END + 1):
            _copy(curve[i], 0, curve[i + 7], 0, COLUMNS)
    elif curve[_CHANGE_END, SEGMENT_TIME] < time:
        here = (
            curve[_CHANGE_END, SEGMENT_POSITION]
            + (time - curve[_CHANGE_END, SEGMENT_TIME]) * curve[_CHANGE_END, SEGMENT_SPEED]
        )
        _put_nothing(curve, _START, _START, _CHANGE_END)
        _put_nothing(curve, _START + 1, _START + 1, _START)
        curve[_START + 1, SEGMENT_TIME], curve[_START + 1, SEGMENT_POSITION] = time, here
        _put_nothing(curve, _START + 2, _ACCEL_END, _START + 1)
    if curve[_CHANGE_END, SEGMENT_SPEED] < curve[_ACCEL_END, SEGMENT_SPEED]:
        # A planned reduction of speed is given up before it begins; braking then needs more room.
        _put_nothing(curve, _ACCEL_END + 1, _CRUISE, _ACCEL_END)
        _put_end(head, curve, head[LENGTH] - curve[_CRUISE, SEGMENT_POSITION])
    brakes = curve[_CRUISE, SEGMENT_POSITION]
    top, before = curve[_ACCEL_TOP, SEGMENT_TIME], curve[_ACCEL_TOP - 1, SEGMENT_TIME]
    accel = curve[_ACCEL_TOP, SEGMENT_ACCELERATION]
    half = 0.5 * head[LENGTH]
    if time <= top and top - before >= _TINY and speed < curve[_ACCEL_END, SEGMENT_SPEED] and accel >= _TINY:
        # The leg is still at full acceleration, so this segment is shortened.
        least = curve[_ACCEL_END, SEGMENT_SPEED] - accel * (top - max(time, before))
        jerk, ramp, full, middle = _speed_change(
            head[SNAP], head[JERK], curve[_START, SEGMENT_SPEED], head[ACCEL], max(least, speed), half
        )
        _put_change(curve, _START + 1, jerk, ramp, full, middle)
        _put_nothing(curve, _ACCEL_END + 1, _CRUISE, _ACCEL_END)
        _put_end(head, curve, half)
        brakes = curve[_CRUISE, SEGMENT_POSITION]
    _put_nothing(curve, _ACCEL_END + 1, _CHANGE_END, _ACCEL_END)
    _change_under_way(head, curve, speed, brakes - curve[_ACCEL_END, SEGMENT_POSITION])
    _put_nothing(curve, _CRUISE, _CRUISE, _CHANGE_END)
    _put_end(head, curve, head[LENGTH] - curve[_CRUISE, SEGMENT_POSITION])


@compiled(allocates=False)
def _change_under_way(head: Floats, curve: Floats, speed: float, room: float) -> None:
    """Change the speed after the initial acceleration, if there is room before the braking."""
    now = curve[_ACCEL_END, SEGMENT_SPEED]
    snap, limit, accel = head[SNAP], head[JERK], head[ACCEL]
    if abs(speed - now) < _TINY or room <= 0.0 or now < _TINY:
        return
    time = 12.0 * min((abs(speed - now) * pi / (4.0 * snap)) ** (1.0 / 3.0), limit * pi / (2.0 * snap))
    sign, low, high = 1.0, now, min(speed, room / time)
    if speed < now:
        if time * now >= room:
            return
        sign, low, high = -1.0, speed, now
    jerk, ramp, full, middle = _speed_change(snap, limit, low, accel, high, 0.5 * room)
    _put_change(curve, _ACCEL_END + 1, sign * jerk, ramp, full, middle)
    if curve[_CHANGE_END, SEGMENT_POSITION] - curve[_ACCEL_END, SEGMENT_POSITION] > room:
        _put_nothing(curve, _ACCEL_END + 1, _CHANGE_END, _ACCEL_END)


@compiled(inline="late", allocates=False)
def state_at(head: Floats, curve: Floats, time: float) -> tuple[float, float, float]:
    """Return the position along the leg, the speed and the acceleration at a time."""
    if head[MADE] == 0.0:
        return 0.0, 0.0, 0.0
    if time >= curve[_END, SEGMENT_TIME]:
        return curve[_END, SEGMENT_POSITION], curve[_END, SEGMENT_SPEED], curve[_END, SEGMENT_ACCELERATION]
    i = 0
    while time >= curve[i, SEGMENT_TIME]:
        i += 1
    if i == 0:
        return curve[0, SEGMENT_POSITION], curve[0, SEGMENT_SPEED], curve[0, SEGMENT_ACCELERATION]
    before, row = curve[i - 1], curve[i]
    whole, since = row[SEGMENT_TIME] - before[SEGMENT_TIME], time - before[SEGMENT_TIME]
    a, v, p = _after(before, row[SEGMENT_SHAPE], row[SEGMENT_JERK], whole, since)
    return max(p, 0.0), v, a


@compiled(inline="always")
def end_time(head: Floats, curve: Floats) -> float:
    """Return the duration of a leg."""
    return float(curve[_END, SEGMENT_TIME]) if head[MADE] != 0.0 else 0.0


@compiled(allocates=False)
def may_turn(heads: Floats, curves: Floats, radius: float, corner: float) -> bool:
    """Return whether the next leg may begin while the present leg still brakes.

    In the middle of the turn, the vehicle must be within `radius` of the corner, slower than on both legs,
    and accelerate by less than `corner`.
    """
    this, after = heads[1], heads[2]
    here, ahead = curves[1], curves[2]
    left = end_time(this, here) - this[TIME]
    if (
        this[MADE] == 0.0
        or after[MADE] == 0.0
        or this[TIME] < here[_CRUISE, SEGMENT_TIME]
        or left > ahead[_ACCEL_END, SEGMENT_TIME]
    ):
        return False
    p, v, a = state_at(this, here, this[TIME] + 0.5 * left)
    q, w, b = state_at(after, ahead, 0.5 * left)
    p -= this[LENGTH]
    size = speed = accel = climb = 0.0
    for k in range(UX, UZ + 1):
        size += (p * this[k] + q * after[k]) ** 2
        speed += (v * this[k] + w * after[k]) ** 2
        bend = a * this[k] + b * after[k]
        if k < UZ:
            accel += bend * bend
        else:
            climb = abs(bend)
    slower = min(this[SPEED], after[SPEED])
    return bool(
        size < radius * radius
        and speed < slower * slower
        and accel < corner * corner
        and climb < min(this[ACCEL_Z], after[ACCEL_Z])
    )
