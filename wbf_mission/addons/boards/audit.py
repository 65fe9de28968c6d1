"""Audits benchmark rows: they must be complete, consistent and possible."""

from __future__ import annotations

import functools
import itertools
import math
import re
import tomllib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np

from geo.errors import WbfMissionError
from geo.texts import one_line
from mission.outcome import Outcome
from mission.planners.budget import parse_budget
from sensors.estimators import Estimator
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from sensors.scoring.score import ScoreWeights
from wbf_mission.bench.digests import meaning_of
from wbf_mission.bench.requests import read_asked
from wbf_mission.bench.rows import BenchRow, by_pair, by_scenario
from wbf_mission.bench.spec import require_mover, run_keys, seed_ranges, seeds_of
from wbf_mission.planning.budget import PAPER_STEPS_PER_CELL, make_budget
from wbf_mission.planning.fleet import vehicles_of
from wbf_mission.results.storage import ResultError
from wbf_mission.run.estimation import estimator_of, readings_a_score
from wbf_mission.run.record import MOST_BAD
from wbf_mission.run.resolve import farm_of
from wbf_mission.scenario import Choice, load_scenario, scenario_ids
from wbf_mission.scenario.choice import choose, names_of, registered_elsewhere
from wbf_mission.scenario.parts import UNLIMITED

_LEAST_ERROR = 1e-9
_MOST_LOSS = 1e6
_MOST_ROWS, _MOST_METHODS, _MOST_SEEDS = 100_000, 300, 10_000
_DIGEST = re.compile(r"[0-9a-f]{24}")
_KINDS = ("planner", "estimator")
FILES = "its parameters name local files"


def require_asked(rows: Sequence[BenchRow], folder: Path) -> None:
    """Raise ResultError unless the rows cover every run requested in their folder."""
    there = {(row.scenario, row.planner, row.estimator, row.seed) for row in rows}
    for one in read_asked(folder).asked:
        table = tomllib.loads(one.specification)
        # A specification names Python objects only in comments, not in these lists.
        names = [table.get(key, []) for key in ("scenarios", "planners", "estimators")]
        missing = [
            run for run in itertools.product(*names, seeds_of(str(table["seeds"]))) if run not in there
        ]
        if missing:
            scenario, planner, estimator, seed = missing[0]
            first = f"such as {scenario}, {planner}, {estimator}, seed {seed}"
            msg = f"has no rows for {len(missing)} requested runs, {first}; fly them, or use a new folder"
            raise ResultError(msg)


def require_whole(rows: Sequence[BenchRow], *, sealed: bool = False) -> None:
    """Raise ResultError unless rows are complete, consistent and possible, and have equal behaviour numbers.

    The seeds of each scenario must have no gap, except in a `sealed` round. The error message is one line,
    which names the fault and then the remedy. Rows of failed runs pass: boards show them as failed.
    """
    _require_one_behaviour(rows)
    if len(rows) > _MOST_ROWS:
        raise ResultError(f"holds {len(rows)} rows, more than {_MOST_ROWS}; make several submissions")
    scenarios = by_scenario(rows)
    for scenario, here in scenarios.items():
        _require_meaning(scenario, here[0].codes["scenario"])
        _require_methods(scenario, here)
    for scenario, here in scenarios.items():
        _require_complete(scenario, here)
        if not sealed:
            _require_all_seeds(scenario, {row.seed for row in here})
        limits = _limits_of(scenario)
        for row in here:
            strange = "" if row.key in run_keys(row) else "its key does not belong to this run"
            if why := strange or _inconsistency(row, limits) or next(_impossible(row, limits), ""):
                raise ResultError(f"{one_line(row.named)}: {why}; fly it again into a new folder")


def _require_one_behaviour(rows: Sequence[BenchRow]) -> None:
    if not all({"code", "scenario"} <= row.codes.keys() for row in rows):
        raise ResultError("some rows do not name the code that flew them; fly them again into a new folder")
    behaviours = {row.codes["code"] for row in rows}
    if len(behaviours) > 1:
        several = ", ".join(sorted(behaviours)[:3])
        msg = f"rows of {len(behaviours)} program behaviours ({several}); fly all of them into a new folder"
        raise ResultError(msg)
    names: dict[tuple[str, str], set[str]] = {}
    for row in rows:
        for kind in ("scenario", *_KINDS):
            names.setdefault((kind, getattr(row, kind)), set()).add(row.codes.get(kind, ""))
    for (kind, name), digests in names.items():
        if len(digests) > 1:
            msg = f"{kind} {name} has {len(digests)} code digests; fly its runs again into a new folder"
            raise ResultError(msg)


def _require_meaning(scenario: str, meaning: str) -> None:
    if scenario not in scenario_ids():
        msg = f"{one_line(scenario)} is not in the catalogue; fly scenarios that 'bench list' prints"
        raise ResultError(msg)
    if meaning != _meaning(scenario):
        raise ResultError(f"the settings of {scenario} have changed since the flights; fly it again")


@functools.cache
def _built_in(kind: str) -> frozenset[str]:
    kinds = (kind, "policy") if kind == "planner" else (kind,)
    names = (name for one in kinds for name in names_of(one) if registered_elsewhere(name, one) is None)
    return frozenset(name.lower() for name in names)


@functools.cache
def _meaning(scenario: str) -> str:
    return meaning_of(load_scenario(scenario))


