"""View of a run for pages: built from its events, and sent to each viewer incrementally."""

from __future__ import annotations

import bisect
import math
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from itertools import compress
from operator import attrgetter
from typing import Any, Generic, NewType, TypeAlias, TypeVar

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from geo.errors import told_error
from geo.grid import FarmGrid
from geo.system import steady_s
from mission.outcome import in_words
from mission.policies.decision import AcquisitionMap
from sensors.fields import HEALTH_COLOURS, WATER_COLOURS, Field
from sensors.observations import GrowingArray, Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import Score
from wbf_mission import events
from wbf_mission.addons.web import schema
from wbf_mission.addons.web.layers import LONGEST, Layers, Pixels
from wbf_mission.addons.web.shapes import farm_shape, plan_shape, ring
from wbf_mission.replanning.record import DecisionRecord

T = TypeVar("T")
Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Cursor = NewType("Cursor", int)
"""Version of a view that a viewer has received."""

MAX_STATES = 20_000
"""Maximum number of states per vehicle, and of scores; above it, half of the older rows are dropped."""
MAX_ALL_STATES = 400_000
"""Maximum number of states of all vehicles together."""
MAX_PLANS = 500
MAX_DECISIONS = 2_000
MAX_SAID = 2_000
MAX_CANDIDATES = 40
"""Maximum number of candidates per decision; the best are kept."""
_MAX_TEXT = 500
_WARNING, _INFO = 4, 6  # MAV_SEVERITY
_RUNNING = "running"
_UNDER_WAY = "sent"  # Outcome of a path change in progress

# Tuples of plain values need no garbage collection, unlike other objects.
_State: TypeAlias = tuple[Any, ...]
_STATE = tuple(name for name in events.VehicleMoved.__dataclass_fields__ if name != "system_id")
_state_of = attrgetter(*_STATE)
_TWO_DIGITS = dict.fromkeys(("time_s", "x_m", "y_m", "height_m", "speed_m_s"), 2)
_DIGITS = _TWO_DIGITS | {"heading_rad": 1, "battery": 4, "link_quality": 3, "silent_s": 1}
_SHOWN_AS = {"x_m": "x", "y_m": "y", "heading_rad": "heading_deg", "link_quality": "link"}
_Scored: TypeAlias = tuple[float, int, int, Score | None]


