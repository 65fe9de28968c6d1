"""Jerk-limited profiles along a straight leg, as ArduPilot's navigation makes them.

A profile is a chain of 23 segments: a start, seven that accelerate, seven that change the speed under way,
one of constant speed, and seven that brake to a stop. The jerk rises and falls along raised cosines, so the
snap is limited too. Formulas after ArduPilot, `libraries/AP_Math/SCurve.cpp` (4.7), whose rules also decide
when the next leg begins while the present one still brakes, which makes the corners.

A leg is a row of `HEAD` numbers and a table of `SEGMENTS` x `COLUMNS` of them. All is SI.
"""

from __future__ import annotations

from math import cos, inf, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

Floats = NDArray[np.float64]

# Head of a profile: the time along it, whether there is one (MADE), its length and direction, the horizontal
# part of the length and its rise, and the limits along it.
HEAD = 13
TIME, MADE, LENGTH, UX, UY, UZ, FLAT, RISE, SNAP, JERK, SPEED, ACCEL, ACCEL_Z = range(HEAD)
SEGMENTS, COLUMNS = 23, 6
(
    SEGMENT_TIME,  # At its end, as acceleration, speed and position.
    SEGMENT_SHAPE,  # Of its jerk: 0 constant, 1 rising, -1 falling.
    SEGMENT_JERK,
    SEGMENT_ACCELERATION,
    SEGMENT_SPEED,
    SEGMENT_POSITION,
) = range(COLUMNS)
_START, _ACCEL_TOP, _ACCEL_END, _CHANGE_END, _CRUISE, _END = 0, 4, 7, 14, 15, 22
# What a number must reach to count as positive (single precision, as the autopilot computes).
_TINY = 1.1920929e-7


# Loops: numba takes long to compile each assignment to a slice.
@compiled(inline="always")
def _copy(to: Floats, first: int, source: Floats, begin: int, count: int) -> None:
    """Copy ``count`` numbers, from ``begin`` of a row to ``first`` of another, without overlap."""
    for k in range(count):
        to[first + k] = source[begin + k]


@compiled(inline="always")
def _clear(row: Floats, begin: int, end: int) -> None:
    """Set the numbers ``begin`` up to, not including, ``end`` of a row to 0."""
    for k in range(begin, end):
        row[k] = 0.0


@compiled(allocates=False)
def kinematic_limit(flat: float, rise: float, level: float, up: float, down: float) -> float:
    """Return the limit along a direction; its horizontal part and the vertical ones have their own."""
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
    """Return jerk, duration of its ramps, and the times of full jerk and of full acceleration.

    The change is from ``v0`` to ``v1``, or as far as it can be made within ``length``. It is symmetric: with
    the peak acceleration A, the ramps r and the jerk J its halves last ``t = A / J + r`` each, and it takes
    ``(2 t + m) (v0 + A (t + m) / 2)`` of length when A is held for m.
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
    """Return the peak of a change that never holds its acceleration and takes a length: a root of a cubic."""
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
    """Return acceleration, speed and position a time after the begin of a segment that lasts ``whole``."""
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
    """Write segment ``i`` behind the one before it."""
    before, row = curve[i - 1], curve[i]
    if lasts < _TINY:
        shape, lasts = 0.0, 0.0
    row[SEGMENT_TIME], row[SEGMENT_SHAPE], row[SEGMENT_JERK] = before[SEGMENT_TIME] + lasts, shape, jerk
    row[SEGMENT_ACCELERATION], row[SEGMENT_SPEED], row[SEGMENT_POSITION] = _after(
        before, shape, jerk, lasts, lasts
    )


@compiled(allocates=False)
def _put_change(curve: Floats, i: int, jerk: float, ramp: float, full: float, middle: float) -> None:
    """Write the seven segments of a change of speed from ``i`` on."""
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
    """Make the segments ``first`` to ``last`` empty ones after the segment ``source``."""
    before = curve[source]
    for i in range(first, last + 1):
        row = curve[i]
        row[SEGMENT_SHAPE] = row[SEGMENT_JERK] = row[SEGMENT_ACCELERATION] = 0.0
        row[SEGMENT_TIME], row[SEGMENT_SPEED] = before[SEGMENT_TIME], before[SEGMENT_SPEED]
        row[SEGMENT_POSITION] = before[SEGMENT_POSITION]


@compiled(allocates=False)
def _put_end(head: Floats, curve: Floats, length: float) -> None:
    """Brake from the cruise within a length, and cruise so long that the profile ends where the leg ends."""
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
    """Make it a leg without length: it is finished before it begins."""
    head[TIME], head[MADE], head[LENGTH] = 0.0, 0.0, 0.0


@compiled(allocates=False)
def copy_leg(heads: Floats, curves: Floats, to: int, source: int) -> None:
    """Put the leg ``source`` of three in the place of the leg ``to``."""
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
    """Make the profile of a leg by ``delta`` from standing to standing.

    Speeds are horizontal, up and down, accelerations horizontal and vertical.
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
    _clear(curve[_START], 0, COLUMNS)
    half = 0.5 * head[LENGTH]
    jerk, ramp, full, middle = _speed_change(head[SNAP], head[JERK], 0.0, head[ACCEL], head[SPEED], half)
    _put_change(curve, _START + 1, jerk, ramp, full, middle)
    _put_nothing(curve, _ACCEL_END + 1, _CRUISE, _ACCEL_END)
    _put_end(head, curve, half)


@compiled(allocates=False)
def change_speed(head: Floats, curve: Floats, level: float, up: float, down: float) -> None:
    """Go on along a leg with other limits of speed, as well as what is left of it allows."""
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
        # Under way to another speed already: that change takes the place of the first one.
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
    brakes = curve[_CRUISE, SEGMENT_POSITION]
    top, before = curve[_ACCEL_TOP, SEGMENT_TIME], curve[_ACCEL_TOP - 1, SEGMENT_TIME]
    accel = curve[_ACCEL_TOP, SEGMENT_ACCELERATION]
    half = 0.5 * head[LENGTH]
    if time <= top and top - before >= _TINY and speed < curve[_ACCEL_END, SEGMENT_SPEED] and accel >= _TINY:
        # Still at full acceleration: cut that short.
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
    """Change the speed after the first acceleration, if what is left before the braking is long enough."""
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
    """Return position along the leg, speed and acceleration at a time."""
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
    """Return whether the leg after the present one may begin while that one still brakes.

    The middle of the turn must lie within ``radius`` of the corner, be slower than both legs, and have less
    than the acceleration ``corner``.
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
