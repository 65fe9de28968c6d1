"""Heights: too high for the rules, too low for what grows and stands there."""

from __future__ import annotations

from collections.abc import Iterator

from wbf_mission.preflight.checks.legs import PLACED
from wbf_mission.preflight.finding import Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.subject import Subject

__all__ = ["check_heights"]

_HIGHEST_M = 120.0
"""Open category (EU 2019/947); 400 ft of 14 CFR 107.51 are 122 m."""
_LOWEST_M = 2.0


def check_heights(subject: Subject) -> Iterator[Finding]:
    """Positions above 120 m and below 2 m, and a path that gets higher than its positions."""
    if subject.vehicle.kind == "rover" or subject.vehicle.is_ideal:
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
    high = [hit for hit in heights if hit.value > _HIGHEST_M]
    # A return may climb to a height of its own; half a metre above a waypoint is the controller's.
    high = high or [hit for hit in flown if hit.value > _HIGHEST_M + 1.0]
    if (found := worst_of(high, largest=True)) is not None:
        hit, count = found
        yield subject.finding(
            Severity.WARNING,
            "too-high",
            "higher above home than most rules allow above the ground",
            "fly lower, or with a permission; mind where the ground falls",
            item=hit.item,
            measure=Measure.at_most("height above home", hit.value, _HIGHEST_M, "m"),
            count=count,
        )
    low = [hit for hit in heights if 0.0 < hit.value < _LOWEST_M]
    if (found := worst_of(low, largest=False)) is not None:
        hit, count = found
        yield subject.finding(
            Severity.WARNING,
            "too-low",
            "so low that a slope, a plant or the error of the barometer is in the way",
            "fly higher",
            item=hit.item,
            measure=Measure.at_least("height above home", hit.value, _LOWEST_M, "m"),
            count=count,
        )
