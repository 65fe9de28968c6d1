"""What a run gave, and its summary in plain values."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.outcome import Outcome
from sensors.camera.wire import AssemblerStatistics
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.estimation import ScoreHistory
from wbf_mission.outcome import Track
from wbf_mission.planning import PlanResult
from wbf_mission.report import FarmReport, FieldMap, report_of_maps
from wbf_mission.scenario import Scenario


@dataclass(slots=True)
class RunRecord:
    """What a run gave; parts that were not reached are empty.

    Parameters
    ----------
    scenario : Scenario
    plan : PlanResult
    outcome : Outcome
        How the flight ended.
    reason : str
        Why it ended so, empty when it went well.
    track : Track
        What was flown, as the vehicle believed.
    true_track : Track or None
        What was flown; None when the vehicle made no errors about its position.
    observations : Observations
        What arrived from the camera.
    camera : AssemblerStatistics
        Images received, lost, fetched again.
    transfers : list
        Statistics of the mission transfers.
    truth, model : float32[n, W, H] and InformationModel, or None
        The environment of the flight's day, and the last estimate.
    history : ScoreHistory
        Scores over time.
    battery_used : float or None
        Fraction of the battery, from the vehicle's telemetry.
    flight_time_s : float
        Simulated seconds from the mission's start to its end.
    timings_s : dict
        Wall seconds of each part.
    texts : list
        What the vehicle said (time, severity, text).
    warnings : list of str
        What the user should know, each in one line; those of the plan come first.
    environment_cached : bool
        Whether the environment came from the user's cache.
    fields : FieldSet
        What was sensed and scored.
    maps, true_maps : tuple of FieldMap
        Estimate and truth in blocks of cells; empty without an estimate.
    """

    scenario: Scenario
    plan: PlanResult
    outcome: Outcome
    reason: str
    track: Track
    observations: Observations
    camera: AssemblerStatistics
    transfers: list[Any]
    truth: NDArray[np.float32] | None
    model: InformationModel | None
    history: ScoreHistory
    battery_used: float | None
    flight_time_s: float
    simulated_s: float
    frames: int
    timings_s: dict[str, float] = field(default_factory=dict)
    texts: list[tuple[float, int, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    environment_cached: bool = False
    true_track: Track | None = None
    fields: FieldSet = PAPER_FIELDS
    maps: tuple[FieldMap, ...] = ()
    true_maps: tuple[FieldMap, ...] = ()

    @property
    def report(self) -> FarmReport | None:
        """What the estimate says of the farm, if there is one."""
        return report_of_maps(self.farm, self.maps) if self.maps else None

    @property
    def score(self) -> float | None:
        """The paper's score, averaged over the scored times of the run; 0 is perfect; None without any."""
        return self.history.score

    @property
    def final_score(self) -> float | None:
        """The paper's score of the last estimate."""
        return self.history.entries[-1].score if self.history.entries else None

    @property
    def losses(self) -> dict[str, float]:
        """The mean loss a cell of each field by the last estimate; empty without one."""
        if not self.history.entries:
            return {}
        return dict(zip(self.fields.names, self.history.entries[-1].field_loss, strict=True))

    @property
    def estimator(self) -> str:
        """The estimator with its parameters."""
        return str(self.scenario.estimate.estimator)

    @property
    def farm(self) -> Farm:
        """The farm that was flown."""
        return self.plan.farm

    def summary(self) -> dict[str, Any]:
        """Return the run in plain values, for JSON."""
        final = self.history.entries[-1] if self.history.entries else None
        seen = self.observations
        cells = len(np.unique(seen.x.astype(np.int64) * self.farm.height_cells + seen.y)) if len(seen) else 0
        flight_s = self.timings_s.get("flight", 0.0)
        report = self.report
        return {
            "seed": self.scenario.seed,
            "farm": self.farm.name,
            "planner": self.plan.planner,
            "mission": self.scenario.mission.file,
            "estimator": self.estimator,
            "vehicle": self.plan.vehicle.name,
            "day": self.scenario.farm.day,
            "outcome": self.outcome.value,
            "reason": self.reason,
            "warnings": list(self.warnings),
            "score": self.history.score,
            "final_score": final.score if final else None,
            "scored_times": len(self.history.entries),
            "losses": _by_field(self.fields.names, final.field_loss if final else None),
            "rmse": _by_field(self.fields.names, final.field_rmse if final else None),
            "mae": _by_field(self.fields.names, final.field_mae if final else None),
            "authors_axis_max": final.authors_axis_max if final else None,
            "report": report.to_dict() if report is not None else None,
            "observations": len(seen),
            "cells_observed": cells,
            "path_length_m": self.track.length_m,
            "position_error_m": self._position_error(),
            "planned_length_m": self.plan.length_m,
            "flight_time_s": self.flight_time_s,
            "predicted_time_s": self.plan.prediction.duration_s,
            "battery_used": self.battery_used,
            "predicted_battery_used": self.plan.battery_used,
            "coverage": self.plan.coverage,
            "spacing_m": self.plan.spacing_m,
            "budget": self.plan.budget_text,
            "transfer": _transfer_summary(self.transfers),
            "camera": asdict(self.camera),
            "mavlink_frames": self.frames,
            "wall_time_s": sum(self.timings_s.values()),
            "realtime_factor": self.simulated_s / flight_s if flight_s > 0.0 else 0.0,
            "timings_s": dict(self.timings_s),
            "environment_cached": self.environment_cached,
            "scenario": self.scenario.to_dict(),
        }

    def _position_error(self) -> dict[str, float] | None:
        """Return how far the vehicle was from where it believed to be: root of the mean square, and most."""
        if self.true_track is None or not len(self.track.time_s):
            return None
        error_m = self.track.distance_m(self.true_track)
        return {"rms": float(np.sqrt(np.mean(error_m**2))), "max": float(error_m.max())}


def _by_field(names: tuple[str, ...], values: tuple[float, ...] | None) -> dict[str, float | None]:
    return dict.fromkeys(names) if values is None else dict(zip(names, values, strict=True))


def _transfer_summary(transfers: list[Any]) -> dict[str, Any]:
    return {
        "items": sum(part.items for part in transfers),
        "messages_sent": sum(part.messages_sent for part in transfers),
        "messages_received": sum(part.messages_received for part in transfers),
        "retries": sum(part.retries for part in transfers),
        "duration_s": sum(part.duration_s for part in transfers),
        "verified": bool(transfers) and all(part.verified for part in transfers),
    }
