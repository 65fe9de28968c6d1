"""A finished run as its stream of events; estimates are computed again from the run's observations."""

from __future__ import annotations

import bisect
import copy
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import merge
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mission.errors import LinkError
from mission.ground.items import revised_mission
from mission.ground.vehicle_state import VehicleMonitor, VehicleState
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.link.tlog import read_tlog
from mission.model import Command, Mission
from sensors.estimation import attribute_errors_to, checked_prediction, prepare_days
from sensors.estimators import Estimator, advance_estimator
from wbf_mission import events
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError
from wbf_mission.run.estimation import estimator_of

if TYPE_CHECKING:
    from sensors.scoring.information import InformationModel
    from wbf_mission.replanning.record import DecisionRecord, PathChange
    from wbf_mission.run.record import FlightRecord, RunRecord


def fresh_estimator(record: RunRecord, progress: Progress, estimator: Estimator | None = None) -> Estimator:
    """Return an estimator that is fitted to the farm, without observations.

    The estimator is `estimator`; by default, the one that the run's scenario names, or a copy of the
    scenario's estimator object.
    """
    if estimator is None:
        choice = record.scenario.estimate.estimator
        if choice.made is not None:
            estimator = copy.deepcopy(choice.made)
        else:
            estimator = estimator_of(choice, record.scenario.seed, record.fields)
    with attribute_errors_to(estimator):
        estimator.fit(record.farm.grid())
    days = [flight.day for flight in record.flights] + [day.day for day in record.days]
    prepare_days(estimator, min(days), max(days) - min(days) + 1, progress)
    return estimator


def estimates_again(
    record: RunRecord, estimator: Estimator, moments: Iterable[tuple[int, int, bool]]
) -> Iterator[InformationModel | None]:
    """Yield the estimates of a fresh estimator at `moments`; the arrays are not copies.

    A moment is a day, the number of known observations, and whether the estimate is wanted. The estimate of a
    moment is None if it is not wanted, or equal to the previous estimate.
    """
    day, seen, is_known = None, 0, False
    for of_day, known, is_wanted in moments:
        with attribute_errors_to(estimator):
            if of_day != day:
                day, is_known = of_day, False
                advance_estimator(estimator, day)
            if known > seen:
                estimator.partial_fit(record.observations[seen:known])
                seen, is_known = known, False
        if is_wanted and not is_known:
            is_known = True
            # Estimates are not stored, because they are large on large farms.
            yield checked_prediction(estimator, record.fields.names, record.farm.grid().shape)
        else:
            yield None


def kept_truths(record: RunRecord) -> dict[int, NDArray[np.float32]]:
    """Return the recorded truths by day, float32[n, W, H]; for large farms only the last day has a truth."""
    truths = {one.day: one.truth for one in record.days}
    if record.days and truths[record.days[-1].day] is None:
        truths[record.days[-1].day] = record.truth
    return {day: truth for day, truth in truths.items() if truth is not None}


MOST_STATES = 20_000
"""Largest number of states per track; longer tracks are thinned to every n-th state."""
_SEEN_S = 1.0
"""Interval between events of observations (s)."""

_SAME_S = 1e-3  # Times in a log are whole microseconds
_LONGEST_GAP_S = 5.0
"""A state in the telemetry is valid until the next state, but at most for this time (s)."""

_Timed = tuple[float, events.Event]


@dataclass(frozen=True, slots=True)
class FlightTogether:
    """Records of the vehicles that fly at the same time."""

    records: tuple[FlightRecord, ...]
    begun_s: float  # Start of the flight, in seconds after the start of the run.
    seen: slice  # Slice of the flight's observations among the run's observations.

    @property
    def started_s(self) -> float:
        """Time of the first position fix of any vehicle in the flight (s after the start of the run)."""
        firsts = [float(record.track.time_s[0]) for record in self.records if len(record.track.time_s)]
        return self.begun_s + min(firsts, default=0.0)


