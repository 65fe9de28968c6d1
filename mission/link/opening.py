"""Opening a link by its address; serial lines; links that reopen after a loss."""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from geo.imports import load_extra
from geo.texts import one_line
from mission.errors import LinkError, LinkLostError
from mission.link.address import SERIAL, Link, LinkAddress, parse_link_url
from mission.link.sockets import Stream, TcpLink, TcpListener, UdpInLink, UdpOutLink

_RETRY_S = 1.0
_GIVE_UP_S = 5.0
_PENDING = frozenset({0, errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EALREADY})
_SERIAL_ERRORS = {
    errno.ENOENT: "there is none of that name; check the name, and that it is plugged in",
    errno.EACCES: "permission denied; add yourself to the group that it belongs to (dialout, uucp)",
    errno.EBUSY: "another program uses it; end that",
    errno.EAGAIN: "another program uses it; end that",
    errno.ENOTTY: "it is no serial device; check the name",
}
_SERIAL_BACKLOG_BYTES = 1 << 16
_SERIAL_READ_BYTES = 65536


class SerialLink(Stream):
    """A serial line, never blocking; it keeps up to 64 KiB.

    LinkError if pyserial is not installed or the device cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(str(address), _SERIAL_BACKLOG_BYTES)
        serial = load_extra("serial", "serial", f"{self.name}: serial lines need", LinkError)
        try:
            self._port: Any = serial.Serial(
                address.host, address.port, timeout=0, write_timeout=0, exclusive=True
            )
        except (OSError, ValueError) as error:
            msg = f"{self.name}: the device cannot be opened: {_serial_reason(error)}"
            raise LinkError(msg) from error

    def _write(self, data: bytearray) -> int:
        # pyserial's own write waits for a line that takes nothing, whatever its time-out.
        return os.write(self._port.fileno(), data)

    def _gone(self) -> LinkLostError:
        return LinkLostError(f"{self.name}: the device has gone; plug it in and start again")

    def receive(self) -> list[bytes]:
        """Return the bytes that have arrived; LinkError once the device has gone."""
        self._flush()
        try:
            data = self._port.read(_SERIAL_READ_BYTES)
        except (OSError, TypeError) as error:
            raise self._gone() from error
        return [data] if data else []

    def close(self) -> None:
        """Close the line."""
        with contextlib.suppress(OSError):
            self._port.close()

    def fileno(self) -> int | None:
        """Return the descriptor, None once closed."""
        return int(self._port.fileno()) if self._port.is_open else None


def _serial_reason(error: BaseException) -> str:
    """Return why a device cannot be opened, with advice; pyserial hides the system's error in texts."""
    cause: BaseException | None = error
    while cause is not None:
        number = getattr(cause, "errno", None)
        if number is None and cause.args and isinstance(cause.args[0], int):  # termios.error
            number = cause.args[0]
        if number is not None:
            why = _SERIAL_ERRORS.get(number) or f"{os.strerror(number).lower()}; check its name"
            return one_line(why)
        cause = cause.__context__
    return one_line(f"{error}; check its name and its speed")


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