class _Rows(Generic[T]):
    """Rows with their versions; above the limit, the older half of the rows is thinned or dropped."""

    def __init__(self, name: str, limit: int, *, thins: bool = False) -> None:
        self.name, self.limit, self.step = name, limit, 2 if thins else 1
        self.rows: list[T] = []
        self.versions: list[int] = []
        self.thinned = 0  # Version of the last thinning

    def add(self, row: T, version: int) -> None:
        """Append a row with its version; thin the older rows above the limit."""
        self.rows.append(row)
        self.versions.append(version)
        if len(self.rows) > self.limit:
            for rows in (self.rows, self.versions):
                del rows[: self.limit // 2 : self.step]
            self.thinned = version

    def keep(self, kept: Sequence[bool]) -> None:
        """Keep only the rows for which `kept` is true."""
        self.rows, self.versions = list(compress(self.rows, kept)), list(compress(self.versions, kept))

    def after(self, cursor: int, restart: list[str]) -> list[T]:
        """Return the rows newer than a cursor; after a thinning, return all rows and note it in `restart`."""
        if 0 < cursor < self.thinned:
            restart.append(self.name)
            cursor = 0
        return self.rows[bisect.bisect_right(self.versions, cursor) :]


class _Readings:
    """Readings of cells as columns; their number has no limit."""

    def __init__(self) -> None:
        self.time_s, self.x, self.y = (GrowingArray((), kind) for kind in "dff")
        self.values: dict[str, GrowingArray] = {}
        self.ends: list[int] = []
        self.versions: list[int] = []

    def add(self, seen: Observations, offset_s: float, cell_m: float, version: int) -> None:
        """Append the readings of an event."""
        known = len(self.time_s)
        self.time_s.append(seen.time_s + offset_s)
        self.x.append((seen.x + 0.5) * cell_m)
        self.y.append((seen.y + 0.5) * cell_m)
        for name in seen.fields:
            if name not in self.values:
                self.values[name] = GrowingArray((), np.float32)
                self.values[name].append(np.full(known, np.nan, np.float32))
        for name, column in self.values.items():
            found = seen.values[:, seen.fields.index(name)] if name in seen.fields else None
            column.append(np.full(len(seen), np.nan, np.float32) if found is None else found)
        self.ends.append(len(self.time_s))
        self.versions.append(version)

    def after(self, cursor: int) -> dict[str, NDArray[Any]]:
        """Return the rows newer than a cursor, by column; written rows never change."""
        known = bisect.bisect_right(self.versions, cursor)
        first = self.ends[known - 1] if known else 0
        columns = {"time_s": self.time_s, "x": self.x, "y": self.y, **self.values}
        return {name: column.array[first:] for name, column in columns.items()}


class View:
    """State of a run as pages show it; listens to the run's events.

    The run's threads call `take`, which is fast. Any number of viewers call `update` at any time; the view
    keeps no state for viewers. Drawing uses at most `share` of the wall time (1: no limit), but a flight's
    last estimate is always drawn. Layers have at most `longest` pixels per side. `clock` measures ages.

    >>> view = View()
    >>> view.take(events.Noted("the vehicle is heard"))
    >>> update, cursor = view.update(None)
    >>> update.said[0].text, view.update(cursor)[0].json()
    ('the vehicle is heard', b'{"time_s":0.0}')
    """

    def __init__(
        self, *, share: float = 0.2, longest: int = LONGEST, clock: Callable[[], float] = steady_s
    ) -> None:
        self._share, self._longest, self._clock = share, longest, clock
        # The first lock is held for a whole drawing, the second one briefly for each access to the state.
        self._drawing, self._lock = threading.RLock(), threading.RLock()
        self._begun: events.RunBegun | None = None
        self._fields: tuple[Field, ...] = ()
        self._skipped: InformationModel | None = None  # Latest estimate, if it is not drawn yet
        self._stale: Bools | None = None  # bool[n, tiles along x, y]: tiles changed since the last drawing
        self._followed: tuple[weakref.ref[Any], int] | None = None  # Latest estimate's values, revision
        self._draw_at_s = 0.0

        self._layers: Layers | None = None
        self._version = 1
        self._replaced = {"status": 1}  # Version of the last change of each member that is sent whole
        self._time_s = 0.0
        self._run: schema.Run | None = None
        self._status = schema.Status(_RUNNING, in_words(_RUNNING), "", None, None, ())
        self._background: schema.Background | None = None
        self._plans = _Rows[schema.Plan]("plans", MAX_PLANS)
        self._states: dict[int, _Rows[_State]] = {}
        self._heard_s: dict[int, float] = {}  # Receive times of the vehicles' latest states, by the clock
        self._readings = _Readings()
        self._scores = _Rows[_Scored]("scores", MAX_STATES, thins=True)
        self._decisions = _Rows[schema.Decision]("decisions", MAX_DECISIONS)
        self._records: list[tuple[float, DecisionRecord]] = []  # Times since the start, and decisions
        self._open: dict[int, tuple[str, tuple[str, ...]] | None] = {}  # Unfinished: state that was sent last
        self._said = _Rows[schema.Said]("said", MAX_SAID)

    # Output

    @property
    def cursor(self) -> Cursor:
        """Cursor of a viewer with all data; grows with every change."""
        with self._lock:
            self._look_after_decisions()
            return Cursor(self._version)

    @property
    def time_s(self) -> float:
        """Time of the latest event (s)."""
        return round(self._time_s, 2)

    def silent_s(self) -> dict[str, float]:
        """Return the age of each vehicle's newest state (s); empty in a simulation, where time may stop."""
        if self._run is None or self._run.simulated or self._status.outcome != _RUNNING:
            return {}
        with self._lock:
            now_s = self._clock()
            return {str(number): round(now_s - heard_s, 1) for number, heard_s in self._heard_s.items()}

    def update(self, cursor: Cursor | None) -> tuple[schema.Update, Cursor]:
        """Return the data newer than a cursor (None: all data), and the next cursor."""
        at, restart = int(cursor or 0), list[str]()
        with self._lock:
            self._look_after_decisions()
            replaced = {name for name, version in self._replaced.items() if version > at}
            whole = {name: getattr(self, f"_{name}") for name in replaced - {"layers"}}
            update, version = schema.Update(self.time_s, **whole), Cursor(self._version)
            plans, said = self._plans.after(at, restart), self._said.after(at, restart)
            decisions, scores = self._decisions.after(at, restart), self._scores.after(at, restart)
            states = {str(key): rows.after(at, restart) for key, rows in self._states.items()}
            readings = self._readings.after(at)
            if at and "layers" in replaced:
                restart.append("tiles")
                at = 0
            tiles = [] if self._layers is None else self._layers.show(at)
            if tiles and self._layers is not None:
                update.scales = self._layers.scales
        new = {
            "restart": restart,
            "plans": plans,
            "said": said,
            "decisions": decisions,
            "states": {name: _states(rows) for name, rows in states.items() if rows},
            "readings": _readings(readings) if len(readings["time_s"]) else None,
            "scores": _scores(scores) if scores else None,
            "tiles": [tile.packed() for tile in tiles],
        }
        return replace(update, **{name: part for name, part in new.items() if part}), version

    def offer(self, background: schema.Background | None) -> None:
        """Set the user's background map."""
        self._replace("background", background)

    # Input

    def take(self, event: events.Event) -> None:
        """Process an event; an error is shown on the page and does not end the flight."""
        try:
            self._take(event)
        except Exception as error:
            text = f"the page cannot show {type(event).__name__}: {told_error(error)}"
            self._say(text, _WARNING, 0, self._time_s)

    def _take(self, event: events.Event) -> None:
        match event:
            case events.RunBegun():
                self._begin(event)
            case events.DayBegun():
                self._hear(event.time_s)
                self._draw_truth(event.truth)
            case events.Planned():
                farm = None if self._begun is None else self._begun.farm
                self._add(self._plans, plan_shape(event, farm), event.time_s)
            case events.VehicleMoved():
                if math.isfinite(event.x_m) and math.isfinite(event.y_m):
                    with self._lock:
                        self._heard_s[event.system_id] = self._clock() - event.silent_s
                    self._add(self._states_of(event.system_id), _state_of(event), event.time_s)
            case events.VehicleSaid():
                self._say(event.text, event.severity, event.system_id, event.time_s)
            case events.Seen():
                self._see(event)
            case events.Estimated():
                if event.model is not None:
                    self._draw_estimate(event.model)
                row = event.time_s, event.day, event.observations, event.score
                self._add(self._scores, row, event.time_s)
            case events.Decided():
                self._hear(event.time_s)
                self._draw_acquisition(event.acquisition)
                self._decide(event.time_s, event.record)
            case events.FlightEnded():
                self._draw_skipped()
                text = f"flight {event.flight}: {in_words(event.outcome, event.reason)}"
                self._say(text, _INFO, event.system_id, event.time_s)
            case events.Progressed():
                over = 0.0 < event.total <= event.done
                self._tell(progress=None if over else schema.Progress(event.what, event.done, event.total))
            case events.Noted():
                self._say(event.text, _WARNING if event.warns else _INFO, 0, self._time_s)
            case events.Asked():
                question = schema.Question(event.question, event.answers, event.number)
                self._tell(question=question if event.question else None)
            case events.Orderable():
                self._tell(orders=event.orders)
            case events.RunEnded():
                self._draw_skipped()
                self._hear(event.time_s)
                ended = {"outcome": event.outcome, "words": in_words(event.outcome), "reason": event.reason}
                self._tell(progress=None, question=None, **ended)

    def _hear(self, time_s: float) -> int:
        """Record the time of an event, and return a new version number."""
        with self._lock:
            self._version += 1
            self._time_s = max(self._time_s, time_s)
            return self._version

    def _add(self, rows: _Rows[T], row: T, time_s: float) -> None:
        with self._lock:
            rows.add(row, self._hear(time_s))

    def _replace(self, name: str, value: Any) -> None:
        with self._lock:
            setattr(self, f"_{name}", value)
            self._replaced[name] = self._hear(0.0)

    def _tell(self, **status: Any) -> None:
        with self._lock:
            self._replace("status", replace(self._status, **status))

    def _say(self, text: str, severity: int, system_id: int, time_s: float) -> None:
        said = schema.Said(round(time_s, 2), system_id, severity, text[:_MAX_TEXT])
        self._add(self._said, said, time_s)

    def _states_of(self, system_id: int) -> _Rows[_State]:
        with self._lock:
            if system_id not in self._states:
                self._states[system_id] = _Rows(f"states/{system_id}", MAX_STATES, thins=True)
                for rows in self._states.values():
                    rows.limit = min(MAX_STATES, MAX_ALL_STATES // len(self._states))
            return self._states[system_id]

    def _begin(self, event: events.RunBegun) -> None:
        with self._drawing:
            before, self._begun = self._begun, event
            farm, fields, layers = event.farm, event.fields, self._layers
            self._fields = tuple(fields or ())
            anew = before is None or (before.farm, before.fields) != (farm, fields)
            if anew:
                layers = None if farm is None or fields is None else Layers(farm, self._longest)
                self._skipped = self._stale = self._followed = None
            run = schema.Run(
                *(event.title, event.simulated, event.seed, event.estimator, event.planner),
                farm=None if farm is None else farm_shape(farm),
                fields=[_field(field) for field in self._fields],
                raster=None if layers is None else layers.raster,
                vehicles=[
                    schema.VehicleInfo(vehicle.system_id, vehicle.name, vehicle.kind)
                    for vehicle in event.vehicles
                ],
            )
            with self._lock:
                if anew:
                    self._replace("layers", layers)
                self._replace("run", run)

    def _see(self, event: events.Seen) -> None:
        seen = event.observations
        if len(seen):
            farm = self._begun.farm if self._begun else None
            cell_m = 1.0 if farm is None else farm.cell_size_m
            if farm is not None:
                seen = _of_their_crops(farm.grid(), self._fields, seen)
            with self._lock:
                version = self._hear(event.offset_s + float(seen.time_s.max()))
                self._readings.add(seen, event.offset_s, cell_m, version)

    def _decide(self, time_s: float, record: DecisionRecord) -> None:
        with self._lock:
            known = (i for i, (_, earlier) in enumerate(self._records) if earlier is record)
            index = next(known, len(self._records))
            if index == len(self._records):
                self._records.append((time_s, record))
            self._open[index + 1] = None
            self._look_after_decisions()

    def _look_after_decisions(self) -> None:
        """Publish again the decisions whose outcomes have changed since they were sent."""
        for number, sent in tuple(self._open.items()):
            time_s, record = self._records[number - 1]
            state = record.refused, tuple(change.outcome for change in record.changes)
            if state != sent:
                self._decisions.keep([known.number != number for known in self._decisions.rows])
                self._decisions.add(_decision(number, time_s, record), self._hear(time_s))
                self._open[number] = state
            if _UNDER_WAY not in state[1]:
                del self._open[number]

    # Layers

    def _draw(
        self, name: str, pixels: Pixels, *, stale: Bools | None = None, scale: float | None = None
    ) -> None:
        """Draw a layer; the caller holds the lock `_drawing`, and `_layers` is set."""
        assert self._layers is not None
        drawing = self._layers.put(name, pixels, changed=stale, scale=scale)
        with self._lock:
            self._layers.draw(drawing, self._hear(0.0))

    def _draw_truth(self, truth: Floats | None) -> None:
        with self._drawing:
            layers, fields = self._layers, self._fields
            if truth is not None and layers is not None:
                for k, field in enumerate(fields):
                    self._draw(f"truth/{field.name}", layers.of_cells(truth[k], field.crops), scale=1.0)

    def _draw_acquisition(self, acquisition: AcquisitionMap | None) -> None:
        with self._drawing:
            if acquisition is not None and self._layers is not None:
                pixels = self._layers.of_blocks(acquisition.values, acquisition.cell_m)
                self._draw("acquisition", pixels)

    def _draw_estimate(self, model: InformationModel) -> None:
        with self._drawing:
            follows = self._followed is not None and self._followed[0]() is model.value
            follows = follows and self._followed is not None and self._followed[1] + 1 == model.revision
            self._followed = weakref.ref(model.value), model.revision
            changed = np.stack([model.changed_in(k) for k in range(len(model.fields))])
            stale = changed if follows else np.ones_like(changed)
            self._stale = stale if self._stale is None else self._stale | stale
            self._skipped = model
            if time.perf_counter() >= self._draw_at_s:
                self._draw_skipped()

    def _draw_skipped(self) -> None:
        """Draw the latest estimate unless it is drawn already."""
        with self._drawing:
            model, self._skipped = self._skipped, None
            layers, crops = self._layers, {field.name: field.crops for field in self._fields}
            if model is None or self._stale is None or layers is None:
                return
            began_s = time.perf_counter()
            # Read each field only when it is drawn, so that it takes no memory afterwards.
            maps = ("value", model.value, 1.0), ("uncertainty", model.uncertainty, None)
            for k, name in enumerate(model.fields):
                for kind, cells, scale in maps:
                    pixels = layers.of_cells(cells[k], crops[name])
                    self._draw(f"{kind}/{name}", pixels, stale=self._stale[k], scale=scale)
                    del pixels
            self._stale = None
            now_s = time.perf_counter()
            self._draw_at_s = now_s + (now_s - began_s) * (1.0 / self._share - 1.0)


def _field(field: Field) -> schema.FieldInfo:
    kind = field.kind if field.is_simulated else "measured"
    # The page has its own colours for each kind, with monotonic lightness.
    colours = () if field.colours in (HEALTH_COLOURS, WATER_COLOURS) else field.colours
    return schema.FieldInfo(field.name, field.title, kind, field.unit, field.range, colours)


def _decision(number: int, time_s: float, record: DecisionRecord) -> schema.Decision:
    return schema.Decision(
        *(number, round(time_s, 2), record.day, record.flight, record.event, record.reason, record.refused),
        compute_s=round(record.compute_s, 4),
        candidates=[
            schema.Candidate(other.system_id, ring(other.points_m), other.value, other.cost)
            for other in record.alternatives[:MAX_CANDIDATES]
        ],
        changes=[
            schema.Change(change.system_id, ring(change.path_m), change.cost, change.outcome)
            for change in record.changes
        ],
    )


def _states(rows: list[_State]) -> schema.States:
    columns: dict[str, Any] = dict(zip(_STATE, map(list, zip(*rows, strict=True)), strict=True))
    columns["heading_rad"] = np.degrees(np.array(columns["heading_rad"], np.float64))
    for name, digits in _DIGITS.items():
        # In a float64 array, None becomes NaN, which is written to JSON as null
        columns[name] = np.round(np.array(columns[name], np.float64), digits).tolist()
    return schema.States(**{_SHOWN_AS.get(name, name): column for name, column in columns.items()})


def _of_their_crops(grid: FarmGrid, fields: Sequence[Field], seen: Observations) -> Observations:
    """Return the observations; a field's readings outside its crops are replaced by NaN."""
    values = seen.values.copy()
    for field in fields:
        if field.name in seen.fields:
            values[~field.hosts(grid, (seen.x, seen.y)), seen.fields.index(field.name)] = np.nan
    return Observations(seen.x, seen.y, seen.time_s, seen.day, values, seen.fields)


def _readings(columns: dict[str, NDArray[Any]]) -> schema.Readings:
    rounded = {name: np.round(column.astype(np.float64), 3).tolist() for name, column in columns.items()}
    return schema.Readings(rounded.pop("time_s"), rounded.pop("x"), rounded.pop("y"), rounded)


def _scores(rows: list[_Scored]) -> schema.Scores:
    scores = [row[3] for row in rows]
    lost = [
        {} if score is None else dict(zip(score.fields, score.field_loss, strict=True)) for score in scores
    ]
    names = dict.fromkeys(name for losses in lost for name in losses)
    return schema.Scores(
        time_s=[round(row[0], 2) for row in rows],
        day=[row[1] for row in rows],
        observations=[row[2] for row in rows],
        score=[None if score is None else score.score for score in scores],
        losses={name: [losses.get(name) for losses in lost] for name in names},
    )