def events_of(
    result: RunRecord,
    *,
    estimates: int = 0,
    estimator: Estimator | None = None,
    log: Path | None = None,
    progress: Progress = silent,
) -> Iterator[events.Event]:
    """Yield the events of a finished run in order of time, over all days, flights and vehicles.

    Unknown values are None. Without a log, only position and speed of a vehicle's state are known. On large
    farms, only the last day's truth is known. Every scored time is an `Estimated` event, in the order of the
    history. With several vehicles, the observations in the events may not be in order of time.

    Parameters
    ----------
    estimates : int
        Approximate number of scored times, evenly spaced, at which a fresh estimator recomputes the model.
        Stored models, at the ends of days, are always included.
    estimator : Estimator, optional
        Replaces the run's estimator; it is fitted again.
    log : path, optional
        The run's telemetry log (``flight.tlog`` in its folder), with full vehicle states.
    progress : callable
        Receives the progress of the estimates.

    Raises
    ------
    EstimatorError
        If the run's estimator cannot be made again: a loaded result does not contain estimator objects.
    ResultError
        If the log cannot be read.

    Examples
    --------
    >>> from wbf_mission import Scenario, fly
    >>> scenario = Scenario(farm="miniberry-10", vehicle="ideal", budget="60steps", estimator="point")
    >>> events = list(events_of(fly(scenario)))
    >>> [type(one).__name__ for one in events[:3]], events[-1].outcome
    (['RunBegun', 'DayBegun', 'Decided'], 'completed')
    """
    flights = flights_of(result)
    yield _begun(result)
    states = sum(len(one.track.time_s) for one in result.flights)
    step = max(1, -(-states // MOST_STATES))
    told = {} if log is None else states_in(log, [one.begun_s for one in flights])
    streams: list[Iterator[_Timed]] = [_days(result, flights)]
    for number, flight in enumerate(flights):
        streams.append(_decided(result, flight))
        for record in flight.records:
            streams += [
                _planned(result, flight, record),
                _moved(flight, record, step, told.get((record.system_id, number))),
                _said(flight, record),
                _ended(flight, record),
            ]
        streams.append(_seen(result, flight))
    streams.append(_estimated(result, estimates, estimator, progress))
    for _, event in merge(*streams, key=lambda one: one[0]):
        yield event
    yield events.RunEnded(result.simulated_s, result.outcome.value, result.reason, result.summary())


def flights_of(result: RunRecord) -> list[FlightTogether]:
    """Return the flights of a run in their order, each with all of its vehicles."""
    together = [tuple(each) for _, each in groupby(result.flights, lambda one: (one.day, one.flight))]
    firsts = [flight[0].seen_before for flight in together] + [len(result.observations)]
    return [
        FlightTogether(each, each[0].begun_s, slice(*seen))
        for each, seen in zip(together, pairwise(firsts), strict=True)
    ]


def _begun(result: RunRecord) -> events.RunBegun:
    vehicles = {
        flight.system_id: events.VehicleInfo(
            flight.system_id, flight.plan.vehicle.name, flight.plan.vehicle.kind
        )
        for flight in reversed(result.flights)
    }
    decider = result.plan.planner or result.scenario.mission.file
    return events.RunBegun(
        f"{result.farm.name}, {decider}",
        result.farm,
        result.fields,
        tuple(vehicles[number] for number in sorted(vehicles)),
        # Only flights of real vehicles have a link report.
        simulated=all(flight.link is None for flight in result.flights),
        seed=result.scenario.seed,
        estimator=result.estimator,
        planner=decider,
    )


def _days(result: RunRecord, flights: Sequence[FlightTogether]) -> Iterator[_Timed]:
    # Days without a flight are scored, too.
    begun_s = dict(zip(reversed(result.history.days), reversed(result.history.times_s), strict=True))
    begun_s |= {flight.records[0].day: flight.begun_s for flight in reversed(flights)}
    truths = kept_truths(result)
    for day, time_s in sorted(begun_s.items()):
        yield time_s, events.DayBegun(time_s, day, truths.get(day))


def _planned(result: RunRecord, flight: FlightTogether, record: FlightRecord) -> Iterator[_Timed]:
    plan, numbers = record.plan, (record.day, record.flight, record.system_id)
    yield (
        flight.begun_s,
        events.Planned(
            flight.begun_s,
            *numbers,
            plan.mission,
            plan.path_m,
            duration_s=plan.prediction.duration_s,
            length_m=plan.length_m,
            coverage=plan.coverage,
        ),
    )
    changes = [
        (flight.started_s + change.effect_s, change)
        for decision in _decisions(result, flight)
        for change in decision.changes
        if change.system_id == record.system_id and change.effect_s is not None
    ]
    for time_s, change in sorted(changes, key=lambda one: one[0]):
        yield time_s, events.Planned(time_s, *numbers, _changed(record, change), change.path_m)


def _decisions(result: RunRecord, flight: FlightTogether) -> list[DecisionRecord]:
    numbers = flight.records[0].day, flight.records[0].flight
    return [decision for decision in result.decisions if (decision.day, decision.flight) == numbers]


def _changed(record: FlightRecord, change: PathChange) -> Mission:
    """Return the flight's mission with the new path of a change."""
    mission = record.plan.mission
    waypoints = [item for item in mission.items if item.command == Command.NAV_WAYPOINT]
    if not waypoints:
        return mission
    latitude, longitude = record.plan.farm.frame.to_wgs84(change.path_m[:, 0], change.path_m[:, 1])
    return revised_mission(
        mission,
        len(mission.items),
        list(zip(latitude.tolist(), longitude.tolist(), strict=True)),
        altitude_m=waypoints[0].z,
        acceptance_radius_m=waypoints[0].param2 or 0.0,
    )[0]


def _moved(
    flight: FlightTogether, record: FlightRecord, step: int, told: StateLog | None
) -> Iterator[_Timed]:
    """Yield a vehicle's positions with its logged states, or with speeds from its track.

    The last position is given with the last logged state, in which the vehicle is disarmed.
    """
    track, last = record.track, len(record.track.time_s) - 1
    if last < 0:
        return
    rows = np.unique(np.append(np.arange(0, last, step), last))
    time_s, x_m, y_m, height_m = (
        column[rows] for column in (track.time_s + flight.begun_s, track.x_m, track.y_m, track.altitude_m)
    )
    took_s = np.maximum(np.diff(time_s, prepend=time_s[0]), 1e-3)
    speed_m_s = np.hypot(np.diff(x_m, prepend=x_m[0]), np.diff(y_m, prepend=y_m[0])) / took_s
    states = [None] * len(rows) if told is None else [*told.at(time_s[:-1]), told.states[-1]]
    columns = (one.tolist() for one in (time_s, x_m, y_m, height_m, speed_m_s))
    for at_s, x, y, height, speed, known in zip(*columns, states, strict=True):
        moved = events.VehicleMoved(at_s, record.day, record.flight, record.system_id, x, y, height, speed)
        if known is not None:
            own, mode = known
            moved = replace(
                moved,
                speed_m_s=own.ground_speed_m_s,
                heading_rad=own.heading_rad,
                battery=own.battery.remaining,
                mode=mode,
                armed=own.armed,
                item=own.item,
                items=own.total,
            )
        yield at_s, moved


def _said(flight: FlightTogether, record: FlightRecord) -> Iterator[_Timed]:
    for at_s, severity, text in sorted(record.texts, key=lambda one: one[0]):
        time_s = flight.begun_s + at_s
        yield time_s, events.VehicleSaid(time_s, record.system_id, severity, text)


def _ended(flight: FlightTogether, record: FlightRecord) -> Iterator[_Timed]:
    times = [record.texts[-1][0]] if record.texts else []
    times += record.track.time_s[-1:].tolist()
    time_s = flight.begun_s + max(times, default=0.0)
    outcome = record.outcome.value
    numbers = record.day, record.flight, record.system_id
    yield time_s, events.FlightEnded(time_s, *numbers, outcome, record.reason)


def _seen(result: RunRecord, flight: FlightTogether) -> Iterator[_Timed]:
    """Yield the observations of a flight, grouped by the second in which they became known."""
    part = result.observations[flight.seen]
    if not len(part):
        return
    # A lost image that was fetched again became known only when it arrived.
    known_s = np.maximum.accumulate(part.time_s)
    ends = np.flatnonzero(np.diff(np.floor(known_s / _SEEN_S)) > 0.0) + 1
    for begin, end in zip([0, *ends.tolist()], [*ends.tolist(), len(part)], strict=True):
        yield flight.begun_s + float(known_s[end - 1]), events.Seen(flight.begun_s, part[begin:end])


def _decided(result: RunRecord, flight: FlightTogether) -> Iterator[_Timed]:
    for record in _decisions(result, flight):
        # A decision at time 0 is made before the flight.
        time_s = flight.started_s + record.time_s if record.time_s > 0.0 else flight.begun_s
        yield time_s, events.Decided(time_s, record)


def _estimated(
    result: RunRecord, estimates: int, estimator: Estimator | None, progress: Progress
) -> Iterator[_Timed]:
    history = result.history
    count = len(history.entries)
    last_of_day = {day: number for number, day in enumerate(history.days)}
    kept = {last_of_day[one.day]: one.model for one in result.days if one.model and one.day in last_of_day}
    if result.model is not None and count:
        kept[count - 1] = result.model
    wanted = set(np.linspace(0, count - 1, min(estimates, count)).round().astype(int).tolist()) - kept.keys()
    again: Iterator[InformationModel | None] = iter(())
    if wanted:
        moments = zip(history.days, history.observations, map(wanted.__contains__, range(count)), strict=True)
        again = estimates_again(result, fresh_estimator(result, progress, estimator), moments)
    due_s = 0.0
    for number, (time_s, day, seen, score) in enumerate(
        zip(history.times_s, history.days, history.observations, history.entries, strict=True)
    ):
        if wanted:
            progress("estimates", number + 1, count)
        if number > max(wanted, default=count):
            again = iter(())  # Frees the estimator
        due_s = max(due_s, time_s)
        yield due_s, events.Estimated(time_s, day, seen, next(again, None) or kept.get(number), score)


@dataclass(frozen=True, slots=True, eq=False)
class StateLog:
    """States of a vehicle over time, from its telemetry."""

    time_s: NDArray[np.float64]
    """Seconds after the start of the log."""
    states: list[tuple[VehicleState, str]]
    """State and name of the flight mode at each time."""

    def at(self, time_s: NDArray[np.float64]) -> list[tuple[VehicleState, str] | None]:
        """Return state and mode at each time; None if the telemetry has no recent state."""
        last = np.searchsorted(self.time_s, time_s + _SAME_S, side="right") - 1
        is_known = (last >= 0) & (time_s - self.time_s[np.maximum(last, 0)] <= _LONGEST_GAP_S)
        return [
            self.states[k] if known else None
            for k, known in zip(last.tolist(), is_known.tolist(), strict=True)
        ]


def states_in(path: Path, begins_s: Sequence[float]) -> dict[tuple[int, int], StateLog]:
    """Return the states in a .tlog, keyed by (system id, part); ResultError if the file cannot be read.

    Part k begins `begins_s[k]` seconds after the start of the log; telemetry before a part does not count.
    """
    begun_s: float | None = None
    monitors: dict[tuple[int, int], VehicleMonitor] = {}
    found: dict[tuple[int, int], list[tuple[float, VehicleState, str]]] = {}
    try:
        for utc_s, message in read_tlog(path):
            begun_s = utc_s if begun_s is None else begun_s
            if message.get_srcComponent() != m.MAV_COMP_ID_AUTOPILOT1:
                continue
            time_s = utc_s - begun_s
            key = message.get_srcSystem(), bisect.bisect_right(begins_s, time_s + _SAME_S) - 1
            monitor = monitors.get(key) or monitors.setdefault(key, VehicleMonitor())
            monitor.receive(message, time_s)
            rows = found.setdefault(key, [])
            state, mode = monitor.state, monitor.mode
            # Arming and mode changes get separate rows, since disarming may follow the last position.
            changes = bool(rows) and (rows[-1][1].armed, rows[-1][2]) != (state.armed, mode)
            if changes or is_a(message, m.MAVLink_global_position_int_message):
                rows.append((time_s, state, mode))
    except LinkError as error:
        raise ResultError(str(error)) from None
    return {
        key: StateLog(np.array([row[0] for row in rows]), [row[1:] for row in rows])
        for key, rows in found.items()
        if rows
    }
