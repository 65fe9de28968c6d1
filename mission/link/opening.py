"""Opening a link by its address, serial links, and links that reconnect."""

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

_RETRY_S = 1.0  # Interval of reconnection attempts.
_GIVE_UP_S = 5.0  # Timeout of one reconnection attempt.
_PENDING = frozenset({0, errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EALREADY})
_SERIAL_ERRORS = {
    errno.ENOENT: "no device has that name; check the name, and that the device is plugged in",
    errno.EACCES: "permission denied; add yourself to the group of the device (dialout, uucp)",
    errno.EBUSY: "another program uses the device; end that program",
    errno.EAGAIN: "another program uses the device; end that program",
    errno.ENOTTY: "this is not a serial device; check the name",
}
_SERIAL_BACKLOG_BYTES = 1 << 16
_SERIAL_READ_BYTES = 65536


class SerialLink(Stream):
    """Non-blocking serial link with a transmit buffer of 64 KiB.

    Raises LinkError if pyserial is not installed or the device cannot be opened.
    """

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(str(address), _SERIAL_BACKLOG_BYTES)
        serial = load_extra("serial", "serial", f"{self.name}: serial lines need", LinkError)
        try:
            self._port: Any = serial.Serial(
                address.host, address.port, timeout=0, write_timeout=0, exclusive=True
            )
        except (OSError, ValueError) as error:
            raise LinkError(f"{self.name}: the device cannot be opened: {_serial_reason(error)}") from error

    def _write(self, data: bytes) -> int:
        # Serial.write blocks while the line accepts no bytes, even with write_timeout=0.
        return os.write(self._port.fileno(), data)

    def _gone(self) -> LinkLostError:
        return LinkLostError(f"{self.name}: the device was unplugged; plug it in and start again")

    def receive(self) -> list[bytes]:
        """Return the bytes that have arrived; raise LinkError if the device was removed."""
        self._flush()
        try:
            data = self._port.read(_SERIAL_READ_BYTES)
        except (OSError, TypeError) as error:
            raise self._gone() from error
        return [data] if data else []

    def close(self) -> None:
        """Close the serial port."""
        with contextlib.suppress(OSError):
            self._port.close()

    def fileno(self) -> int | None:
        """Return the file descriptor, or None after `close`."""
        return int(self._port.fileno()) if self._port.is_open else None


def _serial_reason(error: BaseException) -> str:
    """Return the reason why a device cannot be opened, by the error number in the chain of exceptions."""
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
    """Link that reconnects after a disconnection; data sent while disconnected are dropped."""

    def __init__(self, name: str, link: _Link | None = None) -> None:
        self.name = name
        self._link: _Link | None = link

    def send(self, data: bytes) -> None:
        """Send ``data``, or drop the data while disconnected."""
        link = self._link or self._try()
        if link is None:
            return
        try:
            link.send(data)
        except LinkError:
            self._lose()

    def receive(self) -> list[bytes]:
        """Return the pieces that have arrived, or an empty list while disconnected."""
        link = self._link or self._try()
        if link is None:
            return []
        try:
            return link.receive()
        except LinkError:
            self._lose()
            return []

    def close(self) -> None:
        """Close the connection."""
        self._lose()

    def fileno(self) -> int | None:
        """Return the file descriptor, or None while disconnected."""
        return None if self._link is None else self._link.fileno()

    def _lose(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    @abstractmethod
    def _try(self) -> _Link | None:
        """Try to reconnect if an attempt is due; return the connection, or None while disconnected."""


class TcpServerLink(_Returning[TcpLink]):
    """Listening TCP link for one client at a time; a new client replaces the current client."""

    def __init__(self, address: LinkAddress) -> None:
        self._listener = TcpListener(address)
        super().__init__(self._listener.name)

    def _try(self) -> TcpLink | None:
        for client in self._listener.accept():
            self._lose()
            self._link = client
        return self._link

    def receive(self) -> list[bytes]:
        """Return the pieces that have arrived; a disconnected client is not an error."""
        self._try()
        return super().receive()

    def close(self) -> None:
        """Close the client's connection and stop listening."""
        super().close()
        self._listener.close()

    def fileno(self) -> int | None:
        """Return the file descriptor of the client, or the listener's if there is no client.

        After `close`, return None.
        """
        return self._listener.fileno() if self._link is None else self._link.fileno()


class _Reopening(_Returning[_Link]):
    """Link that tries to reconnect each second, without blocking; counts its connections."""

    def __init__(self, address: LinkAddress, link: _Link, clock: Callable[[], float]) -> None:
        super().__init__(str(address), link)
        self.connections = 1
        self._address = address
        self._clock = clock
        self._next_s = 0.0
        self._closed = False

    def close(self) -> None:
        """Close the link and stop reconnecting."""
        self._closed = True
        super().close()

    def _lose(self) -> None:
        super()._lose()
        self._next_s = self._clock() + _RETRY_S


class TcpClientLink(_Reopening[TcpLink]):
    """TCP client link that reconnects; raises LinkError if the first connection fails."""

    def __init__(
        self,
        address: LinkAddress,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        link = TcpLink.connect(address, timeout_s=timeout_s)
        # A name is resolved only once: that may take seconds, in which a flight would stand still.
        self._family, self._peer = link.family, link.peer
        super().__init__(address, link, clock)
        self._trying: socket.socket | None = None

    @property
    def connected(self) -> bool:
        """Whether the TCP connection is established."""
        return self._link is not None

    def close(self) -> None:
        """Close the connection and stop reconnecting."""
        super().close()
        if self._trying is not None:
            self._trying.close()
            self._trying = None

    def _try(self) -> TcpLink | None:
        """Check the connection attempt in progress, or start a new attempt if one is due."""
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
            trying = socket.socket(self._family, socket.SOCK_STREAM)
            trying.setblocking(False)
            if trying.connect_ex(self._peer) in _PENDING:
                self._trying = trying
            else:
                trying.close()


class SerialClientLink(_Reopening[SerialLink]):
    """Serial link that reopens a device that was unplugged; raises LinkError if the first attempt fails."""

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
        Timeout of a TCP connection (s).
    reconnect : bool
        Whether a lost ``tcp`` or serial link reconnects, dropping the data sent while disconnected. If False,
        a lost link raises LinkError.

    Raises
    ------
    LinkError
        If the address is wrong, the host is unknown, the port is in use, the connection is refused, or there
        is no such device.
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
