"""The list of items itself: what cannot be flown, is never flown, or does not fit into the autopilot."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from mission.ground.items import Shots, shots_ordered
from mission.model import Command, Frame
from mission.transfer.remarks import Remark
from mission.transfer.rendering import render
from mission.transfer.wire import command_name
from sim_vehicle.execution.items import DO_COMMANDS, NAV_COMMANDS, Settings, do_items
from sim_vehicle.motion.legs import Position
from wbf_mission.planning.coverage import LEAST_OF_WHOLE, asks_whole, too_little_seen
from wbf_mission.preflight.finding import Concern, Finding, Hit, Severity, worst_of
from wbf_mission.preflight.rules import first, found, worst
from wbf_mission.preflight.subject import (
    LANDINGS,
    LAST_NAV,
    PLACED,
    TAKEOFFS,
    Subject,
    followers,
    never_ends,
    reachable,
)
from wbf_mission.scenario.parts import MAX_ALTITUDE_M

_FLOWN_TO = PLACED | {int(Command.NAV_LAND)}
_PASSED = frozenset({int(Command.NAV_WAYPOINT), int(Command.NAV_SPLINE_WAYPOINT)})
_FAR_FROM_HOME = PLACED - {int(Command.NAV_TAKEOFF)}
_ZERO_M = 0.01
_LONGEST_M = 10_000.0
_FARTHEST_START_M = 1000.0
_SMALLEST_RADIUS_M = 1.0


@dataclass(frozen=True, slots=True)
class Leg:
    """The way to an item, in the order of the items; jumps are not followed."""

    item: int
    """It ends there; counted from 0."""
    start_m: Position
    """East, north, up about home."""
    end_m: Position
    speed_m_s: float
    """Ordered."""
    radius_m: float
    """At which its end counts as reached."""
    passed: bool
    """It is flown through, without a pause at its end."""

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
    yield from worst(
        subject, "zero-leg", (Hit(leg.item, 0.0) for leg in legs if leg.passed and _is_zero(leg, subject))
    )
    long = [Hit(leg.item, leg.length_m) for leg in legs if leg.length_m > _LONGEST_M]
    yield from worst(subject, "long-leg", long, _LONGEST_M)


def check_radii(subject: Subject) -> Iterator[Finding]:
    """Acceptance radii that the vehicle cannot hold: the error of its height estimate counts in them."""
    if subject.profile.radius_in_space and subject.vehicle.hovers:
        small = [Hit(leg.item, leg.radius_m) for leg in legs_of(subject) if leg.radius_m < _SMALLEST_RADIUS_M]
        yield from worst(subject, "small-radius", small, _SMALLEST_RADIUS_M, autopilot=subject.profile.name)


def check_start_distance(subject: Subject) -> Iterator[Finding]:
    """A mission that lies far from home. On a large farm the first position alone may be far away."""
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


def _is_zero(leg: Leg, subject: Subject) -> bool:
    """Return whether a waypoint repeats the waypoint before it."""
    before = next((k for k in range(leg.item - 1, -1, -1) if subject.items[k].command in _FLOWN_TO), None)
    repeated = before is not None and subject.items[before].command in _PASSED
    return repeated and leg.length_m <= _ZERO_M and abs(leg.climb_m) <= _ZERO_M


_FRAMES = {
    int(Frame.GLOBAL): "above the sea",
    int(Frame.GLOBAL_RELATIVE_ALT): "above home",
    int(Frame.GLOBAL_TERRAIN_ALT): "above the terrain",
}
_REMARKS = {
    Severity.ERROR: "autopilot-refuses",
    Severity.WARNING: "autopilot-changes",
    Severity.NOTE: "autopilot-ignores",
}
_FIXES = {
    "empty": "give a mission with items",
    "no-position": "add a waypoint",
    "no-takeoff": "begin with NAV_TAKEOFF",
    "altitude": "give a height within the limits",
    "far-from-home": "plan from a home nearby",
    "frame": "use frame 0 or 3",
    "jump-loop": "jump to a position, or before one",
}


def check_problems(subject: Subject) -> Iterator[Finding]:
    """What the vehicle cannot fly, as its own checks before arming find it."""
    # Where a jump leads is told of every autopilot.
    problems = [one for one in subject.problems if one.code != "jump-target"]
    for code in dict.fromkeys(one.code for one in problems):
        same = [one for one in problems if one.code == code]
        one = same[0]
        yield Finding(
            Severity.ERROR,
            code,
            one.reason,
            _FIXES.get(code, "correct the item"),
            item=None if one.item is None else one.item + 1,
            command="" if one.item is None else command_name(one.command),
            count=len(same),
        )
    if subject.stopped is not None:
        item, reason = subject.stopped
        yield found(subject, "stops", item=item, reason=reason)


def check_predicted(subject: Subject) -> Iterator[Finding]:
    """A plan whose flight could not be predicted: several checks know less then."""
    if subject.prediction is None:
        yield found(subject, "no-prediction")


def check_unknown(subject: Subject) -> Iterator[Finding]:
    """Commands and heights that the prediction leaves out."""
    items = list(enumerate(subject.items))
    unknown = [k for k, one in items if one.command not in NAV_COMMANDS and one.command not in DO_COMMANDS]
    terrain = [k for k, one in items if one.frame == Frame.GLOBAL_TERRAIN_ALT]
    yield from first(subject, "not-predicted", unknown)
    yield from first(subject, "terrain-heights", terrain)


def check_flown(subject: Subject) -> Iterator[Finding]:
    """Items behind the end of the mission."""
    seen = reachable(subject.items)
    yield from first(subject, "unreachable", [k for k in range(len(subject.items)) if k not in seen])


def check_ends(subject: Subject) -> Iterator[Finding]:
    """Jumps that go round for ever."""
    if never_ends(subject.items):
        jump = max((k for k in reachable(subject.items) if k < len(subject.items)), default=0)
        yield found(subject, "endless", item=jump)


def check_frames(subject: Subject) -> Iterator[Finding]:
    """Heights that count from different levels."""
    frames = [
        (k, item.frame)
        for k, item in enumerate(subject.items)
        if item.command in PLACED and item.frame in _FRAMES and item.has_position
    ]
    usual = Counter(frame for _, frame in frames).most_common(1)
    others = [(k, frame) for k, frame in frames if frame != usual[0][0]]
    if others:
        own, level = _FRAMES[others[0][1]], _FRAMES[usual[0][0]]
        yield from first(subject, "mixed-frames", [k for k, _ in others], frame=own, usual=level)


def check_dialect(subject: Subject) -> Iterator[Finding]:
    """What the autopilot would refuse, change or ignore, as `mission.transfer.rendering` tells."""
    for remark in remarks_of(subject):
        yield Finding(
            remark.severity,
            "landing-rule" if remark.parameter else _REMARKS[remark.severity],
            remark.text,
            remark.fix,
            plan=remark.plan.name.lower(),
            item=None if remark.item is None else remark.item + 1,
            command="" if remark.command is None else command_name(remark.command),
            count=remark.count,
            concern=Concern.PARAMETERS if remark.parameter else Concern.PLAN,
        )


def remarks_of(subject: Subject) -> tuple[Remark, ...]:
    """Return what is to be said of the plan before it is sent to such an autopilot."""
    mission, profile = subject.mission, subject.profile
    told, planned = subject.parameters, dict(subject.vehicle.parameters)
    return render(mission, profile, subject.vehicle_type, parameters=told, planned=planned).remarks


_LOWEST_TAKEOFF_M = 1.5
_FARTHEST_LANDING_M = 50.0


def check_takeoff(subject: Subject) -> Iterator[Finding]:
    """A take-off that is missing, late or low."""
    if subject.vehicle.drives or subject.vehicle.is_ideal:
        return
    nav = [k for k, item in enumerate(subject.items) if item.command <= LAST_NAV]
    takeoffs = [k for k in nav if subject.items[k].command in TAKEOFFS]
    known = any(one.code == "no-takeoff" for one in subject.problems)
    if nav and not known and (not takeoffs or takeoffs[0] != nav[0]):
        yield found(subject, "late-takeoff" if takeoffs else "climbs-by-itself", item=nav[0])
    for k in takeoffs[:1]:
        height_m = subject.positions[k][2]
        if 0.0 < height_m < _LOWEST_TAKEOFF_M:
            yield found(subject, "low-takeoff", item=k, measured=(height_m, _LOWEST_TAKEOFF_M))


def check_end(subject: Subject) -> Iterator[Finding]:
    """An end in the air, or far from home."""
    if not subject.items or subject.vehicle.is_ideal:
        return
    endless = never_ends(subject.items)
    flown = (k for k in sorted(reachable(subject.items)) if k < len(subject.items))
    lasts = [] if endless else [k for k in flown if _is_last(subject, k)]
    for last in lasts[:1]:
        command = subject.items[last].command
        if command not in LANDINGS and command != Command.NAV_RETURN_TO_LAUNCH:
            yield found(subject, "no-landing", item=last)
    for k, item in enumerate(subject.items):
        away_m = math.hypot(*subject.positions[k][:2])
        if item.command in LANDINGS and away_m > _FARTHEST_LANDING_M:
            yield found(subject, "lands-elsewhere", item=k, measured=(away_m, _FARTHEST_LANDING_M))


def _is_last(subject: Subject, item: int) -> bool:
    """Return whether the mission ends with a NAV item: nothing but DO items may follow it."""
    items = subject.items
    if items[item].command > LAST_NAV:
        return False
    open_, seen = list(followers(items, item)), set()
    while open_:
        seq = open_.pop()
        if seq in seen or seq == len(items):
            continue
        seen.add(seq)
        if items[seq].command <= LAST_NAV:
            return False
        open_ += followers(items, seq)
    return True


def check_camera(subject: Subject) -> Iterator[Finding]:
    """Images that would have to follow each other faster than the camera takes them; one that is left on."""
    speeds = {leg.item: leg.speed_m_s for leg in legs_of(subject)}
    hits: list[Hit] = []
    on: int | None = None
    order, distance_m = 0, 0.0
    for k, item in enumerate(subject.items):
        if (ordered := shots_ordered(item)) is not None:
            starts = not ordered.is_off
            on, order = (k, k) if starts else (None, order)
            distance_m, interval_s = ordered.distance_m, ordered.interval_ms / 1000.0
            if 0.0 < interval_s < subject.given.image_interval_s:
                hits.append(Hit(k, interval_s))
        elif distance_m > 0.0 and speeds.get(k, 0.0) > 0.0:
            interval_s = distance_m / speeds[k]
            if interval_s < subject.given.image_interval_s:
                hits.append(Hit(order, interval_s))
    yield from worst(subject, "camera-too-fast", hits, subject.given.image_interval_s)
    if on is not None:
        yield found(subject, "camera-left-on", item=on)
    if on is None and all(shots_ordered(item) in (None, Shots()) for item in subject.items):
        yield found(subject, "no-camera")


def check_coverage(subject: Subject) -> Iterator[Finding]:
    """Images that show less of the farm than was asked for: nothing, or of the whole land a part."""
    given = subject.given
    coverage = subject.coverage if given.coverage is None or subject.prediction is None else given.coverage
    whole = asks_whole(given.imaging, given.planner)
    if coverage is not None and too_little_seen(coverage, whole=whole):
        measured = (100.0 * coverage, 100.0 * LEAST_OF_WHOLE) if whole else None
        yield found(subject, "unseen", measured=measured)


_LOWEST_M = 2.0


def check_heights(subject: Subject) -> Iterator[Finding]:
    """Positions above the allowed height and below 2 m, and a path that gets higher than its positions."""
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
        # A return may climb to a height of its own; half a metre above a waypoint is the controller's.
        high = [hit for hit in heights if hit.value > height_m]
        return high or [hit for hit in flown if hit.value > height_m + 1.0]

    allowed_m = subject.given.max_altitude_m
    if high := above(allowed_m):
        yield from worst(subject, "too-high", high, allowed_m)
    elif allowed_m > MAX_ALTITUDE_M:
        yield from worst(subject, "with-permission", above(MAX_ALTITUDE_M), MAX_ALTITUDE_M)
    low = [hit for hit in heights if 0.0 < hit.value < _LOWEST_M]
    yield from worst(subject, "too-low", low, _LOWEST_M)
