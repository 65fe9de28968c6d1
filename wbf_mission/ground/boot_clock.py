"""A vehicle's own clock, which starts again with its autopilot."""

from __future__ import annotations

import math

__all__ = ["BootClock"]

_RESTART_MS = 5000
"""A report that is older than the last one by more than this is none that was late on its way."""


class BootClock:
    """Makes one clock of a vehicle's times since boot, across restarts of its autopilot.

    Attributes
    ----------
    restarts : int
        How often it started again.
    offset_ms : int
        What is added to the times that the vehicle tells now.

    Examples
    --------
    >>> clock = BootClock()
    >>> [clock.take(time_ms, now_s) for time_ms, now_s in ((90_000, 10.0), (91_000, 11.0), (200, 13.0))]
    [90000, 91000, 93000]
    >>> clock.restarts
    1
    """

    def __init__(self) -> None:
        self.restarts = 0
        self.offset_ms = 0
        self._last_ms = -1
        self._last_s = -math.inf

    def take(self, time_boot_ms: int, now_s: float) -> int:
        """Return a time since boot in milliseconds of the one clock."""
        time_ms = time_boot_ms + self.offset_ms
        if self._last_ms >= 0 and time_ms < self._last_ms - _RESTART_MS:
            self.restarts += 1
            passed_ms = max(1, round(1000.0 * (now_s - self._last_s)))
            time_ms = self._last_ms + passed_ms
            self.offset_ms = time_ms - time_boot_ms
        if time_ms >= self._last_ms:
            self._last_ms, self._last_s = time_ms, now_s
        return time_ms
