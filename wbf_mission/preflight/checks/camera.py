"""The camera: whether it is started, stopped, and fast enough."""

from __future__ import annotations

from collections.abc import Iterator

from mission.model import Command
from wbf_mission.planning.result import turns_camera
from wbf_mission.preflight.checks.legs import legs_of
from wbf_mission.preflight.finding import Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.subject import Subject

__all__ = ["check_camera"]

_DISTANCE = int(Command.DO_SET_CAM_TRIGG_DIST)
_INTERVAL = int(Command.DO_SET_CAM_TRIGG_INTERVAL)
_START, _STOP = int(Command.IMAGE_START_CAPTURE), int(Command.IMAGE_STOP_CAPTURE)


def check_camera(subject: Subject) -> Iterator[Finding]:
    """Images that would have to follow each other faster than the camera takes them; one that is left on."""
    speeds = {leg.item: leg.speed_m_s for leg in legs_of(subject)}
    hits: list[Hit] = []
    on: int | None = None
    order, distance_m = 0, 0.0
    for k, item in enumerate(subject.items):
        first = item.param1 or 0.0
        if item.command in (_DISTANCE, _INTERVAL, _START, _STOP):
            starts = turns_camera(item) is True
            on, order = (k, k) if starts else (None, order)
            distance_m = first if item.command == _DISTANCE else 0.0
            interval_s = {_INTERVAL: first / 1000.0, _START: item.param2 or 0.0}.get(item.command, 0.0)
            if 0.0 < interval_s < subject.image_interval_s and starts:
                hits.append(Hit(k, interval_s))
        elif distance_m > 0.0 and speeds.get(k, 0.0) > 0.0:
            interval_s = distance_m / speeds[k]
            if interval_s < subject.image_interval_s:
                hits.append(Hit(order, interval_s))
    if (found := worst_of(hits, largest=False)) is not None:
        hit, count = found
        yield subject.finding(
            Severity.WARNING,
            "camera-too-fast",
            "the images follow each other faster than the camera takes them: some will be missing",
            "fly slower, or leave more distance between images",
            item=hit.item,
            measure=Measure.at_least("time between images", hit.value, subject.image_interval_s, "s"),
            count=count,
        )
    if on is not None:
        yield subject.finding(
            Severity.NOTE,
            "camera-left-on",
            "the camera is not stopped before the end: it goes on taking images on the way home",
            item=on,
        )
    if not any(item.command in (_DISTANCE, _INTERVAL, _START) for item in subject.items):
        yield Finding(Severity.NOTE, "no-camera", "the mission never starts a camera")
