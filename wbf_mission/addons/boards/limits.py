"""Upper limits of a scenario's results: rows that exceed the limits were made up."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from itertools import pairwise
from typing import cast

import numpy as np

from mission.outcome import Outcome
from mission.planners.budget import parse_budget
from sensors.estimators import Estimator
from sensors.scoring.score import ScoreWeights
from wbf_mission.bench.rows import BenchRow
from wbf_mission.planning.budget import PAPER_STEPS_PER_CELL, make_budget
from wbf_mission.planning.fleet import vehicles_of
from wbf_mission.run.estimation import readings_a_score
from wbf_mission.run.record import MOST_BAD
from wbf_mission.run.resolve import farm_of
from wbf_mission.scenario import load_scenario
from wbf_mission.scenario.parts import UNLIMITED

# Real flights exceed the prediction because of wind, gusts, arming and landing.
_SLACK, _SLACK_S, _SLACK_M = 1.5, 60.0, 30.0
# Vehicles that wait, turn or revisit a place give more readings per metre than predicted.
_READINGS, _SLACK_READINGS = 3.0, 50
# Largest possible error of an estimate: health lies between 0 and 1, but some estimators extrapolate.
_WIDEST_ERROR = 5.0
_NUMBERS = (
    "observations",
    "cells_observed",
    "path_length_m",
    "flight_time_s",
    "predicted_time_s",
    "battery_used",
    "decisions",
    "wall_time_s",
    "cpu_time_s",
)
_NEEDED = ("observations", "cells_observed", "path_length_m", "flight_time_s", "decisions", "budget")


class Limits:
    """Upper limits of one run of a catalogue scenario; they are sums over all flights unless noted."""

    def __init__(self, name: str) -> None:
        self.scenario = scenario = load_scenario(name)
        self.farm, fields = farm_of(scenario.farm)
        vehicles = vehicles_of(scenario, self.farm, seed=0, first_day=scenario.farm.day)
        builders = [vehicle.task.builder for vehicle in vehicles]
        first, camera, text = builders[0], scenario.camera, scenario.mission.budget
        ideal = all(builder.vehicle.is_ideal for builder in builders)
        self.flights = scenario.farm.days * scenario.farm.flights_per_day
        # The budget of one flight, as rows state it for a planner and for a policy.
        self.budgets = {make_budget(text, first, steered=steered)[1] for steered in (False, True)}
        value, unit = math.inf, ""
        if text is None and ideal:
            value, unit = float(round(PAPER_STEPS_PER_CELL * self.farm.owner_cells)), "steps"
        elif text is not None and text.strip().lower() != UNLIMITED:
            value, unit = parse_budget(text)
        # Largest flight time per flight, and path length per flight and vehicle, that the budget allows.
        self.flight_s = value if unit in ("s", "steps") else math.inf
        self.flight_m = {"m": value, "steps": value * self.farm.cell_size_m}.get(unit, math.inf)
        # Sum of the vehicles' top speeds, each increased by the wind speed.
        self.speed_m_s = sum(builder.vehicle.top_speed_m_s for builder in builders)
        self.speed_m_s += len(builders) * scenario.weather.wind_speed_m_s
        # Cells that the paper's robots observe per second (0 for other vehicles), and cells that a vehicle
        # observes per metre of path.
        seen = camera.footprint**2
        self.readings_s = len(builders) * seen / first.vehicle.step_s if ideal else 0.0
        self.readings_m = seen / (camera.spacing_m or self.farm.cell_size_m * camera.footprint)
        self.cells = self.farm.width_cells * self.farm.height_cells
        weights = ScoreWeights.of(fields)
        masks = fields.masks(self.farm.grid()).sum(axis=(1, 2))
        # Largest number of scored cells of a field.
        self.scored = int(max(masks))
        # Largest possible loss of each field.
        costs = zip(fields.names, weights.too_healthy, weights.too_sick, strict=True)
        self.losses = {field: max(cost) * _WIDEST_ERROR**2 for field, *cost in costs}
        # Fraction of the total loss by field: weight times number of cells, normalised.
        counts = np.array(weights.field) * masks
        self.parts = counts / counts.sum()

    def fewest_scored(self, row: BenchRow) -> int:
        """Return the minimum number of scored times for the readings of a row."""
        readings, flown_s = row.observations or 0, (row.flight_time_s or 0.0) / self.flights
        # The number of readings between two scored times depends on the expected readings of a flight.
        if self.readings_s:
            expected = self.flight_s * self.readings_s
        else:
            whole = max(1.0, self.flight_s / max(flown_s, 1.0)) if math.isfinite(self.flight_s) else 1.0
            expected = _READINGS * whole * self.readings_m * (row.path_length_m or 0.0) / self.flights
        if not math.isfinite(expected):
            return 1
        points, ideal = self.scenario.score.points, self.readings_s > 0.0
        # Some estimators are scored more often on a large farm: they exceed this minimum.
        any_one = cast("Estimator", None)
        every = readings_a_score(points, self.farm, any_one, self.flights, expected, ideal=ideal)
        return max(1, math.floor(0.9 * readings / every))


@functools.cache
def limits_of(scenario: str) -> Limits:
    """Return the limits of a scenario of the catalogue, computed once."""
    return Limits(scenario)


def impossible(row: BenchRow, limits: Limits) -> str:
    """Describe the first impossible value of a row; empty if a run of its scenario can have all values."""
    return next(_impossible(row, limits), "")


def _impossible(row: BenchRow, limits: Limits) -> Iterator[str]:
    for name in _NUMBERS:
        value = getattr(row, name)
        if value is not None and not (math.isfinite(value) and value >= 0.0):
            yield f"its {name} is {value:g}"
    if any(not (math.isfinite(value) and value >= 0.0) for value in row.timings_s.values()):
        yield "the time of one of its parts is negative or not finite"
    bad = sum(row.bad_answers.values())
    if any(count < 0 for count in row.bad_answers.values()) or bad > (row.decisions or 0):
        yield f"it counts {bad} bad answers among {row.decisions or 0} answers"
    for name, most in limits.losses.items():
        if any(not 0.0 <= loss <= most for loss in row.history.get(name, ())):
            yield f"a loss of {name} is not between 0 and {most:g}"
    if row.error is not None:
        if row.score is None and (len(row.scores) or row.history):
            yield "it has a history, but no score"
        return
    if missing := [name for name in _NEEDED if getattr(row, name) is None]:
        yield f"it has no value for {missing[0]}"
        return
    if bad > MOST_BAD * (row.decisions or 0):
        yield f"{bad} of {row.decisions} answers were bad, but it is not marked as failed"
    if row.outcome not in {one.value for one in Outcome if one.is_good}:
        yield f"its outcome is {row.outcome}, but it is not marked as failed"
    yield from _beyond(row, limits)
    yield from _odd_history(row, limits)


def _beyond(row: BenchRow, limits: Limits) -> Iterator[str]:
    """Yield the values of a complete row that exceed its scenario's limits."""
    readings, cells = row.observations or 0, row.cells_observed or 0
    length_m, flown_s, flights = row.path_length_m or 0.0, row.flight_time_s or 0.0, limits.flights
    if row.budget not in limits.budgets:
        yield f"its budget is {row.budget}, but the scenario has {' or '.join(sorted(limits.budgets))}"
    # The paper's robot takes one step after its last reading.
    ideal = limits.readings_s > 0.0
    most_s = limits.flight_s + 1.0 if ideal else _SLACK * limits.flight_s + _SLACK_S
    if flown_s > flights * most_s:
        yield f"it flew for {flown_s:g} s, longer than its budget allows"
    if length_m > flights * (limits.flight_m * _SLACK + _SLACK_M) * len(limits.scenario.vehicle.fleet):
        yield f"its path of {length_m:g} m is longer than its budget allows"
    if length_m > limits.speed_m_s * (flown_s + flights * (1.0 if ideal else _SLACK_S)):
        yield f"its vehicles cannot fly {length_m:g} m in {flown_s:g} s"
    most = (flown_s + flights) * limits.readings_s
    most = most or _READINGS * limits.readings_m * length_m + flights * _SLACK_READINGS
    if readings > most:
        yield f"{readings} readings are more than its path can give"
    if not 1 <= cells <= min(readings, limits.cells):
        yield f"{cells} cells observed are not possible with {readings} readings of {limits.cells} cells"


def _odd_history(row: BenchRow, limits: Limits) -> Iterator[str]:
    """Yield contradictions in the history of scored times of a complete row."""
    last_s = (row.flight_time_s or 0.0) * _SLACK + limits.flights * _SLACK_S
    # Images of vehicles other than the paper's robots arrive late: scored times may be out of order.
    ordered = row.times_s if limits.readings_s else sorted(row.times_s)
    if any(later < sooner for sooner, later in pairwise((0.0, *ordered, last_s))):
        yield "its scored times do not rise from 0 to the end of its flights"
    fewest = limits.fewest_scored(row)
    if len(row.scores) < fewest:
        yield f"it has {len(row.scores)} scored times, but its readings give at least {fewest}"
    most = (row.observations or 0) + limits.flights * (2 + (limits.scenario.score.points or len(row.scores)))
    if len(row.scores) > most:
        yield f"it has {len(row.scores)} scored times, but its readings give at most {most}"
    if any(score >= 0.0 for score in row.scores) and (row.cells_observed or 0) < limits.scored:
        yield f"an estimate is perfect, but only {row.cells_observed} cells were observed"