def _require_methods(scenario: str, rows: Sequence[BenchRow]) -> None:
    """Raise ResultError unless every planner and estimator of a scenario can be created."""
    pairs, seeds = by_pair(rows), {row.seed for row in rows}
    if len(pairs) > _MOST_METHODS or len(seeds) > _MOST_SEEDS:
        msg = f"{scenario} has {len(pairs)} methods on {len(seeds)} environments"
        raise ResultError(f"{msg}; at most {_MOST_METHODS} on {_MOST_SEEDS} fit: make several submissions")
    fields = load_field_set(load_scenario(scenario).farm.fields)
    for kind in _KINDS:
        for label, code in dict.fromkeys((getattr(row, kind), row.codes.get(kind)) for row in rows):
            why = _unusable(kind, label, fields) if code is None else ""
            if code is not None and not _DIGEST.fullmatch(code):
                why = "its code digest is malformed"
            elif code is not None and label.partition(":")[0].lower() in _built_in(kind):
                why = "it is your own code with the name of a built-in method: rename your code"
            if why:
                msg = f"{kind} {one_line(label, 60) or 'without a name'}: {why}"
                raise ResultError(f"{msg}; use a {kind} that everybody can fly")


def names_files(choice: Choice) -> bool:
    """Return whether a method's parameters name files or folders, which untrusted rows must not access."""
    return any(key == "cache" or "/" in str(value) for key, value in choice.params.items())


def _unusable(kind: str, label: str, fields: FieldSet) -> str:
    """Return the reason why a label names no built-in planner, policy or estimator; empty if it names one."""
    try:
        choice = choose(label, kind)
        if names_files(choice):
            return FILES
        if kind == "estimator":
            estimator_of(choice, 0, fields)
        else:
            require_mover(choice)
    except WbfMissionError as error:
        return one_line(str(error), 200)
    except (TypeError, ValueError) as error:  # The constructor refused the parameters
        return one_line(f"{type(error).__name__}: {error}", 200)
    return ""


def _require_complete(scenario: str, rows: Sequence[BenchRow]) -> None:
    """Raise ResultError unless every pair of planner and estimator has one row for each seed."""
    every = {row.seed for row in rows}
    for (planner, estimator), own in by_pair(rows).items():
        seeds = [row.seed for row in own]
        missing, label = sorted(every - set(seeds)), one_line(f"{scenario}, {planner}, {estimator}")
        if len(set(seeds)) < len(seeds):
            raise ResultError(f"{label}: two rows have the same seed; fly them again into a new folder")
        if missing:
            which = one_line(seed_ranges(missing), 60)
            msg = f"{label}: no rows for seeds {which}, which other methods have; fly these seeds, too"
            raise ResultError(msg)


def _require_all_seeds(scenario: str, seeds: set[int]) -> None:
    """Raise ResultError if a seed between the first and the last is missing: gaps may hide bad scores."""
    first, last = min(seeds), max(seeds)
    if last - first >= len(seeds):
        which = one_line(seed_ranges(sorted(seeds)), 60)
        msg = f"{scenario}: seeds {which} have gaps between {first} and {last}; fly the missing seeds, too"
        raise ResultError(msg)


def _inconsistency(row: BenchRow, limits: Limits) -> str:
    """Return a contradiction within a row; empty if there is none."""
    scores = np.array(row.scores)
    if row.score is None or row.final_score is None or not len(scores):
        return "" if row.error is not None else "it has neither a score nor an error"
    names = tuple(limits.losses)
    if set(row.history) != set(names) or set(row.losses) != set(names):
        return f"its losses are for other fields than {', '.join(names)}"
    history = [np.array(row.history[name]) for name in names]
    if {len(row.times_s), *map(len, history)} != {len(scores)}:
        return "the lists of its history have different lengths"
    losses = np.array(history)
    numbers = (scores, losses, np.array(row.times_s), np.array([row.score, row.final_score]))
    if (
        not all(np.isfinite(number).all() for number in numbers)
        or not ((losses >= 0.0) & (losses <= _MOST_LOSS)).all()
    ):
        return "its history has a number that is not finite, or an impossible loss"
    if row.score != float(np.mean(scores)):
        return f"its score {row.score} is not the mean of the scores in its history"
    if row.final_score != scores[-1]:
        return f"its final score {row.final_score} is not the last score in its history"
    for name in names:
        if row.losses[name] != row.history[name][-1]:
            return f"its loss of {name} is not the last loss in its history"
    loss = (limits.parts[:, None] * losses).sum(axis=0)
    if (np.abs(scores + loss) > _LEAST_ERROR * np.maximum(1.0, np.abs(scores))).any():
        return "its scores do not follow from its losses"
    return ""


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
    """Upper limits of one run of a catalogue scenario; unless noted, a limit is a sum over all flights."""

    def __init__(self, name: str) -> None:
        self.scenario = scenario = load_scenario(name)
        self.farm, fields = farm_of(scenario.farm)
        vehicles = vehicles_of(scenario, self.farm, seed=0, first_day=scenario.farm.day)
        builders = [vehicle.task.builder for vehicle in vehicles]
        first, camera, text = builders[0], scenario.camera, scenario.mission.budget
        ideal = all(builder.vehicle.is_ideal for builder in builders)
        self.flights = scenario.farm.days * scenario.farm.flights_per_day
        # Budget of one flight as text, as rows of planners and rows of policies state it.
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
        # On a large farm, some estimators are scored more often than this minimum.
        any_one = cast("Estimator", None)
        every = readings_a_score(points, self.farm, any_one, self.flights, expected, ideal=ideal)
        return max(1, math.floor(0.9 * readings / every))


_limits_of = functools.cache(Limits)


def _impossible(row: BenchRow, limits: Limits) -> Iterator[str]:
    """Yield the values of a row that no run of its scenario can have."""
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
