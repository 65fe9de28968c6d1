"""The host on the wall clock: the same components over UDP and TCP, for any number of clients."""

from __future__ import annotations

import contextlib
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType
from typing import Self

from mission.link.frames import FrameReader, FrameWriter, Message
from sim_vehicle.clients import Client, Door, open_door
from sim_vehicle.component import NEVER, Component
from sim_vehicle.errors import VehicleError
from sim_vehicle.routing import RoutingTable, frame_id, frame_source, frame_target
from sim_vehicle.simulation import StopReason

__all__ = ["Server", "default_urls"]

_LONGEST_WAIT_S = 0.5
_BURST_S = 0.02
_LARGEST_LAG_S = 0.5


def default_urls(autopilot: str, index: int = 0) -> tuple[str, ...]:
    """Return where the autopilot's own simulator would be found.

    PX4 sends to a ground station (UDP 14550, from 18570 + i) and an API (UDP 14540 + i, from 14580 + i);
    ArduPilot listens on TCP 5760 + 10 i.

    Examples
    --------
    >>> default_urls("px4")
    ('udpout:127.0.0.1:14550,18570', 'udpout:127.0.0.1:14540,14580')
    >>> default_urls("ardupilot", 1)
    ('tcpin:127.0.0.1:5770',)
    """
    if autopilot == "ardupilot":
        return (f"tcpin:127.0.0.1:{5760 + 10 * index}",)
    return (
        f"udpout:127.0.0.1:14550,{18570 + index}",
        f"udpout:127.0.0.1:{14540 + index},{14580 + index}",
    )


class _Local:
    """A component of ours as a port of the router."""

    __slots__ = ("component", "wanted", "writer")

    def __init__(self, component: Component) -> None:
        self.component = component
        self.wanted = component.wanted
        self.writer = FrameWriter(component.system_id, component.component_id)


