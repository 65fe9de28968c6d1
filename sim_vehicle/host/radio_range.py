"""How far the radio of a ground station reaches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from geo.frame import LocalFrame
from mission.model import GeoPoint

__all__ = ["Located", "RadioRange"]


class Located(Protocol):
    """A vehicle whose true position is known to the simulation."""

    system_id: int

    @property
    def home(self) -> GeoPoint:
        """Where it stood at the start."""

    @property
    def true_position_m(self) -> tuple[float, float, float]:
        """Where it is: east and north of there, height above it."""


class RadioRange:
    """A sphere about the ground station outside of which nothing is heard, in either direction.

    Parameters
    ----------
    range_m : float
        Its radius.
    station : GeoPoint
        Where the ground station's antenna stands.
    vehicles : sequence of Located
    """

    def __init__(self, range_m: float, station: GeoPoint, vehicles: Sequence[Located]) -> None:
        self._range_m = range_m
        frame = LocalFrame(station.latitude_deg, station.longitude_deg)
        self._vehicles: dict[int, tuple[Located, tuple[float, float, float]]] = {}
        for one in vehicles:
            east_m, north_m = frame.from_wgs84(one.home.latitude_deg, one.home.longitude_deg)
            home_m = (east_m, north_m, one.home.altitude_m - station.altitude_m)
            self._vehicles[one.system_id] = one, home_m

    def distance_m(self, system_id: int) -> float:
        """Return how far a vehicle is from the ground station, in space; 0 for systems that are none."""
        known = self._vehicles.get(system_id)
        return 0.0 if known is None else math.dist((0.0, 0.0, 0.0), _sum(known[0].true_position_m, known[1]))

    def reaches(self, system_id: int) -> bool:
        """Return whether a system hears the ground station now, and is heard."""
        return self.distance_m(system_id) <= self._range_m


def _sum(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]
