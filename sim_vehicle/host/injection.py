"""Radios of a host's links, and the interface for an add-on that injects faults.

The entry points of the group ``wbf_mission.faults`` name the parts of the add-on (`fault_part`). A part is
loaded only if a run has faults.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol

from numpy.random import SeedSequence

from geo.imports import load_named, loader_of
from geo.seeds import stream
from mission.link.faults import Faults, FaultyChannel
from sim_vehicle.component import NEVER, Component
from sim_vehicle.errors import VehicleError

GROUP = "wbf_mission.faults"
Direction = Literal["up", "down"]


class AnyFault(Protocol):
    """A fault that the add-on defines."""

    @property
    def vehicle(self) -> int | None:
        """System id of the affected vehicle; None for all vehicles."""


class Radio:
    """The radio of a link; "up" is the direction to the vehicle.

    `name` identifies the random streams. `faults` disturb each frame.
    """

    def __init__(self, seed: int | SeedSequence, name: str, faults: Faults) -> None:
        self._faults = faults
        self._channels = {
            direction: FaultyChannel(faults, stream(seed, "link", name, direction))
            for direction in ("up", "down")
        }

    def send(self, direction: Direction, frame: bytes, system: int, now_s: float) -> None:
        """Send a frame to or from vehicle `system` (0: all vehicles)."""
        channel = self._channels[direction]
        channel.faults = self.faults_of(direction, system, now_s)
        channel.send(frame, now_s)

    def faults_of(self, direction: Direction, system: int, now_s: float) -> Faults:
        """Return the disturbances of a frame that is sent at `now_s`."""
        return self._faults

    def receive(self, direction: Direction, now_s: float) -> list[bytes]:
        """Return the frames that have arrived."""
        return self._channels[direction].receive(now_s)

    def next_arrival(self) -> float:
        """Return the arrival time of the next frame; `NEVER` if no frame is in transit."""
        up_s, down_s = (self._channels[direction].next_arrival() for direction in ("up", "down"))
        return min(NEVER if up_s is None else up_s, NEVER if down_s is None else down_s)


class Injection:
    """Components and radios of a host without faults; a subclass in an add-on injects faults into them."""

    def __init__(self, seed: int | SeedSequence) -> None:
        self.faults: tuple[AnyFault, ...] = ()
        self.seed = seed

    def require_vehicles(self, systems: Collection[int]) -> None:
        """Raise VehicleError if a fault names a vehicle that is not among these MAVLink systems."""

    def wrap(self, components: Sequence[Component]) -> list[Component]:
        """Return the components, wrapped if faults affect them; raises VehicleError for unknown vehicles."""
        return list(components)

    def radio(self, name: str, number: int, client: int = 0, always: Faults | None = None) -> Radio | None:
        """Return the radio of a link; None if nothing disturbs the link.

        `number` counts the links of the host, from 1. `client` counts the clients of the link. Each client
        has its own random streams. `always` are the disturbances that the link has even without faults.
        """
        return None if always is None else Radio(self.seed, f"{number}.{client}", always)


def injection(faults: Sequence[AnyFault | str], seed: int | SeedSequence = 0) -> Injection:
    """Return an `Injection` of faults (objects or texts); raises VehicleError if a fault is invalid."""
    if not faults:
        return Injection(seed)
    return fault_part("session")(faults, seed)


def fault_part(name: str) -> Any:
    """Return a part of the add-on that injects faults; raises VehicleError if no add-on provides it.

    ``session`` makes an `Injection` from faults and a seed. ``Fault`` is the class of a fault. ``tables``
    reads the ``[[fault]]`` tables of a decoded file. ``kinds`` prints the kinds of faults to an `Output`.
    """
    return load_named(GROUP, name, "injects faults with", "the injection of faults:", VehicleError)


if TYPE_CHECKING:

    class Fault:
        """A fault; the docstring of the class in the add-on lists its parameters."""

        vehicle: int | None

        def __init__(
            self, kind: str, value: float | str | None = ..., *when: Any, **options: Any
        ) -> None: ...

else:
    __getattr__ = loader_of(__name__, ("Fault",), fault_part)
