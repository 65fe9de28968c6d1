"""Guidance of vehicles that steer, compiled: from a path to a lateral acceleration.

Two laws follow straight lines and circles. East-north axes; accelerations and errors to the right are
positive.

PX4's is NPFG: T. Stastny and R. Siegwart, "On Flying Backwards: Preventing Run-away of Small, Low-speed,
Fixed-wing UAVs in Strong Winds", IROS 2019, with the bearing law of T. Stastny, "L1 guidance logic extension
for small UAVs: handling high winds and small loiter radii", arXiv:1804.04209. ArduPilot's is L1: S. Park,
J. Deyst and J. P. How, "A New Nonlinear Guidance Logic for Trajectory Tracking", AIAA 2004-4900, with its PD
law for circles.
"""

from __future__ import annotations

from math import asin, atan2, cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion.columns import Record

Floats = NDArray[np.float64]

NPFG, L1 = 0.0, 1.0
# Within this margin below the airspeed a bearing across the wind is less and less held.
AIRSPEED_BUFFER = 1.5
LEAST_RADIUS_M = 0.5
_CAPTURE = 0.7071
_LATE_S = 3.0
_DECIDED = 0.9 * pi


@compiled(allocates=False)
def switch_distance(ground: float, period: float, damping: float, share: float) -> float:
    """Return the distance to a waypoint at which NPFG turns to the next leg."""
    constant = period * damping
    bound = ground * constant if ground > 1.0 else 0.5 * constant * (ground * ground + 1.0)
    return float(min(share * bound, 500.0))


@compiled(allocates=False)
def l1_distance(ground: float, period: float, damping: float) -> float:
    """Return the distance to the point on the path that L1 steers to."""
    return float(max(damping * period * ground / pi, 0.1))


@compiled(allocates=False)
def _feasible(across: float, along: float, airspeed: float, wind: float) -> float:
    across = wind if along < 0.0 else abs(across)
    share = min(max((airspeed - across) / AIRSPEED_BUFFER, 0.0), 1.0)
    s = sin(0.5 * pi * share)
    return float(s * s)


@compiled(allocates=False)
def npfg(
    error: float,
    te: float,
    tn: float,
    curvature: float,
    ve: float,
    vn: float,
    we: float,
    wn: float,
    period: float,
    damping: float,
) -> tuple[float, float, float]:
    """Return the lateral acceleration, and the bearing that is steered (east, north).

    Parameters
    ----------
    error : float
        Distance to the right of the path.
    te, tn : float
        Unit tangent of the path.
    curvature : float
        Positive to the right.
    ve, vn, we, wn : float
        Velocity over ground, wind.
    period, damping : float
        Of the guidance.
    """
    ground = sqrt(ve * ve + vn * vn)
    ae, an = ve - we, vn - wn
    airspeed = max(sqrt(ae * ae + an * an), 1.0)
    wind = sqrt(we * we + wn * wn)
    constant = period * damping
    bound = ground * constant if ground > 1.0 else 0.5 * constant * (ground * ground + 1.0)
    near = min(abs(error) / bound, 1.0) - 1.0
    ahead = 0.5 * pi * near * near
    toward, along = cos(ahead), sin(ahead)
    side = -toward if error > 0.0 else toward
    # The right-hand normal of the tangent is (tn, -te).
    be, bn = along * te + side * tn, along * tn - side * te
    wind_across, wind_along = wn * be - we * bn, we * be + wn * bn
    path_across, path_along = wn * te - we * tn, we * te + wn * tn
    acceleration = 0.0
    if curvature != 0.0:
        bent = curvature / max(1.0 - curvature * error, abs(curvature) * LEAST_RADIUS_M)
        rate = bent * max(ve * te + vn * tn, 0.0)
        free = airspeed * airspeed - path_across * path_across
        ratio = 1.0 + path_along / max(sqrt(free) if free > 0.0 else 0.0, 0.1)
        held = _feasible(path_across, path_along, airspeed, wind) * _feasible(
            wind_across, wind_along, airspeed, wind
        )
        acceleration = airspeed * ratio * rate * held * along * along
    if abs(wind_across) < airspeed and (wind_along > 0.0 or wind < airspeed):
        # Wind triangle: the heading that makes the bearing good.
        forward = sqrt(airspeed * airspeed - wind_across * wind_across)
        he = forward * be + wind_across * bn
        hn = forward * bn - wind_across * be
    else:
        away = wind * wind - airspeed * airspeed
        away = sqrt(away) if away > 0.0 else 0.0
        he, hn = away * be - we, away * bn - wn
    size = max(sqrt(he * he + hn * hn), 1e-6)
    he, hn = he / size, hn / size
    turn = an * he - ae * hn
    if ae * he + an * hn < 0.0:
        turn = airspeed if turn >= 0.0 else -airspeed
    return acceleration + 4.0 * pi * damping / period * turn, be, bn


