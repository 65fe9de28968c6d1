"""Vehicle extras: parts that add-ons add to every simulated vehicle through entry points (`EXTRA_GROUP`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, Protocol, TypeAlias

from geo.imports import entry_points, load_entry
from mission.link.codec.dialect import Message
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink.parameters import ParameterSet
from sim_vehicle.mavlink.plan_receiver import PlanReceiver
from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["EXTRA_GROUP", "Timed", "VehicleExtra", "extras_of"]

EXTRA_GROUP = "wbf_mission.vehicle_extras"
"""Entry point group; each entry makes a `VehicleExtra` from a vehicle's state, parameters and plans."""


class Timed(Protocol):
    """Part of a vehicle that sends messages at its ``due_s``."""

    @property
    def due_s(self) -> float:
        """Time of the next `poll` that does anything (s); infinite if none."""

    def poll(self, now_s: float) -> Iterable[Message]:
        """Return the messages that are due."""


class VehicleExtra(Protocol):
    """Part of a vehicle that an add-on provides."""

    capabilities: int
    """Bits added to the capabilities in AUTOPILOT_VERSION (MAV_PROTOCOL_CAPABILITY)."""
    handlers: Mapping[int, Callable[[Any, float], Iterable[Message] | None]]
    """Message handlers by message id; a handler takes the message and the time."""
    timed: Sequence[Timed]

    def log_frame(self, frame: bytes, message_id: int, now_s: float) -> None:
        """Log a frame that the vehicle sent or received."""

    def metadata(self) -> tuple[Message, ...]:
        """Return COMPONENT_METADATA messages; empty if the extra has none."""


_Maker: TypeAlias = Callable[[WireState, ParameterSet, PlanReceiver], VehicleExtra]


@cache
def _makers() -> tuple[_Maker, ...]:
    entries = sorted(entry_points(EXTRA_GROUP), key=lambda entry: entry.name)
    return tuple(load_entry(entry, f"vehicle extra {entry.name}", VehicleError) for entry in entries)


def extras_of(state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> tuple[VehicleExtra, ...]:
    """Make the extras of a vehicle.

    Raises
    ------
    VehicleError
        If a package that provides an extra cannot be loaded.
    """
    return tuple(make(state, parameters, plans) for make in _makers())
