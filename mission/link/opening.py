"""Opening a link by its address; links that are opened again when they were lost."""

from __future__ import annotations

import contextlib
import errno
import selectors
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, TypeVar

from mission.errors import LinkError
from mission.link.address import SERIAL, Link, LinkAddress, parse_link_url
from mission.link.serial import SerialLink
from mission.link.sockets import TcpLink, TcpListener, UdpInLink, UdpOutLink

_RETRY_S = 1.0
_GIVE_UP_S = 5.0
_PENDING = frozenset({0, errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EALREADY})


_Link = TypeVar("_Link", bound=TcpLink | SerialLink)


class _Returning(ABC, Generic[_Link]):
    """A link whose other side may go away and come back; what is sent meanwhile is dropped."""

    def __init__(self, name: str, link: _Link | None = None) -> None:
        self.name = name
        self._link: _Link | None = link

    def send(self, data: bytes) -> None:
        """Send, or drop it while nobody is there."""
        link = self._link or self._try()
        if link is None:
            return
        try:
            link.send(data)
        except LinkError:
            self._lose()

    def receive(self) -> list[bytes]:
        """Return the pieces that have arrived; nothing while nobody is there."""
        link = self._link or self._try()
        if link is None:
            return []
        try:
            return link.receive()
        except LinkError:
            self._lose()
            return []

    def close(self) -> None:
        """Close it."""
        self._lose()

    def fileno(self) -> int | None:
        """Return the descriptor, None while there is none."""
        return None if self._link is None else self._link.fileno()

    def _lose(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    @abstractmethod
    def _try(self) -> _Link | None:
        """Open it again when it is time; None while that has not succeeded."""


class TcpServerLink(_Returning[TcpLink]):
    """A TCP link that listens and serves one client at a time; a new client replaces the old one."""

    def __init__(self, address: LinkAddress) -> None:
        self._listener = TcpListener(address)
        super().__init__(self._listener.name)

    def _try(self) -> TcpLink | None:
        for client in self._listener.accept():
            self._lose()
            self._link = client
        return self._link

    def receive(self) -> list[bytes]:
        """Return the pieces that have arrived; a client that goes away is no error."""
        self._try()
        return super().receive()

    def close(self) -> None:
        """Close the client's connection and stop listening."""
        super().close()
        self._listener.close()

    def fileno(self) -> int | None:
        """Return the client's descriptor, or the listener's while nobody is connected; None once closed."""
        return self._listener.fileno() if self._link is None else self._link.fileno()


class _Reopening(_Returning[_Link]):
    """A link that we open again when it was lost: each second, without ever blocking. It counts openings."""

    def __init__(self, address: LinkAddress, link: _Link, clock: Callable[[], float]) -> None:
        super().__init__(str(address), link)
        self.connections = 1
        self._address = address
        self._clock = clock
        self._next_s = 0.0
        self._closed = False

    def close(self) -> None:
        """Close it and stop trying."""
        self._closed = True
        super().close()

    def _lose(self) -> None:
        super()._lose()
        self._next_s = self._clock() + _RETRY_S


class TcpClientLink(_Reopening[TcpLink]):
    """A TCP link to a host that may go away and come back.

    LinkError if the first connection cannot be made in ``timeout_s``.
    """

    def __init__(
        self,
        address: LinkAddress,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(address, TcpLink.connect(address, timeout_s=timeout_s), clock)
        self._trying: socket.socket | None = None

    @property
    def connected(self) -> bool:
        """Whether the host is there."""
        return self._link is not None

    def close(self) -> None:
        """Close the connection and stop trying."""
        super().close()
        if self._trying is not None:
            self._trying.close()
            self._trying = None

    def _try(self) -> TcpLink | None:
        """Go on with the connection that is being made, or begin one when it is time."""
        now_s = self._clock()
        if self._closed:
            return None
        if self._trying is None:
            if now_s >= self._next_s:
                self._next_s = now_s + _RETRY_S
                self._begin(now_s)
            return None
        with selectors.DefaultSelector() as selector:
            selector.register(self._trying, selectors.EVENT_WRITE)
            ready = bool(selector.select(0))
        if not ready and now_s < self._deadline_s:
            return None
        trying, self._trying = self._trying, None
        if not ready or trying.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            trying.close()
            return None
        self._link = TcpLink(trying, self.name)
        self.connections += 1
        return self._link

    def _begin(self, now_s: float) -> None:
        self._deadline_s = now_s + _GIVE_UP_S
        with contextlib.suppress(OSError):
            found = socket.getaddrinfo(self._address.host, self._address.port, type=socket.SOCK_STREAM)
            found.sort(key=lambda entry: entry[0] != socket.AF_INET)
            trying = socket.socket(found[0][0], socket.SOCK_STREAM)
            trying.setblocking(False)
            if trying.connect_ex(found[0][4]) in _PENDING:
                self._trying = trying
            else:
                trying.close()


class SerialClientLink(_Reopening[SerialLink]):
    """A serial line whose device may disappear and come back, as that of a radio on USB does.

    LinkError if it cannot be opened the first time.
    """

    def __init__(self, address: LinkAddress, *, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(address, SerialLink(address), clock)

    def _try(self) -> SerialLink | None:
        now_s = self._clock()
        if self._closed or now_s < self._next_s:
            return None
        self._next_s = now_s + _RETRY_S
        with contextlib.suppress(LinkError):
            self._link = SerialLink(self._address)
            self.connections += 1
        return self._link


def open_link(url: str, *, timeout_s: float = 5.0, reconnect: bool = False) -> Link:
    """Open a link by its address.

    Parameters
    ----------
    url : str
        See `mission.link.address.parse_link_url`.
    timeout_s : float
        How long a TCP connection may take to be made.
    reconnect : bool
        A ``tcp`` link or serial line that is lost is made again as soon as the other side is there, and drops
        what is sent in between; without, it raises LinkError.

    Raises
    ------
    LinkError
        If the address is wrong, the host unknown, the port in use, the connection refused or the device
        absent.
    """
    address = parse_link_url(url)
    if address.scheme == SERIAL:
        return SerialClientLink(address) if reconnect else SerialLink(address)
    if address.scheme == "udpin":
        return UdpInLink(address)
    if address.scheme == "udpout":
        return UdpOutLink(address)
    if address.scheme == "tcpin":
        return TcpServerLink(address)
    if reconnect:
        return TcpClientLink(address, timeout_s=timeout_s)
    return TcpLink.connect(address, timeout_s=timeout_s)


__all__ = ["SerialClientLink", "TcpClientLink", "open_link"]
