"""Non-blocking links over UDP and TCP sockets."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import selectors
import socket
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from itertools import chain, islice
from typing import Any

from geo.system import steady_s
from mission.errors import LinkError, LinkLostError, NoPeerError
from mission.link.address import LinkAddress

_MOST_BYTES, _OVERHEAD_BYTES = 32 << 20, 256
"""Greatest memory of the queue (bytes), and the part of it that a datagram takes in addition to its data."""
_SHARES = 32
_OTHERS = "other senders"


class _Share:
    """Queued datagrams of one sender, each with its arrival number."""

    __slots__ = ("dropped", "held_bytes", "taken", "waiting")

    def __init__(self) -> None:
        self.waiting: deque[tuple[int, bytes, Any, _Share]] = deque()
        self.held_bytes = self.taken = self.dropped = 0


class WaitingDatagrams:
    """First-in, first-out queue of datagrams that limits the memory of each sender.

    One sender may fill the whole queue. When the queue is full, it drops the newest datagram of the sender
    with the most queued bytes, so a sender below its share of the memory (1/32) loses nothing. The first 31
    senders have a share each; all other senders have the last share together. Sender addresses can be forged,
    so a flood of new senders must not displace a vehicle: a new sender replaces only the known sender with
    the fewest delivered datagrams, and only if no datagram of that sender is still in the queue.
    """

    def __init__(self) -> None:
        self._others = _Share()
        self._shares: dict[Any, _Share] = {}
        self._arrived = self._held_bytes = 0

    def __bool__(self) -> bool:
        return self._held_bytes > 0

    @property
    def dropped(self) -> dict[str, int]:
        """Number of dropped datagrams by sender address."""
        found = {f"{peer[0]}:{peer[1]}": share.dropped for peer, share in self._shares.items()}
        found[_OTHERS] = self._others.dropped
        return {name: count for name, count in found.items() if count}

    def put(self, data: bytes, peer: Any) -> None:
        """Queue a datagram from ``peer``."""
        share = self._shares.get(peer) or self._admit(peer)
        self._arrived += 1
        share.waiting.append((self._arrived, data, peer, share))
        self._hold(share, len(data) + _OVERHEAD_BYTES)
        while self._held_bytes > _MOST_BYTES:
            greatest = max(self._others, *self._shares.values(), key=lambda share: share.held_bytes)
            greatest.dropped += 1
            self._hold(greatest, -len(greatest.waiting.pop()[1]) - _OVERHEAD_BYTES)

    def take(self, most: int) -> list[tuple[bytes, Any]]:
        """Remove and return the oldest datagrams with their senders, at most ``most``."""
        shares = (self._others, *self._shares.values())
        first = sorted(chain.from_iterable(islice(share.waiting, most) for share in shares))[:most]
        for _, data, _, share in first:
            share.waiting.popleft()
            share.taken += 1
            self._hold(share, -len(data) - _OVERHEAD_BYTES)
        return [(data, peer) for _, data, peer, _ in first]

    def _hold(self, share: _Share, more_bytes: int) -> None:
        share.held_bytes += more_bytes
        self._held_bytes += more_bytes

    def _admit(self, peer: Any) -> _Share:
        """Return the share of a new sender: its own share, or the common share of later senders."""
        if len(self._shares) >= _SHARES - 1:
            weakest = min(self._shares, key=lambda known: self._shares[known].taken)
            if self._shares[weakest].waiting:
                return self._others
            self._others.dropped += self._shares.pop(weakest).dropped
        return self._shares.setdefault(peer, _Share())


_DATAGRAM_BYTES = 65536
_BATCH = 256
_BUFFER_BYTES = 4 << 20
_REST_S = 0.1
_BACKLOG_BYTES = 1 << 20
# Largest age of a frame in a transmit buffer (s): an old command could overrule a pilot's later action.
_LONGEST_S = 3.0
_Peer = Any


def _why(address: LinkAddress, error: OSError) -> LinkError:
    """Return the LinkError for an operating system error, with advice for the user."""
    where = str(address)
    if isinstance(error, socket.gaierror):
        text = f"{where}: the host {address.host!r} cannot be resolved; check its name or give its address"
    elif error.errno == errno.EADDRINUSE:
        text = f"{where}: port {address.port} is in use; stop the other program or choose another port"
    elif error.errno == errno.EADDRNOTAVAIL:
        text = f"{where}: {address.host!r} is not an address of this machine; bind to 127.0.0.1 or 0.0.0.0"
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
    """Return the address family and the socket address of a host; IPv4 is preferred."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise _why(address, socket.gaierror(str(error))) from error
    found.sort(key=lambda entry: entry[0] != socket.AF_INET)
    return found[0][0], found[0][4]


