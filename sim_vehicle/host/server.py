"""Host of components on the wall clock, for clients over UDP, TCP and serial lines."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence

from numpy.random import SeedSequence

from geo.processes import interrupts_noted
from geo.system import Closing
from mission.link.address import Link
from mission.link.codec.dialect import Message
from mission.link.codec.frames import FrameReader, FrameWriter, valid_frame_end
from mission.link.codec.signing import SETUP_SIGNING, Signing
from sim_vehicle.component import NEVER, Component, KeepsLog, SaysGoodbye, Serves, Streams
from sim_vehicle.errors import VehicleError
from sim_vehicle.host.injection import AnyFault, injection
from sim_vehicle.host.ports import Client, PortSelector, ServerUrl
from sim_vehicle.host.router import RoutingTable, frame_id, frame_source, frame_target
from sim_vehicle.host.simulation import StopReason

_LONGEST_WAIT_S = 0.5
_BURST_S = 0.02
_LARGEST_LAG_S = 0.5
_MOST_ROUTES = 20_000
_MOST_ANSWERS = 100_000


class _Local:
    """A component of the server in the role of a port of the router."""

    __slots__ = ("component", "log", "streams", "systems", "wanted", "writer", "writers")

    def __init__(
        self, component: Component, signing: Signing | None, bare: Component, urls: Sequence[ServerUrl]
    ) -> None:
        log = bare if isinstance(bare, KeepsLog) else None
        serves = bare.vehicle_system_id if isinstance(bare, Serves) else bare.system_id
        self.component = component
        self.systems = frozenset((serves,))
        self.wanted = component.wanted
        self.writer = FrameWriter(component.system_id, component.component_id, signing=signing)
        # Peers count losses by sequence numbers, so the frames on each named link have their own sequence.
        links = {url.link for url in urls if url.link and (not url.systems or serves in url.systems)}
        self.writers = {
            link: FrameWriter(component.system_id, component.component_id, signing=signing) for link in links
        }
        self.streams: Streams | None = None
        if links and isinstance(bare, Streams) and isinstance(component, Streams):
            self.streams = component
            component.open_links(frozenset(links))
        self.log = log


_Port = _Local | Client
_Route = tuple[tuple[_Local, ...], tuple[Client, ...]]


class Server(Closing):
    """Host of components on real sockets.

    The server routes frames between clients as mavlink-router does. A client that sends garbage, stops
    reading or disappears does not affect the other clients.

    Parameters
    ----------
    components : sequence of Component
        Components with different addresses.
    urls : sequence of str or ServerUrl
        Addresses for `sim_vehicle.host.ports.open_port`; a `ServerUrl` can limit the vehicles at an address.
    speed : float
        Simulation time divided by wall-clock time; infinity runs as fast as possible. On a slow machine the
        simulation runs more slowly, but it skips no time.
    tap : callable, optional
        ``tap(frame, now_s)`` is called with every frame sent or received.
    faults : sequence of Fault or str
        Faults (needs the add-on); links are numbered from 1 in the order of ``urls``.
    seed : int or numpy.random.SeedSequence
        Seed of the faults.
    signing : Signing, optional
        Signature of the components' messages; client frames without a valid signature are dropped.
    links : sequence of Link
        Open links in addition to the URLs; the server closes them.
    at_once : bool
        Whether datagrams are received between calls of `run`, too (`mission.link.sockets.UdpSocket`).

    Attributes
    ----------
    now_s : float
        Simulation time.
    frames : int
        Number of frames that the components sent.
    urls : tuple of str
        Addresses with the actual port numbers.

    Raises
    ------
    VehicleError
        If two components have the same address, the speed is not positive, or a fault is invalid.
    LinkError
        If an address is invalid or in use.

    Examples
    --------
    >>> with Server([], ["tcpin:127.0.0.1:0"]) as server:
    ...     server.run(limit_s=0.01)
    <StopReason.TIME_LIMIT: 'time limit'>
    """

    def __init__(
        self,
        components: Sequence[Component],
        urls: Sequence[str | ServerUrl],
        *,
        speed: float = 1.0,
        tap: Callable[[bytes, float], None] | None = None,
        faults: Sequence[AnyFault | str] = (),
        seed: int | SeedSequence = 0,
        signing: Signing | None = None,
        links: Sequence[Link] = (),
        at_once: bool = False,
    ) -> None:
        if not speed > 0.0:
            raise VehicleError(f"server: speed {speed} is not positive; 1 is real time")
        addresses = [(c.system_id, c.component_id) for c in components]
        if len(set(addresses)) < len(addresses):
            msg = f"server: two components share an address in {addresses}; give each a different address"
            raise VehicleError(msg)
        self.now_s = 0.0
        self.frames = 0
        self.speed = speed
        self._tap = tap
        self._signing = signing
        injected = injection(faults, seed)
        ports = [url if isinstance(url, ServerUrl) else ServerUrl(url) for url in urls]
        self._locals = [
            _Local(wrapped, signing, component, ports)
            for component, wrapped in zip(components, injected.wrap(components), strict=True)
        ]
        self._table: RoutingTable[_Port] = RoutingTable()
        for local, address in zip(self._locals, addresses, strict=True):
            self._table.learn(local, address)
        self._reader = FrameReader()
        # Frames, their senders, and the link to send them on (None: all links; "": links without a name).
        self._inbox: deque[tuple[bytes, _Port, str | None]] = deque()
        self._routes: dict[tuple[_Port, int, tuple[int, int], str | None], _Route] = {}
        self._clients: list[Client] = []
        self._radios: list[Client] = []
        self._stopping = False
        self._closed = False
        self._origin_s = 0.0
        self._selector = PortSelector(ports, injected, links, at_once=at_once)
        self.urls = self._selector.urls
        self._meet_clients()

    @property
    def clients(self) -> tuple[str, ...]:
        """Names of the connected clients."""
        return tuple(client.name for client in self._clients)

    @property
    def dropped(self) -> Counter[str]:
        """Number of datagrams that were dropped because of a full receive queue, by address."""
        return self._selector.dropped

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Serve until ``until(now_s)`` is true, for `limit_s` simulated seconds, or until `stop`/Ctrl-C."""
        end_s = self.now_s + limit_s
        self._origin_s = self.now_s - self._wall_s()
        try:
            with interrupts_noted(self._selector.wake) as answer_interrupt:
                while True:
                    self._run_due(end_s)
                    answer_interrupt()
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

    def send(self, component: Component, messages: Iterable[Message]) -> None:
        """Send messages that a component did not return from `receive` or `poll`.

        Raises VehicleError if the component does not belong to the server.
        """
        address = (component.system_id, component.component_id)
        for local in self._locals:
            if (local.component.system_id, local.component.component_id) == address:
                self._send(local, messages)
                self._route_all()
                self._flush()
                return
        raise VehicleError(f"server: no component has the address {address}")

    def stop(self) -> None:
        """End `run`; this method may be called from another thread."""
        self._stopping = True
        self._selector.wake()

    def close(self) -> None:
        """Send the last messages of the components and close all sockets; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        for local in self._locals:
            if isinstance(local.component, SaysGoodbye):
                self._send(local, local.component.goodbye())
        self._route_all()
        self._flush()
        self._selector.close()

    def _wall_s(self) -> float:
        return 0.0 if self.speed == NEVER else time.monotonic() * self.speed

    def _deadline(self) -> float:
        deadline_s = min((local.component.next_deadline() for local in self._locals), default=NEVER)
        for client in self._radios:
            assert client.radio is not None
            deadline_s = min(deadline_s, client.radio.next_arrival())
        return deadline_s

    def _run_due(self, end_s: float) -> None:
        """Poll the components at all deadlines that are due, in order of time."""
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
                    for link, messages in () if local.streams is None else local.streams.streamed():
                        self._send(local, messages, link)
            self._take_from_radios()
            self._route_all()
            self._flush()
            if self.speed == NEVER:
                return
            if time.monotonic() - began_s > _BURST_S:
                # A simulation that lags behind the wall clock must still poll the sockets; slowing the clock
                # limits the lag.
                lag_s = clock_s - self.now_s - _LARGEST_LAG_S * self.speed
                self._origin_s -= max(0.0, lag_s)
                return

    def _wait(self, end_s: float) -> None:
        """Sleep until the next deadline or until data arrive, and process the data."""
        wait_s = 0.0
        if self.speed != NEVER:
            target_s = min(self._deadline(), end_s)
            wait_s = (target_s - self._origin_s - self._wall_s()) / self.speed
        elif self._deadline() == NEVER:
            wait_s = _LONGEST_WAIT_S
        arrived = self._selector.wait(min(wait_s, _LONGEST_WAIT_S))
        self._meet_clients()
        if not arrived:
            return
        if self.speed != NEVER:
            clock_s = self._origin_s + self._wall_s()
            self.now_s = max(self.now_s, min(clock_s, self._deadline(), end_s))
        for client, frame in arrived:
            if self._tap is not None and frame_id(frame) != SETUP_SIGNING:  # The tap never gets signing keys.
                self._tap(frame, self.now_s)
            if client.radio is not None:
                client.radio.send("up", frame, frame_target(frame)[0], self.now_s)
            else:
                self._take(client, frame)
                self._route_all()
        self._take_from_radios()
        self._route_all()
        self._flush()

    def _take(self, client: Client, frame: bytes) -> None:
        if self._signing is not None and not self._signing.accepts(frame, frame_id(frame)):
            return
        if self._table.learn(client, frame_source(frame)):
            self._routes.clear()
        self._inbox.append((frame, client, None))

    def _take_from_radios(self) -> None:
        """Forward the frames that arrive over faulty radios; drop damaged frames of clients."""
        for client in self._radios:
            assert client.radio is not None
            for frame in client.radio.receive("up", self.now_s):
                if valid_frame_end(frame) == len(frame):
                    self._take(client, frame)
            for frame in client.radio.receive("down", self.now_s):
                client.send(frame)

    def _meet_clients(self) -> None:
        """Update the routing for the clients that are now connected."""
        clients = self._selector.clients
        if clients is self._clients:
            return
        for client in self._clients:
            if client not in clients:
                self._table.forget(client)
        self._clients = clients
        self._radios = [client for client in clients if client.radio is not None]
        self._routes.clear()

    def _send(self, local: _Local, messages: Iterable[Message], link: str | None = None) -> None:
        """Send and log messages. If `link` is given, send them on this link only, without logging."""
        writer = local.writers[link] if link else local.writer
        for message in messages:
            frame = writer.encode(message)
            self.frames += 1
            if not link:
                if local.log is not None:
                    local.log.log_frame(frame, type(message).id, self.now_s)
                if self._tap is not None:
                    self._tap(frame, self.now_s)
            self._inbox.append((frame, local, link))

    def _route_all(self) -> None:
        inbox, routes = self._inbox, self._routes
        for _ in range(_MOST_ANSWERS):
            if not inbox:
                return
            frame, source, link = inbox.popleft()
            key = (source, frame_id(frame), frame_target(frame), link)
            route = routes.get(key)
            if route is None:
                route = self._route(*key)
                if len(routes) >= _MOST_ROUTES:
                    routes.clear()
                routes[key] = route
            locals_, clients = route
            numbered: dict[str, bytes] = {}  # The frame as renumbered for each named link.
            for client in clients:
                data = frame
                if client.link and not link and isinstance(source, _Local) and client.link in source.writers:
                    if client.link not in numbered:
                        numbered[client.link] = source.writers[client.link].renumber(frame)
                    data = numbered[client.link]
                if client.radio is not None:
                    client.radio.send("down", data, frame_source(frame)[0], self.now_s)
                else:
                    client.send(data)
            if locals_:
                for message in self._reader.feed(frame):
                    for local in locals_:
                        if local.streams is not None:
                            local.streams.link = source.link if isinstance(source, Client) else ""
                        if local.log is not None:
                            local.log.log_frame(frame, key[1], self.now_s)
                        self._send(local, local.component.receive(message, self.now_s))
        inbox.clear()

    def _route(self, source: _Port, message_id: int, target: tuple[int, int], link: str | None) -> _Route:
        """Return the components and the clients to which a message goes."""
        ports: list[_Port] = [*self._locals, *self._clients]
        if link is not None:
            ports = [port for port in ports if (port.link if isinstance(port, Client) else "") == link]
        found = [
            port for port in self._table.destinations(target, source, ports) if _are_connected(source, port)
        ]
        return (
            tuple(
                port
                for port in found
                if isinstance(port, _Local) and (port.wanted is None or message_id in port.wanted)
            ),
            tuple(port for port in found if isinstance(port, Client) and message_id != SETUP_SIGNING),
        )

    def _flush(self) -> None:
        self._selector.flush()
        self._meet_clients()


def _are_connected(source: _Port, port: _Port) -> bool:
    """Return whether frames pass between two ports; a port for one vehicle serves only this vehicle."""
    if isinstance(source, _Local) and isinstance(port, _Local):
        return True
    return not source.systems or not port.systems or not source.systems.isdisjoint(port.systems)
