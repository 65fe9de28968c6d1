"""Checks of a plan's path: fence, obstacles, heights and legs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from mission.errors import MissionFileError
from mission.files.fence import geo_fence
from mission.model import Command, MissionType
from sim_vehicle.execution.items import Settings, do_items
from sim_vehicle.motion.legs import Position
from sim_vehicle.pilot.fence import Fence
from wbf_mission.preflight import rules
from wbf_mission.preflight.finding import Finding, Hit, Severity, worst_of
from wbf_mission.preflight.plan_rules import remarks_of
from wbf_mission.preflight.rules import ERROR, NOTE, WARNING, Rule, found, worst
from wbf_mission.preflight.subject import PLACED, FlownTrack, Subject
from wbf_mission.scenario.parts import MAX_ALTITUDE_M

CHECKS = rules.Checks[[Subject]]()

_FLOWN_TO = PLACED | {int(Command.NAV_LAND)}

_PASSED = frozenset({int(Command.NAV_WAYPOINT), int(Command.NAV_SPLINE_WAYPOINT)})


@dataclass(frozen=True, slots=True)
class Leg:
    """Leg of the mission that ends at an item; jumps are ignored."""

    item: int
    """Item at the end of the leg, from 0."""
    start_m: Position
    """East, north, up from home."""
    end_m: Position
    speed_m_s: float
    """Commanded speed."""
    radius_m: float
    """Acceptance radius of the leg's end."""
    passed: bool
    """Whether the vehicle passes the leg's end without stopping."""

    @property
    def length_m(self) -> float:
        """Length over ground (m)."""
        return math.hypot(self.end_m[0] - self.start_m[0], self.end_m[1] - self.start_m[1])

    @property
    def climb_m(self) -> float:
        """Height of the leg's end above its start (m)."""
        return self.end_m[2] - self.start_m[2]


def legs_of(subject: Subject) -> tuple[Leg, ...]:
    """Return the legs of a mission; the first begins at home, on the ground.

    After a return or an item without position, the next leg starts at the next position.
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
    """Return the acceptance radius at an item; some autopilots ignore the radius in the item."""
    one = subject.items[item]
    own = one.param2 if one.command == Command.NAV_WAYPOINT else None
    kept = "param2" not in subject.profile.lossy.get(one.command, frozenset())
    return own if own and kept else subject.vehicle.acceptance_radius_m


@CHECKS.finds(
    Rule("bad-fence", ERROR, "{error}", "draw the fence again"),
    Rule(
        "home-outside-fence",
        ERROR,
        "home is outside the fence: the vehicle would not arm",
        "move the fence or home",
        rules.INSIDE,
    ),
    Rule(
        "rally-outside-fence", WARNING, "a rally point is outside the fence", "move it inside", rules.INSIDE
    ),
    Rule(
        "outside-fence",
        ERROR,
        "the path to this item leaves the fence, or enters an area that the fence excludes",
        "move the waypoint or the fence",
        rules.INSIDE,
    ),
    Rule(
        "near-fence",
        WARNING,
        "the path to this item comes near the edge of the fence",
        "keep away from the edge, or give a smaller margin",
        rules.INSIDE,
    ),
)
def check_fence(subject: Subject) -> Iterator[Finding]:
    """Find a home, rally points and flown paths outside the fence, and paths near the fence's edge."""
    if not subject.mission.fence:
        return
    try:
        geo_fence(subject.mission.fence)
    except MissionFileError as error:
        told = any(
            remark.plan is MissionType.FENCE and remark.severity is Severity.ERROR
            for remark in remarks_of(subject)
        )
        if not told:
            yield found(subject, "bad-fence", plan="fence", error=error)
        return
    from sim_vehicle.autopilot import autopilot_of_number

    # The autopilot decides whether being inside one inclusion area is enough.
    rules = autopilot_of_number(subject.profile.autopilot).for_vehicle(subject.vehicle.kind).rules
    fence = Fence.of(subject.mission.fence, subject.frame, any_inclusion=rules.any_inclusion)
    home_m = fence.margin_m(0.0, 0.0)
    if home_m < 0.0:
        yield found(subject, "home-outside-fence", plan="fence", measured=(home_m, 0.0))
    for k, item in enumerate(subject.mission.rally):
        margin_m = fence.margin_m(*subject.frame.from_wgs84(item.x, item.y))
        if margin_m < 0.0:
            yield found(subject, "rally-outside-fence", item=k, plan="rally", measured=(margin_m, 0.0))
    near = [
        Hit(int(item), float(margin))
        for track in _paths(subject)
        for item, margin in zip(track.items, fence.margins_m(*track.points_m[:, :2].T), strict=True)
        if margin < subject.given.margin_m
    ]
    outside = [hit for hit in near if hit.value < 0.0]
    if outside:
        yield from worst(subject, "outside-fence", outside, 0.0)
    else:
        yield from worst(subject, "near-fence", near, subject.given.margin_m)