@compiled(allocates=False)
def _decide(nu: float, state: Record) -> float:
    """Keep turning the same way when the goal is behind."""
    last = state.guidance
    if abs(nu) > _DECIDED and abs(last) > _DECIDED and nu * last < 0.0:
        nu = last
    state.guidance = nu
    return float(min(max(nu, -0.5 * pi), 0.5 * pi))


@compiled(allocates=False)
def l1_line(
    rx: float,
    ry: float,
    te: float,
    tn: float,
    length: float,
    ve: float,
    vn: float,
    period: float,
    damping: float,
    gain: float,
    dt: float,
    state: Record,
) -> tuple[float, float, float]:
    """Return L1's lateral acceleration along a leg, and its bearing (east, north).

    Parameters
    ----------
    rx, ry : float
        Position, from the beginning of the leg.
    te, tn, length : float
        Direction and length of the leg.
    ve, vn : float
        Velocity over ground.
    period, damping, gain : float
        Of the loop; gain of the integral of the cross-track angle.
    state : STATE
        Holds the last angle and the integral.
    """
    ground = max(sqrt(ve * ve + vn * vn), 0.1)
    distance = l1_distance(ground, period, damping)
    k = 4.0 * damping * damping
    away = sqrt(rx * rx + ry * ry)
    along = rx * te + ry * tn
    be, bn = te, tn
    direct = False
    if away > distance and along / max(away, 1.0) < -_CAPTURE:
        be, bn = -rx / away, -ry / away
        direct = True
    elif along > length + _LATE_S * ground:
        be, bn = length * te - rx, length * tn - ry
        size = max(sqrt(be * be + bn * bn), 1e-6)
        be, bn = be / size, bn / size
        direct = True
    # Angles to the right of the velocity.
    angle = atan2(vn * be - ve * bn, ve * be + vn * bn)
    if not direct:
        error = rx * tn - ry * te
        share = min(max(error / distance, -_CAPTURE), _CAPTURE)
        capture = -asin(share)
        if gain > 0.0 and abs(capture) < 0.0873:
            integral = state.guidance_integral + capture * gain * dt
            state.guidance_integral = min(max(integral, -0.1), 0.1)
        capture += state.guidance_integral
        angle += capture
        c, s = cos(capture), sin(capture)
        be, bn = be * c + bn * s, bn * c - be * s
    angle = _decide(angle, state)
    return k * ground * ground / distance * sin(angle), be, bn


@compiled(allocates=False)
def l1_circle(
    rx: float,
    ry: float,
    radius: float,
    sense: float,
    ve: float,
    vn: float,
    period: float,
    damping: float,
    state: Record,
) -> float:
    """Return L1's lateral acceleration to reach and follow a circle.

    Parameters
    ----------
    rx, ry : float
        Position, from the centre.
    radius, sense : float
        Positive radius; 1 is clockwise.
    ve, vn : float
        Velocity over ground.
    """
    ground = max(sqrt(ve * ve + vn * vn), 1.0)
    omega = 2.0 * pi / period
    distance = l1_distance(ground, period, damping)
    away = sqrt(rx * rx + ry * ry)
    if away > 0.1:
        oe, on = rx / away, ry / away
    else:
        oe, on = ve / ground, vn / ground
    # Velocity outward, and clockwise about the centre.
    outward = ve * oe + vn * on
    clockwise = ve * on - vn * oe
    angle = _decide(atan2(clockwise, -outward), state)
    capture = 4.0 * damping * damping * ground * ground / distance * sin(angle)
    error = away - radius
    correction = error * omega * omega + outward * 2.0 * damping * omega
    tangent = clockwise * sense
    if outward > 0.0 and tangent < 0.0:
        correction = max(correction, 0.0)
    circle = sense * (correction + tangent * tangent / max(0.5 * radius, away))
    if error > 0.0 and sense * capture < sense * circle:
        return float(capture)
    return float(circle)
