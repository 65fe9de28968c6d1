"""Interface of a MAVLink component: a state machine without sockets and without a clock.

Vehicle, camera and ground station implement this interface. The same object runs on the virtual clock
(`sim_vehicle.host.simulation`) and over sockets (`sim_vehicle.host.server`).
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from mission.link.codec.dialect import mavlink

NEVER = float("inf")
"""Value of ``next_deadline`` for a component that only reacts to messages."""


@runtime_checkable
class Component(Protocol):
    """A MAVLink component; its host sends the messages that `receive` and `poll` return.

    Times are seconds of the host's monotonic clock.
    """

    @property
    def system_id(self) -> int:
        """MAVLink system id, 1 to 255."""
        ...

    @property
    def component_id(self) -> int:
        """MAVLink component id, 1 to 255."""
        ...

    @property
    def wanted(self) -> frozenset[int] | None:
        """IDs of the messages that the host parses for `receive`; None for all. The host reads them once."""
        ...

    def receive(self, message: mavlink.MAVLink_message, now_s: float) -> list[mavlink.MAVLink_message]:
        """Process a message and return the messages to send; an invalid message is ignored."""
        ...

    def poll(self, now_s: float) -> list[mavlink.MAVLink_message]:
        """Advance to `now_s` (timers, physics, telemetry) and return the messages to send."""
        ...

    def next_deadline(self) -> float:
        """Return the time of the next `poll` (s); `NEVER` if no poll is due before a message arrives."""
        ...


@runtime_checkable
class SaysGoodbye(Protocol):
    """A component that sends messages when its host stops."""

    def goodbye(self) -> list[mavlink.MAVLink_message]:
        """Return the messages to send before the host stops."""
        ...


@runtime_checkable
class KeepsLog(Protocol):
    """A component with a log for download; the server passes the frames to the log."""

    def log_frame(self, frame: bytes, message_id: int, now_s: float) -> None:
        """Log a frame that the component sent or received."""
        ...


@runtime_checkable
class Serves(Protocol):
    """A component with its own system id that exchanges messages with one vehicle only."""

    @property
    def vehicle_system_id(self) -> int:
        """MAVLink system id of the vehicle."""
        ...


UNHEARD: Any = object()
"""Placeholder for a message to which nobody listens (see `SaysMuch`); the host counts it as a frame."""


@runtime_checkable
class SaysMuch(Protocol):
    """A component that can leave out messages to which nobody listens."""

    def only_heard(self, message_ids: frozenset[int] | None) -> None:
        """Build only messages with these IDs (None: all); return `UNHEARD` in place of other messages."""
        ...


@runtime_checkable
class Streams(Protocol):
    """A component with different telemetry on different links."""

    link: str
    """Name of the link from which the next message comes; empty for a link without a name."""

    def open_links(self, names: frozenset[str]) -> None:
        """Add links for streaming; from then on `streamed` returns the telemetry, and `poll` does not."""
        ...

    def streamed(self) -> list[tuple[str, list[mavlink.MAVLink_message]]]:
        """Return, for each link, the telemetry that is due at the time of the last `poll`."""
        ...
