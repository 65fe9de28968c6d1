"""The sockets of the server: each URL is a door, behind which any number of clients may stand."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from mission.errors import LinkError
from mission.link.frames import FrameReader
from mission.link.link import LOOPBACK, LinkAddress, parse_link_url
from mission.link.sockets import TcpLink, TcpListener, UdpSocket
from sim_vehicle.errors import VehicleError

__all__ = ["Client", "Door", "open_door"]

_DATAGRAM_BYTES = 1200
_SILENCE_S = 60.0
_MOST_PEERS = 64


class Client:
    """One peer: a stream of bytes each way.

    Frames to send are collected and go out together with `flush`, as autopilots do: fewer, larger datagrams.

    Parameters
    ----------
    name : str
        For messages.
    write : callable
        Sends bytes; LinkError when the peer has gone.
    """

    def __init__(self, name: str, write: Callable[[bytes], None]) -> None:
        self.name = name
        self.alive = True
        self.heard_s = time.monotonic()
        self._write = write
        self._outgoing = bytearray()
        self._frames: list[bytes] = []
        self._reader = FrameReader(wanted=(), tap=self._frames.append)

    def take(self, data: bytes) -> list[bytes]:
        """Take bytes that came from the peer and return the sound frames among them."""
        self._reader.feed(data)
        frames = self._frames[:]
        self._frames.clear()
        if frames:
            self.heard_s = time.monotonic()
        return frames

    def send(self, frame: bytes) -> None:
        """Put a frame on the way."""
        if len(self._outgoing) + len(frame) > _DATAGRAM_BYTES:
            self.flush()
        self._outgoing += frame

    def flush(self) -> None:
        """Send what was collected; a peer that has gone is marked so."""
        if not self._outgoing:
            return
        data = bytes(self._outgoing)
        self._outgoing.clear()
        try:
            self._write(data)
        except LinkError:
            self.alive = False


class Door(Protocol):
    """A socket with its clients.

    Attributes
    ----------
    name : str
        The address, with the port that was really taken.
    """

    name: str

    def handles(self) -> dict[int, Callable[[], list[tuple[Client, bytes]]]]:
        """Descriptors to wait for, each with what to call then: returns frames and who sent them."""

    def clients(self) -> list[Client]:
        """Return the clients that are there now."""

    def close(self) -> None:
        """Close all sockets of this door."""


class _UdpDoor:
    def __init__(self, bind: LinkAddress, peer: LinkAddress | None = None) -> None:
        self._socket = UdpSocket(bind)
        self.name = str(peer) if peer else self._socket.name
        self._peers: dict[Any, Client] = {}
        self._fixed: Any = None
        if peer is not None:
            self._fixed = (peer.host, peer.port)
            self._admit(self._fixed)

    def handles(self) -> dict[int, Callable[[], list[tuple[Client, bytes]]]]:
        number = self._socket.fileno()
        return {} if number is None else {number: self._receive}

    def clients(self) -> list[Client]:
        if len(self._peers) > (self._fixed is not None):
            oldest_s = time.monotonic() - _SILENCE_S
            for peer, client in list(self._peers.items()):
                if client.heard_s < oldest_s and peer != self._fixed:
                    client.alive = False
                    del self._peers[peer]
        return list(self._peers.values())

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
                # Only who speaks MAVLink becomes a client.
                if len(self._peers) >= _MOST_PEERS or not _speaks_mavlink(data):
                    continue
                client = self._admit(peer)
            found += [(client, frame) for frame in client.take(data)]
        return found


class _TcpDoor:
    def __init__(self, name: str, listener: TcpListener | None, links: list[TcpLink]) -> None:
        self.name = name
        self._listener = listener
        self._links: dict[TcpLink, Client] = {link: self._client(link) for link in links}

    @staticmethod
    def _client(link: TcpLink) -> Client:
        return Client(link.name, link.send)

    def handles(self) -> dict[int, Callable[[], list[tuple[Client, bytes]]]]:
        found: dict[int, Callable[[], list[tuple[Client, bytes]]]] = {}
        if self._listener is not None and (number := self._listener.fileno()) is not None:
            found[number] = self._accept
        for link in self._links:
            if (number := link.fileno()) is not None:
                found[number] = lambda link=link: self._receive(link)  # type: ignore[misc]
        return found

    def clients(self) -> list[Client]:
        for link, client in list(self._links.items()):
            if not client.alive:
                link.close()
                del self._links[link]
        return list(self._links.values())

    def close(self) -> None:
        if self._listener is not None:
            self._listener.close()
        for link in self._links:
            link.close()

    def _accept(self) -> list[tuple[Client, bytes]]:
        assert self._listener is not None
        for link in self._listener.accept():
            if len(self._links) < _MOST_PEERS:
                self._links[link] = self._client(link)
            else:
                link.close()
        return []

    def _receive(self, link: TcpLink) -> list[tuple[Client, bytes]]:
        client = self._links.get(link)
        if client is None:
            return []
        try:
            pieces = link.receive()
        except LinkError:
            client.alive = False
            return []
        return [(client, frame) for piece in pieces for frame in client.take(piece)]


def _speaks_mavlink(data: bytes) -> bool:
    reader = FrameReader(wanted=())
    reader.feed(data)
    return reader.frames > 0


def open_door(url: str) -> Door:
    """Open a socket for clients.

    Parameters
    ----------
    url : str
        ``udpin:HOST:PORT`` waits for clients, ``udpout:HOST:PORT`` sends to one (and serves whoever answers),
        ``tcpin:HOST:PORT`` waits for connections, ``tcp:HOST:PORT`` makes one. After ``udpout`` the local
        port may follow: ``udpout:127.0.0.1:14550,18570``.

    Raises
    ------
    LinkError
        If the address is wrong, in use or not reachable.
    VehicleError
        If the local port is no port.
    """
    text, comma, local = url.partition(",")
    address = parse_link_url(text)
    port = 0
    if comma:
        if address.scheme != "udpout" or not local.strip().isdigit() or int(local) > 65535:
            msg = f"{url!r}: a local port (0 to 65535) may follow udpout only"
            raise VehicleError(msg)
        port = int(local)
    if address.scheme == "udpin":
        return _UdpDoor(address)
    if address.scheme == "udpout":
        near = LOOPBACK if address.host in (LOOPBACK, "localhost") else "0.0.0.0"  # noqa: S104
        peer = LinkAddress("udpout", LOOPBACK if near == LOOPBACK else address.host, address.port)
        return _UdpDoor(LinkAddress("udpout", near, port), peer)
    if address.scheme == "tcpin":
        listener = TcpListener(address)
        return _TcpDoor(listener.name, listener, [])
    link = TcpLink.connect(address)
    return _TcpDoor(link.name, None, [link])
