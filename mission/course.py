"""Legs of a mission, places along them, and the progress of a flight over them."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from geo.frame import LocalFrame
from mission.errors import MissionError
from mission.ground.items import FLOWN_TO, shots_ordered
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import MAX_ITEMS, Command, Mission, MissionItem

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_HERE = frozenset({17, 18, 19, 31})
_CONDITIONS = frozenset({int(Command.CONDITION_DELAY), int(Command.CONDITION_DISTANCE)})
_LANDINGS = frozenset(
    {int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_LAND), int(Command.DO_LAND_START), 85}
)
_TAKEOFFS = frozenset({int(Command.NAV_TAKEOFF), 84})


def takes_image(item: MissionItem) -> bool:
    """Return whether an item triggers a single image."""
    shots = shots_ordered(item)
    return shots is not None and math.isinf(shots.interval_ms)


def turns_camera(item: MissionItem) -> bool | None:
    """Return True if an item starts a series of images, False if it stops one, None otherwise."""
    shots = shots_ordered(item)
    return None if shots is None or takes_image(item) else not shots.is_off


@dataclass(frozen=True, slots=True, order=True)
class Place:
    """A place on a leg of a mission.

    Fraction 0 is the start of the leg, after all commands between the previous leg and this leg. The end of a
    leg is always written as fraction 0 of the next leg.
    """

    item: int
    """Index of the item at the end of the leg, from 0."""
    fraction: float = 0.0
    """Flown fraction of the leg, from 0 to below 1."""

    def __str__(self) -> str:
        return f"item {self.item + 1}" + (f", {self.fraction:.0%} of its leg" if self.fraction else "")


@dataclass(frozen=True, slots=True)
class Leg:
    """A leg: the path flown to one navigation item."""

    item: int
    begin: tuple[float, float, float]
    """Latitude and longitude (degrees), and altitude (m) in the frame of the leg's item."""
    end: tuple[float, float, float]
    straight: bool
    """Whether a mission can be cut on the leg: the leg has no spline, no loiter and no CONDITION command."""
    works: bool
    """Whether images are taken on the leg or at its end."""


