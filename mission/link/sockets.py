"""Links over UDP and TCP sockets, all non-blocking."""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import socket
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

from mission.errors import LinkError, LinkLostError, NoPeerError
from mission.link.address import LinkAddress
from mission.link.waiting import WaitingDatagrams

_DATAGRAM_BYTES = 65536
_BATCH = 256
_BUFFER_BYTES = 4 << 20
_REST_S = 0.1
_BACKLOG_BYTES = 1 << 20
_Peer = Any


def _why(address: LinkAddress, error: OSError) -> LinkError:
    """Turn an operating system error into one line that says what to do."""
    where = str(address)
    if isinstance(error, socket.gaierror):
        text = f"{where}: the host {address.host!r} cannot be resolved; check its name or give its address"
    elif error.errno == errno.EADDRINUSE:
        text = f"{where}: port {address.port} is in use; stop the other program or choose another port"
    elif error.errno == errno.EADDRNOTAVAIL:
        text = f"{where}: {address.host!r} is no address of this machine; bind to 127.0.0.1 or 0.0.0.0"
    elif error.errno in (errno.EACCES, errno.EPERM):
        text = f"{where}: not permitted; choose a port above 1023 and an address that is not a broadcast"
    elif isinstance(error, ConnectionRefusedError):
        text = f"{where}: connection refused; start the vehicle there first, or check the address"
        return NoPeerError(text)
    elif isinstance(error, TimeoutError):
        text = f"{where}: no answer to the connection request; check the address and the network"
        return NoPeerError(text)
    else:
        text = f"{where}: {(os.strerror(error.errno) if error.errno else str(error)).lower()}"
    return LinkError(text)


