"""Ports of the server and their clients; the server has one port for each URL."""

from __future__ import annotations

import contextlib
import selectors
import socket
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from geo.system import allow_open_files
from mission.errors import LinkError
from mission.link.address import LOOPBACK, SERIAL, Link, LinkAddress, parse_link_url
from mission.link.codec.frames import FrameReader
from mission.link.opening import open_link
from mission.link.sockets import TcpLink, TcpListener, UdpSocket
from sim_vehicle.errors import VehicleError
from sim_vehicle.host.injection import Injection, Radio

_DATAGRAM_BYTES = 1200


@dataclass(frozen=True, slots=True)
class ServerUrl:
    """Address of a port of the server (`open_port`), with the vehicles and the link that the port serves.

    `systems` are the system ids of the vehicles at this address, for example of one autopilot. An empty
    set means all vehicles.
    """

    url: str
    systems: frozenset[int] = frozenset()
    link: str = ""
    """Name of the link, for vehicles that send different telemetry on different links (`Streams`)."""


class Client:
    """A peer of a port, with a stream of bytes in each direction.

    Outgoing frames are collected until `flush`; as with autopilots, datagrams are thus few but large. `radio`
    applies faults to the frames. See `ServerUrl` for `systems` and `link`.
    """

    def __init__(self, name: str, write: Callable[[bytes], None]) -> None:
        self.name = name
        self.systems: frozenset[int] = frozenset()
        self.link = ""
        self.radio: Radio | None = None
        self.alive = True
        self.last_received_s = time.monotonic()
        self._write = write
        self._outgoing = bytearray()
        self._frames: list[bytes] = []
        self._reader = FrameReader(wanted=(), tap=self._frames.append)

    def take(self, data: bytes) -> list[bytes]:
        """Process bytes from the peer and return the valid frames."""
        self._reader.feed(data)
        frames = self._frames[:]
        self._frames.clear()
        if frames:
            self.last_received_s = time.monotonic()
        return frames

    def send(self, frame: bytes) -> None:
        """Collect a frame for `flush`; send the frames before it at once if they fill a datagram."""
        if len(self._outgoing) + len(frame) > _DATAGRAM_BYTES:
            self.flush()
        self._outgoing += frame

    def flush(self) -> None:
        """Send the collected frames; set `alive` to False if the peer is gone."""
        if not self._outgoing:
            return
        data = bytes(self._outgoing)
        self._outgoing.clear()
        try:
            self._write(data)
        except LinkError:
            self.alive = False


class ReadyCallback(NamedTuple):
    """Function to call when data wait at a file descriptor."""

    owner: object
    """Owner of the descriptor, needed because the system reuses descriptor numbers."""
    receive: Callable[[], list[tuple[Client, bytes]]]
    """Reads the data, and returns the frames with their senders."""


def _received(link: Link, client: Client) -> list[tuple[Client, bytes]]:
    """Return the frames received over a client's link; if the link is lost, set `alive` to False."""
    try:
        pieces = link.receive()
    except LinkError:
        client.alive = False
        return []
    return [(client, frame) for piece in pieces for frame in client.take(piece)]


_SILENCE_S = 60.0
_MOST_PEERS = 64


class _UdpPort:
    def __init__(self, bind: LinkAddress, peer: LinkAddress | None = None, *, at_once: bool) -> None:
        self._socket = UdpSocket(bind, at_once=at_once)
        self.name = str(peer) if peer else self._socket.name
        self._peers: dict[Any, Client] = {}
        self._fixed: Any = None
        if peer is not None:
            self._fixed = (peer.host, peer.port)
            self._admit(self._fixed)

    def ready_callbacks(self) -> dict[int, ReadyCallback]:
        number = self._socket.fileno()
        return {} if number is None else {number: ReadyCallback(self._socket, self._receive)}

    def clients(self) -> list[Client]:
        if len(self._peers) > (self._fixed is not None):
            oldest_s = time.monotonic() - _SILENCE_S
            for peer, client in list(self._peers.items()):
                if client.last_received_s < oldest_s and peer != self._fixed:
                    client.alive = False
                    del self._peers[peer]
        return list(self._peers.values())

    @property
    def dropped(self) -> dict[str, int]:
        return self._socket.dropped

    def close(self) -> None:
        self._socket.close()

    def _admit(self, peer: Any) -> Client:
        client = Client(f"{self.name} {peer[0]}:{peer[1]}", lambda data: self._socket.send_to(data, peer))
        self._peers[peer] = client
        return client

    def _receive(self) -> list[tuple[Client, bytes]]:
        found: list[tuple[Client, bytes]] = []
        try:
            arrived = self._socket.receive_from()
        except LinkError:
            return found
        for data, peer in arrived:
            client = self._peers.get(peer)
            if client is None:
                # A peer becomes a client when its first MAVLink frame arrives.
                if len(self._peers) >= _MOST_PEERS or not _speaks_mavlink(data):
                    continue
                client = self._admit(peer)
            found += [(client, frame) for frame in client.take(data)]
        return found