@CHECKS.finds(
    Rule(
        "obstacle",
        ERROR,
        "the path to this item crosses an obstacle of the farm",
        "fly round it",
        rules.at_least("distance from the obstacle", "m"),
    ),
    Rule(
        "near-obstacle",
        WARNING,
        "the path to this item comes near an obstacle of the farm",
        "fly round it",
        rules.at_least("distance from the obstacle", "m"),
    ),
)
def check_obstacles(subject: Subject) -> Iterator[Finding]:
    """Find flown paths too near to the farm's obstacles, beside or above them."""
    touched: list[Hit] = []
    too_near: dict[float, list[Hit]] = {}
    for obstacle in subject.obstacles:
        margin_m = obstacle.margin(subject.given.margin_m)
        top_m = math.inf if obstacle.height_m is None else obstacle.height_m
        shapely.prepare(obstacle.polygon)
        for track in _paths(subject):
            legs = shapely.linestrings(np.stack((track.points_m[:-1, :2], track.points_m[1:, :2]), axis=1))
            above = np.maximum(np.minimum(track.points_m[:-1, 2], track.points_m[1:, 2]) - top_m, 0.0)
            near = np.flatnonzero(shapely.dwithin(legs, obstacle.polygon, margin_m) & (above <= margin_m))
            # Distance to the obstacle: horizontal, vertical, or diagonal to the edge of the obstacle's top.
            away = np.hypot(shapely.distance(legs[near], obstacle.polygon), above[near])
            for k, metres in zip(near, away, strict=True):
                hits = touched if metres == 0.0 else too_near.setdefault(margin_m, [])
                hits.append(Hit(int(track.items[k + 1]), float(metres)))
    if touched:
        yield from worst(subject, "obstacle", touched, subject.given.margin_m)
        return
    for margin_m, hits in too_near.items():
        yield from worst(subject, "near-obstacle", hits, margin_m)


# Point spacing on a straight leg (m), and largest number of points; longer legs get a wider spacing
_STEP_M, _MOST_STEPS = 1.0, 1000


def _paths(subject: Subject) -> list[FlownTrack]:
    """Return the paths to check: the predicted flights or, without a prediction, straight legs."""
    if subject.tracks:
        return [track for track in subject.tracks if len(track.points_m) > 1]
    placed = [(k, position) for k, position in enumerate(subject.positions) if not np.isnan(position[0])]
    if not placed:
        return []
    points = np.array([(0.0, 0.0, 0.0), *(position for _, position in placed)])
    ends = np.array([k for k, _ in placed], dtype=np.int64)
    lengths = np.hypot(*np.diff(points[:, :2], axis=0).T)
    steps = np.clip(np.ceil(lengths / _STEP_M), 1, _MOST_STEPS).astype(np.int64)
    path = [np.linspace(points[k], points[k + 1], n, endpoint=False) for k, n in enumerate(steps)]
    return [FlownTrack(np.vstack((*path, points[-1:])), np.append(np.repeat(ends, steps), ends[-1]))]


_LOWEST_M = 2.0