def _open(
    address: LinkAddress, kind: socket.SocketKind, prepare: Callable[[socket.socket, Any], None]
) -> socket.socket:
    """Return a non-blocking socket that ``prepare(socket, where)`` has bound or connected to an address."""
    family, where = _resolve(address, kind)
    made = socket.socket(family, kind)
    try:
        made.setblocking(False)
        if kind == socket.SOCK_DGRAM:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        prepare(made, where)
    except OSError as error:
        made.close()
        raise _why(address, error) from error
    return made


class _OnSocket:
    """Base class of links on one socket."""

    def __init__(self, made: socket.socket) -> None:
        self._socket = made

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def fileno(self) -> int | None:
        """Return the file descriptor, or None after `close`."""
        number = self._socket.fileno()
        return None if number < 0 else number

    def _bound(self, address: LinkAddress) -> LinkAddress:
        """Return ``address`` with the port number that the system chose."""
        return LinkAddress(address.scheme, address.host, int(self._socket.getsockname()[1]))


class _Datagrams(_OnSocket):
    """UDP socket; with ``at_once``, a thread moves arriving datagrams from the kernel into a large queue.

    The kernel's buffer is small (Linux: 208 KiB including bookkeeping, about 330 datagrams): less than a
    second of a vehicle's telemetry and images. The caller may be busy for longer than a second.

    Raises LinkError, and closes the socket, if the thread's sockets cannot be created.
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
        """Return a file descriptor that is readable while datagrams are queued, or None after `close`."""
        return super().fileno() if self._reader is None else self._reader.fileno()

    def close(self) -> None:
        """Close the socket."""
        if self._reader is not None:
            self._reader.close()
        super().close()

    @property
    def dropped(self) -> dict[str, int]:
        """Number of datagrams dropped because the queue was full, by sender address."""
        with self._lock:
            return self._kept.dropped

    def _take(self) -> bool:
        """Queue the datagrams that have arrived; return False if the socket failed."""
        with self._lock:
            for data, peer in self._incoming():
                self._kept.put(data, peer)
            self._show()
            return self._error is None

    def _show(self) -> None:
        """Make the descriptor readable if a datagram or an error is pending; the caller holds the lock."""
        if self._reader is not None:
            self._reader.show(bool(self._kept) or self._error is not None)

    def _incoming(self) -> Iterator[tuple[bytes, _Peer]]:
        """Yield at most 256 datagrams from the kernel; the caller holds the lock."""
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
        """Return the arrived datagrams (at most 256 per call); raise LinkError if the socket failed."""
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
    """Thread that calls ``take`` when a socket is readable; its file descriptor signals queued data."""

    def __init__(self, made: socket.socket, take: Callable[[], bool], name: str) -> None:
        self._socket, self._take = made, take
        self._closing = threading.Event()
        self._ready, self._signal = socket.socketpair()
        self._stop, self._stopped = socket.socketpair()
        self._is_shown = False
        self._thread = threading.Thread(target=self._run, name=f"link {name}", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def fileno(self) -> int | None:
        """Return the descriptor that `show` makes readable, or None after `close`."""
        number = self._ready.fileno()
        return None if number < 0 else number

    def show(self, waits: bool) -> None:
        """Make the descriptor readable only if ``waits``; the caller holds the lock of the queue."""
        if waits and not self._is_shown:
            self._signal.send(b"\0")
        elif self._is_shown and not waits:
            self._ready.recv(1)
        self._is_shown = waits

    def close(self) -> None:
        """End the thread; a second call has no effect."""
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


def _listen(made: socket.socket, where: Any) -> None:
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.bind(where)
    made.listen(16)


class UdpSocket(_Datagrams):
    """Bound UDP socket for any number of peers.

    ``at_once`` is for callers that may be busy between two calls of `receive_from`; it costs a thread and
    five file descriptors. If the port is 0, the system chooses it. Raises LinkError if binding fails.
    """

    def __init__(self, address: LinkAddress, *, at_once: bool = False) -> None:
        super().__init__(_open(address, socket.SOCK_DGRAM, socket.socket.bind), address, at_once=at_once)
        self.address = self._bound(address)
        self.name = str(self.address)

    def send_to(self, data: bytes, peer: _Peer) -> None:
        """Send one datagram; the datagram is lost if the network does not accept it now."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, peer)

    def receive_from(self) -> list[tuple[bytes, _Peer]]:
        """Return the datagrams that have arrived (at most 256 per call) with their senders."""
        return self._arrived()


