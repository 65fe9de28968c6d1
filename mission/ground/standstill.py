"""Detection of a suspended program: stopped, or on a machine that slept."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["LIFE_S", "Standstill"]

LIFE_S = 2.0
"""Age at which an order, answer or agreement expires (s): the situation may have changed."""


class Standstill:
    """Timer of the interval between calls of `look`, by a clock that runs while the machine sleeps.

    Examples
    --------
    >>> times_s = iter([0.0, 1.0, 15.0, 15.5])
    >>> standstill = Standstill(lambda: next(times_s))
    >>> [standstill.look() for _ in range(4)]
    [0.0, 0.0, 14.0, 0.0]
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._looked_s: float | None = None

    def look(self) -> float:
        """Return the time since the last call (s) if longer than `LIFE_S`, otherwise 0."""
        before_s, self._looked_s = self._looked_s, self._clock()
        stood_s = 0.0 if before_s is None else self._looked_s - before_s
        return stood_s if stood_s > LIFE_S else 0.0
