"""The `Link` interface, an in-process link, and link addresses."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from mission.errors import LinkError
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.codec.signing import Signing

LOOPBACK = "127.0.0.1"
_SCHEMES = {
    "udp": "udpin",
    "udpin": "udpin",
    "udpout": "udpout",
    "tcp": "tcp",
    "tcpout": "tcp",
    "tcpin": "tcpin",
}
SERIAL = "serial"
SERIAL_BAUD = 57600
_BAUDS = (300, 12_000_000)
_EXAMPLE = (
    "write udpin:127.0.0.1:14550, udpout:HOST:14550, tcp:127.0.0.1:5760, tcpin:127.0.0.1:5760"
    " or serial:/dev/ttyUSB0:57600"
)
_URL = re.compile(r"(?P<scheme>[A-Za-z0-9]+):(//)?(?P<host>\[[^\[\]]*\]|[^:/\[\]\s]*):(?P<port>[0-9]+)/?")


class Link(Protocol):
    """A two-way byte link that never blocks.

    ``receive`` returns whole datagrams, or pieces of a stream cut at arbitrary places. A link without a peer
    drops the data sent on it, like a radio.

    Attributes
    ----------
    name : str
        Link address, in the form that `parse_link_url` reads.
    """

    name: str

    def send(self, data: bytes) -> None:
        """Send one frame (or datagram); raise LinkError if the link has failed permanently."""

    def receive(self) -> list[bytes]:
        """Return the data received since the last call; raise LinkError if the link has failed."""

    def close(self) -> None:
        """Close the link; a second call has no effect."""

    def fileno(self) -> int | None:
        """Return the file descriptor for ``select``, or None if the link has no descriptor."""


class MemoryLink:
    """One end of an in-process link made by `memory_pair`; the data arrive complete and in order."""

    __slots__ = ("_inbox", "_open", "_peer_inbox", "name")

    def __init__(self, name: str, inbox: list[bytes], peer_inbox: list[bytes]) -> None:
        self.name = name
        self._inbox = inbox
        self._peer_inbox = peer_inbox
        self._open = True

    def send(self, data: bytes) -> None:
        """Deliver the data to the other end of the pair."""
        if not self._open:
            raise LinkError(f"{self.name}: the link is closed")
        self._peer_inbox.append(data)

    def receive(self) -> list[bytes]:
        """Return the data received since the last call."""
        if not self._inbox:
            return []
        arrived = self._inbox[:]
        self._inbox.clear()
        return arrived

    def close(self) -> None:
        """Refuse further `send` calls; data that have arrived can still be received."""
        self._open = False

    def fileno(self) -> int | None:
        """Return None: a link in memory has no file descriptor."""
        return None


def memory_pair(name: str = "memory") -> tuple[MemoryLink, MemoryLink]:
    """Return two links that are connected to each other.

    >>> ground, vehicle = memory_pair()
    >>> ground.send(b"hello")
    >>> vehicle.receive()
    [b'hello']
    """
    first: list[bytes] = []
    second: list[bytes] = []
    return MemoryLink(f"{name}:a", first, second), MemoryLink(f"{name}:b", second, first)


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """A parsed link address.

    Parameters
    ----------
    scheme : str
        ``udpin`` (bind and answer the last sender), ``udpout`` (send to a host), ``tcp`` (connect), ``tcpin``
        (listen) or ``serial``.
    host : str
        Host name or IP address; for ``serial``, the device.
    port : int
        Port number (``udpin`` and ``tcpin``: 0 for any free port); for ``serial``, the speed (bit/s).
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host and self.scheme != SERIAL else self.host
        return f"{self.scheme}:{host}:{self.port}"


