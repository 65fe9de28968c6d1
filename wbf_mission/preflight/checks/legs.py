"""The legs between positions: zero, short and endless ones, and how far from home they lead."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from mission.model import Command
from sim_vehicle.execution.items import Settings, do_items
from sim_vehicle.motion.legs import Position
from wbf_mission.preflight.finding import Finding, Hit, Measure, worst_of
from wbf_mission.preflight.subject import Subject

__all__ = ["PLACED", "Leg", "check_lengths", "check_radii", "check_start_distance", "legs_of"]

PLACED = frozenset({16, 17, 18, 19, 22, 31, 82})
"""Commands that are flown to at a height of their own."""
_FLOWN_TO = PLACED | {int(Command.NAV_LAND)}
_PASSED = frozenset({int(Command.NAV_WAYPOINT), int(Command.NAV_SPLINE_WAYPOINT)})
_FAR_FROM_HOME = PLACED - {int(Command.NAV_TAKEOFF)}
_ZERO_M = 0.01
_LONGEST_M = 10_000.0
_FARTHEST_START_M = 1000.0
_SMALLEST_RADIUS_M = 1.0


@dataclass(frozen=True, slots=True)
class Leg:
    """The way to an item, in the order of the items; jumps are not followed.

    Parameters
    ----------
    item : int
        It ends there; counted from 0.
    start_m, end_m : Position
        East, north, up about home.
    speed_m_s : float
        Ordered.
    radius_m : float
        At which its end counts as reached.
    passed : bool
        It is flown through, without a pause at its end.
    """

    item: int
    start_m: Position
    end_m: Position
    speed_m_s: float
    radius_m: float
    passed: bool

    @property
    def length_m(self) -> float:
        """Over ground."""
        return math.hypot(self.end_m[0] - self.start_m[0], self.end_m[1] - self.start_m[1])

    @property
    def climb_m(self) -> float:
        """How much higher its end is."""
        return self.end_m[2] - self.start_m[2]


def legs_of(subject: Subject) -> tuple[Leg, ...]:
    """Return the legs of a mission; the first begins at home, on the ground.

    An item without a position of its own, and a return, begin the legs anew at the next position.
    """
    legs: list[Leg] = []
    settings = Settings(subject.vehicle.cruise_speed_m_s, default_m_s=subject.vehicle.cruise_speed_m_s)
    last: Position | None = (0.0, 0.0, 0.0)
    for k, (item, position) in enumerate(zip(subject.items, subject.positions, strict=True)):
        if item.command == Command.DO_CHANGE_SPEED:
            do_items((item,), 0, settings, subject.vehicle.top_speed_m_s)
        elif item.command == Command.NAV_RETURN_TO_LAUNCH:
            last = None
        elif item.command in _FLOWN_TO:
            end: Position | None = position
            if math.isnan(position[0]):
                end = None if last is None else (last[0], last[1], position[2])
            if last is not None and end is not None:
                hold = item.param1 or 0.0
                passed = item.command in _PASSED and hold <= 0.0
                legs.append(Leg(k, last, end, settings.speed_m_s, _radius_m(subject, k), passed))
            last = end
    return tuple(legs)


def _radius_m(subject: Subject, item: int) -> float:
    """Return the acceptance radius of an item: its own where the autopilot keeps it."""
    one = subject.items[item]
    own = one.param2 if one.command == Command.NAV_WAYPOINT else None
    kept = "param2" not in subject.profile.lossy.get(one.command, frozenset())
    return own if own and kept else subject.vehicle.acceptance_radius_m


def check_lengths(subject: Subject) -> Iterator[Finding]:
    """Legs of no length, and longer than 10 km."""
    legs = legs_of(subject)
    zero = [Hit(leg.item, 0.0) for leg in legs if leg.passed and _is_zero(leg, subject)]
    if (found := worst_of(zero, largest=True)) is not None:
        yield subject.worst(
            found,
            "zero-leg",
            "the same position as before",
            "remove one of the two",
        )
    long = [Hit(leg.item, leg.length_m) for leg in legs if leg.length_m > _LONGEST_M]
    if (found := worst_of(long, largest=True)) is not None:
        yield subject.worst(
            found,
            "long-leg",
            "a very long leg",
            "is the position right?",
            Measure.at_most("length of the leg", found[0].value, _LONGEST_M, "m"),
        )


def check_radii(subject: Subject) -> Iterator[Finding]:
    """Acceptance radii that the vehicle cannot hold: the error of its height estimate counts in them."""
    if not subject.profile.radius_in_space or subject.vehicle.kind != "multirotor":
        return
    hits = [Hit(leg.item, leg.radius_m) for leg in legs_of(subject) if leg.radius_m < _SMALLEST_RADIUS_M]
    if (found := worst_of(hits, largest=False)) is not None:
        yield subject.worst(
            found,
            "small-radius",
            "the acceptance radius counts in space, and the height estimate is wrong by half a metre: "
            f"{subject.profile.name} may wait at the waypoint",
            "give 2 m, or 0 for the autopilot's own",
            Measure.at_least("acceptance radius", found[0].value, _SMALLEST_RADIUS_M, "m"),
        )


def check_start_distance(subject: Subject) -> Iterator[Finding]:
    """A mission that lies far from home. On a large farm the first position alone may be far away."""
    positions = zip(subject.items, subject.positions, strict=True)
    away = [
        Hit(k, math.hypot(x, y))
        for k, (item, (x, y, _)) in enumerate(positions)
        if item.command in _FAR_FROM_HOME
    ]
    if (found := worst_of(away, largest=False)) is not None and found[0].value > _FARTHEST_START_M:
        nearest = found[0]
        yield subject.worst(
            (nearest, 1),
            "far-start",
            "the whole mission is far from home: this is its nearest position",
            "is home right?",
            Measure.at_most("distance from home", nearest.value, _FARTHEST_START_M, "m"),
        )


def _is_zero(leg: Leg, subject: Subject) -> bool:
    """Return whether a waypoint repeats the waypoint before it."""
    before = next((k for k in range(leg.item - 1, -1, -1) if subject.items[k].command in _FLOWN_TO), None)
    repeated = before is not None and subject.items[before].command in _PASSED
    return repeated and leg.length_m <= _ZERO_M and abs(leg.climb_m) <= _ZERO_M