class Course:
    """The legs of a mission between take-off and landing.

    Parameters
    ----------
    mission : Mission
    frame : LocalFrame, optional
        Local frame for distances. By default its origin is the mission's home, or without a home the first
        position.

    Raises
    ------
    MissionError
        If the mission has jumps (which `unrolled` writes out), lands before its last waypoint, or has no
        waypoint.

    Examples
    --------
    >>> rows = [MissionItem.waypoint(28.05 + 0.001 * k, -82.15, 10.0) for k in range(3)]
    >>> course = Course(Mission((*rows, MissionItem(20)), None))
    >>> course.lengths_m.round().tolist(), str(course.place(166.25))
    ([0.0, 111.0, 111.0], 'item 3, 50% of its leg')
    """

    def __init__(self, mission: Mission, frame: LocalFrame | None = None) -> None:
        items = mission.items
        if any(item.command == Command.DO_JUMP for item in items):
            msg = "the mission has DO_JUMP items, so a place may be flown several times; write out the jumps"
            raise MissionError(msg)
        self.mission = mission
        flown = [k for k, item in enumerate(items) if item.command in FLOWN_TO]
        takeoffs = [k for k, item in enumerate(items) if item.command in _TAKEOFFS]
        first = flown[0] if flown else len(items)
        self.begin: int = max((k + 1 for k in takeoffs if k < first), default=0)
        """Index of the first item after the take-off."""
        landings = [k for k, item in enumerate(items) if k >= self.begin and item.command in _LANDINGS]
        self.end: int = landings[0] if landings else len(items)
        """Index of the first item of the return or landing; the number of items if there is none."""
        lands = items[self.end].command if landings else None
        if any(k > first for k in takeoffs) or (
            lands not in (None, Command.DO_LAND_START) and any(k > self.end for k in flown)
        ):
            msg = f"item {self.end + 1}: the mission lands before its last waypoint; split it at its landings"
            raise MissionError(msg)
        flown = [k for k in flown if k < self.end]
        if not flown:
            raise MissionError(
                "the mission has no waypoint between take-off and landing: there is nothing to cut or resume"
            )
        self.frame = frame if frame is not None else self._home_frame()
        self.legs: tuple[Leg, ...] = tuple(self._legs_to(flown))

    def _home_frame(self) -> LocalFrame:
        home = self.mission.home
        if home is not None:
            return LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m)
        placed = next((item for item in self.mission.items if item.has_position and (item.x or item.y)), None)
        if placed is None:
            raise MissionError("the mission has no position, so its start is unknown; give it a home")
        return LocalFrame(placed.x, placed.y)

    def _legs_to(self, flown: list[int]) -> list[Leg]:
        items, home = self.mission.items, self.mission.home
        begun = items[self.begin - 1] if self.begin else None
        at: tuple[float, float, float] | None = None
        if begun and begun.has_position and (begun.x or begun.y):
            at = (begun.x, begun.y, begun.z)
        elif home is not None:
            at = (home.latitude_deg, home.longitude_deg, begun.z if begun else 0.0)
        shots = any(map(turns_camera, items)) or any(map(takes_image, items))
        on, before, frame = False, self.begin, begun.frame if begun else None
        legs: list[Leg] = []
        for number, k in enumerate(flown):
            item = items[k]
            between = items[before:k]
            for command in between:
                turned = turns_camera(command)
                on = on if turned is None else turned
            in_place = not item.has_position or (item.command in _HERE and not (item.x or item.y))
            begin = at or (item.x, item.y, item.z)
            if frame != item.frame:
                begin = (*begin[:2], item.z)
            end = begin if in_place else (item.x, item.y, item.z)
            ends = flown[number + 1] if number + 1 < len(flown) else self.end
            straight = item.command == Command.NAV_WAYPOINT and not any(
                command.command in _CONDITIONS for command in between
            )
            # A spline item also curves the leg before it.
            straight = straight and not (
                number + 1 < len(flown) and items[ends].command == Command.NAV_SPLINE_WAYPOINT
            )
            works = on or not shots or any(map(takes_image, items[k + 1 : ends]))
            legs.append(Leg(k, begin, end, straight, works))
            at, before, frame = end, k + 1, item.frame
        return legs

    @cached_property
    def _ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Starts and ends of the legs in the local frame (m), float64[n, 2] each."""
        begin, end = (
            np.column_stack(self.frame.from_wgs84(*np.array([place[:2] for place in places]).T))
            for places in ([leg.begin for leg in self.legs], [leg.end for leg in self.legs])
        )
        return begin, end

    @cached_property
    def lengths_m(self) -> NDArray[np.float64]:
        """Horizontal length of each leg, float64[n]."""
        begin, end = self._ends
        return np.hypot(*(end - begin).T)

    @cached_property
    def ends_m(self) -> NDArray[np.float64]:
        """Distance from the start of the course to the end of each leg, float64[n]."""
        return np.cumsum(self.lengths_m)

    @property
    def length_m(self) -> float:
        """Horizontal length of the whole course."""
        return float(self.ends_m[-1])

    @property
    def start(self) -> Place:
        """First place of the course."""
        return Place(self.legs[0].item)

    @cached_property
    def _flown_items(self) -> list[int]:
        return [leg.item for leg in self.legs]

    def leg_of(self, place: Place) -> int:
        """Return the index of the leg of a place, or the number of legs if the place is past the last leg."""
        return bisect.bisect_left(self._flown_items, place.item)

    def metres(self, place: Place) -> float:
        """Return the distance from the start of the course to a place."""
        number = self.leg_of(place)
        if number == len(self.legs):
            return self.length_m
        behind = place.fraction if place.item == self.legs[number].item else 0.0
        return float(self.ends_m[number] - (1.0 - behind) * self.lengths_m[number])

    def place(self, metres: float) -> Place | None:
        """Return the place at a distance from the start of the course, or None at the end of the course."""
        number = int(np.searchsorted(self.ends_m, metres, side="right"))
        if number >= len(self.legs):
            return None
        part = 1.0 - float((self.ends_m[number] - metres) / self.lengths_m[number])
        return Place(self.legs[number].item, min(max(part, 0.0), math.nextafter(1.0, 0.0)))

    def position(self, place: Place) -> tuple[float, float, float]:
        """Return latitude, longitude and altitude of a place, in the frame of the leg's item."""
        number = self.leg_of(place)
        if number == len(self.legs):
            return self.legs[-1].end
        part, (x, y, z), end = place.fraction, self.legs[number].begin, self.legs[number].end
        y += part * math.remainder(end[1] - y, 360.0)  # The leg may cross the date line
        return x + part * (end[0] - x), math.remainder(y, 360.0), z + part * (end[2] - z)

    def after(self, place: Place) -> Place | None:
        """Return `place` if its leg has images, otherwise the start of the next leg with images, or None."""
        number = self.leg_of(place)
        if number < len(self.legs) and self.legs[number].works:
            return place
        return next((Place(leg.item) for leg in self.legs[number:] if leg.works), None)

    def back(self, place: Place, overlap_m: float) -> Place:
        """Return the place `overlap_m` metres before `place`.

        The overlap does not extend into a leg without images. On a curved leg the result is the leg's start.
        """
        number, left = self.leg_of(place), overlap_m
        part = place.fraction
        while True:
            leg, length_m = self.legs[number], float(self.lengths_m[number])
            room = part * length_m
            if leg.straight and room >= left and length_m > 0.0:
                return Place(leg.item, max(part - left / length_m, 0.0))
            if number == 0 or not self.legs[number - 1].works:
                return Place(leg.item)
            left = max(left - room, 0.0)
            if left == 0.0:
                return Place(leg.item)
            number, part = number - 1, 1.0

    def along(self, items: ArrayLike, east_m: ArrayLike, north_m: ArrayLike) -> NDArray[np.float64]:
        """Return the distance from the start of the course to each position, float64[n].

        Each position (m in the local frame) is projected onto the leg to its item.
        """
        numbers, part, _ = self._projected(items, east_m, north_m)
        return self.ends_m[numbers] - (1.0 - part) * self.lengths_m[numbers]

    def aside_m(self, items: ArrayLike, east_m: ArrayLike, north_m: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each position from the leg of its item, float64[n]; 0 after the last leg."""
        return self._projected(items, east_m, north_m)[2]

    def _projected(
        self, items: ArrayLike, east_m: ArrayLike, north_m: ArrayLike
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return for each position the leg index, the flown fraction, and the distance from the leg."""
        numbers = np.searchsorted(self._flown_items, np.asarray(items))
        ended = numbers >= len(self.legs)
        numbers = np.minimum(numbers, len(self.legs) - 1)
        begin, end = self._ends
        step = (end - begin)[numbers]
        from_begin = np.column_stack((np.asarray(east_m), np.asarray(north_m))) - begin[numbers]
        part = (from_begin * step).sum(axis=1) / np.maximum(self.lengths_m[numbers], 1e-9) ** 2
        part = np.where(ended, 1.0, np.clip(part, 0.0, 1.0))
        aside = np.where(ended, 0.0, np.hypot(*(from_begin - part[:, None] * step).T))
        return numbers, part, aside


def unrolled(mission: Mission) -> Mission:
    """Return a mission with each DO_JUMP replaced by the items that the jump repeats.

    Raises
    ------
    MissionError
        If a jump is endless, its target does not exist, or the result has more than `MAX_ITEMS` items.
    """
    items = mission.items
    if not any(item.command == Command.DO_JUMP for item in items):
        return mission
    taken: dict[int, int] = {}
    written: list[MissionItem] = []
    k = steps = 0
    while k < len(items):
        item, steps = items[k], steps + 1
        if steps > 2 * MAX_ITEMS or len(written) > MAX_ITEMS:
            msg = f"the mission with its DO_JUMP items written out has more than {MAX_ITEMS} items"
            raise MissionError(msg)
        if item.command != Command.DO_JUMP:
            written.append(item)
            k += 1
            continue
        target, repeat = item.param1, item.param2 or 0.0
        if repeat < 0.0:
            raise MissionError(f"item {k + 1}: the DO_JUMP repeats without end; give a number of repetitions")
        if target is None or not 0 <= target < len(items):
            where = "unset" if target is None else int(target) + 1
            msg = f"item {k + 1}: the target of the DO_JUMP is {where}; give an item from 1 to {len(items)}"
            raise MissionError(msg)
        if taken.get(k, 0) < repeat:
            taken[k] = taken.get(k, 0) + 1
            k = int(target)
        else:
            k += 1
    return replace(mission, items=tuple(written))


# A vehicle farther from its leg than this is on the approach, or flies another mission.
_ON_LEG_M = 50.0


class MissionProgress:
    """Progress of a vehicle along the course of its mission.

    A position counts only if the next HEARTBEAT still shows the mission mode; so positions of the return home
    are discarded. The caller passes only messages of the vehicle's autopilot to `receive`.

    Parameters
    ----------
    course : Course
        Course of the mission on the vehicle.
    """

    def __init__(self, course: Course) -> None:
        self.course = course
        self.monitor = VehicleMonitor()
        self._pending: list[tuple[int, float, float]] = []
        self._flown: list[tuple[int, float, float]] = []
        self._reached = -1

    def receive(self, message: Message, now_s: float) -> None:
        """Process a message of the vehicle."""
        self.monitor.receive(message, now_s)
        if isinstance(message, m.MAVLink_heartbeat_message):
            if self._flies:
                self._flown += self._pending
            self._pending.clear()
        elif isinstance(message, m.MAVLink_mission_item_reached_message) and self._flies:
            self._reached = message.seq - (1 if self.monitor.profile.home_at_zero else 0)
        elif isinstance(message, m.MAVLink_global_position_int_message) and self._flies:
            state = self.monitor.state
            if state.item is not None and self.monitor.knows_position:
                self._pending.append((state.item, state.latitude_deg, state.longitude_deg))

    @property
    def _flies(self) -> bool:
        return self.monitor.in_mission and self.monitor.state.armed and not self.monitor.left_mission

    def place(self) -> Place | None:
        """Return the farthest place flown, or None if the mission was flown to its end.

        Raises MissionError if the vehicle never flew its mission.
        """
        if not self._flown:
            raise MissionError("no message shows the vehicle armed in its mission mode, at a known position")
        course = self.course
        items, latitude, longitude = np.array(self._flown).T
        if items.max() >= len(course.mission.items):
            raise MissionError(
                f"the vehicle flies item {int(items.max()) + 1}, but the mission has"
                f" {len(course.mission.items)} items: the vehicle flies another mission"
            )
        if self._reached >= course.legs[-1].item:
            return None
        east, north = course.frame.from_wgs84(latitude, longitude)
        on_leg = course.aside_m(items, east, north) <= _ON_LEG_M
        if not on_leg.any():
            msg = f"the vehicle was never within {_ON_LEG_M:g} m of its leg: it flew another mission"
            raise MissionError(msg)
        return course.place(float(course.along(items, east, north)[on_leg].max()))
