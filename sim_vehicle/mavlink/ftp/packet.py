"""The payload of FILE_TRANSFER_PROTOCOL.

Layout, operations and errors: https://mavlink.io/en/services/ftp.html.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from enum import IntEnum

__all__ = ["MOST_DATA", "FtpError", "Operation", "Packet"]

MOST_DATA = 239
"""Bytes of data that a packet holds."""
_HEADER = struct.Struct("<HBBBBBxI")
_PAYLOAD = 251


class Operation(IntEnum):
    """What a request asks for, and the two kinds of answers."""

    NONE = 0
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN_TO_READ = 4
    READ = 5
    CREATE = 6
    WRITE = 7
    REMOVE = 8
    MAKE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_TO_WRITE = 11
    TRUNCATE = 12
    RENAME = 13
    CHECKSUM = 14
    BURST = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """Why a request was not carried out."""

    FAIL = 1
    INVALID_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    PROTECTED = 9
    NOT_FOUND = 10


@dataclass(frozen=True, slots=True)
class Packet:
    """A request or an answer.

    Parameters
    ----------
    sequence : int
        Number of the packet, modulo 65536; an answer has that of its request plus one.
    session, operation, size : int
        ``size`` is that of the data, and in requests to read what is asked for.
    request : int
        The operation that an answer is to.
    complete : bool
        The last packet of a burst that ends before the file.
    offset : int
        In bytes; in a list the number of the first entry.
    data : bytes
        At most 239.

    Examples
    --------
    >>> packet = Packet(7, 1, Operation.LIST, data=b"/")
    >>> Packet.parse(packet.payload()) == packet
    True
    """

    sequence: int
    session: int
    operation: int
    size: int = -1
    request: int = 0
    complete: bool = False
    offset: int = 0
    data: bytes = b""

    def __post_init__(self) -> None:
        if self.size < 0:
            object.__setattr__(self, "size", len(self.data))

    @classmethod
    def parse(cls, payload: bytes) -> Packet | None:
        """Read a payload; None when it is too short or says that it holds more than it can."""
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
        """The bytes of the message's payload, 251 of them."""
        header = _HEADER.pack(
            self.sequence, self.session, self.operation, self.size, self.request, self.complete, self.offset
        )
        return (header + self.data).ljust(_PAYLOAD, b"\0")

    def answer(self, data: bytes = b"", *, offset: int = 0) -> Packet:
        """The answer that says it was done."""
        sequence = (self.sequence + 1) & 0xFFFF
        return Packet(sequence, self.session, Operation.ACK, -1, self.operation, False, offset, data)

    def refusal(self, error: FtpError) -> Packet:
        """The answer that says why it was not done."""
        answer = self.answer(bytes([error]), offset=self.offset)
        return replace(answer, operation=int(Operation.NAK))

    @property
    def text(self) -> str | None:
        """The path in the data, up to the first zero; None when it is empty or not plain text."""
        raw = self.data.split(b"\0", 1)[0]
        if not raw.isascii() or not raw.decode("ascii").isprintable():
            return None
        return raw.decode("ascii") or None
