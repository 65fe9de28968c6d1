"""Which flight of a run it is, and the random streams that it draws from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SortieNumber:
    """Which flight of a run it is.

    Parameters
    ----------
    day : int
        Of the environment.
    flight : int
        On that day, from 1.
    system_id : int
        Of the vehicle.
    first_day : int
        The first day that is flown.
    """

    day: int
    flight: int
    system_id: int
    first_day: int

    @classmethod
    def first(cls, day: int, system_id: int) -> SortieNumber:
        """Return a vehicle's first flight of a run that begins on a day."""
        return cls(day, 1, system_id, day)

    def stream_names(self, part: str) -> tuple[str, ...]:
        """Return the names of a part's random stream; the first flight of a run has the part's own."""
        names = [part]
        if (self.day, self.flight) != (self.first_day, 1):
            names += [f"day-{self.day}", f"flight-{self.flight}"]
        if self.system_id != 1:
            names.append(f"vehicle-{self.system_id}")
        return tuple(names)
