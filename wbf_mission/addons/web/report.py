"""Report of one or two finished runs as one HTML file: a one-sheet summary, and the page that replays them.

The page is the live page of a run, but it plays a recording. A `View` listens to the events of the result,
and its layers are kept at some moments. A file that is too large gets fewer moments, larger pixels, and
finally fewer readings; its notes say so. `RunPage` keeps the layers of a run that is flown for the report.
These layers include the acquisition maps of decisions, which results do not contain.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import replace as replaced
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import UNSET
from msgspec.structs import asdict, replace
from numpy.typing import NDArray

from geo.atomic import atomic_write
from geo.errors import WbfMissionError
from mission.planners.path import keep_within
from sensors.errors import EstimatorError
from wbf_mission.addons.base.markup import data_element
from wbf_mission.addons.base.replay import events_of
from wbf_mission.addons.web import schema
from wbf_mission.addons.web.bench_page import document
from wbf_mission.addons.web.layers import LONGEST
from wbf_mission.addons.web.summary import comparison_of, run_title, summary_of
from wbf_mission.addons.web.view import Cursor, View
from wbf_mission.events import DayBegun, Decided, Estimated, Event, EventStream, RunBegun, RunEnded
from wbf_mission.maps.blocks import SICK_BELOW
from wbf_mission.progress import Progress, silent
from wbf_mission.run.record import RunRecord

MOMENTS = 40
"""Approximate number of scored times at which layers are kept."""
PIXELS = (LONGEST, LONGEST // 2, LONGEST // 4)
"""Sizes in which layers are kept: pixels along the longer side of the farm."""
_SMALL_CELLS = 40_000
"""Up to this number of cells, every estimate is drawn, so that a decision shows the estimate that it used."""
_ACQUISITION = "acquisition"
_TOLERANCES = {
    "x": 0.02,
    "y": 0.02,
    "height_m": 0.05,
    "speed_m_s": 0.25,
    "battery": 0.002,
    "heading_deg": 2.0,
}
"""Maximum deviation of a dropped state from the line between the states kept, in the values' units."""
_FIXED = ("day", "flight", "item", "items", "mode", "phase", "armed")


class Recorder:
    """Draws the layers of a run in several pixel sizes, and keeps the layers of chosen moments."""

    def __init__(self) -> None:
        self.views = {longest: View(share=1.0, longest=longest) for longest in PIXELS}
        self._cursors: dict[int, Cursor | None] = dict.fromkeys(self.views)
        self.moments: dict[int, list[schema.Moment]] = {longest: [] for longest in self.views}
        self.decisions: list[bool] = []  # Whether each moment is the time of a decision

    def take(self, event: Event) -> None:
        """Draw the layers that an event changes."""
        for view in self.views.values():
            view.take(event)

    def keep(self, time_s: float, day: int, observations: int, *, decision: bool = False) -> None:
        """Keep the tiles changed since the previous moment."""
        new = {}
        for longest, view in self.views.items():
            new[longest], self._cursors[longest] = view.update(self._cursors[longest])
        if not new[LONGEST].tiles:
            return
        self.decisions.append(decision)
        for longest, moments in self.moments.items():
            # Events come from two threads, and events with estimates may be late.
            at_s = max(time_s, moments[-1].time_s) if moments else time_s
            update = new[longest]
            moments.append(schema.Moment(at_s, day, observations, update.tiles or [], update.scales or {}))