def _resolve(address: LinkAddress, kind: socket.SocketKind) -> tuple[int, Any]:
    """Return the address family and the socket address, IPv4 first."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise _why(address, socket.gaierror(str(error))) from error
    found.sort(key=lambda entry: entry[0] != socket.AF_INET)
    return found[0][0], found[0][4]


def _open(
    address: LinkAddress, kind: socket.SocketKind, prepare: Callable[[socket.socket, Any], None]
) -> socket.socket:
    """Return a non-blocking socket for an address, bound or connected by ``prepare(socket, where)``."""
    family, where = _resolve(address, kind)
    made = socket.socket(family, kind)
    try:
        made.setblocking(False)
        prepare(made, where)
    except OSError as error:
        made.close()
        raise _why(address, error) from error
    return made


class _OnSocket:
    """Base of the links on one socket."""

    def __init__(self, made: socket.socket) -> None:
        self._socket = made

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def fileno(self) -> int | None:
        """Return the descriptor, None once closed."""
        number = self._socket.fileno()
        return None if number < 0 else number

    def _bound(self, address: LinkAddress) -> LinkAddress:
        """Return an address with the port that the system chose."""
        return LinkAddress(address.scheme, address.host, int(self._socket.getsockname()[1]))


class _Datagrams(_OnSocket):
    """A socket for datagrams; `at_once` a thread takes them from the system as they come, and keeps them.

    The system keeps few (Linux: 208 KiB with its bookkeeping, some 330), which is less than a second of a
    vehicle's telemetry and images; who waits for the descriptor may be busy for longer than that.

    LinkError, and nothing stays open, if the thread cannot begin.
    """

    def __init__(self, made: socket.socket, address: LinkAddress, *, at_once: bool) -> None:
        super().__init__(made)
        self._from = address
        self._kept = WaitingDatagrams()
        self._error: OSError | None = None
        self._lock = threading.Lock()
        self._reader: _Reader | None = None
        if at_once:
            try:
                self._reader = _Reader(made, self._take, str(address))
            except OSError as error:
                made.close()
                raise _why(address, error) from error
            self._reader.start()

    def fileno(self) -> int | None:
        """Return a descriptor that is readable while there are datagrams, None once closed."""
        return super().fileno() if self._reader is None else self._reader.fileno()

    def close(self) -> None:
        """Close the socket."""
        if self._reader is not None:
            self._reader.close()
        super().close()

    @property
    def dropped(self) -> dict[str, int]:
        """How many datagrams of which address were dropped because too many were kept already."""
        with self._lock:
            return self._kept.dropped

    def _take(self) -> bool:
        """Keep the arrived data; return whether the socket can be read."""
        with self._lock:
            for data, peer in self._incoming():
                self._kept.put(data, peer)
            self._show()
            return self._error is None

    def _show(self) -> None:
        """Make the descriptor readable while there is something to take, with the lock."""
        if self._reader is not None:
            self._reader.show(bool(self._kept) or self._error is not None)

    def _incoming(self) -> Iterator[tuple[bytes, _Peer]]:
        """Take at most 256 datagrams from the system, with the lock."""
        for _ in range(_BATCH):
            try:
                yield self._socket.recvfrom(_DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except ConnectionError:
                continue
            except OSError as error:
                self._error = error
                return

    def _arrived(self) -> list[tuple[bytes, _Peer]]:
        """Return the datagrams that have arrived (at most 256 a call); LinkError if the socket fails."""
        if self._reader is not None:
            self._take()
        with self._lock:
            taken = list(self._incoming()) if self._reader is None else self._kept.take(_BATCH)
            error = None
            if not taken:
                error, self._error = self._error, None
            self._show()
        if error is not None:
            raise _why(self._from, error) from error
        return taken


class _Reader:
    """A thread that calls `take` whenever a socket is readable, and a descriptor for the kept data."""

    def __init__(self, made: socket.socket, take: Callable[[], bool], name: str) -> None:
        self._socket, self._take = made, take
        self._closing = threading.Event()
        self._ready, self._signal = socket.socketpair()
        self._stop, self._stopped = socket.socketpair()
        self._is_shown = False
        self._thread = threading.Thread(target=self._run, name=f"link {name}", daemon=True)

    def start(self) -> None:
        """Begin to take."""
        self._thread.start()

    def fileno(self) -> int | None:
        """Return the descriptor that is readable while it is shown so, None once closed."""
        number = self._ready.fileno()
        return None if number < 0 else number

    def show(self, waits: bool) -> None:
        """Make the descriptor readable, or not; the caller holds the lock of the kept data."""
        if waits and not self._is_shown:
            self._signal.send(b"\0")
        elif self._is_shown and not waits:
            self._ready.recv(1)
        self._is_shown = waits

    def close(self) -> None:
        """End the thread; closing twice is fine."""
        self._closing.set()
        with contextlib.suppress(OSError):
            self._stopped.send(b"\0")
        self._thread.join()
        for end in (self._ready, self._signal, self._stop, self._stopped):
            end.close()

    def _run(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._socket, selectors.EVENT_READ)
            selector.register(self._stop, selectors.EVENT_READ)
            while not self._closing.is_set():
                selector.select()
                if not self._take():
                    self._closing.wait(_REST_S)


def _bind_datagrams(made: socket.socket, where: Any) -> None:
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
    made.bind(where)


def _connect_datagrams(made: socket.socket, where: Any) -> None:
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
    made.connect(where)


def _listen(made: socket.socket, where: Any) -> None:
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.bind(where)
    made.listen(16)


class UdpSocket(_Datagrams):
    """A bound UDP socket that any number of peers may call; the piece that multi-client hosts build on.

    LinkError if it cannot be bound; port 0 lets the system choose. Who may be busy for long between two calls
    of `receive_from` takes datagrams `at_once`, which costs a thread and five descriptors.
    """

    def __init__(self, address: LinkAddress, *, at_once: bool = False) -> None:
        super().__init__(_open(address, socket.SOCK_DGRAM, _bind_datagrams), address, at_once=at_once)
        self.address = self._bound(address)
        self.name = str(self.address)

    def send_to(self, data: bytes, peer: _Peer) -> None:
        """Send one datagram; it is lost if the network does not take it now, as on a radio."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, peer)

    def receive_from(self) -> list[tuple[bytes, _Peer]]:
        """Return the datagrams that have arrived (at most 256 a call) with their senders."""
        return self._arrived()


class UdpInLink(UdpSocket):
    """A UDP link that waits for a caller and answers whoever called last."""

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(address, at_once=True)
        self._peer: _Peer | None = None

    def send(self, data: bytes) -> None:
        """Send to the last caller; nobody has called: drop."""
        if self._peer is not None:
            self.send_to(data, self._peer)

    def receive(self) -> list[bytes]:
        """Return the datagrams that have arrived."""
        arrived = self.receive_from()
        if arrived:
            self._peer = arrived[-1][1]
        return [data for data, _ in arrived]


