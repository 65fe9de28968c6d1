"""Round trip time and frame loss of a link, and the waits and repetitions that follow from them."""

from __future__ import annotations

import math

__all__ = ["RoundTrip"]

_GAIN = 0.125
_SLOW = 1.1
_FAILS = 0.01
_MOST_COPIES = 4
_SURE_LOSS = 0.02


class RoundTrip:
    """A smoothed round trip time and the losses of a link, shared by the transfers over it.

    Attributes
    ----------
    seconds : float or None
        The round trip time; None before the first measurement.
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
        """Add a measurement (smoothed by 1/8, as TCP does: RFC 6298)."""
        known = self.seconds
        self.seconds = seconds if known is None else known + (seconds - known) * _GAIN

    def limit(self, seconds: float) -> None:
        """Note an upper bound of the round trip; it counts until a measurement."""
        self._limit_s = seconds if self._limit_s is None else min(seconds, self._limit_s)

    @property
    def known_s(self) -> float | None:
        """The round trip time, or its upper bound; None before any."""
        return self._limit_s if self.seconds is None else self.seconds

    @property
    def is_lossy(self) -> bool:
        """Whether the link is known to lose frames."""
        return self.loss > _SURE_LOSS

    def wait(self, default_s: float, floor_s: float, most_s: float) -> float:
        """Return the wait before a message is repeated: four round trips, at least one.

        ``default_s`` while nothing is known; ``floor_s`` and ``most_s`` limit the four, not a single one.
        """
        known_s = self.known_s
        if known_s is None:
            return default_s
        return max(min(max(4.0 * known_s, floor_s), most_s), _SLOW * known_s)

    def copies(self, patience_s: float) -> tuple[int, float]:
        """Return the number of copies of a message to send in a round trip, and their spacing in seconds.

        One copy, unless the link loses frames and the other side gives up, ``patience_s`` after the last new
        message, before enough repetitions: then enough copies that all are lost once in a hundred times, at
        most four.

        Examples
        --------
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