def parse_link_url(url: str) -> LinkAddress:
    """Parse a link address.

    Parameters
    ----------
    url : str
        ``SCHEME:HOST:PORT`` or ``SCHEME://HOST:PORT`` with the scheme udpin (or udp), udpout, tcp (or
        tcpout) or tcpin. An empty host is the loopback address; write IPv6 addresses in brackets. For a
        serial line, ``serial:DEVICE[:BAUD]``; the default is 57600 baud.

    Raises
    ------
    LinkError
        If ``url`` is not a link address.

    Examples
    --------
    >>> parse_link_url("udpin://0.0.0.0:14540")
    LinkAddress(scheme='udpin', host='0.0.0.0', port=14540)
    >>> str(parse_link_url("tcp::5760"))
    'tcp:127.0.0.1:5760'
    >>> str(parse_link_url("serial:/dev/ttyACM0"))
    'serial:/dev/ttyACM0:57600'
    """
    text = url.strip()
    if text.lower().startswith("serial:"):
        return _parse_serial(text)
    match = _URL.fullmatch(text)
    if match is None:
        raise LinkError(f"{url!r} is not a link address; {_EXAMPLE}")
    scheme = _SCHEMES.get(match["scheme"].lower())
    if scheme is None:
        raise LinkError(f"{url!r}: unknown kind of link {match['scheme']!r}; {_EXAMPLE}")
    lowest = 0 if scheme in ("udpin", "tcpin") else 1
    digits = match["port"]
    port = int(digits) if len(digits) <= 5 else 65536
    if not lowest <= port <= 65535:
        raise LinkError(f"{url!r}: port {digits} is outside {lowest}..65535")
    return LinkAddress(scheme, match["host"].strip("[]") or LOOPBACK, port)


def _parse_serial(url: str) -> LinkAddress:
    rest = url[len("serial:") :]
    rest = rest[2:] if rest.startswith("//") else rest
    device, colon, digits = rest.rpartition(":")
    if not colon:
        device, digits = rest, str(SERIAL_BAUD)
    baud = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 8 else 0
    if not device or not _BAUDS[0] <= baud <= _BAUDS[1]:
        msg = f"{url!r} is not a serial line: write serial:DEVICE:BAUD, such as serial:/dev/ttyUSB0:57600"
        raise LinkError(msg)
    return LinkAddress(SERIAL, device, baud)


Tap = Callable[[bytes, bool], None]


class MavlinkEndpoint:
    """The sender and receiver of MAVLink messages for one component on a link.

    Parameters
    ----------
    wanted : iterable of int, optional
        Message ids that `receive` returns; None returns all. Other messages are only checked and counted.
    tap : callable, optional
        Called for each frame with its bytes, and with True for a sent or False for a received frame.
    signing : Signing, optional
        Signs sent frames and checks the signatures of received frames.

    Attributes
    ----------
    reader : FrameReader
        Decoder of received frames; holds ``wanted`` and the counters ``frames``, ``sources``, ``bad_frames``.
    system_id, component_id : int
        System and component id of sent messages.

    Examples
    --------
    >>> from mission.link.address import memory_pair
    >>> ground_link, vehicle_link = memory_pair()
    >>> ground, vehicle = MavlinkEndpoint(ground_link, 255, 190), MavlinkEndpoint(vehicle_link, 1, 1)
    >>> ground.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    >>> [(m.get_type(), m.get_srcSystem()) for m in vehicle.receive()]
    [('MISSION_REQUEST_LIST', 255)]
    """

    def __init__(
        self,
        link: Link,
        system_id: int,
        component_id: int,
        *,
        wanted: Iterable[int] | None = None,
        tap: Tap | None = None,
        signing: Signing | None = None,
    ) -> None:
        self.link = link
        self.system_id, self.component_id = system_id, component_id
        self.codec = mavlink.MAVLink(None, system_id, component_id)
        heard = None if tap is None else lambda frame: tap(frame, False)
        self.reader = FrameReader(wanted, heard, self.codec, signing=signing)
        self._writer = FrameWriter(system_id, component_id, self.codec, signing=signing)
        self._tap = tap

    def send(self, message: Message) -> None:
        """Send one message; raise LinkError if the link failed, struct.error if a field is out of range."""
        frame = self._writer.encode(message)
        self.link.send(frame)
        if self._tap is not None:
            self._tap(frame, True)

    def receive(self) -> list[Message]:
        """Return the wanted messages that have arrived; raise LinkError if the link failed."""
        return [message for data in self.link.receive() for message in self.reader.feed(data)]

    def close(self) -> None:
        """Close the link."""
        self.link.close()
