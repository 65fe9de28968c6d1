"""Checks of the predicted flight: speeds, turns, climbs, wind, battery and images."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import shapely

from mission.ground.items import Shots, shots_ordered
from mission.model import Command
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.prediction.battery_swaps import batteries_needed
from wbf_mission.planning.coverage import LEAST_OF_WHOLE, asks_whole, too_little_seen
from wbf_mission.preflight import rules
from wbf_mission.preflight.finding import Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.path_rules import Leg, legs_of
from wbf_mission.preflight.rules import ERROR, NOTE, WARNING, Rule, found, worst
from wbf_mission.preflight.subject import Subject

CHECKS = rules.Checks[[Subject]]()

_FOLLOW_STEP_M = 0.5

_MOST_POINTS = 20_000


def share_flown(subject: Subject, legs: Sequence[Leg], within_m: float) -> float | None:
    """Return the fraction of the legs' length that lies within `within_m` of the flown path (horizontally).

    If several flights are predicted, return the smallest fraction; if no flight is predicted, return None.
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


@CHECKS.finds(
    Rule(
        "too-fast",
        WARNING,
        "the speed is above the top speed of {vehicle}, so the vehicle flies slower",
        "give a speed that the vehicle reaches",
        rules.at_most("speed", "m/s"),
    ),
    Rule(
        "too-slow",
        WARNING,
        "the speed is below the least airspeed of the fixed wing, so the autopilot flies faster",
        "give at least this airspeed",
        rules.at_least("airspeed", "m/s"),
    ),
)
def check_speeds(subject: Subject) -> Iterator[Finding]:
    """Find speeds above the vehicle's maximum or below its stall speed."""
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


_ZERO_M = 0.01

_MOST_OF_IT = 0.9


@CHECKS.finds(
    Rule(
        "short-leg",
        WARNING,
        "successive legs are shorter than the acceptance radius, so the vehicle skips them",
        "give a smaller radius, or leave waypoints out",
        rules.at_least("length of the leg", "m"),
    )
)
def check_short_legs(subject: Subject) -> Iterator[Finding]:
    """Find successive legs that the vehicle skips because they are shorter than the acceptance radius.

    A single short leg is allowed: it joins two rows. Short legs along a line or a wide curve are flown.
    """
    vehicle = subject.vehicle
    lossy = subject.profile.lossy.get(int(Command.NAV_WAYPOINT), frozenset())
    # ArduCopter flies each leg to its end, whatever the acceptance radius is.
    if vehicle.circles or (vehicle.hovers and "param2" in lossy):
        return

    def is_short(leg: Leg) -> bool:
        return leg.passed and _ZERO_M < leg.length_m < leg.radius_m

    pairs = pairwise(legs_of(subject))
    short = list(dict.fromkeys(leg for pair in pairs if all(map(is_short, pair)) for leg in pair))
    shortest = min(short, key=lambda leg: leg.length_m, default=None)
    if shortest is None:
        return
    share = share_flown(subject, short, 0.5 * shortest.radius_m)
    if share is None or share < _MOST_OF_IT:
        hits = (Hit(leg.item, leg.length_m) for leg in short)
        yield from worst(subject, "short-leg", hits, shortest.radius_m)


_TURN_BACK = 2.0

_BESIDE_M = 5.0
"""An image from 10 m or higher shows the ground up to this distance from the path."""


@CHECKS.finds(
    Rule(
        "tight-turn",
        WARNING,
        "the legs are too short for the turns of a fixed wing: much of the plan is not flown",
        "lay rows at least {room_m:.0f} m apart; if the field is too small for that, fly a multirotor",
    )
)
def check_turns(subject: Subject) -> Iterator[Finding]:
    """Find corners between legs that are too short for a fixed wing's turns."""
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


def _turn_rad(one: Leg, following: Leg) -> float:
    """Return the change of direction between two legs, 0 to pi."""
    first = math.atan2(one.end_m[1] - one.start_m[1], one.end_m[0] - one.start_m[0])
    second = math.atan2(following.end_m[1] - following.start_m[1], following.end_m[0] - following.start_m[0])
    return abs(math.remainder(second - first, math.tau))


