"""The interface of a link, the link inside a process, and the addresses of links."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Protocol

from mission.errors import LinkError

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
    """Something that carries bytes in both directions and never blocks.

    ``receive`` returns what has arrived: whole datagrams, or pieces of a stream cut anywhere. A link
    without a peer (nobody has called yet) drops data, as a radio does.

    Attributes
    ----------
    name : str
        The link's address as the user would write it.
    """

    name: str

    def send(self, data: bytes) -> None:
        """Send one frame (or datagram); raise LinkError if the link is broken for good."""

    def receive(self) -> list[bytes]:
        """Return at once the data since the last call; LinkError if the link is broken for good."""

    def close(self) -> None:
        """Close the link; closing twice is fine."""

    def fileno(self) -> int | None:
        """Return the descriptor to wait on with ``select``, or None if there is none."""


class MemoryLink:
    """One end of a pair made by `memory_pair`: bytes arrive at the other end in order and whole."""

    __slots__ = ("_inbox", "_open", "_peer_inbox", "name")

    def __init__(self, name: str, inbox: list[bytes], peer_inbox: list[bytes]) -> None:
        self.name = name
        self._inbox = inbox
        self._peer_inbox = peer_inbox
        self._open = True

    def send(self, data: bytes) -> None:
        """Put the bytes into the other end's inbox."""
        if not self._open:
            msg = f"{self.name}: the link is closed"
            raise LinkError(msg)
        self._peer_inbox.append(data)

    def receive(self) -> list[bytes]:
        """Return and forget what has arrived."""
        if not self._inbox:
            return []
        arrived = self._inbox[:]
        self._inbox.clear()
        return arrived

    def close(self) -> None:
        """Stop sending; what has already arrived can still be received."""
        self._open = False

    def fileno(self) -> int | None:
        """Return None: there is nothing to wait on."""
        return None


def memory_pair(name: str = "memory") -> tuple[MemoryLink, MemoryLink]:
    """Make two links that are connected to each other.

    Examples
    --------
    >>> ground, vehicle = memory_pair()
    >>> ground.send(b"hello")
    >>> vehicle.receive()
    [b'hello']
    """
    one: list[bytes] = []
    other: list[bytes] = []
    return MemoryLink(f"{name}:a", one, other), MemoryLink(f"{name}:b", other, one)


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """A parsed link address.

    Parameters
    ----------
    scheme : str
        ``udpin`` (bind, talk to whoever calls), ``udpout`` (call), ``tcp`` (connect), ``tcpin`` (listen) or
        ``serial``.
    host : str
        Host name or address; the device of a serial line.
    port : int
        Port, 0 lets the system choose one for ``udpin`` and ``tcpin``; bits per second of a serial line.
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
        tcpout) or tcpin. An empty host is the loopback address; IPv6 addresses stand in brackets. Or
        ``serial:DEVICE[:BAUD]``, 57600 baud unless given.

    Raises
    ------
    LinkError
        If the text is no such address.

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
        msg = f"{url!r} is not a link address; {_EXAMPLE}"
        raise LinkError(msg)
    scheme = _SCHEMES.get(match["scheme"].lower())
    if scheme is None:
        msg = f"{url!r}: unknown kind of link {match['scheme']!r}; {_EXAMPLE}"
        raise LinkError(msg)
    lowest = 0 if scheme in ("udpin", "tcpin") else 1
    digits = match["port"]
    port = int(digits) if len(digits) <= 5 else 65536
    if not lowest <= port <= 65535:
        msg = f"{url!r}: port {digits} is outside {lowest}..65535"
        raise LinkError(msg)
    return LinkAddress(scheme, match["host"].strip("[]") or LOOPBACK, port)


def _parse_serial(url: str) -> LinkAddress:
    rest = url[len("serial:") :]
    rest = rest[2:] if rest.startswith("//") else rest
    device, colon, digits = rest.rpartition(":")
    if not colon:
        device, digits = rest, str(SERIAL_BAUD)
    baud = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 8 else 0
    if not device or not _BAUDS[0] <= baud <= _BAUDS[1]:
        msg = f"{url!r} is no serial line: write serial:DEVICE:BAUD, such as serial:/dev/ttyUSB0:57600"
        raise LinkError(msg)
    return LinkAddress(SERIAL, device, baud)
