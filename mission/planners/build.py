"""Building a mission from a planned path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mission.errors import PlanningError
from mission.model import MAX_ITEMS, Command, Frame, GeoPoint, Mission, MissionItem
from mission.planners.cornering import Cornering
from mission.planners.path import Area, PlannedPath, Points, keep_within

if TYPE_CHECKING:
    from geo.frame import LocalFrame

TOLERANCE_M = 1.0
"""Greatest difference between the wanted and the actual height above ground (m)."""
_AT_SAMPLES = 0.7  # Fraction of the tolerance used at samples; the rest is for the ground between samples.
_MOST_SAMPLES = 2_000_000  # Greatest number of samples; it limits memory and time.


@dataclass(frozen=True, slots=True, eq=False)
class HeightProfile:
    """Terrain following: finds waypoints of a path at a wanted height above the ground.

    Parameters
    ----------
    ground : callable
        Maps positions, float64[n, 2] in metres of the farm frame, to ground elevations in metres.
    height_m : float
        Wanted height above the ground.
    step_m : float
        Greatest distance between samples of the ground.
    climb, descent : float
        Steepest slopes of the vehicle, metres up or down per metre over ground, above zero. Over steeper
        ground the vehicle starts its climb earlier, so it flies higher than wanted, never lower.
    home_m : tuple of float
        Home position. Altitudes are relative to the ground at home.
    """

    ground: Callable[[Points], NDArray[np.float64]]
    height_m: float
    step_m: float
    climb: float
    descent: float
    home_m: tuple[float, float]

    def follow(self, path_m: Points) -> tuple[Points, NDArray[np.float64], NDArray[np.int64]]:
        """Return the waypoints of a path: positions, altitudes above home, and owners.

        A waypoint's owner is the path point at the end of its leg, given as an index. The waypoints include
        all points of the path. Altitudes are linear between waypoints.
        """
        places, leg, at = _sampled(path_m, self.step_m)
        home = float(self.ground(np.array([self.home_m]))[0])
        wanted = self.ground(places) + self.height_m - home
        smooth = _slopes_limited(wanted, at, self.climb, self.descent)
        # The last sample of each leg is a point of the path.
        fixed = np.append(np.flatnonzero(np.diff(leg)), len(leg) - 1)
        kept = np.zeros(len(places), dtype=bool)
        kept[0] = True
        kept[fixed] = True
        keep_within(at, smooth[None], _AT_SAMPLES * TOLERANCE_M, kept)
        return places[kept], smooth[kept], leg[kept]


def _sampled(path_m: Points, step_m: float) -> tuple[Points, NDArray[np.int64], NDArray[np.float64]]:
    """Return samples along a path: position, index of the next path point, and distance from the start."""
    lengths = np.hypot(*np.diff(path_m, axis=0).T)
    counts = np.maximum(np.ceil(lengths / step_m), 1).astype(np.int64)
    if counts.sum() > _MOST_SAMPLES:
        raise PlanningError(
            f"terrain: the path of {lengths.sum() / 1000.0:.0f} km is too long for samples of the ground"
            f" every {step_m:.2g} m; take a coarser raster"
        )
    leg = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(leg)) - np.repeat(np.cumsum(counts) - counts, counts) + 1) / counts[leg]
    places = path_m[leg] + share[:, None] * (path_m[leg + 1] - path_m[leg])
    before = np.concatenate(([0.0], np.cumsum(lengths)))
    at = before[leg] + share * lengths[leg]
    return (
        np.vstack((path_m[:1], places)),
        np.concatenate(([0], leg + 1)),
        np.concatenate(([0.0], at)),
    )


def _slopes_limited(
    wanted: NDArray[np.float64], at: NDArray[np.float64], climb: float, descent: float
) -> NDArray[np.float64]:
    """Return the lowest altitudes that are nowhere below `wanted`, and whose slopes keep the two limits."""
    if not (climb > 0.0 and descent > 0.0):
        raise PlanningError(f"terrain: slopes of {climb:g} up and {descent:g} down must be above zero")
    # A climb must start before the ground rises, and a descent may only end after the ground has fallen.
    rise = np.maximum.accumulate((wanted - climb * at)[::-1])[::-1] + climb * at
    fall = np.maximum.accumulate(wanted + descent * at) - descent * at
    return np.maximum(rise, fall)


def slope(rate_m_s: float, speed_m_s: float) -> float:
    """Return the slope (m per m) of a climb or descent from its rate and the ground speed.

    >>> slope(2.0, 8.0)
    0.25
    """
    return rate_m_s / speed_m_s if math.isfinite(rate_m_s) and speed_m_s > 0.0 else math.inf


_AIRSPEED, _GROUND_SPEED = 0.0, 1.0
_THROTTLE_UNCHANGED = -1.0


@dataclass(frozen=True, slots=True)
class WingPattern:
    """Take-off and landing of a fixed wing.

    Parameters
    ----------
    heading_rad : float
        Compass heading of take-off and landing, preferably into the wind.
    climb_out_m : float
        Distance from home to the position of the take-off item.
    approach_m, approach_altitude_m : float
        Length of the final approach, and height above home at its start.
    radius_m : float
        Radius of the loiter circle for the descent to `approach_altitude_m`.
    placed_start : bool
        Whether ``DO_LAND_START`` has a position. ArduPilot needs a position, PX4 accepts none.
    """

    heading_rad: float
    climb_out_m: float
    approach_m: float
    approach_altitude_m: float
    radius_m: float
    placed_start: bool = False


def build_mission(
    path: PlannedPath,
    *,
    frame: LocalFrame,
    home_xy_m: tuple[float, float],
    altitude_m: float,
    speed_m_s: float,
    camera_distance_m: float | None = None,
    camera_interval_s: float | None = None,
    cornering: Cornering | None = None,
    avoid: Area | None = None,
    camera_on_approach: bool = False,
    return_home: bool = True,
    pattern: WingPattern | None = None,
    heights: HeightProfile | None = None,
) -> Mission:
    """Return the mission of a path.

    The mission has these items, in this order:

    1. ``NAV_TAKEOFF`` to `altitude_m` above home;
    2. ``DO_CHANGE_SPEED`` to `speed_m_s` as ground speed;
    3. ``NAV_WAYPOINT`` at the first point of the path;
    4. camera start: ``DO_SET_CAM_TRIGG_DIST`` (param1 metres, param3 1: take an image immediately) or
       ``DO_SET_CAM_TRIGG_INTERVAL`` (param1 milliseconds); omitted if neither distance nor interval is
       given;
    5. ``NAV_WAYPOINT`` at each further point;
    6. camera stop: the camera command again with param1 0;
    7. ``NAV_RETURN_TO_LAUNCH``, which also lands. Without `return_home` this item is omitted, and the vehicle
       holds at the last waypoint.

    With a `pattern` (for a fixed wing), the take-off item has a position ahead of home, and the speed is an
    airspeed. A landing replaces the return: ``DO_LAND_START``, ``NAV_LOITER_TO_ALT`` on a circle tangent to
    the final approach, and ``NAV_LAND`` at home.

    A point within 1 cm of the previous point is a loiter. With a camera interval, each loiter adds an
    interval to the hold (param1), for another image; with a camera distance, loiters are dropped. Legs are
    extended for autopilots that turn early (`mission.planners.cornering.Cornering`). No item sets a yaw.

    Parameters
    ----------
    path : PlannedPath
        The path in metres of the farm frame.
    frame : geo.frame.LocalFrame
        The farm frame.
    home_xy_m : tuple of float
        Take-off position, in metres of the farm frame.
    altitude_m : float
        Flight altitude above home.
    speed_m_s : float
        Ground speed; airspeed with a `pattern`.
    camera_distance_m, camera_interval_s : float, optional
        Distance or time between two images. Give at most one of them.
    cornering : Cornering, optional
        How the autopilot turns at corners. None: each point of the path is a waypoint, with the autopilot's
        default acceptance radius.
    avoid : Polygon or MultiPolygon, optional
        Land that must not be flown over, in metres of the farm frame.
    camera_on_approach : bool
        Start the camera before the first point of the path: item 4 precedes item 3.
    return_home : bool
        End with a return to launch.
    pattern : WingPattern, optional
        Take-off and landing of a fixed wing. None: a vehicle that hovers.
    heights : HeightProfile, optional
        Terrain following: waypoints are added so that all legs keep a height above the ground, also the leg
        from home and, except for a fixed wing, the leg back. None: all waypoints are at `altitude_m`.

    Returns
    -------
    Mission
        A mission with home at `home_xy_m` on the ground.

    Raises
    ------
    PlanningError
        If a number is out of range, both camera arguments are given, or there are more than 65535 items.
    """
    _check_positive("altitude", altitude_m, "m")
    _check_positive("speed", speed_m_s, "m/s")
    camera = _camera_command(camera_distance_m, camera_interval_s)
    route = (cornering or Cornering()).waypoints(path.points_m, home_xy_m, avoid=avoid)
    points, altitudes_m = route.points_m, np.full(len(route.points_m), altitude_m)
    holds_s = route.loiters * (camera_interval_s or 0.0)
    before = after = 0  # Number of waypoints added to the leg from home to the path, and to the leg back
    if heights is not None:
        homewards = return_home and pattern is None
        points, altitudes_m, holds_s, before, after = _followed(
            heights, points, holds_s, home_xy_m, homewards=homewards
        )
    ending = 3 if pattern is not None else 1
    # The camera must start before the hold at the first point, so that point needs two waypoints.
    twice = bool(holds_s[before : before + 1].any()) and not camera_on_approach
    count = len(points) + twice + 2 + (2 if camera else 0) + (ending if return_home else 0)
    if count > MAX_ITEMS:
        raise PlanningError(
            f"planner {path.planner}: the path's {len(points)} points make a mission of {count} items; "
            f"a vehicle stores at most {MAX_ITEMS}: use a smaller budget or a wider footprint"
        )

    home_latitude, home_longitude = (float(value) for value in frame.to_wgs84(*home_xy_m))
    latitudes, longitudes = frame.to_wgs84(points[:, 0], points[:, 1])
    waypoints = [
        MissionItem.waypoint(latitude, longitude, z, acceptance_radius_m=route.radius_m, hold_s=hold_s)
        for latitude, longitude, z, hold_s in zip(
            latitudes.tolist(), longitudes.tolist(), altitudes_m.tolist(), holds_s.tolist(), strict=True
        )
    ]
    relative = Frame.GLOBAL_RELATIVE_ALT
    takeoff = MissionItem(
        Command.NAV_TAKEOFF, relative, param4=None, x=home_latitude, y=home_longitude, z=altitude_m
    )
    kind = _GROUND_SPEED if pattern is None else _AIRSPEED
    speed = MissionItem(Command.DO_CHANGE_SPEED, param1=kind, param2=speed_m_s, param3=_THROTTLE_UNCHANGED)
    start, stop = camera if camera else ((), ())
    end: tuple[MissionItem, ...] = (MissionItem(Command.NAV_RETURN_TO_LAUNCH),)
    if pattern is not None:
        takeoff, end = _pattern_items(pattern, frame, home_xy_m, altitude_m)
    if not return_home:
        end = ()
    approach, back = waypoints[:before], waypoints[len(waypoints) - after :]
    waypoints = waypoints[before : len(waypoints) - after]
    first = (*start, *approach, waypoints[0]) if camera_on_approach else (*approach, waypoints[0], *start)
    if twice:
        assert camera_interval_s is not None
        # The vehicle already spends one interval on its way to the second waypoint at the same place.
        again = replace(waypoints[0], param1=float(holds_s[before]) - camera_interval_s)
        first = (*approach, replace(waypoints[0], param1=0.0), *start, again)
    return Mission(
        items=(takeoff, speed, *first, *waypoints[1:], *stop, *back, *end),
        home=GeoPoint(home_latitude, home_longitude, frame.altitude_m),
        cruise_speed_m_s=speed_m_s,
        hover_speed_m_s=speed_m_s,
    )


def _followed(
    heights: HeightProfile,
    points: Points,
    holds_s: NDArray[np.floating],
    home_xy_m: tuple[float, float],
    *,
    homewards: bool,
) -> tuple[Points, NDArray[np.float64], NDArray[np.float64], int, int]:
    """Return points, altitudes and holds over uneven ground, and how many come before and after the path."""
    way = np.vstack((home_xy_m, points, *([home_xy_m] if homewards else [])))
    places, altitudes, owner = heights.follow(way)
    # The take-off item replaces a waypoint at home.
    places, altitudes, owner = places[1:], altitudes[1:], owner[1:]
    # The last waypoint of each owner lies at the owner, a point of the path.
    is_point = np.append(np.diff(owner) > 0, True)
    holds = np.where(is_point, np.append(holds_s, 0.0)[np.minimum(owner - 1, len(holds_s))], 0.0)
    before = int(np.count_nonzero(owner == 1)) - 1
    after = int(np.count_nonzero(owner == len(points) + 1))
    return places, altitudes, holds, before, after


def _pattern_items(
    pattern: WingPattern, frame: LocalFrame, home_xy_m: tuple[float, float], altitude_m: float
) -> tuple[MissionItem, tuple[MissionItem, ...]]:
    """Return the take-off and the landing of a fixed wing."""
    # The farm frame's x-axis may be rotated from east.
    angle = 0.5 * math.pi - pattern.heading_rad - math.radians(frame.rotation_deg)
    ahead = (math.cos(angle), math.sin(angle))
    right = (ahead[1], -ahead[0])
    x, y = home_xy_m
    relative = Frame.GLOBAL_RELATIVE_ALT

    def item(command: Command, along_m: float, aside_m: float, z: float, *params: float) -> MissionItem:
        place = (x + along_m * ahead[0] + aside_m * right[0], y + along_m * ahead[1] + aside_m * right[1])
        latitude, longitude = (float(value) for value in frame.to_wgs84(*place))
        first, second, third, fourth = params
        return MissionItem(command, relative, first, second, third, fourth, latitude, longitude, z)

    takeoff = item(Command.NAV_TAKEOFF, pattern.climb_out_m, 0.0, altitude_m, 10.0, 0.0, 0.0, 0.0)
    down = pattern.approach_altitude_m
    turn = (1.0, pattern.radius_m, 0.0, 1.0)
    circle = item(Command.NAV_LOITER_TO_ALT, -pattern.approach_m, pattern.radius_m, down, *turn)
    land = item(Command.NAV_LAND, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    start = MissionItem(Command.DO_LAND_START)
    if pattern.placed_start:
        start = item(Command.DO_LAND_START, -pattern.approach_m, 0.0, down, 0.0, 0.0, 0.0, 0.0)
    return takeoff, (start, circle, land)


def _camera_command(
    distance_m: float | None, interval_s: float | None
) -> tuple[tuple[MissionItem], tuple[MissionItem]] | None:
    if distance_m is not None and interval_s is not None:
        msg = "the camera fires by distance or by interval: give one of camera_distance_m, camera_interval_s"
        raise PlanningError(msg)
    if distance_m is not None:
        _check_positive("camera distance", distance_m, "m")
        command = Command.DO_SET_CAM_TRIGG_DIST
        return (MissionItem(command, param1=distance_m, param3=1.0),), (MissionItem(command),)
    if interval_s is not None:
        _check_positive("camera interval", interval_s, "s")
        command = Command.DO_SET_CAM_TRIGG_INTERVAL
        return (MissionItem(command, param1=interval_s * 1000.0),), (MissionItem(command),)
    return None


def _check_positive(name: str, value: float, unit: str) -> None:
    if not (math.isfinite(value) and value > 0):
        raise PlanningError(f"mission: {name} {value} {unit} must be a finite number above zero")
