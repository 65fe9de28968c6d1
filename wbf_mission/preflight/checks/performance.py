"""What the vehicle can do: speeds, turns, climbs, and the wind that it withstands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from mission.model import Command
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.execution.fixed_wing_items import must_circle
from wbf_mission.preflight.checks.as_flown import share_flown
from wbf_mission.preflight.checks.legs import Leg, legs_of
from wbf_mission.preflight.finding import Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.subject import Subject

__all__ = ["check_climbs", "check_short_legs", "check_speeds", "check_turns", "check_wind"]

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
    if (found := worst_of(fast, largest=True)) is not None:
        yield subject.worst(
            found,
            "too-fast",
            f"faster than {vehicle.name} flies: it will take longer than the speed tells",
            "give a speed that it reaches",
            Measure.at_most("speed", found[0].value, vehicle.fastest_m_s, "m/s"),
        )
    if must_circle(vehicle):
        least = fixed_wing_procedures(vehicle).limits(vehicle).airspeed_min
        slow = [hit for hit in orders if hit.value < least]
        if (found := worst_of(slow, largest=False)) is not None:
            yield subject.worst(
                found,
                "too-slow",
                "below the least airspeed of the fixed wing: the autopilot flies faster",
                "give at least that",
                Measure.at_least("airspeed", found[0].value, least, "m/s"),
            )


def check_short_legs(subject: Subject) -> Iterator[Finding]:
    """Several legs that lie within one acceptance radius, so that the vehicle leaves them out.

    One short leg alone is the way from a row to the next, and many along a line or a wide curve are followed.
    """
    vehicle = subject.vehicle
    if must_circle(vehicle) or _flies_to_the_end(subject):
        return
    pairs = pairwise(legs_of(subject))
    short = list(dict.fromkeys(leg for pair in pairs if all(map(_is_short, pair)) for leg in pair))
    found = worst_of([Hit(leg.item, leg.length_m) for leg in short], largest=False)
    if found is None:
        return
    radius_m = next(leg.radius_m for leg in short if leg.item == found[0].item)
    share = share_flown(subject, short, 0.5 * radius_m)
    if share is None or share < _MOST_OF_IT:
        yield subject.worst(
            found,
            "short-leg",
            "legs in a row are shorter than the acceptance radius: they count as flown at once",
            "give a smaller radius, or leave waypoints out",
            Measure.at_least("length of the leg", found[0].value, radius_m, "m"),
        )


def _is_short(leg: Leg) -> bool:
    return leg.passed and _ZERO_M < leg.length_m < leg.radius_m


def _flies_to_the_end(subject: Subject) -> bool:
    """ArduCopter flies its path to the end, whatever the radius."""
    lossy = subject.profile.lossy.get(int(Command.NAV_WAYPOINT), frozenset())
    return subject.vehicle.kind == "multirotor" and "param2" in lossy


def check_turns(subject: Subject) -> Iterator[Finding]:
    """Corners for which the legs are too short, so that a fixed wing does not fly what is planned."""
    vehicle = subject.vehicle
    if not must_circle(vehicle):
        return
    limits = fixed_wing_procedures(vehicle).limits(vehicle)
    legs = legs_of(subject)
    needs = [0.0] * (len(legs) + 1)
    for k in range(len(legs) - 1):
        if legs[k].passed and legs[k + 1].item != legs[k].item:
            radius_m = limits.tightest_m(max(legs[k].speed_m_s, limits.airspeed_min))
            needs[k + 1] = radius_m * min(math.tan(0.5 * _turn_rad(legs[k], legs[k + 1])), _TURN_BACK)
    tight = []
    for k, leg in enumerate(legs):
        needed_m = needs[k] + needs[k + 1]
        if leg.passed and 0.0 < leg.length_m < needed_m:
            tight.append((Hit(leg.item, leg.length_m / needed_m), leg, needed_m))
    found = worst_of([hit for hit, _, _ in tight], largest=False)
    share = share_flown(subject, [leg for leg in legs if leg.passed], _BESIDE_M)
    if found is None or (share is not None and share >= _MOST_OF_IT):
        return
    leg, needed_m = next((leg, needed) for hit, leg, needed in tight if hit == found[0])
    room_m = max(2.0 * limits.tightest_m(max(leg.speed_m_s, limits.airspeed_min)), 1.0)
    yield subject.worst(
        found,
        "tight-turn",
        "the legs are too short for the turns of a fixed wing: much of the plan is not flown",
        f"lay rows at least {room_m:.0f} m apart; where the field is too small for that, fly a multirotor",
        Measure.at_least("length of the leg", leg.length_m, needed_m, "m")
        if share is None
        else Measure.at_least(
            f"part of the path flown within {_BESIDE_M:g} m", 100.0 * share, 100.0 * _MOST_OF_IT, "%"
        ),
    )


def check_climbs(subject: Subject) -> Iterator[Finding]:
    """Legs that climb or sink faster than the vehicle does at the speed of the leg."""
    vehicle = subject.vehicle
    if vehicle.kind not in ("multirotor", "fixed-wing"):
        return
    steep = []
    for leg in legs_of(subject)[1:]:
        limit = vehicle.climb_speed_m_s if leg.climb_m > 0.0 else vehicle.descent_speed_m_s
        lands = subject.items[leg.item].command == Command.NAV_LAND
        if leg.length_m <= 0.0 or lands or not leg.passed:
            continue
        rate = abs(leg.climb_m) * leg.speed_m_s / leg.length_m
        if rate > limit:
            steep.append((Hit(leg.item, rate / limit), rate, limit))
    if (found := worst_of([hit for hit, _, _ in steep], largest=True)) is not None:
        rate, limit = next((rate, limit) for hit, rate, limit in steep if hit == found[0])
        wing = must_circle(vehicle)
        what = "the height is not reached at the waypoint" if wing else "the leg is flown slower"
        yield subject.worst(
            found,
            "steep-leg",
            f"the leg climbs or sinks faster than the vehicle does: {what}",
            "make the leg longer, or fly slower",
            Measure.at_most("climb or descent", rate, limit, "m/s"),
            Severity.WARNING if wing else Severity.NOTE,
        )


def check_wind(subject: Subject) -> Iterator[Finding]:
    """A mean wind in which the vehicle would be blown away."""
    vehicle, wind = subject.vehicle, subject.wind
    if wind is None or vehicle.is_ideal:
        return
    top_m = max((leg.end_m[2] for leg in legs_of(subject)), default=vehicle.takeoff_altitude_m)
    speed = math.hypot(*wind.mean_at(max(top_m, 0.0)))
    if speed >= vehicle.airspeed_limit_m_s:
        yield Finding(
            Severity.WARNING if subject.assumed else Severity.ERROR,
            "too-windy",
            f"{vehicle.name} would be blown away",
            "wait for less wind",
            measure=Measure.at_most("wind", speed, vehicle.airspeed_limit_m_s, "m/s"),
        )


def _turn_rad(one: Leg, following: Leg) -> float:
    """Return by how much the direction changes, 0 to pi."""
    first = math.atan2(one.end_m[1] - one.start_m[1], one.end_m[0] - one.start_m[0])
    second = math.atan2(following.end_m[1] - following.start_m[1], following.end_m[0] - following.start_m[0])
    return abs(math.remainder(second - first, math.tau))