class _TcpPort:
    def __init__(self, listener: TcpListener) -> None:
        self.name = listener.name
        self._listener = listener
        self._links: dict[TcpLink, Client] = {}

    def ready_callbacks(self) -> dict[int, ReadyCallback]:
        found: dict[int, ReadyCallback] = {}
        if (number := self._listener.fileno()) is not None:
            found[number] = ReadyCallback(self._listener, self._accept)
        for link in self._links:
            if (number := link.fileno()) is not None:
                found[number] = ReadyCallback(link, lambda link=link: self._receive(link))  # type: ignore[misc]
        return found

    def clients(self) -> list[Client]:
        for link, client in list(self._links.items()):
            if not client.alive:
                link.close()
                del self._links[link]
        return list(self._links.values())

    def close(self) -> None:
        self._listener.close()
        for link in self._links:
            link.close()

    def _accept(self) -> list[tuple[Client, bytes]]:
        for link in self._listener.accept():
            if len(self._links) < _MOST_PEERS:
                self._links[link] = Client(link.name, link.send)
            else:
                link.close()
        return []

    def _receive(self, link: TcpLink) -> list[tuple[Client, bytes]]:
        client = self._links.get(link)
        return [] if client is None else _received(link, client)


class _LinkPort:
    """A peer behind a serial line or a TCP connection, which the server opens, and reopens after a loss."""

    def __init__(self, link: Link) -> None:
        self.name = link.name
        self._link = link
        self._client = Client(link.name, link.send)
        self._socket: tuple[int, object] = (-1, None)

    def _owner(self) -> object:
        """Return the descriptor's owner, which is a new object after each reconnection."""
        made = getattr(self._link, "connections", 1)
        if self._socket[0] != made:
            self._socket = (made, object())
        return self._socket[1]

    def ready_callbacks(self) -> dict[int, ReadyCallback]:
        number = self._link.fileno() if self._client.alive else None
        return {} if number is None else {number: ReadyCallback(self._owner(), self._receive)}

    def clients(self) -> list[Client]:
        if self._client.alive and self._link.fileno() is None:
            self._receive()
        return [self._client] if self._client.alive else []

    def close(self) -> None:
        self._link.close()

    def _receive(self) -> list[tuple[Client, bytes]]:
        return _received(self._link, self._client)


ServerPort: TypeAlias = _UdpPort | _TcpPort | _LinkPort


def _speaks_mavlink(data: bytes) -> bool:
    reader = FrameReader(wanted=())
    reader.feed(data)
    return reader.frames > 0


def open_port(url: str, *, at_once: bool = False) -> ServerPort:
    """Open a port for clients.

    ``udpin:HOST:PORT`` waits for clients. ``udpout:HOST:PORT`` sends to one client and serves all peers that
    answer; a local port may follow, as in ``udpout:127.0.0.1:14550,18570``. ``tcpin:HOST:PORT`` waits for
    connections. ``tcp:HOST:PORT`` connects, and reconnects after a loss. ``serial:DEVICE:BAUD`` opens a
    serial line, and reopens it if it was lost. `at_once` is passed to `mission.link.sockets.UdpSocket`.

    Raises LinkError if the address is invalid, in use or unreachable, and VehicleError for a bad local port.
    """
    text, comma, local = url.partition(",")
    if text.strip().lower().startswith(SERIAL):
        return _LinkPort(open_link(url, reconnect=True))
    address = parse_link_url(text)
    port = 0
    if comma:
        if address.scheme != "udpout" or not local.strip().isdigit() or int(local) > 65535:
            raise VehicleError(f"{url!r}: a local port (0 to 65535) may follow udpout only")
        port = int(local)
    if address.scheme == "udpin":
        return _UdpPort(address, at_once=at_once)
    if address.scheme == "udpout":
        host = _address_of(address)
        near = LOOPBACK if host.startswith("127.") else "0.0.0.0"  # noqa: S104
        peer = LinkAddress("udpout", host, address.port)
        return _UdpPort(LinkAddress("udpout", near, port), peer, at_once=at_once)
    if address.scheme == "tcpin":
        return _TcpPort(TcpListener(address))
    return _LinkPort(open_link(text, reconnect=True))


