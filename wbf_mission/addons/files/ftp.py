"""MAVLink FTP server of a vehicle: payloads of FILE_TRANSFER_PROTOCOL, and sessions.

Layout, operations and errors are as in https://mavlink.io/en/services/ftp.html. The client chooses the
session number, as with ArduPilot. PX4's clients read this number from the answer, which repeats it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.component import NEVER
from wbf_mission.addons.files.file_tree import FileError, FileTree, FtpError, Path, path_of

MOST_DATA = 239
"""Maximum bytes of data in a packet."""
_HEADER = struct.Struct("<HBBBBBxI")
_PAYLOAD = 251
_MOST_SESSIONS = 8
_MOST_PEERS = 32
# ArduPilot ends a burst after 100 packets, so that the client can request missing packets.
_BURST = 100
_BATCH = 10
_BATCH_S = 0.005

Peer = tuple[int, int]


Operation = IntEnum(
    "Operation",
    "NONE TERMINATE RESET LIST OPEN_TO_READ READ CREATE WRITE REMOVE MAKE_DIRECTORY REMOVE_DIRECTORY "
    "OPEN_TO_WRITE TRUNCATE RENAME CHECKSUM BURST",
    start=0,
)
"""Operations of requests."""
# Operations of answers.
ACK, NAK = 128, 129


@dataclass(frozen=True, slots=True)
class Packet:
    """A request or an answer. An answer has the sequence number of the request plus 1, modulo 65536.

    >>> packet = Packet(7, 1, Operation.LIST, data=b"/")
    >>> Packet.parse(packet.payload()) == packet
    True
    """

    sequence: int
    session: int
    operation: int
    size: int = -1  # Number of bytes of data, or of the requested bytes in a read request.
    request: int = 0  # In an answer, the operation of the request.
    complete: bool = False  # Whether a burst ends with this packet, before the end of the file.
    offset: int = 0  # Offset in the file in bytes; for LIST, the index of the first entry.
    data: bytes = b""

    def __post_init__(self) -> None:
        if self.size < 0:
            object.__setattr__(self, "size", len(self.data))

    @classmethod
    def parse(cls, payload: bytes) -> Packet | None:
        """Parse a payload; return None if the payload is too short, or its size field is too large."""
        if len(payload) < _HEADER.size:
            return None
        sequence, session, operation, size, request, complete, offset = _HEADER.unpack_from(payload)
        if size > MOST_DATA:
            return None
        data = payload[_HEADER.size : _HEADER.size + size].ljust(size, b"\0")
        if operation in (Operation.READ, Operation.BURST):
            data = b""
        return cls(sequence, session, operation, size, request, bool(complete), offset, data)

    def payload(self) -> bytes:
        """Return the 251 bytes of the message's payload."""
        header = _HEADER.pack(
            self.sequence, self.session, self.operation, self.size, self.request, self.complete, self.offset
        )
        return (header + self.data).ljust(_PAYLOAD, b"\0")

    def answer(self, data: bytes = b"", *, offset: int = 0) -> Packet:
        """Return the positive answer to this request."""
        sequence = (self.sequence + 1) & 0xFFFF
        return Packet(sequence, self.session, ACK, -1, self.operation, False, offset, data)

    def refusal(self, error: FtpError) -> Packet:
        """Return the negative answer to this request, with the reason."""
        answer = self.answer(bytes([error]), offset=self.offset)
        return replace(answer, operation=NAK)

    @property
    def text(self) -> str | None:
        """The path in the data, up to the first zero byte; None if that is empty or not printable ASCII."""
        raw = self.data.split(b"\0", 1)[0]
        if not raw.isascii() or not raw.decode("ascii").isprintable():
            return None
        return raw.decode("ascii") or None


@dataclass(slots=True)
class _Session:
    """An open file: it has `contents` if it is open for reading, and a `path` if it is open for writing."""

    contents: Callable[[int], bytes | None] | None = None
    path: Path = ()
    read: bytes | None = None

    def data(self, size: int) -> bytes:
        """Return the contents: they are generated at the first read, and do not change afterwards."""
        if self.contents is None:
            raise FileError(FtpError.FAIL)
        if self.read is None:
            self.read = self.contents(size)
        if self.read is None:
            raise FileError(FtpError.FAIL)
        return self.read


