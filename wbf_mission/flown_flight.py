"""What a flight gave that was not followed while it went on."""

from __future__ import annotations

from dataclasses import dataclass, field

from mission.link.tlog import FrameLog
from sensors.observations import Observations
from wbf_mission.deciding.record import DecisionRecord
from wbf_mission.flight_record import FlightRecord


@dataclass(frozen=True, slots=True)
class FlownFlight:
    """What a flight gave that was flown in another process, or for another run.

    Parameters
    ----------
    records : list of FlightRecord
        Of each vehicle.
    parts : tuple of Observations
        In the order in which they arrived.
    duration_s : float
        Simulated seconds.
    frames : int
    decisions : list of DecisionRecord
        With the number of observations since the flight began; without those that the run has already.
    log : FrameLog or None
        All frames, with their times since the flight began.
    """

    records: list[FlightRecord]
    parts: tuple[Observations, ...]
    duration_s: float
    frames: int
    decisions: list[DecisionRecord] = field(default_factory=list)
    log: FrameLog | None = None
