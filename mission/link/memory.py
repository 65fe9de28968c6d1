"""A link inside the process: what one end sends, the other receives, in order and whole."""

from __future__ import annotations

from mission.errors import LinkError


class MemoryLink:
    """One end of a pair made by `memory_pair`."""

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
