"""Formats to which a finished run can be exported."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from mission.errors import LinkError
from mission.link.tlog import read_tlog
from sim_vehicle.execution.state import EPOCH_UNIX_S
from wbf_mission.addons.base.replay import events_of
from wbf_mission.events import VehicleMoved
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError

if TYPE_CHECKING:
    from wbf_mission.events import Event
    from wbf_mission.run.record import RunRecord

Write: TypeAlias = "Callable[[RunRecord, tuple[Path, ...], Iterable[Event], float], None]"


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A file format: suffix, the tool it is for, and the module and function that write it."""

    suffix: str
    what: str
    module: str
    function: str
    shows_estimates: bool = False
    beside: str = ""  # Suffix of the second file

    def files(self, path: Path) -> tuple[Path, ...]:
        """Return the paths of all files written for `path`."""
        return (path, path.with_suffix(self.beside)) if self.beside else (path,)


FORMATS = {
    "mcap": ExportFormat(
        ".mcap", "Foxglove", "foxglove", "write_mcap", shows_estimates=True, beside=".foxglove.json"
    ),
    "rerun": ExportFormat(".rrd", "Rerun", "rerun", "write_rrd", shows_estimates=True),
    "gpx": ExportFormat(".gpx", "map programs and GNSS receivers", "tracks", "write_gpx"),
    "kml": ExportFormat(".kml", "Google Earth", "tracks", "write_kml"),
    "geojson": ExportFormat(".geojson", "GIS and maps on the web", "tracks", "write_geojson"),
    "csv": ExportFormat(".csv", "spreadsheets", "tracks", "write_csv"),
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
    """Write a finished run in a format of another tool, and return the files; each is complete or absent.

    Parameters
    ----------
    to : str
        A name of `FORMATS`.
    estimates : int
        Number of moments at which the estimate is computed again, as of `events_of`.
    log : path, optional
        Telemetry log of the run: source of the time of day and of more details of the vehicles.
    progress : callable
        Called with the progress of the export.

    Raises
    ------
    EstimatorError
        If the run's estimator cannot be created.
    ResultError
        If the log cannot be read.
    OSError
        If a file cannot be written.
    """
    chosen = FORMATS[to]
    write: Write = getattr(import_module(f"wbf_mission.addons.export.{chosen.module}"), chosen.function)
    wanted = estimates if chosen.shows_estimates else 0
    events = events_of(result, estimates=wanted, log=log, progress=progress)
    files = chosen.files(path)
    write(result, files, _followed(events, result.simulated_s, progress), epoch_of(log))
    return files


def _followed(events: Iterable[Event], total_s: float, progress: Progress) -> Iterator[Event]:
    """Yield events and report the progress."""
    for event in events:
        if isinstance(event, VehicleMoved):
            progress("writing", event.time_s, total_s)
        yield event


def epoch_of(log: Path | None) -> float:
    """Return the time of day at the start of a run (s since 1970): from its log, else a fixed epoch."""
    if log is None:
        return EPOCH_UNIX_S
    try:
        return next((time_s for time_s, _ in read_tlog(log)), EPOCH_UNIX_S)
    except LinkError as error:
        raise ResultError(str(error)) from None
