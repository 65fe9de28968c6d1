"""Simulated radio faults in virtual time: loss, delay, duplication, reordering and corruption of frames."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import count

import numpy as np

from mission.errors import LinkError

_BUFFER_BYTES = 16384  # Typical transmit buffer of a telemetry radio.
_BITS_A_BYTE = 10.0  # 8N1: start bit, 8 data bits, stop bit.


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults of one direction of a link."""

    loss: float = 0.0  # Probability (0 to 1) that a frame is lost.
    duplicate: float = 0.0  # Probability that a frame arrives twice.
    corrupt: float = 0.0  # Probability that one byte of a frame is changed.
    delay_s: float = 0.0  # Delay of each frame.
    jitter_s: float = 0.0  # Largest random delay added to a frame; random delays reorder frames.
    baud: float = math.inf  # Line speed (bit/s); frames that overflow a buffer of 16 KiB are lost.

    def __post_init__(self) -> None:
        for name in ("loss", "duplicate", "corrupt"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                msg = f"{name} {getattr(self, name)} is not a probability; give a number from 0 to 1"
                raise LinkError(msg)
        for name in ("delay_s", "jitter_s"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                msg = f"{name} {getattr(self, name)} is not a time; give a number of seconds, 0 or more"
                raise LinkError(msg)
        if not self.baud >= 1.0:
            raise LinkError(f"baud {self.baud} is not a line speed; give bits per second, such as 57600")


class FaultyChannel:
    """One direction of a link with faults, in the caller's time.

    Parameters
    ----------
    faults : Faults
        Faults to apply. Assigning new faults affects only frames sent afterwards.
    rng : numpy.random.Generator
        Random numbers that decide which faults affect a frame.

    Examples
    --------
    >>> channel = FaultyChannel(Faults(delay_s=0.5), np.random.default_rng(1))
    >>> channel.send(b"frame", now_s=10.0)
    >>> channel.receive(now_s=10.4), channel.next_arrival()
    ([], 10.5)
    >>> channel.receive(now_s=10.5)
    [b'frame']
    """

    def __init__(self, faults: Faults, rng: np.random.Generator) -> None:
        self.faults = faults
        self._rng = rng
        self._order = count()
        self._flying: list[tuple[float, int, bytes]] = []
        self._free_s = -math.inf

    def send(self, data: bytes, now_s: float) -> None:
        """Transmit one frame at ``now_s``."""
        faults, rng = self.faults, self._rng
        starts_s = max(now_s, self._free_s)
        if faults.baud < math.inf:
            takes_s = _BITS_A_BYTE / faults.baud
            if (starts_s - now_s) > _BUFFER_BYTES * takes_s:
                return
            self._free_s = starts_s = starts_s + len(data) * takes_s
        for _ in range(2 if rng.random() < faults.duplicate else 1):
            if rng.random() < faults.loss:
                continue
            arrives_s = starts_s + faults.delay_s + faults.jitter_s * rng.random()
            frame = self._damage(data) if rng.random() < faults.corrupt else data
            heapq.heappush(self._flying, (arrives_s, next(self._order), frame))

    def _damage(self, data: bytes) -> bytes:
        damaged = bytearray(data)
        damaged[int(self._rng.integers(len(damaged)))] ^= int(self._rng.integers(1, 256))
        return bytes(damaged)

    def receive(self, now_s: float) -> list[bytes]:
        """Return the frames that have arrived by ``now_s``."""
        arrived = []
        while self._flying and self._flying[0][0] <= now_s:
            arrived.append(heapq.heappop(self._flying)[2])
        return arrived

    def next_arrival(self) -> float | None:
        """Return the arrival time of the next frame, or None if no frame is in transit."""
        return self._flying[0][0] if self._flying else None