@CHECKS.finds(
    Rule(
        "steep-leg",
        WARNING,
        "the leg is steeper than the vehicle can climb or sink at this speed: {outcome}",
        "make the leg longer, or fly slower",
        rules.at_most("climb or descent", "m/s"),
    )
)
def check_climbs(subject: Subject) -> Iterator[Finding]:
    """Find legs steeper than the vehicle's climb or descent rate at the leg's speed."""
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
"""Total duration of gusts (s) against which a vehicle's inertia is enough."""


@CHECKS.finds(
    Rule(
        "too-windy",
        ERROR,
        "{vehicle} would be blown away",
        "wait for less wind",
        rules.at_most("wind", "m/s"),
        by_vehicle=True,
    ),
    Rule(
        TOO_GUSTY,
        WARNING,
        "{vehicle} holds its path in at most {limit_m_s:.3g} m/s, but gusts are stronger: they blow the"
        " vehicle aside, farther than the margins to obstacles and fence allow for",
        "wait for less wind, or plan farther from obstacles and fence",
        rules.at_most("time in such gusts", "s"),
    ),
)
def check_wind(subject: Subject) -> Iterator[Finding]:
    """Find a mean wind above the vehicle's airspeed, and gusts that push it off its path."""
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


_COMFORT = 0.1
"""A note is given if the battery ends less than this fraction above the reserve."""


@CHECKS.finds(
    Rule(
        "battery",
        ERROR,
        "{flight}; {reason}",
        "fly a shorter mission, or cut the mission into sorties with 'wbf-mission plan'",
        rules.LEFT,
        by_vehicle=True,
    ),
    Rule(
        "battery-close",
        NOTE,
        "{flight}; at the end little more than the reserve is left",
        "begin with a full battery",
        rules.LEFT,
    ),
    Rule("flight", NOTE, "{flight}", measured=rules.LEFT),
)
def check_battery(subject: Subject) -> Iterator[Finding]:
    """Compare the battery's charge at landing with the reserve, and report what the flight uses."""
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
    reason = prediction.reason
    if code == "battery":
        count = batteries_needed(
            subject.mission, subject.vehicle, prediction, wind=subject.wind, frame=subject.frame
        )
        if count is not None and count > 1:
            reason += f"; it needs {count} batteries, changed at home"
    yield found(
        subject,
        code,
        measured=(100.0 * left, 100.0 * reserve),
        flight=f"{text}, {prediction.energy_wh:.1f} of {battery.capacity_wh:g} Wh",
        reason=reason,
    )


@CHECKS.finds(
    Rule(
        "camera-too-fast",
        WARNING,
        "images are triggered faster than the camera can take them, so some will be missing",
        "fly slower, or leave more distance between images",
        rules.at_least("time between images", "s"),
    ),
    Rule(
        "camera-left-on",
        NOTE,
        "the mission does not stop the camera, so it goes on taking images on the way home",
    ),
    Rule("no-camera", NOTE, "the mission never starts a camera"),
)
def check_camera(subject: Subject) -> Iterator[Finding]:
    """Find image intervals below the camera's shortest, and a camera that is never switched off."""
    speeds = {leg.item: leg.speed_m_s for leg in legs_of(subject)}
    hits: list[Hit] = []
    on: int | None = None
    order, distance_m = 0, 0.0
    for k, item in enumerate(subject.items):
        if (ordered := shots_ordered(item)) is not None:
            if math.isinf(ordered.images) and not math.isinf(ordered.interval_ms):
                on, order = (None, order) if ordered.is_off else (k, k)
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


@CHECKS.finds(
    Rule(
        "unseen",
        WARNING,
        "the images show less of the farm's land than was asked for",
        "give the right --farm and --camera, or plan again; ignore this if the plan is a part of a survey",
        rules.at_least("coverage", "%"),
    )
)
def check_coverage(subject: Subject) -> Iterator[Finding]:
    """Find a plan whose images show nothing of the farm, or too little for a full survey."""
    given = subject.given
    coverage = subject.coverage if given.coverage is None or subject.prediction is None else given.coverage
    whole = asks_whole(given.imaging, given.planner)
    if coverage is not None and too_little_seen(coverage, whole=whole):
        measured = (100.0 * coverage, 100.0 * LEAST_OF_WHOLE) if whole else None
        yield found(subject, "unseen", measured=measured)
