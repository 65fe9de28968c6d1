"""Records of a run: its flights, its days and the whole run, with summaries in plain values."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.texts import distance, duration, one_line
from mission.ground.link_state import LinkReport
from mission.ground.tracks import Track, joined
from mission.link.tlog import FrameLog
from mission.model import Mission
from mission.outcome import Outcome
from mission.transfer.events import TransferStatistics
from sensors.camera.wire import AssemblerStatistics
from sensors.estimation import ScoreHistory
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.maps.field_maps import FieldMap
from wbf_mission.maps.report import FarmReport, report_of_maps
from wbf_mission.planning import PlanResult
from wbf_mission.planning.builder import budget_left, coverage_together
from wbf_mission.planning.coverage import seen_share
from wbf_mission.replanning.record import SKIPPED, DecisionRecord
from wbf_mission.scenario import Scenario


@dataclass(slots=True)
class FlightRecord:
    """One vehicle's flight, from take-off to landing.

    Parameters
    ----------
    day, flight : int
        Day of the environment, and number of the flight on that day, from 1.
    system_id : int
        MAVLink system id of the vehicle.
    plan : PlanResult
        The plan before take-off.
    outcome : Outcome
        Outcome of the flight.
    reason : str
        Reason of the outcome; empty for a good outcome.
    track : Track
        Flown track, from the vehicle's position estimates.
    true_track : Track or None
        True flown track, or None if the vehicle has no position errors.
    camera : AssemblerStatistics
        Numbers of images received, lost and fetched again.
    transfers : list
        Statistics of the mission transfers.
    battery_used : float or None
        Used fraction of the battery, from the vehicle's telemetry.
    battery_readings : tuple of float or None
        Battery reading at the mission's start, and lowest reading with running motors.
    flight_time_s : float
        Simulated seconds from the mission's start to its end.
    link : LinkReport or None
        Quality of the link to a real vehicle, or None in a simulation.
    missing_images : int
        Number of images that will stay missing: lost in transfer, or never taken because the link was dead.
    seen_before : int
        Number of the run's observations before the flight.
    begun_s : float
        Start of the flight, seconds after the start of the run; the flight's times count from this time.
    resumed : bool
        Whether the flight ended early and a later flight resumed it.
    texts : list
        Texts of the vehicle: time, severity, text.
    warnings : list of str
        Warnings for the user, each in one line; the plan's warnings come first.
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
    transfers: list[TransferStatistics]
    battery_used: float | None
    flight_time_s: float
    battery_readings: tuple[float | None, float | None] = (None, None)
    link: LinkReport | None = None
    missing_images: int = 0
    seen_before: int = 0
    begun_s: float = 0.0
    resumed: bool = False
    texts: list[tuple[float, int, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def position_error(self) -> dict[str, float] | None:
        """Distance between true and estimated position (m): root mean square and maximum; None if unknown."""
        if self.true_track is None or not len(self.track.time_s):
            return None
        error_m = self.track.distance_m(self.true_track)
        return {"rms": float(np.sqrt(np.mean(error_m**2))), "max": float(error_m.max())}

    def summary(self) -> dict[str, Any]:
        """Return the flight as plain values for JSON."""
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
            "resumed": self.resumed,
            "images": asdict(self.camera),
            "missing_images": self.missing_images,
            "link": None if self.link is None else {**asdict(self.link), "loss": self.link.loss},
        }


@dataclass(frozen=True, slots=True)
class Flight:
    """Result of one flight, which was flown here or in another process, or was reused.

    Parameters
    ----------
    records : list of FlightRecord
        Record of each vehicle.
    duration_s : float
        Simulated seconds of the flight.
    parts : tuple of Observations
        Observations that are not in the run's evidence yet, in order of arrival.
    decisions : list of DecisionRecord
        Decisions that are not in the run's record yet; they count observations from the flight's start.
    log : FrameLog or None
        Frames that are not written yet; their times count from the flight's start.
    """

    records: list[FlightRecord]
    duration_s: float
    frames: int
    parts: tuple[Observations, ...] = ()
    decisions: list[DecisionRecord] = field(default_factory=list)
    log: FrameLog | None = None


KEPT_DAYS_BYTES = 128_000_000
"""Truth and estimate of every day are kept up to this size; in a larger run, only those of the last day."""


@dataclass(frozen=True, slots=True, eq=False)
class DayRecord:
    """One day of a run.

    Parameters
    ----------
    report : FarmReport or None
        Report on the farm by the estimate at the end of the day, or None without an estimate.
    truth : float32[n, W, H] or None
        The environment of the day; None on large farms, where only the last day's environment is kept.
    model : InformationModel or None
        The estimate at the end of the day, without class probabilities; None on large farms, like `truth`.
    """

    day: int
    report: FarmReport | None
    truth: NDArray[np.float32] | None = None
    model: InformationModel | None = None

    def summary(self, history: ScoreHistory, flights: int, observations: int) -> dict[str, Any]:
        """Return the day's report and scores as plain values for JSON."""
        own = history.of_day(self.day)
        last = own.entries[-1] if own.entries else None
        return {
            "day": self.day,
            "flights": flights,
            "observations": observations,
            "scored_times": len(own.entries),
            "score": own.score,
            "final_score": None if last is None else last.score,
            "losses": {} if last is None else dict(zip(last.fields, last.field_loss, strict=True)),
            "report": None if self.report is None else self.report.to_dict(),
        }


def keeps_days(farm: Farm, fields: int, days: int) -> bool:
    """Return whether a run keeps truth and estimate of every day.

    >>> from geo.farms import get_farm
    >>> keeps_days(get_farm("miniberry-100"), 3, 15), keeps_days(get_farm("waterberry"), 3, 2)
    (True, False)
    """
    # Each day has three float32 arrays: truth, value and uncertainty.
    return days * 3 * 4 * fields * farm.width_cells * farm.height_cells <= KEPT_DAYS_BYTES


MOST_BAD = 0.1
"""The run counts as failed if a larger fraction of the policy's answers is bad."""


@dataclass(slots=True)
class RunRecord:
    """Result of a run; the parts of an interrupted run may be empty.

    Parameters
    ----------
    flights : tuple of FlightRecord
        One or more records, one per vehicle and flight, ordered by day, flight and vehicle. Skipped flights
        (`skipped_flights`) have no record.
    observations : Observations
        Observations received from the cameras.
    truth, model : float32[n, W, H] and InformationModel, or None
        Environment of the last flown day, and the last estimate.
    history : ScoreHistory
        Scores over time.
    simulated_s : float
        Simulated seconds of all flights.
    frames : int
        Number of MAVLink frames sent.
    timings_s : dict
        Wall seconds of each part.
    environment_cached : bool
        Whether the environment came from the user's cache.
    fields : FieldSet
        Fields that were sensed and scored.
    maps, true_maps : tuple of FieldMap
        Estimate and truth, summed over pixels; empty without an estimate.
    decisions : list of DecisionRecord
        Every decision of the policy.
    days : tuple of DayRecord
        Record of each day.
    stopped : str
        Why sorties of a real vehicle were not flown; empty if all were flown.
    rest : Mission or None
        Unflown rest of a real vehicle's mission, as a mission that can be flown later.
    """

    scenario: Scenario
    flights: tuple[FlightRecord, ...]
    observations: Observations
    truth: NDArray[np.float32] | None
    model: InformationModel | None
    history: ScoreHistory
    simulated_s: float
    frames: int
    timings_s: dict[str, float] = field(default_factory=dict)
    environment_cached: bool = False
    fields: FieldSet = PAPER_FIELDS
    maps: tuple[FieldMap, ...] = ()
    true_maps: tuple[FieldMap, ...] = ()
    decisions: list[DecisionRecord] = field(default_factory=list)
    days: tuple[DayRecord, ...] = ()
    stopped: str = ""
    rest: Mission | None = None

    @property
    def plan(self) -> PlanResult:
        """Plan of the first vehicle's first flight."""
        return self.flights[0].plan

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run: the outcome of the first flight that failed, or a good outcome if none did."""
        return Outcome.INTERRUPTED if self._stopped_between else self._decisive.outcome

    @property
    def reason(self) -> str:
        """Reason of the outcome; empty for a good outcome."""
        if self._stopped_between:
            one = self.flights[-1]
            if self.stopped:
                return self.stopped
            return f"stopped after flight {one.flight} of day {one.day}"
        one = self._decisive
        if not one.reason or len(self.flights) == 1:
            return one.reason
        return f"day {one.day}, flight {one.flight}, vehicle {one.system_id}: {one.reason}"

    @property
    def skipped_flights(self) -> int:
        """Number of flights that vehicles skipped because the policy gave them a path without points."""
        return sum(change.outcome == SKIPPED for decision in self.decisions for change in decision.changes)

    @property
    def _stopped_between(self) -> bool:
        """Whether the run was stopped between two flights."""
        farm = self.scenario.farm
        expected = farm.days * farm.flights_per_day * len(self.scenario.vehicle.fleet)
        made = len(self.flights) + self.skipped_flights
        return (made < expected or bool(self.stopped)) and self._decisive.outcome.is_good

    @property
    def _decisive(self) -> FlightRecord:
        bad = (flight for flight in self.flights if not (flight.outcome.is_good or flight.resumed))
        return next(bad, next((flight for flight in self.flights if flight.outcome.is_good), self.flights[0]))

    @property
    def track(self) -> Track:
        """Flown track, from estimated positions; a row without a position separates flights."""
        return joined([flight.track for flight in self.flights])

    @property
    def true_track(self) -> Track | None:
        """True flown track, or None if a vehicle had no position errors."""
        true = [flight.true_track for flight in self.flights]
        known = [track for track in true if track is not None]
        return joined(known) if len(known) == len(true) else None

    @property
    def camera(self) -> AssemblerStatistics:
        """Image statistics, summed over all flights."""
        each = [asdict(flight.camera) for flight in self.flights]
        return AssemblerStatistics(**{name: sum(one[name] for one in each) for name in each[0]})

    @property
    def transfers(self) -> list[TransferStatistics]:
        """Statistics of all mission transfers."""
        return [transfer for flight in self.flights for transfer in flight.transfers]

    @property
    def texts(self) -> list[tuple[float, int, str]]:
        """Texts of the vehicles: time, severity, text."""
        return [text for flight in self.flights for text in flight.texts]

    @property
    def warnings(self) -> list[str]:
        """Warnings for the user, each in one line."""
        of_flights = (warning for flight in self.flights for warning in flight.warnings)
        return list(dict.fromkeys([*filter(None, [self._answers_told()]), *of_flights]))

    @property
    def bad_answers(self) -> dict[str, int]:
        """Number of the policy's answers that were refused or late, by kind of fault."""
        return dict(Counter(decision.fault for decision in self.decisions if decision.fault).most_common())

    @property
    def policy_failed(self) -> bool:
        """Whether more than `MOST_BAD` of the policy's answers were bad."""
        return sum(self.bad_answers.values()) > MOST_BAD * len(self.decisions)

    def _answers_told(self) -> str | None:
        """Return the warning about bad answers, with the first refusal; None if all answers were good."""
        bad = self.bad_answers
        if not bad:
            return None
        first = next(decision.refused for decision in self.decisions if decision.fault)
        kinds = ", ".join(f"{count} {kind}" for kind, count in bad.items())
        whose = f"policy {self.scenario.mission.policy}"
        of = f"{sum(bad.values())} of {len(self.decisions)} answers were bad: {kinds}"
        return f"{whose}: {of}" + (f"; first: {one_line(first)}" if first else "")

    @property
    def battery_used(self) -> float | None:
        """Largest battery fraction that a flight used, or None if no vehicle reported its battery."""
        return max(
            (flight.battery_used for flight in self.flights if flight.battery_used is not None), default=None
        )

    @property
    def flight_time_s(self) -> float:
        """Simulated seconds in the air: the sum, over all joint flights, of the longest vehicle's time."""
        return self._time_together_s([flight.flight_time_s for flight in self.flights])

    @property
    def predicted_time_s(self) -> float:
        """Prediction of `flight_time_s` before take-off."""
        return self._time_together_s([flight.plan.prediction.duration_s for flight in self.flights])

    @property
    def air_time_s(self) -> float:
        """Simulated seconds in the air, summed over the vehicles."""
        return sum(flight.flight_time_s for flight in self.flights)

    @property
    def predicted_air_time_s(self) -> float:
        """Prediction of `air_time_s` before take-off."""
        return sum(flight.plan.prediction.duration_s for flight in self.flights)

    def flown(self, *, predicted: bool) -> str:
        """Return flown distance and time in words; `predicted` adds the predicted time."""

        def time(flown_s: float, expected_s: float) -> str:
            return duration(flown_s) + f" (predicted {duration(expected_s)})" * predicted

        way, over = distance(self.track.length_m), time(self.flight_time_s, self.predicted_time_s)
        if (vehicles := len({flight.system_id for flight in self.flights})) == 1:
            return f"{way} in {over}"
        together = time(self.air_time_s, self.predicted_air_time_s)
        return f"{way} by {vehicles} vehicles; total flight time {together}, elapsed {over}"

    @property
    def budget_left(self) -> str:
        """Note on the budget that a planner's first mission leaves unused; empty if little is left."""
        if self.scenario.mission.policy is not None:  # A policy's flight is longer than its first path
            return ""
        day, system_id = self.flights[0].day, self.flights[0].system_id
        plans = [flight.plan for flight in self.flights if (flight.day, flight.system_id) == (day, system_id)]
        return budget_left(plans[: max(1, len(plans) // self.scenario.farm.flights_per_day)])

    @property
    def predicted_coverage(self) -> float:
        """Joint coverage of all vehicles in the first flight, predicted before take-off."""
        first = [
            flight.plan
            for flight in self.flights
            if (flight.day, flight.flight) == (self.flights[0].day, self.flights[0].flight)
        ]
        return coverage_together(first, self.scenario.camera.footprint)

    @property
    def predicted_battery_used(self) -> float | None:
        """Prediction of `battery_used` before take-off."""
        return max(
            (used for flight in self.flights if (used := flight.plan.battery_used) is not None), default=None
        )

    def _time_together_s(self, times_s: list[float]) -> float:
        longest: dict[tuple[int, int], float] = {}
        for one, time_s in zip(self.flights, times_s, strict=True):
            key = (one.day, one.flight)
            longest[key] = max(longest.get(key, 0.0), time_s)
        return sum(longest.values())

    @property
    def least_distance_m(self) -> float | None:
        """Least distance between two vehicles in a joint flight (m), or None without a joint flight.

        The paper's robots have no size and do not count. True tracks are used if they are known.
        """
        tracks = [
            (flight.day, flight.flight, flight.true_track or flight.track)
            for flight in self.flights
            if not flight.plan.vehicle.is_ideal
        ]
        pairs = [
            first.least_distance_m(second)
            for number, (*when, first) in enumerate(tracks)
            for *other, second in tracks[:number]
            if when == other
        ]
        return min((distance_m for distance_m in pairs if distance_m is not None), default=None)

    @property
    def report(self) -> FarmReport | None:
        """Report on the farm, made from the last estimate; None without an estimate."""
        return report_of_maps(self.farm, self.maps) if self.maps else None

    @property
    def score(self) -> float | None:
        """Mean of the paper's score over the run's scored times; 0 is perfect. None without a score."""
        return self.history.score

    @property
    def final_score(self) -> float | None:
        """The paper's score of the last estimate, or None without a score."""
        return self.history.entries[-1].score if self.history.entries else None

    @property
    def losses(self) -> dict[str, float]:
        """Mean loss per cell of the last estimate, for each field; empty without an estimate."""
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

    def by_day(self) -> list[dict[str, Any]]:
        """Return a summary of each day, in plain values."""
        flown = {(flight.day, flight.flight) for flight in self.flights}
        return [
            one.summary(
                self.history,
                sum(day == one.day for day, _ in flown),
                int(np.count_nonzero(self.observations.day == one.day)),
            )
            for one in self.days
        ]

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
            "planner": None if self.scenario.mission.policy is not None else self.plan.planner,
            "policy": None if self.scenario.mission.policy is None else str(self.scenario.mission.policy),
            "mission": self.scenario.mission.file,
            "estimator": self.estimator,
            "vehicle": self.plan.vehicle.name,
            "vehicles": len({flight.system_id for flight in self.flights}),
            "day": self.scenario.farm.day,
            "days": self.scenario.farm.days,
            "outcome": self.outcome.value,
            "reason": self.reason,
            "warnings": list(self.warnings),
            "bad_answers": self.bad_answers,
            "policy_failed": self.policy_failed,
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
            "position_error_m": self.flights[0].position_error,
            "planned_length_m": sum(flight.plan.length_m for flight in self.flights),
            "flight_time_s": self.flight_time_s,
            "predicted_time_s": self.predicted_time_s,
            "air_time_s": self.air_time_s,
            "predicted_air_time_s": self.predicted_air_time_s,
            "battery_used": self.battery_used,
            "predicted_battery_used": self.predicted_battery_used,
            "coverage": seen_share(self.farm, seen.x, seen.y),
            "predicted_coverage": self.predicted_coverage,
            "spacing_m": self.plan.spacing_m,
            "budget": self.plan.budget_text,
            "least_distance_m": self.least_distance_m,
            "flights": [flight.summary() for flight in self.flights],
            "skipped_flights": self.skipped_flights,
            "by_day": self.by_day(),
            "decisions": [decision.summary() for decision in self.decisions],
            "transfer": _transfer_summary(self.transfers),
            "camera": asdict(self.camera),
            "mavlink_frames": self.frames,
            "wall_time_s": sum(self.timings_s.values()),
            "realtime_factor": self.simulated_s / flight_s if flight_s > 0.0 else 0.0,
            "timings_s": dict(self.timings_s),
            "environment_cached": self.environment_cached,
            "scenario": self.scenario.to_dict(),
        }


def _by_field(names: tuple[str, ...], values: tuple[float, ...] | None) -> dict[str, float | None]:
    return dict.fromkeys(names) if values is None else dict(zip(names, values, strict=True))


def _transfer_summary(transfers: list[Any]) -> dict[str, Any]:
    summed = ("items", "messages_sent", "messages_received", "retries", "duration_s")
    totals = {name: sum(getattr(part, name) for part in transfers) for name in summed}
    return {**totals, "verified": bool(transfers) and all(part.verified for part in transfers)}