class UdpOutLink(_Datagrams):
    """A UDP link that calls a host and hears only that host."""

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(_open(address, socket.SOCK_DGRAM, _connect_datagrams), address, at_once=True)
        self.name = str(address)

    def send(self, data: bytes) -> None:
        """Send one datagram; a host that is not listening yet is no error."""
        with contextlib.suppress(OSError):
            self._socket.send(data)

    def receive(self) -> list[bytes]:
        """Return the datagrams that have arrived (at most 256 a call)."""
        return [data for data, _ in self._arrived()]


class Stream(ABC):
    """Base of streams; keeps the bytes that a line does not take at once.

    Beyond ``most_bytes`` whole frames are dropped and counted in ``dropped``; what is kept goes out with the
    next `send` or `receive`.
    """

    def __init__(self, name: str, most_bytes: int) -> None:
        self.name = name
        self.dropped = 0
        self._backlog = bytearray()
        self._most_bytes = most_bytes

    def send(self, data: bytes) -> None:
        """Send one frame; LinkError once the other side has gone."""
        self._flush()
        if self._backlog and len(self._backlog) + len(data) > self._most_bytes:
            self.dropped += 1
            return
        self._backlog += data
        self._flush()

    def _flush(self) -> None:
        if not self._backlog:
            return
        try:
            del self._backlog[: self._write(self._backlog)]
        except BlockingIOError:
            pass
        except OSError as error:
            raise self._gone() from error

    @abstractmethod
    def _write(self, data: bytearray) -> int:
        """Write as much as the line takes; return the number of bytes."""

    @abstractmethod
    def _gone(self) -> LinkLostError:
        """Return the error of a line whose other side has gone."""


class TcpLink(Stream, _OnSocket):
    """A connected TCP stream."""

    def __init__(self, connection: socket.socket, name: str) -> None:
        connection.setblocking(False)
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        Stream.__init__(self, name, _BACKLOG_BYTES)
        _OnSocket.__init__(self, connection)
        self._ended = False

    @classmethod
    def connect(cls, address: LinkAddress, *, timeout_s: float = 5.0) -> TcpLink:
        """Connect to a listening host; LinkError if that fails within ``timeout_s``."""
        _resolve(address, socket.SOCK_STREAM)
        try:
            connection = socket.create_connection((address.host, address.port), timeout=timeout_s)
        except OSError as error:
            raise _why(address, error) from error
        return cls(connection, str(address))

    def _write(self, data: bytearray) -> int:
        return self._socket.send(data)

    def _gone(self) -> LinkLostError:
        return LinkLostError(f"{self.name}: the other side closed the connection; connect again")

    def receive(self) -> list[bytes]:
        """Return the pieces that have arrived; LinkError once the peer has gone and everything was read."""
        if self._ended:
            raise self._gone()
        self._flush()
        arrived: list[bytes] = []
        for _ in range(_BATCH):
            try:
                piece = self._socket.recv(_DATAGRAM_BYTES)
            except BlockingIOError:
                break
            except OSError:
                piece = b""
            if not piece:
                self._ended = True
                break
            arrived.append(piece)
        if self._ended and not arrived:
            raise self._gone()
        return arrived

    def close(self) -> None:
        """Send the kept bytes if the network takes them, and close."""
        if self._socket.fileno() >= 0:
            with contextlib.suppress(LinkError):
                self._flush()
        self._ended = True
        super().close()


class TcpListener(_OnSocket):
    """A listening TCP socket; the piece that multi-client hosts build on.

    LinkError if the port cannot be listened on; port 0 lets the system choose.
    """

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(_open(address, socket.SOCK_STREAM, _listen))
        self.address = self._bound(address)
        self.name = str(self.address)

    def accept(self) -> list[TcpLink]:
        """Return the connections that were made since the last call (at most 16)."""
        accepted: list[TcpLink] = []
        for _ in range(16):
            try:
                connection, peer = self._socket.accept()
            except OSError:
                break
            accepted.append(TcpLink(connection, f"{self.name} from {peer[0]}:{peer[1]}"))
        return accepted
