"""Recorded flights of ArduCopter whose mission is changed in flight, and the same orders flown again."""

import csv
import gzip
import io
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.frame import LocalFrame
from mission.model import Command, GeoPoint, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot, with_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.mavlink import SimVehicle

_SAMPLE_S = 0.1
# Their height, the place from which they are timed, and how long after the guided mode the
# lowest speed is looked for.
_HEIGHT_M, _PASSED_M, _AFTER_GUIDED_S = 10.0, 25.0, 4.0
_GUIDED, _MISSION_POINTS = 4, 3


@dataclass(frozen=True, slots=True)
class ChangedFlight:
    """A flight of ArduCopter whose mission is changed, or that is sent to positions, in flight.

    Parameters
    ----------
    frame : LocalFrame
        About home.
    speed_m_s : float
    before_m, points_m : float64[n, 2]
        The path that is flown, and the positions that the orders name.
    orders : tuple of (float, str, float)
        Seconds since the first one, and what the vehicle is told: ``goto`` (a position, guided), ``speed``,
        ``load`` (a mission through all positions), ``item`` (of it), ``mission`` (the mode).
    time_s : float64[n]
        Since the first order, or since the vehicle passed `_PASSED_M` where there is none.
    position_m, velocity_m_s : float64[n, 2]
        Over ground.
    guided : bool[n]
        Whether it is in the guided mode.
    """

    frame: LocalFrame
    speed_m_s: float
    before_m: NDArray[np.float64]
    points_m: NDArray[np.float64]
    orders: tuple[tuple[float, str, float], ...]
    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    guided: NDArray[np.bool_]

    @classmethod
    def load(cls, path: Path) -> "ChangedFlight":
        """Read ``<name>.json`` and the ``.csv.gz`` beside it."""
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        raw = gzip.decompress(path.with_suffix(".csv.gz").read_bytes()).decode("ascii")
        table = np.array([[float(row[name]) for name in row] for row in csv.DictReader(io.StringIO(raw))])
        return cls(
            LocalFrame(*data["home"]),
            float(data["speed_m_s"]),
            np.array(data["before"]),
            np.array(data["points"]),
            tuple((float(time_s), str(what), float(value)) for time_s, what, value in data["orders"]),
            table[:, 0],
            table[:, 1:3],
            table[:, 4:6],
            table[:, 7] == _GUIDED,
        )

    @property
    def speeds_m_s(self) -> NDArray[np.float64]:
        """Speed over ground, float64[n]."""
        speeds: NDArray[np.float64] = np.hypot(*self.velocity_m_s.T)
        return speeds

    def lowest_m_s(self, *, guided: bool) -> float:
        """Return the lowest speed in the guided mode, or within 4 s after it; NaN without any."""
        left_s = float(self.time_s[self.guided][-1]) if self.guided.any() else math.nan
        inside = self.guided if guided else (self.time_s > left_s) & (self.time_s <= left_s + _AFTER_GUIDED_S)
        return float(self.speeds_m_s[inside].min(initial=math.inf)) if inside.any() else math.nan

    @property
    def back_s(self) -> float:
        """When it has 90 % of its speed again after it was slower; NaN if it never does."""
        slow = self.speeds_m_s < 0.9 * self.speed_m_s
        later = self.time_s[~slow & (self.time_s > self.time_s[slow & (self.time_s > 0.0)].min(initial=1e9))]
        return float(later[0]) if len(later) else math.nan

    @property
    def mean_m_s(self) -> float:
        """Mean speed since the first order."""
        return float(self.speeds_m_s[self.time_s >= 0.0].mean())

    @property
    def took_s(self) -> float:
        """How long it took from a place on the path before to its second new position, at the nearest.

        NaN where more positions than those of a mission were flown to.
        """
        if self.position_m[0, 0] > _PASSED_M or len(self.points_m) > _MISSION_POINTS:
            return math.nan
        early = self.time_s < 1.0
        passed = float(np.interp(_PASSED_M, self.position_m[early, 0], self.time_s[early]))
        inside = self.time_s > max(passed, 0.0) + 1.0
        far = np.hypot(*(self.position_m[inside] - self.points_m[1]).T)
        return float(self.time_s[inside][far.argmin()]) - passed


def fly_changed(recorded: ChangedFlight) -> ChangedFlight:
    """Fly a changed flight again: the same orders, at the same times after the same place."""
    home = GeoPoint(recorded.frame.latitude_deg, recorded.frame.longitude_deg)
    vehicle = SimVehicle(
        with_autopilot(get_vehicle("quad"), "ardupilot"), home, autopilot=get_autopilot("ardupilot")
    )
    pilot = vehicle.pilot

    def mission(points_m: NDArray[np.float64]) -> tuple[MissionItem, ...]:
        return (
            MissionItem(Command.DO_CHANGE_SPEED, param1=1.0, param2=recorded.speed_m_s),
            *(MissionItem.waypoint(*recorded.frame.to_wgs84(*one), _HEIGHT_M) for one in points_m.tolist()),
            MissionItem(Command.NAV_RETURN_TO_LAUNCH),
        )

    climb = MissionItem(Command.NAV_TAKEOFF, 3, x=home.latitude_deg, y=home.longitude_deg, z=_HEIGHT_M)
    pilot.load((climb, *mission(recorded.before_m)))
    pilot.arm(force=True)
    pilot.set_mode(Mode.MISSION)
    now_s = 0.0
    begin_m = float(np.interp(0.0, recorded.time_s, recorded.position_m[:, 0]))
    samples = []

    def fly(until_s: float) -> None:
        nonlocal now_s
        while now_s < until_s - 1e-9:
            now_s = min(until_s, (len(samples) + 1) * _SAMPLE_S)
            pilot.advance(now_s)
            if now_s >= (len(samples) + 1) * _SAMPLE_S - 1e-9:
                state = pilot.state
                samples.append((*state.position_m[:2], *state.velocity_m_s[:2], pilot.mode is Mode.GUIDED))

    while pilot.state.position_m[0] < begin_m:
        fly(now_s + 0.01)
    start_s = now_s - (pilot.state.position_m[0] - begin_m) / recorded.speed_m_s
    for time_s, what, value in recorded.orders:
        fly(start_s + time_s)
        if what == "goto":
            place = recorded.frame.to_wgs84(*recorded.points_m[int(value)].tolist())
            pilot.goto(*place, _HEIGHT_M, mode=Mode.GUIDED)
        elif what == "speed":
            pilot.set_speed(value)
        elif what == "load":
            pilot.load(mission(recorded.points_m))
        elif what == "item":
            pilot.set_current(int(value))
        else:
            pilot.set_mode(Mode.MISSION)
    fly(start_s + float(recorded.time_s[-1]))
    table = np.array(samples)
    time_s = _SAMPLE_S * np.arange(1, len(table) + 1) - start_s
    kept = time_s >= recorded.time_s[0] - _SAMPLE_S
    table, time_s = table[kept], time_s[kept]
    return replace(
        recorded,
        time_s=time_s,
        position_m=table[:, :2],
        velocity_m_s=table[:, 2:4],
        guided=table[:, 4] > 0.0,
    )
