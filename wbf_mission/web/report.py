"""A finished run, or two side by side, as one HTML file: a summary on one sheet, and the page to replay it.

The page is that of a run that happens, with a recording in it: a `View` listens to the events of the result,
and what it shows is kept at some moments. If the file gets too large, moments are left out, pixels are made
larger, and in the end readings are left out; the page says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import UNSET
from msgspec.structs import asdict, replace
from numpy.typing import NDArray

from geo import Farm
from geo.atomic import atomic_write
from geo.errors import WbfMissionError
from sensors.errors import EstimatorError
from wbf_mission.events import Estimated
from wbf_mission.maps.blocks import SICK_BELOW
from wbf_mission.maps.html_page import data_element
from wbf_mission.progress import Progress, silent
from wbf_mission.results.replay import events_of
from wbf_mission.run.record import RunRecord
from wbf_mission.web import schema
from wbf_mission.web.document import document
from wbf_mission.web.layers import LONGEST
from wbf_mission.web.summary import comparison_of, run_title, summary_of
from wbf_mission.web.view import Cursor, View

MOST_BYTES = 5_000_000
"""A report is smaller, if that can be."""
MOMENTS = 40
"""At about so many of the scored times the layers are kept."""
_PIXELS = (LONGEST, LONGEST // 2, LONGEST // 4)
_TOLERANCES = {
    "x": 0.02,
    "y": 0.02,
    "height_m": 0.05,
    "speed_m_s": 0.25,
    "battery": 0.002,
    "heading_deg": 2.0,
}
"""By how much what lies between two states may differ from the line between them, in their units."""
_FIXED = ("day", "flight", "item", "items", "mode", "phase", "armed")


class ReportError(WbfMissionError, ValueError):
    """Runs of which no report can be made."""


@dataclass(frozen=True, slots=True)
class Report:
    """What `write_report` wrote."""

    title: str
    size: int  # Bytes
    moments: tuple[int, ...]  # Of each run
    notes: tuple[str, ...]  # What is not in it


def write_report(
    path: str | Path,
    records: Sequence[RunRecord],
    *,
    logs: Sequence[Path | None] = (None, None),
    most_bytes: int = MOST_BYTES,
    progress: Progress = silent,
) -> Report:
    """Write the report of a run, or of two over the same farm.

    The same runs give the same bytes. The estimates at the moments are made again; `events_of` says how, and
    what the `logs` of the runs tell besides.

    Raises
    ------
    ReportError
        If two runs are of different farms.
    OSError
        If the file cannot be written.
    """
    if len(records) > 1:
        _check_farms(*(one.farm for one in records))
    kept = [_Kept.of(one, log, progress) for one, log in zip(records, logs, strict=False)]
    title = " | ".join(run_title(one) for one in records)
    summary = comparison_of if len(records) > 1 else summary_of
    for reduced in _REDUCTIONS:
        recordings = [one.recording(reduced) for one in kept]
        notes = tuple(dict.fromkeys(note for one in kept for note in one.notes(reduced)))
        body = f'{summary(*records, notes=notes)}\n<div id="app"></div>'
        page = document(title, body, "live", data_element("recording", recordings, packed=True))
        size = len(page.encode())
        if size < most_bytes:
            break
    with atomic_write(path) as file:
        file.write(page)
    return Report(title, size, tuple(len(one.moments) for one in recordings), notes)


def _check_farms(first: Farm, second: Farm) -> None:
    same = ("frame", "width_cells", "height_cells", "cell_size_m", "patches", "owner")
    if any(getattr(first, name) != getattr(second, name) for name in same):
        names = f"{first.name} and {second.name}"
        msg = f"the runs are of different farms, {names}: give two runs of the same farm, or one at a time"
        raise ReportError(msg)


@dataclass(frozen=True, slots=True)
class _Reduced:
    """What is left of a recording."""

    longest: int  # Pixels along the longer side of the farm
    every: int = 1  # Of the moments, and the last one
    readings: int = 1  # Of the readings; those that are sick stay


_REDUCTIONS = (
    *(_Reduced(longest, every) for longest in _PIXELS for every in (1, 2)),
    *(_Reduced(_PIXELS[-1], 4, every) for every in (1, 4, 16, 64)),
)


@dataclass(slots=True)
class _Kept:
    """What a run's page shows, with the layers at all moments in pixels of several sizes."""

    update: schema.Update  # Without layers
    moments: dict[int, list[schema.Moment]]
    rasters: dict[int, schema.Raster | None]
    diseases: list[str]
    lost: str = ""  # Why the estimates could not be made again

    @classmethod
    def of(cls, record: RunRecord, log: Path | None, progress: Progress) -> _Kept:
        """Replay a run."""
        diseases = [one.name for one in record.fields.diseases]
        try:
            return cls(*_replayed(record, MOMENTS, log, progress), diseases)
        except EstimatorError as error:
            return cls(*_replayed(record, 0, log, progress), diseases, str(error))

    def recording(self, reduced: _Reduced) -> schema.Recording:
        """Return the recording for a page."""
        shown = asdict(self.update) | {
            "moments": _thinned_moments(self.moments[reduced.longest], reduced.every)
        }
        if self.update.run:
            shown["run"] = replace(self.update.run, raster=self.rasters[reduced.longest])
        if self.update.readings and reduced.readings > 1:
            shown["readings"] = _thinned_readings(self.update.readings, self.diseases, reduced.readings)
        return schema.Recording(**shown)

    def notes(self, reduced: _Reduced) -> Iterator[str]:
        """Yield what is not in the recording."""
        raster, finest = self.rasters[reduced.longest], self.rasters[LONGEST]
        moments = len(self.moments[LONGEST])
        if self.lost:
            yield f"The layers are those of the end: {self.lost}"
        if reduced.every > 1 and moments > 1:
            left = len(range(0, moments, reduced.every))
            yield f"The layers are kept at {left} of {moments} moments"
        if raster and finest and raster.cells > finest.cells:
            yield f"A pixel of the layers is {raster.pixel_m:.3g} m wide in place of {finest.pixel_m:.3g} m"
        if reduced.readings > 1 and self.update.readings:
            yield f"Of the readings of healthy plants every {reduced.readings}th is kept"


