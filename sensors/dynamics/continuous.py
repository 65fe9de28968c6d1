"""What all continuous fields have in common, whatever changes them from day to day."""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from sensors.errors import EnvironmentDataError

_Level = NDArray[np.float32]
_LEAST_COARSE_CELLS = 8


class Course(Protocol):
    """A field of a farm from day to day."""

    @property
    def pieces(self) -> int:
        """In how many pieces a day is computed."""

    def compute(
        self,
        day: int,
        out: _Level,
        earlier: tuple[int, _Level] | None = None,
        on_piece: Callable[[], None] = lambda: None,
    ) -> None:
        """Compute a day, 0 for the state before the first step, of the whole farm.

        Parameters
        ----------
        out : float32[W, H]
            Is filled.
        earlier : (int, float32[W, H]), optional
            An earlier day and its field, to go on from.
        on_piece : callable
            Called after each of the pieces.
        """


class ContinuousDynamics(ABC):
    """How a continuous field develops: parameters, as of a frozen dataclass, and what follows from them.

    A subclass has a `kind` and writes `days`; it is registered by its kind as an entry point of the group
    ``wbf_mission.dynamics`` (``docs/fields.md`` shows one). Environment, estimators and score need no more.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    kind: ClassVar[str]
    """What a field file calls it."""

    def days(self, shape: tuple[int, int], rng: Generator) -> Iterator[NDArray[np.floating]]:
        """Yield the field of day 0, 1, 2, ... without end, float[W, H] with values in 0..1.

        Lengths are parts of the farm's sides: estimators simulate the field on few cells with the proportions
        of the farm.

        Parameters
        ----------
        shape : tuple of int
            The farm, cells.
        rng : numpy.random.Generator
            All that chance decides; equal generators give equal fields.
        """
        raise NotImplementedError

    def course(self, shape: tuple[int, int], last_day: int, rng: Generator) -> Course:  # noqa: ARG002
        """Return the field up to a day; where days can be computed in pieces this is better than `days`."""
        return _DailyCourse(self.kind, shape, self.days(shape, rng))

    def simulate_coarse(
        self, shape: tuple[int, int], days: Sequence[int], side: int, rngs: Sequence[Generator]
    ) -> NDArray[np.float64]:
        """Simulate some days, in ascending order, on few cells with the proportions of a farm.

        The longer side has `side` cells, the shorter one at least 8. float64[days, n, w, h]: the field by
        each of the n generators on each day, which does not depend on the other days.
        """
        scale = side / max(shape)
        width, height = (max(_LEAST_COARSE_CELLS, round(cells * scale)) for cells in shape)
        fields = np.empty((len(days), len(rngs), width, height))
        for number, rng in enumerate(rngs):
            course = self.course((width, height), max(days), rng)
            earlier: tuple[int, _Level] | None = None
            for k, day in enumerate(days):
                level = np.empty((width, height), np.float32)
                course.compute(day, level, earlier)
                fields[k, number] = level
                earlier = day, level
        return fields


@dataclass(slots=True)
class _DailyCourse:
    """What `ContinuousDynamics.days` yields, checked; days are asked for in ascending order."""

    kind: str
    shape: tuple[int, int]
    left: Iterator[NDArray[np.floating]]
    pieces: int = 1
    day: int = -1

    def compute(
        self,
        day: int,
        out: _Level,
        earlier: tuple[int, _Level] | None = None,  # noqa: ARG002 (chance goes on from the day before only)
        on_piece: Callable[[], None] = lambda: None,
    ) -> None:
        level = None
        while self.day < day:
            level = next(self.left, None)
            self.day += 1
        fits = isinstance(level, np.ndarray) and level.shape == self.shape and level.dtype.kind == "f"
        if not fits or not (level.min() >= 0.0 and level.max() <= 1.0):  # type: ignore[union-attr]
            raise EnvironmentDataError(
                f"{self.kind}: days() did not yield a float array of {self.shape[0]} x {self.shape[1]} values"
                f" in 0..1 for day {day}"
            )
        out[...] = level
        on_piece()
