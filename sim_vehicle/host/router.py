"""Routing of frames, shared by the virtual-clock host and the server.

The rules are those of mavlink-router: a frame for everybody goes to everybody but its sender; a frame for one
address goes to the ports that the address has sent from (or to the system's autopilot, which knows what to
refuse), and nowhere when its system never sent anything. How far a radio reaches is here, too.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Hashable, Iterable, Sequence
from functools import cache
from typing import Generic, Protocol, TypeVar

from geo.frame import LocalFrame
from mission.link.codec.dialect import mavlink
from mission.model import GeoPoint

__all__ = ["Address", "RadioRange", "RoutingTable", "frame_id", "frame_source", "frame_target"]

Port = TypeVar("Port", bound=Hashable)
Address = tuple[int, int]
"""System and component."""

AUTOPILOT = 1
MAGIC_2 = 0xFD


def frame_id(frame: bytes) -> int:
    """Message id of a whole frame."""
    if frame[0] == MAGIC_2:
        return frame[7] | frame[8] << 8 | frame[9] << 16
    return frame[5]


def frame_source(frame: bytes) -> Address:
    """Return the address that a whole frame was sent from."""
    return (frame[5], frame[6]) if frame[0] == MAGIC_2 else (frame[3], frame[4])


def frame_target(frame: bytes) -> Address:
    """Whom a whole frame is for; 0 is everybody.

    MAVLink 2 cuts trailing zeros off the payload, so a field beyond its end is 0.
    """
    system_at, component_at = target_offsets(frame_id(frame))
    if system_at < 0:
        return (0, 0)
    header = 10 if frame[0] == MAGIC_2 else 6
    length = frame[1]
    system = frame[header + system_at] if system_at < length else 0
    component = frame[header + component_at] if 0 <= component_at < length else 0
    return (system, component)


@cache
def target_offsets(message_id: int) -> tuple[int, int]:
    """Where target_system and target_component stand in the payload; -1 where the message has none."""
    kind = mavlink.mavlink_map.get(message_id)
    if kind is None:
        return (-1, -1)
    at, position = {"target_system": -1, "target_component": -1}, 0
    pieces = re.findall(r"\d*[a-zA-Z]", kind.unpacker.format)
    for name, piece in zip(kind.ordered_fieldnames, pieces, strict=True):
        if name in at:
            at[name] = position
        position += struct.calcsize("<" + piece)
    return (at["target_system"], at["target_component"])


class RoutingTable(Generic[Port]):
    """Which addresses have sent at which port.

    Examples
    --------
    >>> table = RoutingTable()
    >>> table.learn("radio", (255, 190)), table.learn("bus", (1, 100)), table.learn("bus", (1, 100))
    (True, True, False)
    >>> table.destinations((1, 0), "radio", ["radio", "bus"])
    ['bus']
    >>> table.destinations((7, 0), "radio", ["radio", "bus"])
    []
    """

    _LIMIT = 256

    def __init__(self) -> None:
        self._known: dict[Port, set[Address]] = {}

    def learn(self, port: Port, address: Address) -> bool:
        """Remember that this address lives behind this port (at most 256 for one port); True if it is new."""
        known = self._known.setdefault(port, set())
        if address in known or len(known) >= self._LIMIT:
            return False
        known.add(address)
        return True

    def forget(self, port: Port) -> None:
        """Drop a port that is gone."""
        self._known.pop(port, None)

    def destinations(self, target: Address, source: Port, ports: Iterable[Port]) -> list[Port]:
        """Return the ports that get a frame for `target` that came in at `source`."""
        system, component = target
        others = [port for port in ports if port != source]
        if system == 0:
            return others
        exact = [port for port in others if self._hosts(port, system, component)]
        return exact or [port for port in others if (system, AUTOPILOT) in self._known.get(port, ())]

    def _hosts(self, port: Port, system: int, component: int) -> bool:
        known = self._known.get(port, ())
        if component == 0:
            return any(address[0] == system for address in known)
        return (system, component) in known


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
    """A sphere about the ground station outside of which nothing is heard, in either direction."""

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
        if system_id not in self._vehicles:
            return 0.0
        vehicle, home_m = self._vehicles[system_id]
        place_m = [moved + start for moved, start in zip(vehicle.true_position_m, home_m, strict=True)]
        return math.dist((0.0, 0.0, 0.0), place_m)

    def reaches(self, system_id: int) -> bool:
        """Return whether a system hears the ground station now, and is heard."""
        return self.distance_m(system_id) <= self._range_m
