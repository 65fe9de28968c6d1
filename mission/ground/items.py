"""Functions on mission items for monitoring and changing a mission in flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mission.model import Command, Mission, MissionItem

_RETURNS = frozenset({int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_LAND)})
_CAMERA = frozenset({int(Command.DO_SET_CAM_TRIGG_DIST), int(Command.DO_SET_CAM_TRIGG_INTERVAL)})
_SPEED = frozenset({int(Command.DO_CHANGE_SPEED)})
# These DO items may stand between two positions.
_DO = frozenset({178, 195, 197, 201, 203, 205, 206, 214, 530, 2000, 2001})
FLOWN_TO = frozenset({16, 17, 18, 19, 31, 82})
"""MAV_CMDs of items with a position on the path."""
_SAME_M = 2.0
_EARTH_M = 6_371_008.8
_SAME_SHOTS = 1e-5  # parameters are 32-bit floats on the link


def is_return(item: MissionItem) -> bool:
    """Whether an item is a return or a landing."""
    return item.command in _RETURNS


def leads_home(items: Sequence[MissionItem], begin: int = 0) -> bool:
    """Whether the items from index ``begin`` on include a return or a landing."""
    return any(map(is_return, items[begin:]))


def leads_on(items: Sequence[MissionItem], begin: int) -> bool:
    """Whether the items from index ``begin`` on include a position on the path."""
    return any(item.command in FLOWN_TO for item in items[begin:])


def next_flown_to(items: Sequence[MissionItem], index: int) -> int:
    """Return the index of the next item that is a position, a return or a landing; else ``index``."""
    following = index + 1
    while following < len(items) and items[following].command in _DO:
        following += 1
    known = following < len(items) and items[following].command in FLOWN_TO | _RETURNS
    return following if known else index


def same_position(a: MissionItem, b: MissionItem) -> bool:
    """Whether two items have the same position, within 2 m."""
    return a.has_position and b.has_position and apart_m((a.x, a.y), (b.x, b.y)) < _SAME_M


def apart_m(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return the distance (m) between two positions (latitude, longitude) that are near each other."""
    north, east = b[0] - a[0], math.remainder(b[1] - a[1], 360.0) * math.cos(math.radians(a[0]))
    return _EARTH_M * math.radians(math.hypot(north, east))


def speed_before(items: Sequence[MissionItem], index: int) -> float | None:
    """Return the speed that earlier items set for an item (m/s), or None for the vehicle's default."""
    for item in reversed(items[:index]):
        if item.command == Command.DO_CHANGE_SPEED and (item.param1 or 0.0) <= 1.0:
            speed = item.param2
            return speed if speed is not None and speed > 0.0 else None
    return None


@dataclass(frozen=True, slots=True)
class Shots:
    """Setting of the camera trigger: distance or time between images. It is off if both values are 0."""

    distance_m: float = 0.0
    interval_ms: float = 0.0
    images: float = math.inf  # Number of images, after which a series ends by itself

    @property
    def is_off(self) -> bool:
        """Whether the trigger is off."""
        return self.distance_m <= 0.0 and self.interval_ms <= 0.0

    def is_same(self, other: Shots) -> bool:
        """Whether another setting is equal, within the precision of 32-bit floats."""
        return math.isclose(self.distance_m, other.distance_m, rel_tol=_SAME_SHOTS) and math.isclose(
            self.interval_ms, other.interval_ms, rel_tol=_SAME_SHOTS
        )


def shots_ordered(item: MissionItem) -> Shots | None:
    """Return the setting of the camera trigger that an item makes, or None if it makes none.

    A single image (IMAGE_START_CAPTURE once or at no interval, DO_DIGICAM_CONTROL) has interval infinity.
    """
    value = max(item.param1 or 0.0, 0.0)
    match item.command:
        case Command.DO_SET_CAM_TRIGG_DIST:
            return Shots(distance_m=value)
        case Command.DO_SET_CAM_TRIGG_INTERVAL:
            return Shots(interval_ms=value)
        case Command.IMAGE_START_CAPTURE:
            images = max(item.param3 or 0.0, 0.0) or math.inf
            interval_s = math.inf if images == 1.0 else item.param2 or math.inf
            return Shots(interval_ms=1000.0 * interval_s, images=images)
        case Command.IMAGE_STOP_CAPTURE:
            return Shots()
        case 203 if item.x == 1.0:  # DO_DIGICAM_CONTROL with the shutter
            return Shots(interval_ms=math.inf)
    return None