class UdpInLink(UdpSocket):
    """Bound UDP link that sends to the peer of the last received datagram."""

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(address, at_once=True)
        self._peer: _Peer | None = None

    def send(self, data: bytes) -> None:
        """Send to the last peer; drop the datagram if no peer is known."""
        if self._peer is not None:
            self.send_to(data, self._peer)

    def receive(self) -> list[bytes]:
        """Return the datagrams that have arrived."""
        arrived = self.receive_from()
        if arrived:
            self._peer = arrived[-1][1]
        return [data for data, _ in arrived]


class UdpOutLink(_Datagrams):
    """UDP link that sends to one host and receives from this host only."""

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(_open(address, socket.SOCK_DGRAM, socket.socket.connect), address, at_once=True)
        self.name = str(address)

    def send(self, data: bytes) -> None:
        """Send one datagram; a host that is not listening is not an error."""
        with contextlib.suppress(OSError):
            self._socket.send(data)

    def receive(self) -> list[bytes]:
        """Return the datagrams that have arrived (at most 256 per call)."""
        return [data for data, _ in self._arrived()]


class Stream(ABC):
    """Base class of stream links with a transmit buffer of ``most_bytes``.

    The next `send` or `receive` transmits the buffered frames. Frames that do not fit into the buffer or are
    older than three seconds are dropped whole and counted in ``dropped``.
    """

    def __init__(self, name: str, most_bytes: int) -> None:
        self.name = name
        self.dropped = 0
        # A frame waits with the time of its `send`; the rest of a partly sent frame never expires (infinity).
        self._backlog: deque[tuple[float, bytes]] = deque()
        self._backlog_bytes, self._most_bytes = 0, most_bytes

    def send(self, data: bytes) -> None:
        """Send or buffer one frame; raise LinkError if the peer has disconnected."""
        self._flush()
        if self._backlog and self._backlog_bytes + len(data) > self._most_bytes:
            self.dropped += 1
            return
        self._backlog.append((steady_s(), data))
        self._backlog_bytes += len(data)
        self._flush()

    def _flush(self) -> None:
        while self._backlog:
            sent_s, data = self._backlog[0]
            if steady_s() - sent_s > _LONGEST_S:
                self.dropped += 1
                written = len(data)
            else:
                try:
                    written = self._write(data)
                except BlockingIOError:
                    return
                except OSError as error:
                    raise self._gone() from error
            self._backlog_bytes -= written
            self._backlog.popleft()
            if written < len(data):
                self._backlog.appendleft((math.inf if written else sent_s, data[written:]))
                return

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Write bytes without blocking; return the number of bytes written."""

    @abstractmethod
    def _gone(self) -> LinkLostError:
        """Return the error for a disconnected peer."""


class TcpLink(Stream, _OnSocket):
    """Connected TCP link; ``peer`` is the address of the other side, if this side has connected."""

    def __init__(self, connection: socket.socket, name: str, peer: Any = None) -> None:
        connection.setblocking(False)
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        Stream.__init__(self, name, _BACKLOG_BYTES)
        _OnSocket.__init__(self, connection)
        self.family, self.peer = connection.family, peer
        self._ended = False

    @classmethod
    def connect(cls, address: LinkAddress, *, timeout_s: float = 5.0) -> TcpLink:
        """Connect to a listening host; raise LinkError if that fails or takes longer than ``timeout_s``."""
        _resolve(address, socket.SOCK_STREAM)
        try:
            connection = socket.create_connection((address.host, address.port), timeout=timeout_s)
            return cls(connection, str(address), connection.getpeername())
        except OSError as error:
            raise _why(address, error) from error

    def _write(self, data: bytes) -> int:
        return self._socket.send(data)

    def _gone(self) -> LinkLostError:
        return LinkLostError(f"{self.name}: the other side closed the connection; connect again")

    def receive(self) -> list[bytes]:
        """Return the arrived pieces; raise LinkError if all were read and the peer has disconnected."""
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
        """Send the buffered bytes that the network accepts now, and close the connection."""
        if self._socket.fileno() >= 0:
            with contextlib.suppress(LinkError):
                self._flush()
        self._ended = True
        super().close()


class TcpListener(_OnSocket):
    """Listening TCP socket for any number of clients; raises LinkError if the port cannot be opened."""

    def __init__(self, address: LinkAddress) -> None:
        super().__init__(_open(address, socket.SOCK_STREAM, _listen))
        self.address = self._bound(address)
        self.name = str(self.address)

    def accept(self) -> list[TcpLink]:
        """Return the new connections since the last call (at most 16)."""
        accepted: list[TcpLink] = []
        for _ in range(16):
            try:
                connection, peer = self._socket.accept()
            except OSError:
                break
            accepted.append(TcpLink(connection, f"{self.name} from {peer[0]}:{peer[1]}"))
        return accepted