@CHECKS.finds(
    Rule(
        "with-permission",
        NOTE,
        "the height is more than is allowed without a permission",
        "carry the permission; where the ground is lower than home, the height above ground is greater",
        rules.at_most("height above home", "m"),
    ),
    Rule(
        "too-high",
        WARNING,
        "the height is more than is allowed above the ground",
        "fly lower, or give --max-altitude if you have a permission; ground below home adds to the height",
        rules.at_most("height above home", "m"),
    ),
    Rule(
        "too-low",
        WARNING,
        "the height is too low for slopes, plants and the error of the barometer",
        "fly higher",
        rules.at_least("height above home", "m"),
    ),
)
def check_heights(subject: Subject) -> Iterator[Finding]:
    """Find positions above the allowed height or below 2 m, and flown paths above the allowed height."""
    if subject.vehicle.drives or subject.vehicle.is_ideal:
        return
    heights = [
        Hit(k, position[2])
        for k, (item, position) in enumerate(zip(subject.items, subject.positions, strict=True))
        if item.command in PLACED
    ]
    flown = [
        Hit(int(track.items[k]), float(track.points_m[k, 2]))
        for track in subject.tracks
        for k in [int(track.points_m[:, 2].argmax())]
    ]

    def above(height_m: float) -> list[Hit]:
        # A return may climb higher than the items, and the altitude controller overshoots by up to 0.5 m.
        high = [hit for hit in heights if hit.value > height_m]
        return high or [hit for hit in flown if hit.value > height_m + 1.0]

    allowed_m = subject.given.max_altitude_m
    if high := above(allowed_m):
        yield from worst(subject, "too-high", high, allowed_m)
    elif allowed_m > MAX_ALTITUDE_M:
        yield from worst(subject, "with-permission", above(MAX_ALTITUDE_M), MAX_ALTITUDE_M)
    low = [hit for hit in heights if 0.0 < hit.value < _LOWEST_M]
    yield from worst(subject, "too-low", low, _LOWEST_M)


_FAR_FROM_HOME = PLACED - {int(Command.NAV_TAKEOFF)}

_FARTHEST_START_M = 1000.0


@CHECKS.finds(
    Rule(
        "far-start",
        WARNING,
        "the whole mission is far from home; of its positions, this item is nearest to home",
        "check the position of home",
        rules.at_most("distance from home", "m"),
    )
)
def check_start_distance(subject: Subject) -> Iterator[Finding]:
    """Find a mission that is far from home everywhere; on a large farm, some positions may be far."""
    positions = zip(subject.items, subject.positions, strict=True)
    away = [
        Hit(k, math.hypot(x, y))
        for k, (item, (x, y, _)) in enumerate(positions)
        if item.command in _FAR_FROM_HOME
    ]
    nearest = worst_of(away, largest=False)
    if nearest is not None and nearest[0].value > _FARTHEST_START_M:
        hit = nearest[0]
        yield found(subject, "far-start", item=hit.item, measured=(hit.value, _FARTHEST_START_M))


_ZERO_M = 0.01

_LONGEST_M = 10_000.0


@CHECKS.finds(
    Rule("zero-leg", WARNING, "the item repeats the position before it", "remove one of the two items"),
    Rule(
        "long-leg",
        WARNING,
        "the leg to this item is very long",
        "check the position",
        rules.at_most("length of the leg", "m"),
    ),
)
def check_lengths(subject: Subject) -> Iterator[Finding]:
    """Find legs of zero length, and legs longer than 10 km."""
    legs = legs_of(subject)
    yield from worst(
        subject, "zero-leg", (Hit(leg.item, 0.0) for leg in legs if leg.passed and _is_zero(leg, subject))
    )
    long = [Hit(leg.item, leg.length_m) for leg in legs if leg.length_m > _LONGEST_M]
    yield from worst(subject, "long-leg", long, _LONGEST_M)


def _is_zero(leg: Leg, subject: Subject) -> bool:
    """Return whether a waypoint repeats the waypoint before it."""
    before = next((k for k in range(leg.item - 1, -1, -1) if subject.items[k].command in _FLOWN_TO), None)
    repeated = before is not None and subject.items[before].command in _PASSED
    return repeated and leg.length_m <= _ZERO_M and abs(leg.climb_m) <= _ZERO_M


_SMALLEST_RADIUS_M = 1.0


@CHECKS.finds(
    Rule(
        "small-radius",
        WARNING,
        "the acceptance radius also limits the height error, and height estimates err by half a metre: "
        "{autopilot} may wait at the waypoint",
        "set the acceptance radius to 2 m, or to 0 for the autopilot's default radius",
        rules.at_least("acceptance radius", "m"),
    )
)
def check_radii(subject: Subject) -> Iterator[Finding]:
    """Find acceptance radii that are too small for height errors, if the radius also limits the height."""
    if subject.profile.radius_in_space and subject.vehicle.hovers:
        small = [Hit(leg.item, leg.radius_m) for leg in legs_of(subject) if leg.radius_m < _SMALLEST_RADIUS_M]
        yield from worst(subject, "small-radius", small, _SMALLEST_RADIUS_M, autopilot=subject.profile.name)
