"""Queue of received datagrams with a fair share of the memory for each sender."""

from __future__ import annotations

from collections import deque
from itertools import chain, islice
from typing import Any

_MOST_BYTES, _OVERHEAD_BYTES = 32 << 20, 256
"""Queue memory, and the bookkeeping of Python charged for each datagram (bytes)."""
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

    One sender may fill the whole queue. When the queue is full, the newest datagram of the sender with the
    most queued bytes is dropped, so a sender within its share (1/32) loses nothing. The last share holds all
    senders after the first 31. Sender addresses can be forged, so a flood of new senders must not displace a
    vehicle: a new sender replaces only the known sender with the fewest delivered datagrams, and only if none
    of that sender's datagrams is queued.
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
        """Return the share of a new sender: a share of its own, or the common share."""
        if len(self._shares) >= _SHARES - 1:
            weakest = min(self._shares, key=lambda known: self._shares[known].taken)
            if self._shares[weakest].waiting:
                return self._others
            self._others.dropped += self._shares.pop(weakest).dropped
        return self._shares.setdefault(peer, _Share())
