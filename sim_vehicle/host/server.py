"""The host on the wall clock: the same components over UDP, TCP and serial lines, for many clients."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence

from numpy.random import SeedSequence

from geo.closing import Closing
from geo.processes import interrupts_noted
from mission.link.address import Link
from mission.link.codec.dialect import Message
from mission.link.codec.frames import FrameReader, FrameWriter, valid_frame_end
from mission.link.codec.signing import SETUP_SIGNING, Signing
from sim_vehicle.component import NEVER, Component, KeepsLog, SaysGoodbye, Serves, Streams
from sim_vehicle.errors import VehicleError
from sim_vehicle.faults.fault import Fault
from sim_vehicle.faults.session import FaultSession
from sim_vehicle.host.ports import Client, PortSelector, ServerUrl
from sim_vehicle.host.router import RoutingTable, frame_id, frame_source, frame_target
from sim_vehicle.host.simulation import StopReason

__all__ = ["Server", "ServerUrl"]

_LONGEST_WAIT_S = 0.5
_BURST_S = 0.02
_LARGEST_LAG_S = 0.5
_MOST_ROUTES = 20_000
_MOST_ANSWERS = 100_000


class _Local:
    """A component of ours as a port of the router."""

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
        # Peers count losses by the sequence numbers; so each link with a name has its own.
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
    """Runs components over real sockets, at a speed.

    Clients hear each other as behind mavlink-router. A client that sends garbage, stops reading or vanishes
    does the others no harm.

    Parameters
    ----------
    components : sequence of Component
        Their addresses must differ.
    urls : sequence of str or ServerUrl
        See `sim_vehicle.host.ports.open_port`; a `ServerUrl` can belong to some vehicles only.
    speed : float
        Seconds of the components' time in a second of the wall clock; infinity is as fast as it goes.
        When the machine cannot keep up, time is stretched, never skipped.
    tap : callable, optional
        ``tap(frame, now_s)`` sees every frame, sent and received.
    faults : sequence of Fault or str
        What goes wrong, see `sim_vehicle.faults.fault`; links are numbered as in ``urls``, from 1.
    seed : int or numpy.random.SeedSequence
        Of the faults.
    signing : Signing, optional
        Signs what the components send; of clients only what it accepts is received and forwarded.
    links : sequence of Link
        Links that are open already, besides the URLs; the server closes them.
    at_once : bool
        Datagrams are taken as they come (`mission.link.sockets.UdpSocket`), for who runs it with long breaks.

    Attributes
    ----------
    now_s : float
        The components' time.
    frames : int
        How many frames the components sent.
    urls : tuple of str
        The addresses with the ports that were really taken.

    Raises
    ------
    VehicleError
        If two components have one address, the speed is not positive, or a fault is wrong.
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
        urls: Sequence[str | ServerUrl],
        *,
        speed: float = 1.0,
        tap: Callable[[bytes, float], None] | None = None,
        faults: Sequence[Fault | str] = (),
        seed: int | SeedSequence = 0,
        signing: Signing | None = None,
        links: Sequence[Link] = (),
        at_once: bool = False,
    ) -> None:
        if not speed > 0.0:
            raise VehicleError(f"server: speed {speed} is not positive; 1 is real time")
        addresses = [(c.system_id, c.component_id) for c in components]
        if len(set(addresses)) < len(addresses):
            msg = f"server: two components have the same address in {addresses}; give each its own"
            raise VehicleError(msg)
        self.now_s = 0.0
        self.frames = 0
        self.speed = speed
        self._tap = tap
        self._signing = signing
        session = FaultSession(faults, seed)
        ports = [url if isinstance(url, ServerUrl) else ServerUrl(url) for url in urls]
        self._locals = [
            _Local(wrapped, signing, component, ports)
            for component, wrapped in zip(components, session.wrap(components), strict=True)
        ]
        self._table: RoutingTable[_Port] = RoutingTable()
        for local, address in zip(self._locals, addresses, strict=True):
            self._table.learn(local, address)
        self._reader = FrameReader()
        # Frames, who sent them, and the link that they are for (None: any; "": those without a name).
        self._inbox: deque[tuple[bytes, _Port, str | None]] = deque()
        self._routes: dict[tuple[_Port, int, tuple[int, int], str | None], _Route] = {}
        self._clients: list[Client] = []
        self._radios: list[Client] = []
        self._stopping = False
        self._closed = False
        self._origin_s = 0.0
        self._selector = PortSelector(ports, session, links, at_once=at_once)
        self.urls = self._selector.urls
        self._meet_clients()

    @property
    def clients(self) -> tuple[str, ...]:
        """Names of the clients that are there now."""
        return tuple(client.name for client in self._clients)

    @property
    def dropped(self) -> Counter[str]:
        """Number of datagrams dropped per address because too many waited to be received."""
        return self._selector.dropped

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Serve until a condition holds, `limit_s` seconds (of the components) passed, `stop` or Ctrl-C."""
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
        """Send messages of a component now, which nothing that it received or a deadline made it send.

        VehicleError if it is none of the server's.
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
        """End `run`; may be called from another thread."""
        self._stopping = True
        self._selector.wake()

    def close(self) -> None:
        """Let the components say goodbye and close all sockets; closing twice is fine."""
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
                    for link, messages in () if local.streams is None else local.streams.streamed():
                        self._send(local, messages, link)
            self._take_from_radios()
            self._route_all()
            self._flush()
            if self.speed == NEVER:
                return
            if time.monotonic() - began_s > _BURST_S:
                # Behind the wall clock: poll the sockets, and let time stretch rather than pile up.
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
        arrived = self._selector.wait(min(wait_s, _LONGEST_WAIT_S))
        self._meet_clients()
        if not arrived:
            return
        if self.speed != NEVER:
            clock_s = self._origin_s + self._wall_s()
            self.now_s = max(self.now_s, min(clock_s, self._deadline(), end_s))
        for client, frame in arrived:
            if self._tap is not None and frame_id(frame) != SETUP_SIGNING:  # a key is never logged
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
        """Take the bytes that leave the radios now; damaged frames of clients end here."""
        for client in self._radios:
            assert client.radio is not None
            for frame in client.radio.receive("up", self.now_s):
                if valid_frame_end(frame) == len(frame):
                    self._take(client, frame)
            for frame in client.radio.receive("down", self.now_s):
                client.send(frame)

    def _meet_clients(self) -> None:
        """Take note of who came and who went."""
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
        """Send messages, over a link only where one is given; those of a link with a name are not logged."""
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
            numbered: dict[str, bytes] = {}  # Once for each link with a name, however many peers it has
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
        """Receivers of such a message: our components that want it, and clients."""
        ports: list[_Port] = [*self._locals, *self._clients]
        if link is not None:
            ports = [port for port in ports if (port.link if isinstance(port, Client) else "") == link]
        found = [port for port in self._table.destinations(target, source, ports) if _meet(source, port)]
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


def _meet(one: _Port, other: _Port) -> bool:
    """Whether two ports share a wire: a client at a vehicle's own port meets that vehicle only."""
    if isinstance(one, _Local) and isinstance(other, _Local):
        return True
    return not one.systems or not other.systems or not one.systems.isdisjoint(other.systems)