@dataclass(slots=True)
class _Burst:
    """A burst read: the bytes of the file that are still to be sent."""

    request: Packet
    data: bytes
    offset: int
    sequence: int
    left: int = _BURST


class FtpServer:
    """Server that answers FILE_TRANSFER_PROTOCOL requests."""

    def __init__(self, files: FileTree) -> None:
        self._files = files
        self._sessions: dict[tuple[Peer, int], _Session] = {}
        self._bursts: dict[Peer, _Burst] = {}
        self._last: dict[Peer, tuple[Packet, Packet]] = {}
        self.due_s = NEVER
        self._operations: dict[int, Callable[[Peer, Packet], Packet]] = {
            Operation.NONE: lambda _peer, request: request.answer(),
            Operation.TERMINATE: self._terminate,
            Operation.RESET: self._reset,
            Operation.LIST: self._list,
            Operation.OPEN_TO_READ: self._open,
            Operation.READ: self._read,
            Operation.CREATE: self._create,
            Operation.OPEN_TO_WRITE: self._create,
            Operation.WRITE: self._write,
            Operation.REMOVE: self._on_path(files.remove),
            Operation.MAKE_DIRECTORY: self._on_path(files.make_directory),
            Operation.REMOVE_DIRECTORY: self._on_path(files.remove_directory),
            Operation.TRUNCATE: self._truncate,
            Operation.RENAME: self._rename,
            Operation.CHECKSUM: self._checksum,
        }

    def receive(self, message: m.MAVLink_file_transfer_protocol_message, now_s: float) -> list[Message]:
        """Answer a request; `poll` sends the packets of a burst."""
        request = Packet.parse(bytes(message.payload))
        if request is None or request.operation in (ACK, NAK):
            return []
        peer = (message.get_srcSystem(), message.get_srcComponent())
        last = self._last.get(peer)
        if last is not None and last[0] == request:
            return [_message(peer, last[1])]
        if request.operation == Operation.BURST:
            return self._begin_burst(peer, request, now_s)
        operation = self._operations.get(request.operation)
        try:
            if operation is None:
                raise FileError(FtpError.UNKNOWN_COMMAND)
            answer = operation(peer, request)
        except FileError as error:
            answer = request.refusal(error.code)
        if peer not in self._last and len(self._last) >= _MOST_PEERS:
            self._last.clear()
        self._last[peer] = (request, answer)
        return [_message(peer, answer)]

    def poll(self, now_s: float) -> list[Message]:
        """Return the burst packets that are due."""
        if now_s < self.due_s:
            return []
        messages = []
        for peer, burst in list(self._bursts.items()):
            for _ in range(_BATCH):
                packet = self._next_of(burst)
                messages.append(_message(peer, packet))
                if packet.complete or packet.operation == NAK:
                    del self._bursts[peer]
                    break
        self.due_s = now_s + _BATCH_S if self._bursts else NEVER
        return messages

    def _begin_burst(self, peer: Peer, request: Packet, now_s: float) -> list[Message]:
        try:
            data = self._session(peer, request).data(request.size or MOST_DATA)
        except FileError as error:
            return [_message(peer, request.refusal(error.code))]
        if peer not in self._bursts and len(self._bursts) >= _MOST_SESSIONS:
            return [_message(peer, request.refusal(FtpError.NO_SESSIONS))]
        self._bursts[peer] = _Burst(request, data, request.offset, request.sequence)
        self.due_s = min(self.due_s, now_s)
        return self.poll(now_s)

    @staticmethod
    def _next_of(burst: _Burst) -> Packet:
        """Return the next packet of a burst: data, or the end of the file."""
        request = replace(burst.request, sequence=burst.sequence, offset=burst.offset)
        burst.sequence = (burst.sequence + 1) & 0xFFFF
        part = burst.data[burst.offset : burst.offset + (request.size or MOST_DATA)]
        if not part:
            return request.refusal(FtpError.END_OF_FILE)
        burst.left -= 1
        answer = request.answer(part, offset=burst.offset)
        burst.offset += len(part)
        return replace(answer, complete=burst.left == 0)

    def _session(self, peer: Peer, request: Packet) -> _Session:
        session = self._sessions.get((peer, request.session))
        if session is None:
            raise FileError(FtpError.INVALID_SESSION)
        return session

    def _begin(self, peer: Peer, request: Packet, session: _Session) -> None:
        """Open a session; an older session with the same number, whose TERMINATE was lost, is replaced."""
        key = (peer, request.session)
        if key not in self._sessions and len(self._sessions) >= _MOST_SESSIONS:
            raise FileError(FtpError.NO_SESSIONS)
        self._sessions[key] = session

    def _terminate(self, peer: Peer, request: Packet) -> Packet:
        session = self._sessions.pop((peer, request.session), None)
        self._bursts.pop(peer, None)
        if session is not None and session.contents is None:
            self._files.close(session.path)
        return request.answer()

    def _reset(self, peer: Peer, request: Packet) -> Packet:
        for key in [key for key in self._sessions if key[0] == peer]:
            del self._sessions[key]
        self._bursts.pop(peer, None)
        return request.answer()

    def _list(self, _peer: Peer, request: Packet) -> Packet:
        entries = [f"{name}\0".encode("ascii") for name in self._files.names(_path(request))]
        data = b""
        for entry in entries[request.offset :]:
            if len(data) + len(entry) > MOST_DATA:
                break
            data += entry
        if not data:
            raise FileError(FtpError.END_OF_FILE)
        return request.answer(data, offset=request.offset)

    def _open(self, peer: Peer, request: Packet) -> Packet:
        session = _Session(self._files.opened(_path(request)))
        # The size of a generated file depends on the read size; assume the size that most clients use.
        size = len(session.contents(MOST_DATA) or b"") if session.contents is not None else 0
        self._begin(peer, request, session)
        return request.answer(struct.pack("<I", size))

    def _read(self, peer: Peer, request: Packet) -> Packet:
        data = self._session(peer, request).data(request.size or MOST_DATA)
        part = data[request.offset : request.offset + request.size]
        if not part:
            raise FileError(FtpError.END_OF_FILE)
        return request.answer(part, offset=request.offset)

    def _create(self, peer: Peer, request: Packet) -> Packet:
        path = self._files.create(_path(request), anew=request.operation == Operation.CREATE)
        self._begin(peer, request, _Session(path=path))
        return request.answer()

    def _write(self, peer: Peer, request: Packet) -> Packet:
        session = self._session(peer, request)
        if session.contents is not None:
            raise FileError(FtpError.FAIL)
        self._files.write(session.path, request.offset, request.data)
        return request.answer(offset=request.offset)

    def _truncate(self, _peer: Peer, request: Packet) -> Packet:
        self._files.truncate(_path(request), request.offset)
        return request.answer()

    def _rename(self, _peer: Peer, request: Packet) -> Packet:
        old, _, new = request.data.partition(b"\0")
        new = new.split(b"\0", 1)[0]
        if not (old and new and (old + new).isascii() and (old + new).decode("ascii").isprintable()):
            raise FileError(FtpError.INVALID_SIZE)
        self._files.rename(old.decode("ascii"), new.decode("ascii"))
        return request.answer()

    def _checksum(self, _peer: Peer, request: Packet) -> Packet:
        contents = self._files.opened(_path(request))(MOST_DATA) or b""
        return request.answer(struct.pack("<I", checksum(contents)))

    @staticmethod
    def _on_path(operation: Callable[[str], None]) -> Callable[[Peer, Packet], Packet]:
        def handler(_peer: Peer, request: Packet) -> Packet:
            operation(_path(request))
            return request.answer()

        return handler


def checksum(data: bytes) -> int:
    """Return the CRC32 of MAVLink FTP: initial value 0, no final inversion.

    >>> hex(checksum(b"123456789"))
    '0x2dfd2d88'
    """
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _path(request: Packet) -> str:
    text = request.text
    if text is None:
        raise FileError(FtpError.INVALID_SIZE)
    path_of(text.partition("?")[0])
    return text


def _message(peer: Peer, packet: Packet) -> Message:
    return m.MAVLink_file_transfer_protocol_message(0, *peer, list(packet.payload()))
