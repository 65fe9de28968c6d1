"""The interface of every MAVLink component: a state machine without sockets and without a clock.

The vehicle, its camera and the ground station have this one shape, so the same object runs on the virtual
clock (`sim_vehicle.host.simulation`) and over sockets (`sim_vehicle.host.server`).
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from mission.link.codec.dialect import mavlink

__all__ = ["NEVER", "UNHEARD", "Component", "KeepsLog", "SaysGoodbye", "SaysMuch", "Serves", "Streams"]

NEVER = float("inf")
"""Value of ``next_deadline`` when nothing is to be done until a message arrives."""


@runtime_checkable
class Component(Protocol):
    """One MAVLink component. Times are monotone seconds of the host's clock.

    Its system and component are the source of everything that it sends.
    """

    @property
    def system_id(self) -> int:
        """The MAVLink system, 1 to 255."""
        ...

    @property
    def component_id(self) -> int:
        """The MAVLink component, 1 to 255."""
        ...

    @property
    def wanted(self) -> frozenset[int] | None:
        """Message ids that `receive` handles, None for all; the host does not parse others. Read once."""
        ...

    def receive(self, message: mavlink.MAVLink_message, now_s: float) -> list[mavlink.MAVLink_message]:
        """Take one message and return the messages to send. A bad message is ignored, never raised."""
        ...

    def poll(self, now_s: float) -> list[mavlink.MAVLink_message]:
        """Advance to `now_s` (timers, physics, telemetry) and return the messages to send."""
        ...

    def next_deadline(self) -> float:
        """When `poll` should be called next: monotone seconds, `NEVER` for only after a message."""
        ...


@runtime_checkable
class SaysGoodbye(Protocol):
    """A component that has something to say when its host ends."""

    def goodbye(self) -> list[mavlink.MAVLink_message]:
        """Messages to send last."""
        ...


@runtime_checkable
class KeepsLog(Protocol):
    """A component that keeps a log which peers can ask it for; the server hands it its frames."""

    def log_frame(self, frame: bytes, message_id: int, now_s: float) -> None:
        """Take a frame that the component sent or heard."""
        ...


@runtime_checkable
class Serves(Protocol):
    """A component that is there for one vehicle, which is not its own system: it meets that one only."""

    @property
    def vehicle_system_id(self) -> int:
        """The vehicle's MAVLink system."""
        ...


UNHEARD: Any = object()
"""In the place of a message of a `SaysMuch` that nobody listens to; it counts as a frame."""


@runtime_checkable
class SaysMuch(Protocol):
    """A component of many messages, which need not make those that nobody listens to."""

    def only_heard(self, message_ids: frozenset[int] | None) -> None:
        """Make messages of these ids only, of others `UNHEARD`; None is all. Answers are always made."""
        ...


@runtime_checkable
class Streams(Protocol):
    """A component whose telemetry differs between links."""

    link: str
    """Name of the link that the next message comes from; empty for any without a name."""

    def open_links(self, names: frozenset[str]) -> None:
        """Stream on these links, too: telemetry is in `streamed` from now on, no longer in `poll`."""
        ...

    def streamed(self) -> list[tuple[str, list[mavlink.MAVLink_message]]]:
        """Return each link's telemetry that is due at the time of the last `poll`."""
        ...
