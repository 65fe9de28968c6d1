"""Place where a mission is resumed: given as an item, or read from a log or from the vehicle."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from pathlib import Path

from mission.course import Course, MissionProgress, Place
from mission.errors import MissionError
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import read_tlog
from mission.transfer.vehicles import VehicleSearch, vehicle_of
from wbf_mission.addons.base.links import LinkHost
from wbf_mission.addons.operate.watching import FleetWatch
from wbf_mission.scenario import ScenarioError

_ITEM = re.compile(r"(\d{1,5})(?:\+(\d+(?:\.\d*)?|\.\d+)\s*m)?")
_LINK = re.compile(r"(udpin|udpout|udp|tcp|tcpin|serial):.+")
_TLOG = "flight.tlog"
_ENOUGH_S = 2.5
"""Listening time for a flying vehicle (s): a later heartbeat must confirm its positions."""


def resume_place(text: str, course: Course, *, wait_s: float = 10.0) -> Place:
    """Return the place where a mission is resumed, as a place on the mission's course.

    The text is an item, counted from 1, with metres flown towards it (``12``, ``12+35m``), a telemetry log, a
    folder with the results of a flight, or the address of a link, where a vehicle must be heard in `wait_s`.

    Raises ScenarioError if the text is none of these, or the mission has no such item; MissionError if a log
    or the vehicle does not show the progress of the mission, if the mission is complete, or if several
    vehicles are heard; LinkError if a log cannot be read or a link cannot be opened; NoVehicleError without a
    vehicle.
    """
    if (item := _ITEM.fullmatch(text)) is not None:
        return _at_item(text, int(item.group(1)), float(item.group(2) or 0.0), course)
    if _LINK.fullmatch(text) is not None:
        return _of_link(text, course, wait_s)
    path = Path(text)
    log = path / _TLOG if path.is_dir() else path
    if not log.exists():
        what = f"the folder has no {_TLOG}" if path.is_dir() else "there is no such file"
        msg = f"--resume {text}: {what}; give an item (12, 12+35m), a .tlog, a results folder or a link"
        raise ScenarioError(msg)
    return _reached(f"--resume {text}", _of_log(f"--resume {text}", log, course))


def _at_item(text: str, number: int, metres: float, course: Course) -> Place:
    leg = course.leg_of(Place(number - 1))
    if not 1 <= number <= len(course.mission.items) or leg == len(course.legs):
        last = course.legs[-1].item + 1
        msg = f"--resume {text}: the mission's last item with a position is {last}; give 1 to {last}"
        raise ScenarioError(msg)
    length_m = float(course.lengths_m[leg])
    if metres >= length_m and metres > 0.0:
        length = f"the leg to item {number} is {length_m:.1f} m long"
        raise ScenarioError(f"--resume {text}: {length}; give fewer metres")
    return Place(course.legs[leg].item, metres / length_m if metres else 0.0)


def _of_log(what: str, path: Path, course: Course) -> MissionProgress:
    """Return the mission progress of the vehicle in a log."""
    progress, vehicles = MissionProgress(course), set[int]()
    for time_s, message in read_tlog(path):
        if message.get_srcComponent() != m.MAV_COMP_ID_AUTOPILOT1:
            continue
        if (vehicle := vehicle_of(message)) is not None:
            vehicles.add(vehicle.system_id)
            _require_one(what, vehicles)
        if message.get_srcSystem() in vehicles:
            progress.receive(message, time_s)
    return progress


def _require_one(what: str, vehicles: Collection[int]) -> None:
    """Raise MissionError if several vehicles are heard: the progress of another one would cut the mission."""
    if len(vehicles) > 1:
        named = ", ".join(map(str, sorted(vehicles)))
        msg = f"{what}: vehicles {named} are heard; give the item of the one that you mean: --resume 12+35m"
        raise MissionError(msg)


def _reached(what: str, progress: MissionProgress) -> Place:
    """Return the place that the vehicle has reached; error messages begin with the source `what`."""
    try:
        place = progress.place()
    except MissionError as error:
        raise MissionError(f"{what}: {error}") from None
    if place is None:
        raise MissionError(f"{what}: the mission is complete; there is nothing to resume")
    return place


class _Listener(FleetWatch):
    """Tracks the mission progress of the vehicle on a link."""

    def __init__(self, course: Course) -> None:
        super().__init__()
        self.progress = MissionProgress(course)
        self.begun_s = math.inf

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Receive a message."""
        out = super().receive(message, now_s)
        first = (next(iter(self.vehicles), 0), int(m.MAV_COMP_ID_AUTOPILOT1))
        if (message.get_srcSystem(), message.get_srcComponent()) == first:
            self.progress.receive(message, now_s)
            self.begun_s = min(self.begun_s, now_s)
        return out

    def is_enough(self, now_s: float) -> bool:
        """Return whether the received messages are enough to know the progress, or that it stays unknown."""
        if len(self.vehicles) > 1:
            return True
        return self.progress.monitor.state.item is not None and now_s > self.begun_s + _ENOUGH_S


def _of_link(url: str, course: Course, wait_s: float) -> Place:
    """Return a vehicle's resume place: its position in flight, else the start of its current item."""
    listener = _Listener(course)
    with LinkHost([listener], [url]) as host:
        name = host.urls[0]
        host.run(until=listener.is_enough, limit_s=wait_s)
    if not listener.vehicles:
        raise VehicleSearch().failure(name, wait_s)
    state = listener.progress.monitor.state
    _require_one(name, listener.vehicles)
    what = f"the vehicle on {name}"
    if state.item is None:
        raise MissionError(f"{what} does not report its current item; give the item: --resume 12+35m")
    if state.armed and listener.progress.monitor.in_mission:
        return _reached(what, listener.progress)
    if state.item >= course.end or state.total not in (None, len(course.mission.items)):
        msg = f"{what} holds another mission, or has completed this mission; give the item: --resume 12+35m"
        raise MissionError(msg)
    return Place(course.legs[course.leg_of(Place(state.item))].item)
