"""Legs, the headings on them, and routes for the compiled motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.motion.columns import Record, record_type, records_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Position = tuple[float, float, float]
"""East, north, up about home, metres."""


class LegKind(IntEnum):
    """Purpose of a leg; an autopilot treats some kinds in its own way.

    SETPOINT is a position that a companion or ground station asks for, again and again: multirotors fly to it
    as their position control does, without a path. LOITER_TO_HEIGHT is a circle that is
    left once its height is reached. ORBIT is a circle about its end that goes on for ever.
    """

    WAYPOINT = 0
    TAKEOFF = 1
    CLIMB = 2
    HOME = 3
    DESCEND = 4
    LAND = 5
    STAY = 6
    LOITER = 7
    ARC = 8
    SETPOINT = 9
    LOITER_TO_HEIGHT = 10
    ORBIT = 11


class HeadingMode(Enum):
    """Where the nose points on a leg."""

    KEEP = "the heading at the start of the leg"
    ALONG = "along the leg"
    FIXED = "a compass heading"
    TURN = "turning at a rate"
    INWARD = "towards the centre of an orbit"


@dataclass(frozen=True, slots=True)
class Heading:
    """Where the nose points on a leg: `KEEP`, `ALONG`, `INWARD`, `Heading.fixed` or `Heading.turning`.

    Examples
    --------
    >>> Heading.fixed(1.5).mode
    <HeadingMode.FIXED: 'a compass heading'>
    """

    mode: HeadingMode
    angle_rad: float = 0.0
    """Compass heading of a fixed one."""
    rate_rad_s: float = 0.0
    """Rate of turning, clockwise."""

    @classmethod
    def fixed(cls, angle_rad: float) -> Heading:
        """Return a compass heading."""
        return cls(HeadingMode.FIXED, angle_rad=angle_rad)

    @classmethod
    def turning(cls, rate_rad_s: float) -> Heading:
        """Return a heading that changes at a rate, clockwise."""
        return cls(HeadingMode.TURN, rate_rad_s=rate_rad_s)

    @property
    def numbers(self) -> tuple[float, float]:
        """Compass heading and rate (NaN for none).

        The heading is NaN along the leg, infinity for the one at its start, minus infinity inward.
        """
        if self.mode is HeadingMode.ALONG:
            return math.nan, math.nan
        if self.mode is HeadingMode.KEEP:
            return math.inf, math.nan
        if self.mode is HeadingMode.INWARD:
            return -math.inf, math.nan
        if self.mode is HeadingMode.FIXED:
            return self.angle_rad, math.nan
        return math.nan, self.rate_rad_s


KEEP = Heading(HeadingMode.KEEP)
ALONG = Heading(HeadingMode.ALONG)
INWARD = Heading(HeadingMode.INWARD)


@dataclass(frozen=True, slots=True)
class Circle:
    """The circle of a leg: of an orbit, and of vehicles that stay by circling."""

    radius_m: float | None = None
    """Clockwise when positive; None is the autopilot's own."""
    turns: float = 0.0
    """To fly before the leg is complete."""
    leave_to_m: tuple[float, float] | None = None
    """Position (east, north) towards which the circle is left, None for anywhere."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One leg of a route."""

    end_m: Position
    speed_m_s: float | None = None
    """Horizontal ground speed (airspeed of a fixed wing); None leaves it to the vehicle."""
    radius_m: float = 0.0
    """Acceptance radius; 0 is a stop."""
    heading: Heading = ALONG
    kind: LegKind = LegKind.WAYPOINT
    vertical_speed_m_s: float | None = None
    """Speed of a vertical leg, up or down; None is the vehicle's own."""
    near_m: float = 0.0
    """Distance to the end at which the motion reports NEAR, 0 for never."""
    pause_s: float = 0.0
    """Time to stay at the end of the leg, which is a stop then."""
    circle: Circle | None = None
    """A fixed wing that lands without one approaches straight."""
    pitch_rad: float = 0.0
    """Least pitch of a fixed wing on a take-off leg; 0 is the autopilot's own."""

    @property
    def descends(self) -> bool:
        """Whether it is part of a landing."""
        return self.kind is LegKind.LAND or self.vertical_speed_m_s is not None


# Columns of the legs of a route: as `Leg`, with NaN for what it leaves to the vehicle.
ROUTE = record_type(
    ["x", "y", "z", "radius", "speed", "vertical"],
    ["heading", "turn"],  # As `Heading.numbers`.
    ["near", "kind", "pause"],
    ["circle", "turns"],  # Radius: NaN for no circle, 0 for the autopilot's own.
    ["exit_x", "exit_y"],  # Where the circle is left to; NaN for anywhere.
    ["pitch"],
)


@dataclass(frozen=True, slots=True)
class Route:
    """Legs that are flown without a pause between them; the last one always ends with a stop."""

    legs: Record
    """ROUTE[n]"""

    @classmethod
    def through(cls, legs: Sequence[Leg]) -> Route:
        """Return the route of one or more legs.

        Examples
        --------
        >>> Route.through([Leg((0.0, 0.0, 10.0), 5.0)]).points_m.tolist()
        [[0.0, 0.0, 10.0]]
        """
        return cls(records_of(np.array([_numbers(leg) for leg in legs]), ROUTE))

    @classmethod
    def over(cls, points_m: NDArray[np.float64], leg: Leg) -> Route:
        """Return the route through positions, float64[n, 3], to each of which leads a leg such as this."""
        table = np.tile(_numbers(leg), (len(points_m), 1))
        table[:, :3] = points_m
        return cls(records_of(table, ROUTE))

    @property
    def points_m(self) -> NDArray[np.float64]:
        """Ends of the legs, float64[n, 3]."""
        table: NDArray[np.float64] = self.legs.view(np.float64).reshape(len(self.legs), -1)
        return table[:, :3]


_NO_CIRCLE = (math.nan, 0.0, math.nan, math.nan)
_ANYWHERE = (math.nan, math.nan)


def _numbers(leg: Leg) -> tuple[float, ...]:
    """Return a leg as one row of numbers, in the order of `ROUTE`."""
    circle = _NO_CIRCLE
    if leg.circle is not None:
        circle = (leg.circle.radius_m or 0.0, leg.circle.turns, *(leg.circle.leave_to_m or _ANYWHERE))
    return (
        *leg.end_m,
        leg.radius_m,
        math.nan if leg.speed_m_s is None else leg.speed_m_s,
        math.nan if leg.vertical_speed_m_s is None else leg.vertical_speed_m_s,
        *leg.heading.numbers,
        leg.near_m,
        leg.kind,
        leg.pause_s,
        *circle,
        leg.pitch_rad,
    )
