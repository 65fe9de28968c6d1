"""Report of one or two finished runs as one HTML file: a one-sheet summary, and the page that replays them.

The page is the same as for a live run, with a recording. A `View` listens to the events of the result, and
its layers are kept at some moments. A file that is too large gets fewer moments, larger pixels, and finally
fewer readings; its notes say so. `LiveLayers` keeps the layers of a run that is flown for the report. They
include the acquisition maps of decisions, which results do not contain.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import replace as replaced
from pathlib import Path

from msgspec import UNSET
from msgspec.structs import asdict, replace

from geo import Farm
from geo.atomic import atomic_write
from geo.errors import WbfMissionError
from sensors.errors import EstimatorError
from wbf_mission.addons.base.markup import data_element
from wbf_mission.addons.base.replay import events_of
from wbf_mission.addons.web import schema
from wbf_mission.addons.web.document import document
from wbf_mission.addons.web.layers import LONGEST
from wbf_mission.addons.web.recording import (
    MOMENTS,
    PIXELS,
    LiveLayers,
    Recorder,
    thinned_moments,
    thinned_readings,
    thinned_states,
)
from wbf_mission.addons.web.summary import comparison_of, run_title, summary_of
from wbf_mission.events import Decided, Estimated
from wbf_mission.progress import Progress, silent
from wbf_mission.run.record import RunRecord

MOST_BYTES = 5_000_000
"""Target for the maximum size of a report."""


class ReportError(WbfMissionError, ValueError):
    """Runs that cannot be shown in a report."""


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
    layers: LiveLayers | None = None,
    told: Sequence[str] = (),
    most_bytes: int = MOST_BYTES,
    progress: Progress = silent,
) -> Report:
    """Write the report of one or two runs over the same farm; raise ReportError if their farms differ.

    Equal runs give equal bytes. Telemetry logs of the runs add vehicle states. `layers` are the layers of a
    run that was just flown; by default the estimates are computed again (`events_of`). The summary also shows
    the notes `told`. Data is omitted to keep the file below `most_bytes`.
    """
    if len(records) > 1:
        _check_farms(*(record.farm for record in records))
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


class RunPage(LiveLayers):
    """Report of a run, recorded during the flight: a `wbf_mission.addons.base.pages.RunPage`."""

    def write(
        self, path: Path, record: RunRecord, *, log: Path | None, notes: Sequence[str], progress: Progress
    ) -> Sequence[str]:
        """Write the report and return its notes."""
        report = write_report(path, [record], logs=[log], layers=self, told=notes, progress=progress)
        return report.notes


def _check_farms(first: Farm, second: Farm) -> None:
    same = ("frame", "width_cells", "height_cells", "cell_size_m", "patches", "owner")
    if any(getattr(first, name) != getattr(second, name) for name in same):
        names = f"{first.name} and {second.name}"
        raise ReportError(
            f"the runs are of different farms, {names}: give two runs of the same farm, or one run at a time"
        )


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

    def __init__(
        self, record: RunRecord, log: Path | None, live: LiveLayers | None, progress: Progress
    ) -> None:
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
            yield f"Only the layers of the end are shown: {self.lost}"
        if reduced.light and any(self.layers.decisions):
            yield f"Only the acquisition maps change between about {MOMENTS} of the scored times"
        if reduced.every > 1 and moments > 1:
            left = len(range(0, moments, reduced.every))
            yield f"The layers are kept at {left} of {moments} moments"
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
