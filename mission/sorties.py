"""Sorties: parts of a mission, each with its own take-off, approach, return and landing."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TypeAlias

from geo.frame import LocalFrame
from mission.course import Course, Place, takes_image, turns_camera
from mission.errors import MissionError
from mission.ground.items import shots_ordered, speed_before
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem

Way: TypeAlias = Callable[[tuple[float, float], tuple[float, float]], Sequence[tuple[float, float]]]
"""Function from two positions (latitude, longitude) to the corners of a path round obstacles."""

_VIDEO_START, _SPRAYER, _PARACHUTE = 2500, 216, 208
# Settings, and the commands that change them. The last command before a part is in force there.
_SETTINGS: dict[int, str] = {
    command: name
    for name, commands in {
        "servo": (183,),
        "relay": (181,),
        "sprayer": (_SPRAYER,),
        "fence": (207,),
        "parachute": (_PARACHUTE,),
        "auxiliary function": (218,),
        "region of interest": (195, 197, 201),
        "mount mode": (204,),
        "mount": (205,),
        "gimbal": (1000,),
        "camera mode": (530,),
        "zoom": (531,),
        "focus": (532,),
        "yaw": (115,),
        "images": (206, 214, 2000, 2001),
        "video": (_VIDEO_START, 2501),
    }.items()
    for command in commands
}
# Each servo, relay and auxiliary function, numbered by param1, is a separate setting.
_BY_NUMBER = frozenset({183, 181, 218})
# These settings are repeated only at the first position of the part, so that they do not act on the approach.
_AT_THE_PLACE = frozenset({"images", "video", "sprayer", "yaw"})
# Commands that start images, video or the sprayer, and the commands that stop them.
_STOPS = {206: 206, 214: 214, 2000: 2001, _VIDEO_START: 2501, _SPRAYER: _SPRAYER}
_WAYPOINT = int(Command.NAV_WAYPOINT)


def part_of(
    course: Course,
    begin: Place,
    end: Place | None = None,
    *,
    overlap_m: float = 0.0,
    hold_s: float = 0.0,
    home: GeoPoint | None = None,
    way: Way | None = None,
    speed_m_s: float = 5.0,
) -> Mission:
    """Return a mission that takes off, flies the part of `course` between two places, and lands.

    The mission repeats settings in force at `begin`: speeds, region of interest, gimbal, zoom, fence switch
    after the take-off; camera, sprayer and heading at the first position of the part. Camera and sprayer are
    stopped at `end`. Fence, rally points, altitude frames, take-off and landing are copied from the whole
    mission. Leading legs without images are left out.

    Parameters
    ----------
    course : Course
        Course of the whole mission.
    begin : Place
    end : Place, optional
        Last place of the part; by default the end of the mission.
    overlap_m : float
        Length before `begin` that is flown again; legs without images are not flown again.
    hold_s : float
        Hold at the first position of the part, before the camera starts. Without a hold a vehicle overshoots
        when it turns onto a row. A fixed wing would circle during the hold.
    home : GeoPoint, optional
        New home; take-off and landing are moved with it.
    way : callable, optional
        Route round obstacles for the approach and the return, see `Way`.
    speed_m_s : float
        Speed where no item sets one, to count the images that a series of N images has left.

    Raises
    ------
    MissionError
        If there is nothing to fly between the places.

    Examples
    --------
    >>> takeoff = MissionItem(22, 3, x=28.05, y=-82.15, z=10.0)
    >>> rows = [MissionItem.waypoint(28.05, -82.15 + 0.001 * k, 10.0) for k in range(1, 4)]
    >>> on, off = (MissionItem(206, param1=metres) for metres in (2.0, 0.0))
    >>> whole = Mission((takeoff, rows[0], on, *rows[1:], off, MissionItem(20)), GeoPoint(28.05, -82.15))
    >>> part = part_of(Course(whole), Place(3, 0.5), Place(4, 0.5))
    >>> [item.command for item in part.items]
    [22, 16, 206, 16, 16, 206, 20]
    >>> round(part.items[1].y, 5), round(part.items[4].y, 5)
    (-82.1485, -82.1475)
    """
    whole, items = course.mission, course.mission.items
    first = resumed_at(course, begin, overlap_m)
    if first is None or (end is not None and end <= first):
        msg = f"nothing is left to fly from {begin}" + (f" to {end}" if end is not None else "")
        raise MissionError(msg)
    here = home if home is not None else whole.home
    head = [_moved(item, whole.home, home) for item in items[: course.begin]]
    rest = course.begin
    if begin > course.start and first > course.start:
        head += _approach(course, first, hold_s, here, way, speed_m_s)
        rest = first.item
    body = list(items[rest : course.end])
    tail = [_moved(item, whole.home, home) for item in items[course.end :]]
    if (end := _reachable(course, first, end)) is not None:
        cut = course.legs[course.leg_of(end)]
        if end.fraction > 0.0:
            body = [*body[: cut.item - rest], _waypoint(items[cut.item], course.position(end))]
        else:
            before = course.legs[course.leg_of(end) - 1].item
            begun = items[before + 1 : cut.item]
            # Conditions, and what is switched on between two legs, affect only the second leg.
            conditions = (Command.CONDITION_DELAY, Command.CONDITION_DISTANCE, Command.CONDITION_YAW)
            stays = (item for item in begun if not (_is_on(item) or item.command in conditions))
            body = [*body[: before + 1 - rest], *stays]
        body += [MissionItem(_STOPS[on.command]) for on in _settings([*head, *body]).values() if _is_on(on)]
        if way is not None and here is not None:
            body += _detour(
                way, course.position(end)[:2], (here.latitude_deg, here.longitude_deg), items[cut.item]
            )
        tail = tail or [MissionItem(Command.NAV_RETURN_TO_LAUNCH)]
    return replace(whole, items=(*head, *body, *tail), home=here)


def resumed_at(course: Course, begin: Place, overlap_m: float) -> Place | None:
    """Return the first place to fly in order to resume at `begin`, or None if no leg with images remains.

    This place is `overlap_m` before `begin`, or the start of the next leg with images if the leg of `begin`
    has no images.
    """
    following = course.after(begin)
    return course.back(begin, overlap_m) if following == begin else following


def image_spacing_m(mission: Mission, speed_m_s: float) -> float | None:
    """Return the approximate image spacing of a mission (m), or None without a camera trigger.

    >>> image_spacing_m(Mission((MissionItem(206, param1=3.0),)), 5.0)
    3.0
    """
    for item in mission.items:
        shots = shots_ordered(item)
        if shots is not None and turns_camera(item):
            return shots.distance_m or 1e-3 * shots.interval_ms * speed_m_s
    return None


def _approach(
    course: Course, first: Place, hold_s: float, home: GeoPoint | None, way: Way | None, speed_m_s: float
) -> list[MissionItem]:
    """Return items for the flight from take-off to `first`, with the settings in force at `first`."""
    items = course.mission.items
    leg = course.leg_of(first)
    since = course.legs[leg - 1].item if leg else course.begin - 1
    held = _settings(items[course.begin : first.item])
    if held.get("yaw") not in (None, *items[since + 1 : first.item]):
        del held["yaw"]
    order = held.get("images")
    if order is not None and (shots := shots_ordered(order)) is not None and shots.images < math.inf:
        begun = Place(max(k for k in range(first.item) if items[k] is order))
        metres = course.metres(first) - course.metres(begun)
        flown_ms = 1000.0 * metres / (speed_before(items, first.item) or speed_m_s)
        left = shots.images - math.ceil(flown_ms / shots.interval_ms)
        held["images"] = replace(order, param3=max(left, 1.0))  # One image is not repeated
    template, place = items[first.item], course.position(first)
    if first.fraction == 0.0 and leg and items[since].command == _WAYPOINT:
        template = items[since]
        place = (*place[:2], template.z)
    resume = _waypoint(template, place)
    made = [item for name, item in held.items() if name not in _AT_THE_PLACE]
    if way is not None and home is not None:
        made += _detour(way, (home.latitude_deg, home.longitude_deg), place[:2], resume)
    made.append(replace(resume, param1=hold_s))
    made += [item for name, item in held.items() if name == "yaw" or (name in _AT_THE_PLACE and _is_on(item))]
    return made


def _settings(items: Iterable[MissionItem]) -> dict[str, MissionItem]:
    """Return the item of each setting in force after `items`, by setting name, in the order of `items`."""
    held: dict[str, MissionItem] = {}
    for item in items:
        name = _SETTINGS.get(item.command)
        if item.command == Command.DO_CHANGE_SPEED:
            name = f"speed {max(int(item.param1 or 0.0), 1)}"
        released = item.command == _PARACHUTE and item.param1 == 2.0
        if name is None or takes_image(item) or released:
            continue
        if item.command in _BY_NUMBER:
            name += f" {item.param1}"
        held.pop(name, None)
        held[name] = item
    return held


def _is_on(item: MissionItem) -> bool:
    """Return whether an item starts images, video or the sprayer."""
    starts = item.command == _VIDEO_START or (item.command == _SPRAYER and bool(item.param1))
    return starts or turns_camera(item) is True


def _reachable(course: Course, first: Place, end: Place | None) -> Place | None:
    """Return a place near `end` at which a part can end, or None if the part ends with the mission."""
    # A curved leg cannot be cut and is flown whole. Trailing legs without images are left out.
    if end is None or (number := course.leg_of(end)) >= len(course.legs):
        return None
    if end.fraction > 0.0 and not course.legs[number].works:
        end = Place(course.legs[number].item)
    elif end.fraction > 0.0 and not course.legs[number].straight:
        number += 1
        if number == len(course.legs):
            return None
        end = Place(course.legs[number].item)
    while end.fraction == 0.0 and not course.legs[number - 1].works:
        number -= 1
        if (before := Place(course.legs[number].item)) <= first:
            break
        end = before
    return end


def _waypoint(like: MissionItem, place: tuple[float, float, float]) -> MissionItem:
    """Return a waypoint at `place` without hold; radius, heading and frame are taken from `like`."""
    radius_m, yaw = (like.param2, like.param4) if like.command == _WAYPOINT else (0.0, None)
    frame = like.frame if like.has_position else Frame.GLOBAL_RELATIVE_ALT
    latitude, longitude, altitude = place
    return MissionItem(_WAYPOINT, frame, 0.0, radius_m, 0.0, yaw, latitude, longitude, altitude)


def _detour(
    way: Way, begin: tuple[float, float], end: tuple[float, float], like: MissionItem
) -> list[MissionItem]:
    """Return the waypoints of a path round obstacles, at the altitude of `like`."""
    return [_waypoint(like, (latitude, longitude, like.z)) for latitude, longitude in way(begin, end)]


def _moved(item: MissionItem, old: GeoPoint | None, new: GeoPoint | None) -> MissionItem:
    """Return a take-off or landing item, moved by the offset from the old home to the new home."""
    if old is None or new is None or not item.has_position or not (item.x or item.y):
        return item
    about_old, about_new = (LocalFrame(at.latitude_deg, at.longitude_deg) for at in (old, new))
    latitude, longitude = about_new.to_wgs84(*about_old.from_wgs84(item.x, item.y))
    return replace(item, x=float(latitude), y=float(longitude))
