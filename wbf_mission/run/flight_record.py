"""What one flight of one vehicle gave."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from mission.ground.link_state import LinkReport
from mission.ground.tracks import Track
from mission.link.tlog import FrameLog
from mission.outcome import Outcome
from sensors.camera.wire import AssemblerStatistics
from sensors.observations import Observations
from wbf_mission.planning import PlanResult
from wbf_mission.replanning.record import DecisionRecord


@dataclass(slots=True)
class FlightRecord:
    """One vehicle's flight, from take-off to landing.

    Parameters
    ----------
    day, flight : int
        The day of the environment, and the number of the flight on it, from 1.
    system_id : int
        Of the vehicle.
    plan : PlanResult
        What was planned before take-off.
    outcome : Outcome
        How the flight ended.
    reason : str
        Why it ended so, empty when it went well.
    track : Track
        What was flown, as the vehicle believed.
    true_track : Track or None
        What was flown; None when the vehicle made no errors about its position.
    camera : AssemblerStatistics
        Images received, lost, fetched again.
    transfers : list
        Statistics of the mission transfers.
    battery_used : float or None
        Fraction of the battery, from the vehicle's telemetry.
    flight_time_s : float
        Simulated seconds from the mission's start to its end.
    link : LinkReport or None
        How good the link to a real vehicle was; None in a simulation.
    missing_images : int
        Images that will not come any more: lost on the way, or never taken because the link was dead.
    seen_before : int
        How many observations of the run there were when it began.
    texts : list
        What the vehicle said (time, severity, text).
    warnings : list of str
        What the user should know, each in one line; those of the plan come first.
    """

    day: int
    flight: int
    system_id: int
    plan: PlanResult
    outcome: Outcome
    reason: str
    track: Track
    true_track: Track | None
    camera: AssemblerStatistics
    transfers: list[Any]
    battery_used: float | None
    flight_time_s: float
    link: LinkReport | None = None
    missing_images: int = 0
    seen_before: int = 0
    texts: list[tuple[float, int, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def position_error(self) -> dict[str, float] | None:
        """How far the vehicle was from where it believed to be: root of the mean square, and most."""
        if self.true_track is None or not len(self.track.time_s):
            return None
        error_m = self.track.distance_m(self.true_track)
        return {"rms": float(np.sqrt(np.mean(error_m**2))), "max": float(error_m.max())}

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "day": self.day,
            "flight": self.flight,
            "vehicle": self.system_id,
            "name": self.plan.vehicle.name,
            "outcome": self.outcome.value,
            "reason": self.reason,
            "path_length_m": self.track.length_m,
            "flight_time_s": self.flight_time_s,
            "predicted_time_s": self.plan.prediction.duration_s,
            "battery_used": self.battery_used,
            "predicted_battery_used": self.plan.battery_used,
            "images": asdict(self.camera),
            "missing_images": self.missing_images,
            "link": None if self.link is None else {**asdict(self.link), "loss": self.link.loss},
        }


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