class Server:
    """Runs components over real sockets, at a speed.

    Clients hear each other as behind mavlink-router. A client that sends garbage, stops reading or vanishes
    does the others no harm.

    Parameters
    ----------
    components : sequence of Component
        Their addresses must differ.
    urls : sequence of str
        See `sim_vehicle.clients.open_door`.
    speed : float
        Seconds of the components' time in a second of the wall clock; infinity is as fast as it goes.
        When the machine cannot keep up, time is stretched, never skipped.
    tap : callable, optional
        ``tap(frame, now_s)`` sees every frame, sent and received.

    Attributes
    ----------
    now_s : float
        The components' time.
    urls : tuple of str
        The addresses with the ports that were really taken.

    Raises
    ------
    VehicleError
        If two components have one address, or the speed is not positive.
    LinkError
        If an address is wrong or in use.

    Examples
    --------
    >>> with Server([], ["tcpin:127.0.0.1:0"]) as server:
    ...     server.run(limit_s=0.01)
    <StopReason.TIME_LIMIT: 'time limit'>
    """

    def __init__(
        self,
        components: Sequence[Component],
        urls: Sequence[str],
        *,
        speed: float = 1.0,
        tap: Callable[[bytes, float], None] | None = None,
    ) -> None:
        if not speed > 0.0:
            msg = f"server: speed {speed} is not positive; 1 is real time"
            raise VehicleError(msg)
        addresses = [(c.system_id, c.component_id) for c in components]
        if len(set(addresses)) < len(addresses):
            msg = f"server: two components have the same address in {addresses}; give each its own"
            raise VehicleError(msg)
        self.now_s = 0.0
        self.speed = speed
        self._tap = tap
        self._locals = [_Local(component) for component in components]
        self._table: RoutingTable[_Local | Client] = RoutingTable()
        for local, address in zip(self._locals, addresses, strict=True):
            self._table.heard(local, address)
        self._reader = FrameReader()
        self._inbox: deque[tuple[bytes, _Local | Client]] = deque()
        self._clients: list[Client] = []
        self._doors: list[Door] = []
        self._selector = selectors.DefaultSelector()
        self._watched: dict[int, Callable[[], list[tuple[Client, bytes]]]] = {}
        self._stopping = False
        self._wake, self._woken = socket.socketpair()
        self._woken.setblocking(False)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._origin_s = 0.0
        try:
            for url in urls:
                self._doors.append(open_door(url))
        except BaseException:
            self.close()
            raise
        self.urls = tuple(door.name for door in self._doors)
        self._look_for_clients()

    @property
    def clients(self) -> tuple[str, ...]:
        """Names of the clients that are there now."""
        return tuple(client.name for client in self._clients)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Serve until a condition holds, `limit_s` more seconds (of the components) passed, `stop` or Ctrl-C.

        Returns
        -------
        StopReason
        """
        end_s = self.now_s + limit_s
        self._origin_s = self.now_s - self._wall_s()
        try:
            while True:
                self._run_due(end_s)
                if self._stopping:
                    return StopReason.STOPPED
                if until is not None and until(self.now_s):
                    return StopReason.FINISHED
                if self.now_s >= end_s:
                    return StopReason.TIME_LIMIT
                self._wait(end_s)
        except KeyboardInterrupt:
            return StopReason.STOPPED
        finally:
            self._stopping = False

    def stop(self) -> None:
        """End `run`; may be called from another thread."""
        self._stopping = True
        with contextlib.suppress(OSError):
            self._wake.send(b"\0")

    def close(self) -> None:
        """Close all sockets."""
        for door in self._doors:
            door.close()
        self._selector.close()
        self._wake.close()
        self._woken.close()

    def _wall_s(self) -> float:
        return 0.0 if self.speed == NEVER else time.monotonic() * self.speed

    def _deadline(self) -> float:
        return min((local.component.next_deadline() for local in self._locals), default=NEVER)

    def _run_due(self, end_s: float) -> None:
        """Poll the components at each of their deadlines that has come, in order."""
        began_s = time.monotonic()
        while True:
            deadline_s = self._deadline()
            if deadline_s == end_s == NEVER:
                return
            clock_s = deadline_s if self.speed == NEVER else self._origin_s + self._wall_s()
            if min(deadline_s, end_s) > clock_s:
                self.now_s = max(self.now_s, clock_s)
                return
            if deadline_s > end_s:
                self.now_s = end_s
                return
            self.now_s = max(self.now_s, deadline_s)
            for local in self._locals:
                if local.component.next_deadline() <= self.now_s:
                    self._send(local, local.component.poll(self.now_s))
            self._route_all()
            self._flush()
            if self.speed == NEVER:
                return
            if time.monotonic() - began_s > _BURST_S:
                # Behind the wall clock: look at the sockets, and let time stretch rather than pile up.
                lag_s = clock_s - self.now_s - _LARGEST_LAG_S * self.speed
                self._origin_s -= max(0.0, lag_s)
                return

    def _wait(self, end_s: float) -> None:
        """Sleep until the next deadline or until bytes come, and handle those."""
        wait_s = 0.0
        if self.speed != NEVER:
            target_s = min(self._deadline(), end_s)
            wait_s = (target_s - self._origin_s - self._wall_s()) / self.speed
        elif self._deadline() == NEVER:
            wait_s = _LONGEST_WAIT_S
        ready = self._selector.select(max(0.0, min(wait_s, _LONGEST_WAIT_S)))
        if self.speed != NEVER and ready:
            clock_s = self._origin_s + self._wall_s()
            self.now_s = max(self.now_s, min(clock_s, self._deadline(), end_s))
        for key, _ in ready:
            handle = self._watched.get(key.fd)
            if handle is None:
                with contextlib.suppress(OSError):
                    self._woken.recv(4096)
                continue
            for client, frame in handle():
                if client not in self._clients:
                    self._clients.append(client)
                self._table.heard(client, frame_source(frame))
                if self._tap is not None:
                    self._tap(frame, self.now_s)
                self._inbox.append((frame, client))
                self._route_all()
        if ready:
            self._flush()
            self._look_for_clients()

    def _look_for_clients(self) -> None:
        """Take up new clients and sockets, and forget those that are gone."""
        found = [client for door in self._doors for client in door.clients()]
        for client in self._clients:
            if client not in found:
                self._table.forget(client)
        self._clients = found
        handles = {fd: handle for door in self._doors for fd, handle in door.handles().items()}
        for fd in self._watched.keys() - handles.keys():
            with contextlib.suppress(KeyError, ValueError, OSError):
                self._selector.unregister(fd)
        for fd in handles.keys() - self._watched.keys():
            self._selector.register(fd, selectors.EVENT_READ)
        self._watched = handles

    def _send(self, local: _Local, messages: Iterable[Message]) -> None:
        for message in messages:
            frame = local.writer.encode(message)
            if self._tap is not None:
                self._tap(frame, self.now_s)
            self._inbox.append((frame, local))

    def _route_all(self) -> None:
        inbox = self._inbox
        budget = 100_000
        while inbox and budget:
            budget -= 1
            frame, source = inbox.popleft()
            message_id = frame_id(frame)
            ports: list[_Local | Client] = [*self._locals, *self._clients]
            for port in self._table.destinations(frame_target(frame), source, ports):
                if isinstance(port, Client):
                    port.send(frame)
                elif port.wanted is None or message_id in port.wanted:
                    for message in self._reader.feed(frame):
                        self._send(port, port.component.receive(message, self.now_s))
        inbox.clear()

    def _flush(self) -> None:
        for client in self._clients:
            client.flush()
        if not all(client.alive for client in self._clients):
            self._look_for_clients()
