"""Routing of frames by the rules of mavlink-router, and the range of a radio.

A broadcast goes to all ports except the sender's port. A frame for an address goes to the ports from which
this address has sent frames. If no frame has come from the address yet, its system's autopilot gets the
frame and can refuse it. A frame for an unknown system is dropped.
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

Port = TypeVar("Port", bound=Hashable)
Address = tuple[int, int]
"""System id and component id."""

AUTOPILOT = 1
MAGIC_2 = 0xFD


def frame_id(frame: bytes) -> int:
    """Return the message id of a frame."""
    if frame[0] == MAGIC_2:
        return frame[7] | frame[8] << 8 | frame[9] << 16
    return frame[5]


def frame_source(frame: bytes) -> Address:
    """Return the address of the sender of a frame."""
    return (frame[5], frame[6]) if frame[0] == MAGIC_2 else (frame[3], frame[4])


def frame_target(frame: bytes) -> Address:
    """Return the target address of a frame; system 0 means a broadcast.

    MAVLink 2 truncates trailing zeros of the payload, so a field beyond the payload is 0.
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
    """Return the payload offsets of target_system and target_component; -1 for a missing field."""
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
    """Routing table: the addresses behind each port.

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
        """Add an address to a port (at most 256 per port); return True if the address is new."""
        known = self._known.setdefault(port, set())
        if address in known or len(known) >= self._LIMIT:
            return False
        known.add(address)
        return True

    def forget(self, port: Port) -> None:
        """Remove a port that was closed."""
        self._known.pop(port, None)

    def destinations(self, target: Address, source: Port, ports: Iterable[Port]) -> list[Port]:
        """Return the ports that receive a frame for `target` from port `source`."""
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
    """A vehicle with its home and its true position."""

    system_id: int

    @property
    def home(self) -> GeoPoint:
        """Home position, the origin of `true_position_m`."""

    @property
    def true_position_m(self) -> tuple[float, float, float]:
        """Position relative to home: east, north, up (m)."""


class RadioRange:
    """Spherical range of the ground station's radio; outside it, no frame passes in either direction."""

    def __init__(self, range_m: float, station: GeoPoint, vehicles: Sequence[Located]) -> None:
        self._range_m = range_m
        frame = LocalFrame(station.latitude_deg, station.longitude_deg)
        self._vehicles: dict[int, tuple[Located, tuple[float, float, float]]] = {}
        for vehicle in vehicles:
            home = vehicle.home
            east_m, north_m = frame.from_wgs84(home.latitude_deg, home.longitude_deg)
            home_m = (east_m, north_m, home.altitude_m - station.altitude_m)
            self._vehicles[vehicle.system_id] = vehicle, home_m

    def distance_m(self, system_id: int) -> float:
        """Return the distance from the ground station to a vehicle (m); 0 if the system is not a vehicle."""
        if system_id not in self._vehicles:
            return 0.0
        vehicle, home_m = self._vehicles[system_id]
        place_m = [moved + start for moved, start in zip(vehicle.true_position_m, home_m, strict=True)]
        return math.dist((0.0, 0.0, 0.0), place_m)

    def reaches(self, system_id: int) -> bool:
        """Return whether a system is within range."""
        return self.distance_m(system_id) <= self._range_m
