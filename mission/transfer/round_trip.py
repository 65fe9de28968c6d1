"""Round trip time and frame loss of a link, with the timeouts and repetitions derived from both."""

from __future__ import annotations

import math

_GAIN = 0.125  # Smoothing factor of TCP (RFC 6298).
_SLOW = 1.1  # Shortest timeout, in round trip times.
_FAILS = 0.01  # Accepted probability that all copies of a message are lost.
_MOST_COPIES = 4  # Limits the extra traffic.
_SURE_LOSS = 0.02  # A smaller measured loss may be due to chance.


class RoundTrip:
    """Smoothed round trip time and frame loss of a link, shared by all transfers on the link.

    Attributes
    ----------
    seconds : float or None
        Smoothed round trip time (s), or None before the first measurement.
    loss : float
        Measured fraction of lost frames.

    Examples
    --------
    >>> trip = RoundTrip()
    >>> trip.wait(0.25, 0.1, 1.5)
    0.25
    >>> trip.sample(0.2)
    >>> trip.wait(0.25, 0.1, 1.5)
    0.8
    >>> trip.sample(34.2)
    >>> round(trip.seconds, 3), round(trip.wait(0.25, 0.1, 1.5), 3)
    (4.45, 4.895)
    """

    __slots__ = ("_limit_s", "loss", "seconds")

    def __init__(self) -> None:
        self.seconds: float | None = None
        self.loss = 0.0
        self._limit_s: float | None = None

    def sample(self, seconds: float) -> None:
        """Add a measured round trip time, smoothed with gain 1/8 like TCP (RFC 6298)."""
        known = self.seconds
        self.seconds = seconds if known is None else known + (seconds - known) * _GAIN

    def limit(self, seconds: float) -> None:
        """Set an upper bound of the round trip time, used until the first measurement."""
        self._limit_s = seconds if self._limit_s is None else min(seconds, self._limit_s)

    @property
    def known_s(self) -> float | None:
        """Round trip time or its upper bound (s), or None if neither is known."""
        return self._limit_s if self.seconds is None else self.seconds

    @property
    def is_lossy(self) -> bool:
        """Whether the measured frame loss is significant."""
        return self.loss > _SURE_LOSS

    def wait(self, default_s: float, floor_s: float, most_s: float) -> float:
        """Return the timeout of a message: four round trips, but at least ``floor_s`` and at most ``most_s``.

        The timeout is never shorter than 1.1 round trips. If the round trip time is unknown, ``default_s`` is
        returned.
        """
        known_s = self.known_s
        if known_s is None:
            return default_s
        return max(min(max(4.0 * known_s, floor_s), most_s), _SLOW * known_s)

    def copies(self, patience_s: float) -> tuple[int, float]:
        """Return the number of copies of a message to send per round trip, and their spacing (s).

        The peer aborts the transfer ``patience_s`` after the last new message. If the link loses frames and
        too few repetitions fit into that time, several copies are sent per round trip: as few as possible, so
        that all are lost with a probability of at most 1 %, and at most four.

        >>> trip = RoundTrip()
        >>> trip.sample(4.0)
        >>> trip.copies(5.0)
        (1, 4.0)
        >>> trip.loss = 0.3
        >>> trip.copies(5.0)
        (4, 0.25)
        >>> trip = RoundTrip()
        >>> trip.sample(0.1)
        >>> trip.loss = 0.3
        >>> trip.copies(5.0)
        (1, 0.1)
        """
        trip_s = self.known_s or 0.0
        if trip_s <= 0.0 or not _SURE_LOSS < self.loss < 1.0:
            return 1, trip_s
        attempts = max(1, math.floor(patience_s / trip_s))
        copies = math.ceil(math.log(_FAILS) / (attempts * math.log(self.loss)))
        copies = min(max(copies, 1), _MOST_COPIES)
        if copies == 1:
            return 1, trip_s
        return copies, min(trip_s, max(patience_s - trip_s, 0.1 * trip_s)) / copies
