"""Flights of a fixed plan, flown in processes of their own while the estimate learns from those before them.

What a planner flies does not depend on what was seen, so the flights of a run need not wait for each other.
They are the same as one after the other: each draws from the random streams of its own number.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import cache, partial

from threadpoolctl import threadpool_limits

from geo.errors import WbfMissionError
from geo.workers import CallsAhead
from mission.link.tlog import FrameLog
from sensors.environment import Environment
from sim_vehicle.epoch import EPOCH_UNIX_S
from wbf_mission.progress import Stopwatch, silent
from wbf_mission.replanning.record import DecisionRecord
from wbf_mission.run.estimation import Evidence
from wbf_mission.run.flight_memory import memory_of_process
from wbf_mission.run.flight_record import FlownFlight
from wbf_mission.run.flights import Flights
from wbf_mission.run.hosting import Hosting, VirtualHosting

__all__ = ["FlightAlone", "FlightsAhead", "can_fly_ahead"]

WORTH_S = 6000.0
"""Seconds of simulated flight of a run from which on processes are worth their start."""
MOST_CELLS = 500_000
"""A larger environment is not sent to other processes."""


@dataclass(frozen=True, slots=True)
class FlightAlone:
    """Flies any flight of a run without the others.

    Parameters
    ----------
    flights : Flights
        With a decider that does not ask what is believed.
    logged : bool
        Whether frames are kept.
    """

    flights: Flights
    environment: Environment
    hosting: Hosting
    logged: bool = False

    def __call__(self, day: int, flight: int) -> FlownFlight:
        """Plan a flight and fly it, unless it was flown in this process before."""
        of = self.flights
        evidence, decisions = Evidence(of.run.farm, of.run.fields), list[DecisionRecord]()
        with threadpool_limits(1, user_api="blas"):
            planned = of.plan(day, flight, evidence, decisions)
            _spare_collector()
            known = memory_of_process().fly(of, planned, self.environment, self.hosting, logged=self.logged)
            if known is not None:
                return replace(known, decisions=decisions)
            log = FrameLog() if self.logged else None
            flown = of.fly(
                planned,
                evidence,
                partial(of.camera, environment=self.environment),
                self.hosting,
                tell=silent,
                watch=Stopwatch(),
                writer=log,
                # Nobody knows yet when the flight begins: frames have their times since then.
                offset_s=-EPOCH_UNIX_S,
            )
        records = [sortie.record() for sortie in flown.sorties]
        return FlownFlight(records, evidence.parts, flown.now_s, flown.frames, decisions, log)


@cache
def _spare_collector() -> None:
    """Let the garbage collector leave alone what this process holds before its first flight: the program."""
    gc.freeze()


def can_fly_ahead(flights: Flights, hosting: Hosting, expected_s: float) -> bool:
    """Return whether the flights of a run can be flown in other processes, and whether that is worth it.

    Who steers has to see first; a flight in real time is followed while it goes on. A planner that is an
    object may be bound to this process. Where this process is itself one of several, these share the cores
    already.

    Parameters
    ----------
    expected_s : float
        About how many seconds all vehicles fly in all flights.
    """
    from joblib import cpu_count

    run = flights.run
    farm = run.farm
    plain = isinstance(hosting, VirtualHosting) and hosting.pace is None
    return (
        plain
        and run.decider.named
        and not run.decider.steers
        and expected_s >= WORTH_S
        and farm.width_cells * farm.height_cells <= MOST_CELLS
        and cpu_count() > 1
        and multiprocessing.current_process().name == "MainProcess"
    )


class FlightsAhead:
    """Flies flights in as many processes as there are cores, and gives them in their order.

    Parameters
    ----------
    numbers : sequence of (int, int)
        Day and flight of each, in their order.
    """

    def __init__(self, fly: FlightAlone, numbers: Sequence[tuple[int, int]]) -> None:
        self._order = {number: k for k, number in enumerate(numbers)}
        self._calls = CallsAhead(fly, numbers)

    def take(self, day: int, flight: int) -> FlownFlight | None:
        """Wait for a flight and return it; in their order, each once.

        None if it has to be flown here in its turn: a process was killed, something is wrong that is found
        again and told here, or something was decided on the way, by what was known when it was flown.
        """
        number = self._order.pop((day, flight), None)
        if number is None:
            return None
        with contextlib.suppress(WbfMissionError, MemoryError, BrokenProcessPool):
            flown = self._calls.result(number)
            if len(flown.decisions) <= 1:
                return flown
        return None

    def close(self) -> None:
        """End the processes."""
        self._calls.close()
