"""The flown path against the fence and the obstacles of the farm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from mission.errors import MissionFileError
from mission.files.fence import geo_fence
from mission.model import MissionType
from sim_vehicle.pilot.fence import Fence
from wbf_mission.preflight.checks.items import remarks_of
from wbf_mission.preflight.finding import Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.subject import FlownTrack, Subject

__all__ = ["check_fence", "check_obstacles"]

_STEP_M, _MOST_STEPS = 1.0, 1000
_INSIDE = "distance inside the fence"


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
            yield Finding(Severity.ERROR, "bad-fence", str(error), "draw the fence again", plan="fence")
        return
    fence = _fence_of(subject)
    home_m = fence.margin_m(0.0, 0.0)
    if home_m < 0.0:
        yield Finding(
            Severity.ERROR,
            "home-outside-fence",
            "home is outside the fence: the vehicle would not arm",
            "move the fence or home",
            plan="fence",
            measure=Measure.at_least(_INSIDE, home_m, 0.0, "m"),
        )
    for k, item in enumerate(subject.mission.rally):
        margin_m = fence.margin_m(*subject.frame.from_wgs84(item.x, item.y))
        if margin_m < 0.0:
            yield Finding(
                Severity.WARNING,
                "rally-outside-fence",
                "a rally point outside the fence",
                "move it inside",
                plan="rally",
                item=k + 1,
                command="NAV_RALLY_POINT",
                measure=Measure.at_least(_INSIDE, margin_m, 0.0, "m"),
            )
    yield from _path_findings(subject, fence)


def _fence_of(subject: Subject) -> Fence:
    """Return the fence as the autopilot takes it: within one area or within all."""
    from sim_vehicle.autopilot import autopilot_of_number

    firmware = autopilot_of_number(subject.profile.autopilot).for_vehicle(subject.vehicle.kind)
    return Fence.of(subject.mission.fence, subject.frame, any_inclusion=firmware.rules.any_inclusion)


def _path_findings(subject: Subject, fence: Fence) -> Iterator[Finding]:
    hits = [
        Hit(int(item), float(margin))
        for track in _paths(subject)
        for item, margin in zip(track.items, fence.margins_m(*track.points_m[:, :2].T), strict=True)
        if margin < subject.margin_m
    ]
    outside = [hit for hit in hits if hit.value < 0.0]
    if (found := worst_of(outside, largest=False)) is not None:
        hit, count = found
        yield subject.finding(
            Severity.ERROR,
            "outside-fence",
            "the path to it leaves the fence, or enters what it shuts out",
            "move the waypoint or the fence",
            item=hit.item,
            measure=Measure.at_least(_INSIDE, hit.value, 0.0, "m"),
            count=count,
        )
    elif (found := worst_of(hits, largest=False)) is not None:
        hit, count = found
        yield subject.finding(
            Severity.WARNING,
            "near-fence",
            "the path to it comes near the edge of the fence",
            "keep away from the edge, or give the margin that is meant",
            item=hit.item,
            measure=Measure.at_least(_INSIDE, hit.value, subject.margin_m, "m"),
            count=count,
        )


def check_obstacles(subject: Subject) -> Iterator[Finding]:
    """Whether the path that is flown stays clear of the farm's obstacles, with the margin."""
    if not subject.obstacles:
        return
    obstacles = shapely.union_all(list(subject.obstacles))
    shapely.prepare(obstacles)
    hits = []
    for track in _paths(subject):
        legs = shapely.linestrings(np.stack((track.points_m[:-1, :2], track.points_m[1:, :2]), axis=1))
        near = np.flatnonzero(shapely.dwithin(legs, obstacles, subject.margin_m))
        away = shapely.distance(legs[near], obstacles)
        hits += [Hit(int(track.items[k + 1]), float(metres)) for k, metres in zip(near, away, strict=True)]
    if (found := worst_of(hits, largest=False)) is None:
        return
    hit, count = found
    crosses = hit.value == 0.0
    yield subject.finding(
        Severity.ERROR if crosses else Severity.WARNING,
        "obstacle" if crosses else "near-obstacle",
        "the path to it crosses an obstacle of the farm"
        if crosses
        else "the path to it comes near an obstacle of the farm",
        "fly round it",
        item=hit.item,
        measure=Measure.at_least("distance from the obstacle", hit.value, subject.margin_m, "m"),
        count=count,
    )


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