def _replayed(
    record: RunRecord, estimates: int, log: Path | None, progress: Progress
) -> tuple[schema.Update, dict[int, list[schema.Moment]], dict[int, schema.Raster | None]]:
    views = {longest: View(share=1.0, longest=longest) for longest in _PIXELS}
    cursors: dict[int, Cursor | None] = dict.fromkeys(views)
    moments: dict[int, list[schema.Moment]] = {longest: [] for longest in views}
    for event in events_of(record, estimates=estimates, log=log, progress=progress):
        for longest, view in views.items():
            view.take(event)
            if isinstance(event, Estimated) and event.model is not None:
                new, cursors[longest] = view.update(cursors[longest])
                if new.tiles:
                    one = (event.time_s, event.day, event.observations, new.tiles, new.scales or {})
                    moments[longest].append(schema.Moment(*one))
    rasters = {}
    for longest, view in views.items():
        update, _ = view.update(None)
        rasters[longest] = update.run.raster if update.run else None
    update.tiles = update.scales = UNSET
    if update.states:
        update.states = {name: _thinned_states(one) for name, one in update.states.items()}
    return update, moments, rasters


def _thinned_moments(moments: Sequence[schema.Moment], every: int) -> list[schema.Moment]:
    """Return every so many of the moments, from the last back; tiles of those between come with the next."""
    kept, tiles = [], dict[tuple[str, int, int], schema.Tile]()
    for number, one in enumerate(moments):
        tiles |= {(tile.layer, tile.x, tile.y): tile for tile in one.tiles}
        if (len(moments) - 1 - number) % every == 0:
            kept.append(replace(one, tiles=list(tiles.values())))
            tiles = {}
    return kept


def _thinned_readings(readings: schema.Readings, diseases: Sequence[str], every: int) -> schema.Readings:
    """Return every so many of the readings, and all that are sick."""
    count = len(readings.time_s)
    kept = np.arange(count) % every == 0
    for name in diseases:
        kept |= np.array(readings.values.get(name, [None] * count), np.float64) < SICK_BELOW
    rows = np.flatnonzero(kept).tolist()

    def some(column: list[Any]) -> list[Any]:
        return [column[row] for row in rows]

    values = {name: some(column) for name, column in readings.values.items()}
    return schema.Readings(some(readings.time_s), some(readings.x), some(readings.y), values)


def _thinned_states(states: schema.States) -> schema.States:
    """Return the states between which the others lie, within `_TOLERANCES`, on straight lines over time.

    Of D. H. Douglas and T. K. Peucker, "Algorithms for the reduction of the number of points required to
    represent a digitized line or its caricature", Cartographica 10 (1973) 112-122, with distances at the same
    time.
    """
    columns: dict[str, list[Any]] = asdict(states)
    kept = np.zeros(len(states.time_s), bool)
    kept[[0, -1]] = True
    values = np.zeros((len(_TOLERANCES), len(kept)))
    for number, (name, tolerance) in enumerate(_TOLERANCES.items()):
        numbers = np.array(columns[name], np.float64)
        known = np.isfinite(numbers)  # What is not told is None or NaN
        values[number, known] = numbers[known] / tolerance
        if name == "heading_deg":
            values[number] = np.unwrap(values[number], period=360.0 / tolerance)
        _keep_changes(known.tolist(), kept)
    for name in _FIXED:
        _keep_changes(columns[name], kept)
    _split(np.array(states.time_s), values, kept)
    rows = np.flatnonzero(kept).tolist()
    return schema.States(**{name: [column[row] for row in rows] for name, column in columns.items()})


def _keep_changes(column: Sequence[Any], kept: NDArray[np.bool_]) -> None:
    """Keep what is before and after each change of a value."""
    differs = np.array([one != two for one, two in pairwise(column)], bool)
    kept[:-1] |= differs
    kept[1:] |= differs


def _split(time_s: NDArray[np.float64], values: NDArray[np.float64], kept: NDArray[np.bool_]) -> None:
    """Keep more, until what lies between two that are kept is within 1 of the line between them."""
    parts = list(pairwise(np.flatnonzero(kept).tolist()))
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        part = (time_s[inner] - time_s[first]) / max(time_s[last] - time_s[first], 1e-9)
        line = values[:, [first]] + part * (values[:, [last]] - values[:, [first]])
        off = np.abs(values[:, inner] - line).max(axis=0, initial=0.0)
        worst = int(off.argmax())
        if off[worst] > 1.0:
            middle = first + 1 + worst
            kept[middle] = True
            parts += [(first, middle), (middle, last)]