def shots_before(items: Sequence[MissionItem], index: int) -> Shots | None:
    """Return the series of images ordered last before item ``index``, or None if no item starts or ends one.

    >>> orders = [MissionItem(Command.DO_SET_CAM_TRIGG_DIST, param1=metres) for metres in (5.0, 0.0)]
    >>> leg = MissionItem(Command.NAV_WAYPOINT, x=27.0, y=-82.0, z=10.0)
    >>> items = (leg, orders[0], leg, orders[1], leg)
    >>> [None if (shots := shots_before(items, k)) is None else shots.distance_m for k in range(5)]
    [None, None, 5.0, 5.0, 0.0]
    """
    orders = map(shots_ordered, reversed(items[: max(index, 0)]))
    return next((shots for shots in orders if shots is not None and shots.interval_ms < math.inf), None)


def item_to_mark(old: Mission, item: int, new: Mission, resume_at: int) -> int:
    """Return the item at which to resume: ``resume_at``, or the first needed DO item directly before it.

    DO items that would repeat the present setting are not needed; a repeated trigger distance could even
    trigger an extra image.
    """
    first = resume_at
    while first > 0 and new.items[first - 1].command in _DO:
        first -= 1
    speed, shots = speed_before(old.items, item), shots_before(old.items, item) or Shots()
    for k in range(first, resume_at):
        command = new.items[k].command
        if command == Command.DO_CHANGE_SPEED:
            if speed_before(new.items, k + 1) != speed:
                return k
        elif command not in _CAMERA or (shots_before(new.items, k + 1) or Shots()) != shots:
            return k
    return resume_at


def revised_mission(
    held: Mission,
    item: int,
    path_deg: Sequence[tuple[float, float]],
    *,
    altitude_m: float,
    acceptance_radius_m: float,
) -> tuple[Mission, int]:
    """Return a mission through new waypoints, and the item at which to resume.

    The new mission keeps the take-off, speed, camera trigger and end of the mission ``held``. If the camera
    already takes images, the new trigger item takes no extra image; otherwise the images begin at the change.
    ``item`` is the current item of ``held``. ``path_deg`` has latitude and longitude of the new waypoints;
    with an empty path, the vehicle flies home immediately.

    >>> items = (MissionItem.waypoint(28.05, -82.15, 10.0), MissionItem(Command.NAV_RETURN_TO_LAUNCH))
    >>> new, resume_at = revised_mission(
    ...     Mission(items), 0, [(28.06, -82.15)], altitude_m=10.0, acceptance_radius_m=1.0
    ... )
    >>> [entry.command for entry in new.items], resume_at
    ([16, 20], 0)
    """
    items = held.items
    ends = (k for k, entry in enumerate(items) if is_return(entry) or entry.command == Command.DO_LAND_START)
    end = next(ends, len(items))
    flown = min(item, end)

    def orders(commands: frozenset[int], until: int) -> list[MissionItem]:
        return [entry for entry in items[:until] if entry.command in commands]

    begin = orders(frozenset({int(Command.NAV_TAKEOFF)}), end)[:1]
    begin += orders(_SPEED, flown)[-1:] or orders(_SPEED, end)[:1]
    starts = [order for order in orders(_CAMERA, end) if (order.param1 or 0.0) > 0.0]
    takes = [order for order in orders(_CAMERA, flown)[-1:] if (order.param1 or 0.0) > 0.0]
    stop = [MissionItem(starts[0].command)] if starts else []
    waypoints = [
        MissionItem.waypoint(latitude, longitude, altitude_m, acceptance_radius_m=acceptance_radius_m)
        for latitude, longitude in path_deg
    ]
    if not waypoints:
        return replace(held, items=(*begin, *stop, *items[end:])), len(begin) + len(stop)
    begin += [replace(order, param3=0.0) for order in takes] or starts[:1]
    return replace(held, items=(*begin, *waypoints, *stop, *items[end:])), len(begin)