class RunPage:
    """Report of a run, recorded during the flight: a `wbf_mission.addons.base.pages.RunPage`.

    The report keeps the layers of estimates at about `MOMENTS` of the `scored` scored times, and the
    acquisition map of each decision. `decided_s` maps the `id` of a decision's record to its time.
    """

    def __init__(self, events: EventStream, scored: int) -> None:
        self.decided_s: dict[int, float] = {}
        self.recorder = Recorder()
        self._lock = threading.Lock()
        self._every, self._left = max(1, -(-scored // MOMENTS)), scored
        self._draws_all = False
        self._last = 0.0, 0, 0  # Time, day and number of observations of the last estimate
        events.listen(self._take, RunBegun, DayBegun, Estimated, Decided, RunEnded)

    def _take(self, event: RunBegun | DayBegun | Estimated | Decided | RunEnded) -> None:
        with self._lock:
            if isinstance(event, RunBegun) and event.farm is not None:
                self._draws_all = event.farm.width_cells * event.farm.height_cells <= _SMALL_CELLS
            if isinstance(event, Estimated):
                self._left -= 1
                due = self._left % self._every == 0
                self._last = event.time_s, event.day, event.observations
                # Events replayed from results have a model only if the model is drawn; do the same here.
                self.recorder.take(event if due or self._draws_all else replaced(event, model=None))
                if due:
                    self.recorder.keep(*self._last)
                return
            self.recorder.take(event)
            if isinstance(event, Decided):
                record = event.record
                self.decided_s[id(record)] = event.time_s
                if event.acquisition is not None:
                    self.recorder.keep(event.time_s, record.day, record.observations, decision=True)
            elif isinstance(event, RunEnded):
                self.recorder.keep(*self._last)

    def write(
        self, path: Path, record: RunRecord, *, log: Path | None, notes: Sequence[str], progress: Progress
    ) -> Sequence[str]:
        """Write the report and return its notes."""
        report = write_report(path, [record], logs=[log], layers=self, told=notes, progress=progress)
        return report.notes


def thinned_moments(
    moments: Sequence[schema.Moment], light: Sequence[bool], every: int
) -> list[schema.Moment]:
    """Return every `every`-th moment, counted back from the last; tiles of skipped moments move to the next.

    A light moment keeps only the acquisition map; its other tiles move to the next moment that is not light.
    """
    kept, tiles = [], dict[tuple[str, int, int], schema.Tile]()
    for number, (moment, is_light) in enumerate(zip(moments, light, strict=True)):
        tiles |= {(tile.layer, tile.x, tile.y): tile for tile in moment.tiles}
        if (len(moments) - 1 - number) % every == 0:
            shown = [key for key in tiles if not is_light or key[0] == _ACQUISITION]
            kept.append(replace(moment, tiles=[tiles.pop(key) for key in shown]))
    if kept:
        kept[-1].tiles += tiles.values()
    return kept


def thinned_readings(readings: schema.Readings, diseases: Sequence[str], every: int) -> schema.Readings:
    """Return every `every`-th reading, and all readings of sick plants."""
    count = len(readings.time_s)
    kept = np.arange(count) % every == 0
    for name in diseases:
        kept |= np.array(readings.values.get(name, [None] * count), np.float64) < SICK_BELOW
    rows = np.flatnonzero(kept).tolist()

    def some(column: list[Any]) -> list[Any]:
        return [column[row] for row in rows]

    values = {name: some(column) for name, column in readings.values.items()}
    return schema.Readings(some(readings.time_s), some(readings.x), some(readings.y), values)


def thinned_states(states: schema.States) -> schema.States:
    """Drop the states that lie on straight lines over time within `_TOLERANCES`; return the other states."""
    columns: dict[str, list[Any]] = asdict(states)
    kept = np.zeros(len(states.time_s), bool)
    kept[[0, -1]] = True
    values = np.zeros((len(_TOLERANCES), len(kept)))
    for number, (name, tolerance) in enumerate(_TOLERANCES.items()):
        numbers = np.array(columns[name], np.float64)
        known = np.isfinite(numbers)  # Missing values are None or NaN
        values[number, known] = numbers[known] / tolerance
        if name == "heading_deg":
            values[number] = np.unwrap(values[number], period=360.0 / tolerance)
        _keep_changes(known.tolist(), kept)
    for name in _FIXED:
        _keep_changes(columns[name], kept)
    keep_within(np.array(states.time_s), values, 1.0, kept)
    rows = np.flatnonzero(kept).tolist()
    return schema.States(**{name: [column[row] for row in rows] for name, column in columns.items()})


def _keep_changes(column: Sequence[Any], kept: NDArray[np.bool_]) -> None:
    """Keep the rows before and after each change of a value."""
    differs = np.array([value != following for value, following in pairwise(column)], bool)
    kept[:-1] |= differs
    kept[1:] |= differs


MOST_BYTES = 5_000_000
"""Target for the maximum size of a report."""


class ReportError(WbfMissionError, ValueError):
    """The runs cannot be shown in a report."""


@dataclass(frozen=True, slots=True)
class Report:
    """Result of `write_report`."""

    title: str
    size: int  # Bytes
    moments: tuple[int, ...]  # Number of moments, per run
    notes: tuple[str, ...]  # Omitted data


def write_report(
    path: str | Path,
    records: Sequence[RunRecord],
    *,
    logs: Sequence[Path | None] = (None, None),
    layers: RunPage | None = None,
    told: Sequence[str] = (),
    most_bytes: int = MOST_BYTES,
    progress: Progress = silent,
) -> Report:
    """Write the report of one or two runs over the same farm; raise ReportError if their farms differ.

    Equal runs give equal bytes. Telemetry logs of the runs add vehicle states. `layers` are the layers of a
    run that was just flown; by default the estimates are computed again (`events_of`). The summary also shows
    the notes `told`. Data is omitted to keep the file below `most_bytes`.
    """
    same = ("frame", "width_cells", "height_cells", "cell_size_m", "patches", "owner")
    first, last = records[0].farm, records[-1].farm
    if any(getattr(first, name) != getattr(last, name) for name in same):
        names = f"{first.name} and {last.name}"
        raise ReportError(
            f"the runs are of different farms, {names}: give two runs of the same farm, or one run at a time"
        )
    kept = [_Kept(record, log, layers, progress) for record, log in zip(records, logs, strict=False)]
    title = " | ".join(run_title(record) for record in records)
    summary = comparison_of if len(records) > 1 else summary_of
    for reduced in _REDUCTIONS:
        recordings = [run.recording(reduced) for run in kept]
        notes = (*told, *dict.fromkeys(note for run in kept for note in run.notes(reduced)))
        body = f'{summary(*records, notes=notes)}\n<div id="app"></div>'
        page = document(title, body, "live", data_element("recording", recordings, packed=True))
        size = len(page.encode())
        if size < most_bytes:
            break
    with atomic_write(path) as file:
        file.write(page)
    return Report(title, size, tuple(len(recording.moments) for recording in recordings), notes)


@dataclass(frozen=True, slots=True)
class _Reduced:
    """A reduced form of a recording."""

    longest: int  # Pixels along the longer side of the farm
    every: int = 1  # Keep every `every`-th moment, and the last
    readings: int = 1  # Keep every `readings`-th reading, and all readings of sick plants
    light: bool = True  # Keep only the acquisition map of a decision


_REDUCTIONS = (
    _Reduced(LONGEST, light=False),
    *(_Reduced(longest, every) for longest in PIXELS for every in (1, 2)),
    *(_Reduced(PIXELS[-1], 4, every) for every in (1, 4, 16, 64)),
    *(_Reduced(PIXELS[-1], every, 64) for every in (16, 64)),
)


class _Kept:
    """Data of a run's page, with the layers at all moments in several pixel sizes."""

    def __init__(self, record: RunRecord, log: Path | None, live: RunPage | None, progress: Progress) -> None:
        self.diseases = [disease.name for disease in record.fields.diseases]
        self.lost = ""  # Reason why estimates could not be computed again
        decided_s = {} if live is None else live.decided_s
        try:
            replayed = _replayed(record, MOMENTS if live is None else 0, log, progress, decided_s)
        except EstimatorError as error:
            self.lost = str(error)
            replayed = _replayed(record, 0, log, progress, decided_s)
        self.layers = replayed if live is None else live.recorder
        self.rasters = {}
        for longest, view in replayed.views.items():
            self.update, _ = view.update(None)
            self.rasters[longest] = self.update.run.raster if self.update.run else None
        self.update.tiles = self.update.scales = UNSET
        if self.update.states:
            self.update.states = {name: thinned_states(state) for name, state in self.update.states.items()}

    def recording(self, reduced: _Reduced) -> schema.Recording:
        """Return the recording in a reduced form."""
        shown = asdict(self.update)
        shown["moments"] = thinned_moments(
            self.layers.moments[reduced.longest],
            [reduced.light and decision for decision in self.layers.decisions],
            reduced.every,
        )
        if self.update.run:
            shown["run"] = replace(self.update.run, raster=self.rasters[reduced.longest])
        if self.update.readings and reduced.readings > 1:
            shown["readings"] = thinned_readings(self.update.readings, self.diseases, reduced.readings)
        return schema.Recording(**shown)

    def notes(self, reduced: _Reduced) -> Iterator[str]:
        """Yield notes on the omitted data."""
        raster, finest = self.rasters[reduced.longest], self.rasters[LONGEST]
        moments = len(self.layers.decisions)
        if self.lost:
            yield f"Layers show only the end of the run: {self.lost}"
        if reduced.light and any(self.layers.decisions):
            yield f"Between about {MOMENTS} of the scored times, only acquisition maps are kept"
        if reduced.every > 1 and moments > 1:
            left = len(range(0, moments, reduced.every))
            yield f"The layers are shown at {left} of {moments} moments"
        if raster and finest and raster.cells > finest.cells:
            yield f"A pixel of the layers is {raster.pixel_m:.3g} m wide in place of {finest.pixel_m:.3g} m"
        if reduced.readings > 1 and self.update.readings:
            yield f"Every {reduced.readings}th reading of healthy plants is kept"


def _replayed(
    record: RunRecord, estimates: int, log: Path | None, progress: Progress, decided_s: Mapping[int, float]
) -> Recorder:
    """Replay a run and record its layers."""
    recorder = Recorder()
    for event in events_of(record, estimates=estimates, log=log, progress=progress):
        if isinstance(event, Decided):
            # In results, the times of decisions are wrong by up to one vehicle step.
            event = replaced(event, time_s=decided_s.get(id(event.record), event.time_s))
        recorder.take(event)
        if isinstance(event, Estimated) and event.model is not None:
            recorder.keep(event.time_s, event.day, event.observations)
    return recorder
