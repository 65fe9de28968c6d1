"""Legs with their headings and circles, and routes for the compiled motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.motion.columns import Record, record_type, records_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Position = tuple[float, float, float]
"""East, north, up relative to the start (m)."""


class LegKind(IntEnum):
    """Purpose of a leg; autopilots fly some kinds differently.

    SETPOINT is a position that a companion computer or ground station sends repeatedly; a multirotor's
    position controller flies there without a planned path. LOITER_TO_HEIGHT is a circle on which the vehicle
    changes its height until it reaches the leg's height. ORBIT is an endless circle about the leg's end.
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


@dataclass(frozen=True, slots=True)
class Heading:
    """Direction of the nose on a leg: `KEEP`, `ALONG`, `INWARD`, `Heading.fixed` or `Heading.turning`.

    Examples
    --------
    >>> Heading.fixed(1.5).numbers, KEEP.numbers
    ((1.5, nan), (inf, nan))
    """

    angle_rad: float | None = None
    """Compass heading; infinity for the heading at the start of the leg, minus infinity for the direction of
    an orbit's centre, None for the direction of the leg."""
    rate_rad_s: float | None = None
    """Heading rate, clockwise; None if `angle_rad` alone gives the heading."""

    @classmethod
    def fixed(cls, angle_rad: float) -> Heading:
        """Return a fixed compass heading."""
        return cls(angle_rad)

    @classmethod
    def turning(cls, rate_rad_s: float) -> Heading:
        """Return a heading that turns clockwise at a rate."""
        return cls(rate_rad_s=rate_rad_s)

    @property
    def numbers(self) -> tuple[float, float]:
        """Compass heading and heading rate as numbers of a route; NaN stands for None."""
        return (
            math.nan if self.angle_rad is None else self.angle_rad,
            math.nan if self.rate_rad_s is None else self.rate_rad_s,
        )


KEEP, ALONG, INWARD = Heading(math.inf), Heading(), Heading(-math.inf)


@dataclass(frozen=True, slots=True)
class Circle:
    """Circle on a leg, for an orbit or for a fixed wing that holds its position."""

    radius_m: float | None = None
    """Radius, positive for clockwise; None selects the autopilot's default."""
    turns: float = 0.0
    """Number of turns after which the leg is complete."""
    leave_to_m: tuple[float, float] | None = None
    """Position (east, north) towards which the vehicle leaves the circle; None for any direction."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One leg of a route."""

    end_m: Position
    speed_m_s: float | None = None
    """Horizontal ground speed (of a fixed wing: airspeed); None selects the vehicle's default."""
    radius_m: float = 0.0
    """Acceptance radius; 0 means that the vehicle stops at the end."""
    heading: Heading = ALONG
    kind: LegKind = LegKind.WAYPOINT
    vertical_speed_m_s: float | None = None
    """Speed of a vertical leg, up or down; None selects the vehicle's default."""
    near_m: float = 0.0
    """Distance from the end at which the motion returns NEAR; 0 for never."""
    pause_s: float = 0.0
    """Pause at the end of the leg; a leg with a pause ends with a stop."""
    circle: Circle | None = None
    """Circle on the leg; without it, a fixed wing that lands approaches in a straight line."""
    pitch_rad: float = 0.0
    """Minimum pitch of a fixed wing on a take-off leg; 0 selects the autopilot's default."""

    @property
    def descends(self) -> bool:
        """Whether the leg is part of a landing."""
        return self.kind is LegKind.LAND or self.vertical_speed_m_s is not None


# Columns of a route's legs, which hold the fields of `Leg`; NaN selects the vehicle's default.
ROUTE = record_type(
    ["x", "y", "z", "radius", "speed", "vertical"],
    ["heading", "turn"],  # The numbers are those of `Heading.numbers`.
    ["near", "kind", "pause"],
    ["circle", "turns"],  # The radius is NaN without a circle, 0 for the autopilot's default.
    ["exit_x", "exit_y"],  # Position towards which the vehicle leaves the circle; NaN for any direction.
    ["pitch"],
)


@dataclass(frozen=True, slots=True)
class Route:
    """Legs that a vehicle flies without a pause; the last leg always ends with a stop."""

    legs: Record
    """Legs of the route, ROUTE[n]."""

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
        """Return the route through positions, float64[n, 3]; the legs are otherwise copies of `leg`."""
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
    """Return a leg as a row of numbers in the order of `ROUTE`."""
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