def _address_of(address: LinkAddress) -> str:
    """Return the IPv4 address of a host; answers with this address come from the host."""
    try:
        return str(socket.getaddrinfo(address.host, address.port, socket.AF_INET, socket.SOCK_DGRAM)[0][4][0])
    except (OSError, UnicodeError) as error:
        msg = f"{address}: the host {address.host!r} has no IPv4 address; check its name"
        raise LinkError(msg) from error


_REFRESH_S = 0.5
# Number of open files besides the sockets of the URLs, for TCP peers, logs and libraries.
_FILES = 512
# Number of open files of a port with `at_once`: one socket, two socket pairs and one selector.
_AT_ONCE_FILES = 6


class PortSelector:
    """Selector over all ports of a server and their clients.

    `links` are open links, which get the numbers after the links of the URLs. `injection` makes the radios of
    the clients.

    ``clients`` is a new list after each change of clients. ``urls`` are the addresses with the actual port
    numbers. Raises LinkError if an address is invalid or in use; all sockets are closed then.
    """

    def __init__(
        self,
        urls: Sequence[ServerUrl],
        injection: Injection,
        links: Sequence[Link] = (),
        *,
        at_once: bool = False,
    ) -> None:
        self.clients: list[Client] = []
        self._injection = injection
        self._ports: list[tuple[ServerPort, ServerUrl]] = []
        self._seen: dict[int, int] = {}
        self._selector = selectors.DefaultSelector()
        self._watched: dict[int, ReadyCallback] = {}
        self._refreshed_s = 0.0
        self._wake, self._woken = socket.socketpair()
        self._woken.setblocking(False)
        self._selector.register(self._woken, selectors.EVENT_READ)
        allow_open_files(len(urls) * (_AT_ONCE_FILES if at_once else 1) + _FILES)
        try:
            for url in urls:
                self._ports.append((open_port(url.url, at_once=at_once), url))
        except BaseException:
            self.close()
            raise
        self._ports += [(_LinkPort(link), ServerUrl(link.name)) for link in links]
        self.urls = tuple(port.name for port, _ in self._ports)
        self.refresh()

    @property
    def dropped(self) -> Counter[str]:
        """Number of datagrams that were dropped because of a full receive queue, by address."""
        ports = (port for port, _ in self._ports if isinstance(port, _UdpPort))
        return sum((Counter(port.dropped) for port in ports), Counter())

    def wake(self) -> None:
        """End `wait`; this method may be called from another thread."""
        with contextlib.suppress(OSError):
            self._wake.send(b"\0")

    def wait(self, seconds: float) -> list[tuple[Client, bytes]]:
        """Wait for data for at most `seconds`; return the frames with their senders."""
        ready = self._selector.select(max(0.0, seconds))
        found: list[tuple[Client, bytes]] = []
        for key, _ in ready:
            handle = self._watched.get(key.fd)
            if handle is not None:
                found += handle.receive()
            else:
                with contextlib.suppress(OSError):
                    self._woken.recv(4096)
        if ready or time.monotonic() - self._refreshed_s > _REFRESH_S:
            self.refresh()
        return found

    def flush(self) -> None:
        """Send the collected frames to the clients."""
        for client in self.clients:
            client.flush()
        if not all(client.alive for client in self.clients):
            self.refresh()

    def refresh(self) -> None:
        """Register new clients and sockets, and remove closed ones."""
        self._refreshed_s = time.monotonic()
        found: list[Client] = []
        for number, (port, url) in enumerate(self._ports, 1):
            for client in port.clients():
                found.append(client)
                if client not in self.clients:
                    count = self._seen[number] = self._seen.get(number, -1) + 1
                    client.systems, client.link = url.systems, url.link
                    client.radio = self._injection.radio(port.name, number, count)
        if found != self.clients:
            self.clients = found
        handles = {fd: handle for port, _ in self._ports for fd, handle in port.ready_callbacks().items()}
        for fd, old in self._watched.items():
            if fd not in handles or handles[fd].owner is not old.owner:
                with contextlib.suppress(KeyError, ValueError, OSError):
                    self._selector.unregister(fd)
        for fd, new in handles.items():
            if fd not in self._watched or self._watched[fd].owner is not new.owner:
                self._selector.register(fd, selectors.EVENT_READ)
        self._watched = handles

    def close(self) -> None:
        """Close all sockets."""
        for port, _ in self._ports:
            port.close()
        self._selector.close()
        self._wake.close()
        self._woken.close()
