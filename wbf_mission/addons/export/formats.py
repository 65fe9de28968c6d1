"""Exports a finished run to one of the known file formats."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, TypeAlias

from mission.errors import LinkError
from mission.link.tlog import read_tlog
from sim_vehicle.execution.state import EPOCH_UNIX_S
from wbf_mission.addons.base.replay import events_of
from wbf_mission.events import Event, VehicleMoved
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError

if TYPE_CHECKING:
    from wbf_mission.run.record import RunRecord

Write: TypeAlias = "Callable[[RunRecord, tuple[Path, ...], Iterable[Event], float], None]"


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A file format: its suffix, the tool that reads it, and the MODULE:FUNCTION that writes it."""

    suffix: str
    what: str
    writer: str
    shows_estimates: bool = False
    beside: str = ""  # Suffix of a second file; empty if only one file is written.

    def files(self, path: Path) -> tuple[Path, ...]:
        """Return the paths of all files that an export writes: `path`, and any second file."""
        return (path, path.with_suffix(self.beside)) if self.beside else (path,)


FORMATS = {
    "mcap": ExportFormat(
        ".mcap", "Foxglove", "foxglove:write_mcap", shows_estimates=True, beside=".foxglove.json"
    ),
    "rerun": ExportFormat(".rrd", "Rerun", "rerun:write_rrd", shows_estimates=True),
    "gpx": ExportFormat(".gpx", "map programs and GNSS receivers", "tracks:write_gpx"),
    "kml": ExportFormat(".kml", "Google Earth", "tracks:write_kml"),
    "geojson": ExportFormat(".geojson", "GIS and maps on the web", "tracks:write_geojson"),
    "csv": ExportFormat(".csv", "spreadsheets", "tracks:write_csv"),
}
"""Export formats by name."""


def export(
    result: RunRecord,
    path: Path,
    to: str,
    *,
    estimates: int = 0,
    log: Path | None = None,
    progress: Progress = silent,
) -> tuple[Path, ...]:
    """Write a finished run in a format of `FORMATS`, and return the files; no partly written file remains.

    The estimate is computed again at about `estimates` moments (see `events_of`). The run's telemetry `log`
    adds the time of day and more details of the vehicles. Raises EstimatorError if the run's estimator cannot
    be created, ResultError if the log cannot be read, and OSError if a file cannot be written.
    """
    chosen = FORMATS[to]
    write: Write = resolve_name(f"wbf_mission.addons.export.{chosen.writer}")
    wanted = estimates if chosen.shows_estimates else 0
    files = chosen.files(path)

    def followed() -> Iterator[Event]:
        for event in events_of(result, estimates=wanted, log=log, progress=progress):
            if isinstance(event, VehicleMoved):
                progress("writing", event.time_s, result.simulated_s)
            yield event

    write(result, files, followed(), epoch_of(log))
    return files


def epoch_of(log: Path | None) -> float:
    """Return the start of a run (s since 1970): the first time in its log, or a fixed time without a log."""
    if log is None:
        return EPOCH_UNIX_S
    try:
        return next((time_s for time_s, _ in read_tlog(log)), EPOCH_UNIX_S)
    except LinkError as error:
        raise ResultError(str(error)) from None
