"""Shapes of flight as legs: circle, spline; and how items become legs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from sim_vehicle.motion.legs import Circle, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position

LOITER_RADIUS_M = 10.0
_CHORD_M = 2.0
_MAX_CHORDS = 64


def lands(legs: Sequence[Leg]) -> bool:
    """Whether legs end on the ground."""
    return legs[-1].kind is LegKind.LAND


def circle_leg(
    centre: Position,
    speed: float,
    radius_m: float = 0.0,
    turns: float = 0.0,
    leave_to_m: tuple[float, float] | None = None,
) -> Leg:
    """Return the leg of a circle; a radius of 0 is the autopilot's own, positive is clockwise."""
    return Leg(centre, speed, kind=LegKind.LOITER, circle=Circle(radius_m or None, turns, leave_to_m))


def circle_legs(
    centre: Position, last: Position, turns: float, radius: float, speed: float, spec: VehicleSpec
) -> list[Leg]:
    """Return chords of 10 degrees for a circle that begins at its point nearest to the vehicle.

    A positive radius is flown clockwise, a negative one the other way, 0 is 10 m.
    """
    x, y, z = centre
    radius = radius or LOITER_RADIUS_M
    sense = -1.0 if radius > 0.0 else 1.0
    radius = abs(radius)
    begin = math.atan2(last[1] - y, last[0] - x)
    chords = max(1, round(36.0 * turns))
    step = sense * math.radians(10.0)
    slow = min(speed, math.sqrt(0.5 * spec.acceleration_m_s2 * radius))
    accept = min(spec.acceptance_radius_m, 0.3 * radius * abs(step))
    return [
        Leg(
            (x + radius * math.cos(begin + k * step), y + radius * math.sin(begin + k * step), z),
            speed if k == 0 else slow,
            accept,
            kind=LegKind.ARC if k > 0 else LegKind.WAYPOINT,
        )
        for k in range(chords + 1)
    ]


def spline_legs(
    path: tuple[Position, Position, Position | None],
    tangent: Position,
    speed: float,
    heading: Heading,
    spec: VehicleSpec,
) -> tuple[list[Leg], Position]:
    """Return chords of a cubic Hermite spline to a position, and the direction in which it arrives.

    As ArduCopter's spline waypoints, it leaves in the direction of arrival and passes its end in the
    direction from the position before to the position after. The length of both tangents is that of the
    straight path, which keeps the curve free of loops.

    The ``path`` is where it begins, where it ends, and the position after; without one it arrives on the
    straight line. The ``tangent`` is the direction at the beginning; zero is the straight line.
    """
    begin, end, ahead = path
    straight = (end[0] - begin[0], end[1] - begin[1], end[2] - begin[2])
    length = math.hypot(*straight)
    if length < 0.1:
        return [Leg(end, speed, spec.acceptance_radius_m, heading)], tangent
    leave = _scaled(tangent, length) or straight
    arrive = straight
    if ahead is not None:
        through = (ahead[0] - begin[0], ahead[1] - begin[1], ahead[2] - begin[2])
        arrive = _scaled(through, length) or straight
    chords = min(max(4, math.ceil(length / _CHORD_M)), _MAX_CHORDS)
    points = [begin]
    for k in range(1, chords + 1):
        t = k / chords
        a, b = (1.0 + 2.0 * t) * (1.0 - t) ** 2, t * (1.0 - t) ** 2
        c, d = t * t * (3.0 - 2.0 * t), t * t * (t - 1.0)
        x, y, z = (a * begin[i] + b * leave[i] + c * end[i] + d * arrive[i] for i in range(3))
        points.append((x, y, z))
    limits = [_curve_speed(points[k : k + 3], spec) for k in range(chords - 1)]
    legs: list[Leg] = []
    for k in range(1, chords + 1):
        slow = min(speed, *limits[max(0, k - 3) : k + 2])
        accept = min(spec.acceptance_radius_m, 0.45 * math.dist(points[k - 1], points[k]))
        legs.append(Leg(points[k], slow, accept, heading, LegKind.ARC))
    return legs, arrive


def _curve_speed(points: list[Position], spec: VehicleSpec) -> float:
    """Return the speed for a curve through three positions: half of the acceleration, as on circles."""
    (ax, ay, _), (bx, by, _), (cx, cy, _) = points
    before, after = math.hypot(bx - ax, by - ay), math.hypot(cx - bx, cy - by)
    turn = math.remainder(math.atan2(cy - by, cx - bx) - math.atan2(by - ay, bx - ax), 2.0 * math.pi)
    radius = 0.5 * (before + after) / max(abs(turn), 1e-6)
    return max(0.5, math.sqrt(0.5 * spec.acceleration_m_s2 * radius))


def _scaled(direction: Position, length: float) -> Position | None:
    size = math.hypot(*direction)
    if size < 1e-6:
        return None
    scale = length / size
    return direction[0] * scale, direction[1] * scale, direction[2] * scale


class AfterLastLeg(Enum):
    """Continuation after the last leg of a plan."""

    NEXT = "the next item"
    WAIT = "a pause"
    FOREVER = "nothing, it stays"
    TOUCHDOWN = "the ground"


@dataclass(slots=True)
class LegPlan:
    """Legs and what they complete."""

    legs: list[Leg] = field(default_factory=list)
    seqs: list[int] = field(default_factory=list)
    """The item that each leg belongs to, -1 outside a mission."""
    done: list[bool] = field(default_factory=list)
    """Whether the leg completes its item."""
    speeds: list[float | None] = field(default_factory=list)
    """The ground speed that was set for the leg; a curve may be flown more slowly."""
    after_last: AfterLastLeg = AfterLastLeg.NEXT
    wait_s: float = 0.0
    """Of a WAIT; NaN until the time of day that the item names."""
    open: bool = False
    """Whether it was cut short, so it has to be planned again before its end."""
    unsure: bool = False
    """Whether something between its items waits for a condition, which may change it."""

    def add(self, leg: Leg, seq: int = -1, *, done: bool = False, speed: float | None = None) -> None:
        """Append a leg."""
        self.speeds.append(leg.speed_m_s if speed is None else speed)
        self.legs.append(leg)
        self.seqs.append(seq)
        self.done.append(done)

    def extend(
        self, legs: Sequence[Leg], seq: int = -1, *, done: bool = False, speed: float | None = None
    ) -> None:
        """Append legs, of which the last one may complete the item."""
        for leg in legs:
            self.add(leg, seq, done=done and leg is legs[-1], speed=speed)

    def prepend(self, leg: Leg, seq: int) -> None:
        """Put a leg before all others; it completes nothing."""
        self.legs.insert(0, leg)
        self.speeds.insert(0, leg.speed_m_s)
        self.seqs.insert(0, seq)
        self.done.insert(0, False)
