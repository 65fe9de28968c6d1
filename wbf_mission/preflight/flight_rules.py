"""What the vehicle can do: speeds, turns, climbs, and the wind that it withstands."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import shapely

from mission.errors import MissionFileError
from mission.files.fence import geo_fence
from mission.model import Command, MissionType
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.pilot.fence import Fence
from sim_vehicle.prediction.battery_swaps import batteries_needed
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.preflight.finding import Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.plan_rules import Leg, legs_of, remarks_of
from wbf_mission.preflight.rules import found, worst
from wbf_mission.preflight.subject import FlownTrack, Subject

_FOLLOW_STEP_M = 0.5
_MOST_POINTS = 20_000


def share_flown(subject: Subject, legs: Sequence[Leg], within_m: float) -> float | None:
    """Return which part of the length of legs is passed at no more than a distance, over ground.

    0 to 1, of the flight that follows them least; None without a predicted flight.
    """
    tracks = [track.points_m[:, :2] for track in subject.tracks if len(track.points_m) > 1]
    lengths_m = np.array([leg.length_m for leg in legs])
    if not tracks or not lengths_m.any():
        return None
    starts = np.array([leg.start_m[:2] for leg in legs])
    ends = np.array([leg.end_m[:2] for leg in legs])
    step_m = max(_FOLLOW_STEP_M, float(lengths_m.sum()) / _MOST_POINTS)
    counts = np.maximum(np.ceil(lengths_m / step_m), 1).astype(np.int64)
    of_leg = np.repeat(np.arange(len(legs)), counts)
    along = (np.arange(len(of_leg)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[of_leg]
    points = shapely.points(starts[of_leg] + along[:, None] * (ends - starts)[of_leg])
    weights = (lengths_m / counts)[of_leg]
    shares = []
    for track in tracks:
        flown = shapely.STRtree(shapely.linestrings(np.stack((track[:-1], track[1:]), axis=1)))
        near = np.unique(flown.query(points, predicate="dwithin", distance=within_m)[0])
        shares.append(float(weights[near].sum() / weights.sum()))
    return min(shares)


_GROUND_OR_AIR = (0.0, 1.0)
_TURN_BACK = 2.0
_ZERO_M = 0.01
_MOST_OF_IT = 0.9
_BESIDE_M = 5.0
"""What lies so far beside the path is still in an image that is taken from ten metres and more."""


def check_speeds(subject: Subject) -> Iterator[Finding]:
    """Speeds that the vehicle does not reach, or at which it would stall."""
    vehicle = subject.vehicle
    orders = [
        Hit(k, item.param2)
        for k, item in enumerate(subject.items)
        if item.command == Command.DO_CHANGE_SPEED
        and (item.param1 or 0.0) in _GROUND_OR_AIR
        and item.param2 is not None
        and item.param2 > 0.0
    ]
    fast = [hit for hit in orders if hit.value > vehicle.fastest_m_s * 1.001]
    yield from worst(subject, "too-fast", fast, vehicle.fastest_m_s, vehicle=vehicle.name)
    if vehicle.circles:
        least = fixed_wing_procedures(vehicle).limits(vehicle).airspeed_min
        yield from worst(subject, "too-slow", [hit for hit in orders if hit.value < least], least)


def check_short_legs(subject: Subject) -> Iterator[Finding]:
    """Several legs that lie within one acceptance radius, so that the vehicle leaves them out.

    One short leg alone is the way from a row to the next, and many along a line or a wide curve are followed.
    """
    vehicle = subject.vehicle
    if vehicle.circles or _flies_to_the_end(subject):
        return
    pairs = pairwise(legs_of(subject))
    short = list(dict.fromkeys(leg for pair in pairs if all(map(_is_short, pair)) for leg in pair))
    shortest = min(short, key=lambda leg: leg.length_m, default=None)
    if shortest is None:
        return
    share = share_flown(subject, short, 0.5 * shortest.radius_m)
    if share is None or share < _MOST_OF_IT:
        hits = (Hit(leg.item, leg.length_m) for leg in short)
        yield from worst(subject, "short-leg", hits, shortest.radius_m)


def _is_short(leg: Leg) -> bool:
    return leg.passed and _ZERO_M < leg.length_m < leg.radius_m


def _flies_to_the_end(subject: Subject) -> bool:
    """ArduCopter flies its path to the end, whatever the radius."""
    lossy = subject.profile.lossy.get(int(Command.NAV_WAYPOINT), frozenset())
    return subject.vehicle.hovers and "param2" in lossy


def check_turns(subject: Subject) -> Iterator[Finding]:
    """Corners for which the legs are too short, so that a fixed wing does not fly what is planned."""
    vehicle = subject.vehicle
    if not vehicle.circles:
        return
    limits = fixed_wing_procedures(vehicle).limits(vehicle)
    legs = legs_of(subject)
    needs = [0.0] * (len(legs) + 1)
    for k in range(len(legs) - 1):
        if legs[k].passed and legs[k + 1].item != legs[k].item:
            radius_m = limits.tightest_m(max(legs[k].speed_m_s, limits.airspeed_min))
            needs[k + 1] = radius_m * min(math.tan(0.5 * _turn_rad(legs[k], legs[k + 1])), _TURN_BACK)
    tight = [
        Hit(leg.item, leg.length_m / needed_m, (leg.length_m, needed_m))
        for leg, needed_m in zip(legs, map(sum, pairwise(needs)), strict=True)
        if leg.passed and 0.0 < leg.length_m < needed_m
    ]
    worst_hit = worst_of(tight, largest=False)
    share = share_flown(subject, [leg for leg in legs if leg.passed], _BESIDE_M)
    if worst_hit is None or (share is not None and share >= _MOST_OF_IT):
        return
    hit, count = worst_hit
    speed_m_s = next(leg.speed_m_s for leg in legs if leg.item == hit.item)
    room_m = max(2.0 * limits.tightest_m(max(speed_m_s, limits.airspeed_min)), 1.0)
    assert hit.measured is not None
    measure = Measure.at_least("length of the leg", *hit.measured, "m")
    if share is not None:
        name = f"part of the path flown within {_BESIDE_M:g} m"
        measure = Measure.at_least(name, 100.0 * share, 100.0 * _MOST_OF_IT, "%")
    yield found(subject, "tight-turn", item=hit.item, count=count, measure=measure, room_m=room_m)


def check_climbs(subject: Subject) -> Iterator[Finding]:
    """Legs that climb or sink faster than the vehicle does at the speed of the leg."""
    vehicle, wing = subject.vehicle, subject.vehicle.circles
    if not (vehicle.hovers or wing):
        return
    steep = []
    for leg in legs_of(subject)[1:]:
        limit = vehicle.climb_speed_m_s if leg.climb_m > 0.0 else vehicle.descent_speed_m_s
        lands = subject.items[leg.item].command == Command.NAV_LAND
        if leg.length_m <= 0.0 or lands or not leg.passed:
            continue
        rate = abs(leg.climb_m) * leg.speed_m_s / leg.length_m
        if rate > limit:
            steep.append(Hit(leg.item, rate / limit, (rate, limit)))
    outcome = "the height is not reached at the waypoint" if wing else "the leg is flown slower"
    severity = Severity.WARNING if wing else Severity.NOTE
    yield from worst(subject, "steep-leg", steep, severity=severity, outcome=outcome)


TOO_GUSTY = "too-gusty"
_SHORT_GUSTS_S = 1.0
"""Inertia carries a vehicle through gusts that last less than this in a whole flight."""


def check_wind(subject: Subject) -> Iterator[Finding]:
    """A mean wind in which the vehicle would be blown away; gusts that it cannot hold its path against."""
    vehicle, wind = subject.vehicle, subject.wind
    if vehicle.is_ideal:
        return
    limit_m_s = vehicle.airspeed_limit_m_s
    top_m = max(0.0, max((leg.end_m[2] for leg in legs_of(subject)), default=vehicle.takeoff_altitude_m))
    speed = math.hypot(*wind.mean_at(top_m))
    if speed >= limit_m_s:
        yield found(subject, "too-windy", measured=(speed, limit_m_s), vehicle=vehicle.name)
    elif subject.prediction is not None and not vehicle.drives:
        beyond_s = wind.share_above(limit_m_s, top_m) * subject.prediction.duration_s
        if beyond_s >= _SHORT_GUSTS_S:
            yield found(
                subject,
                TOO_GUSTY,
                measured=(beyond_s, _SHORT_GUSTS_S),
                vehicle=vehicle.name,
                limit_m_s=limit_m_s,
            )


def _turn_rad(one: Leg, following: Leg) -> float:
    """Return by how much the direction changes, 0 to pi."""
    first = math.atan2(one.end_m[1] - one.start_m[1], one.end_m[0] - one.start_m[0])
    second = math.atan2(following.end_m[1] - following.start_m[1], following.end_m[0] - following.start_m[0])
    return abs(math.remainder(second - first, math.tau))


_COMFORT = 0.1
"""Less than this above the reserve deserves a look; who plans for the whole battery has nothing above it."""


def check_battery(subject: Subject) -> Iterator[Finding]:
    """What is left of a full battery at the end, against its reserve; and what the flight takes."""
    prediction, battery = subject.prediction, subject.vehicle.battery
    if prediction is None:
        return
    minutes, seconds = divmod(round(prediction.duration_s), 60)
    takes = f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
    until = "" if subject.stopped is None else "until it ends there, "
    wind = subject.wind
    speed_m_s = math.hypot(wind.east_m_s, wind.north_m_s)
    gusts = " and gusts" * wind.is_gusty
    air = f"a wind of {speed_m_s:.3g} m/s{gusts}" if speed_m_s or gusts else "calm air"
    over_ground = f"{prediction.ground_length_m:.1f} m over ground"
    text = f"{until}the flight is predicted to take {takes} in {air}: {over_ground}"
    if (coverage := subject.coverage) is not None:
        imaging = subject.given.imaging
        camera = (
            "the leaf camera" if imaging is None else f"{imaging.camera.name} at {imaging.height_m:.1f} m"
        )
        text += f", images of {camera} show {coverage:.2%} of the land to be seen"
    if battery is None or subject.stopped is not None:
        yield found(subject, "flight", flight=text)
        return
    left, reserve = max(0.0, 1.0 - prediction.energy_wh / battery.capacity_wh), battery.reserve_fraction
    code = "battery" if left < reserve else "battery-close" if left < reserve + _COMFORT else "flight"
    yield found(
        subject,
        code,
        measured=(100.0 * left, 100.0 * reserve),
        flight=f"{text}, {prediction.energy_wh:.1f} of {battery.capacity_wh:g} Wh",
        reason=prediction.reason + (_batteries(subject, prediction) if code == "battery" else ""),
    )


def _batteries(subject: Subject, prediction: Prediction) -> str:
    """Say how many batteries a mission needs that is longer than one, where any number is enough."""
    count = batteries_needed(
        subject.mission, subject.vehicle, prediction, wind=subject.wind, frame=subject.frame
    )
    return f"; it needs {count} batteries, changed at home" if count is not None and count > 1 else ""


_STEP_M, _MOST_STEPS = 1.0, 1000


def check_fence(subject: Subject) -> Iterator[Finding]:
    """Whether home, the rally points and the path that is flown stay within the fence, with the margin."""
    if not subject.mission.fence:
        return
    try:
        geo_fence(subject.mission.fence)
    except MissionFileError as error:
        told = any(
            one.plan is MissionType.FENCE and one.severity is Severity.ERROR for one in remarks_of(subject)
        )
        if not told:
            yield found(subject, "bad-fence", plan="fence", error=error)
        return
    fence = _fence_of(subject)
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


def _fence_of(subject: Subject) -> Fence:
    """Return the fence as the autopilot takes it: within one area or within all."""
    from sim_vehicle.autopilot import autopilot_of_number

    firmware = autopilot_of_number(subject.profile.autopilot).for_vehicle(subject.vehicle.kind)
    return Fence.of(subject.mission.fence, subject.frame, any_inclusion=firmware.rules.any_inclusion)


def check_obstacles(subject: Subject) -> Iterator[Finding]:
    """Whether the path that is flown stays clear of the farm's obstacles, beside or above them."""
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
            # Beside it, over it, or both: the nearest corner of its top is as far as that.
            away = np.hypot(shapely.distance(legs[near], obstacle.polygon), above[near])
            for k, metres in zip(near, away, strict=True):
                hits = touched if metres == 0.0 else too_near.setdefault(margin_m, [])
                hits.append(Hit(int(track.items[k + 1]), float(metres)))
    if touched:
        yield from worst(subject, "obstacle", touched, subject.given.margin_m)
        return
    for margin_m, hits in too_near.items():
        yield from worst(subject, "near-obstacle", hits, margin_m)


def _paths(subject: Subject) -> list[FlownTrack]:
    """Return the paths that are judged: as they are flown, else from position to position."""
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
