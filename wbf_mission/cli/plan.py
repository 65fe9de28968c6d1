"""``wbf-mission plan``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from wbf_mission.cli import options
from wbf_mission.cli.convert import write_and_tell
from wbf_mission.cli.options import MISSION_SUFFIXES, Force, Overwrite, option, refuse_overwrite
from wbf_mission.cli.output import Output, distance, duration
from wbf_mission.cli.preflight import show_findings
from wbf_mission.scenario import CameraOptions, FarmOptions, MissionOptions, VehicleOptions, WeatherOptions

if TYPE_CHECKING:
    from wbf_mission.planning import PlanResult

EXAMPLES = """
Examples
wbf-mission plan --farm miniberry-100 --planner spiral --budget 25min --out spiral.plan
wbf-mission plan --farm waterberry --planner lawnmower --budget 8000m --out rows.waypoints
wbf-mission plan --farm my-farm.geojson --planner adaptive-lawnmower --json
wbf-mission plan --farm waterberry --vehicles 3 --partition voronoi --budget 10km --out part.plan
"""


@options.scenario_options(
    FarmOptions,
    MissionOptions,
    VehicleOptions,
    WeatherOptions,
    CameraOptions,
    without=(
        "day",
        "days",
        "flights_per_day",
        "mission",
        "turbulence",
        "gps_noise_m",
        "baro_noise_m",
        "radio_range_m",
        "camera_noise",
        "false_positive_rate",
        "false_negative_rate",
        "camera_fields",
    ),
)
@options.speaks()
def plan_command(
    given: options.Given,
    output: Output,
    out: Annotated[
        Path | None,
        option(
            "Mission file: .plan (QGroundControl), .waypoints (WPL 110), .json (ours), .kml, .kmz, .geojson,"
            " .gpx, .csv, .wpml.kmz (DJI); of several vehicles NAME-1.plan, NAME-2.plan ...",
            panel="Output",
        ),
    ] = None,
    overwrite: Overwrite = False,
    force: Force = False,
) -> None:
    """Plan a mission within a budget and say what it takes: length, time, coverage, battery."""
    from mission.files import Firmware, writer_for
    from mission.transfer import Severity
    from wbf_mission.flight import check_flight
    from wbf_mission.planning.fleet import single_vehicles
    from wbf_mission.planning.plan import plan_fleet
    from wbf_mission.preflight.run import check_plans

    chosen = given.scenario()
    if given.file is not None or chosen.farm.fields:
        check_flight(chosen)
    inputs = [given.file, chosen.farm.name, *chosen.farm.fields, chosen.mission.file, *chosen.vehicle.names]
    files = _files(out, len(chosen.vehicle.fleet))
    for path in files:
        refuse_overwrite(path, inputs, suffixes=MISSION_SUFFIXES, overwrite=overwrite)
        if path is not None:
            writer_for(path)
    with output.progress() as progress:
        progress("planning", 0, 1)
        results = plan_fleet(chosen, progress=progress)
        progress("planning", 1, 1)
    check_plans(
        zip(results, single_vehicles(chosen), strict=True),
        "nothing was written",
        force=force,
        show=partial(show_findings, output),
    )
    for warning in dict.fromkeys(warning for result in results for warning in result.warnings):
        output.warn(warning)
    notes = [one for result in results for one in result.rendered.remarks if one.severity is Severity.NOTE]
    for note in dict.fromkeys(str(one) for one in notes):
        output.note(f"note: {note}")
    values, tables = [], []
    for result, path in zip(results, files, strict=True):
        if path is not None:
            write_and_tell(output, result.mission, path, Firmware(result.mav_autopilot))
        values.append({**result.summary(), "file": str(path) if path else None})
        tables.append(_rows(result, path))
    if len(results) == 1:
        output.result(values[0], tables[0], title="Plan")
        return
    rows = [[str(number), *(one[name] for name in _OF_EACH)] for number, one in enumerate(tables, start=1)]
    title = f"{results[0].farm.name}: {results[0].planner}, {results[0].budget_text} each"
    together = {"vehicles": len(results), "plans": values}
    output.table(together, ["", *_OF_EACH], rows, title=title, left=True)


_OF_EACH = (
    "vehicle",
    "waypoints",
    "row spacing",
    "length",
    "predicted time",
    "coverage",
    "battery use",
    "file",
)
"""What is told of each plan of a fleet."""


def _files(out: Path | None, count: int) -> list[Path | None]:
    """Return the mission file of each vehicle; those of several are numbered."""
    if out is None or count == 1:
        return [out] * count
    from mission.files import ending

    stem = out.name[: len(out.name) - len(ending(out))]
    return [out.with_name(f"{stem}-{number}{out.name[len(stem) :]}") for number in range(1, count + 1)]


def _rows(result: PlanResult, path: Path | None) -> dict[str, str]:
    """Return what is told of a plan."""
    prediction, battery = result.prediction, result.battery_used
    time = duration(prediction.duration_s)
    if prediction.duration_interval_s is not None:
        low, high = map(duration, prediction.duration_interval_s)
        time += f" (90 %: {low} to {high})"
    return {
        "farm": result.farm.name,
        "planner": result.planner or "none (mission file)",
        "vehicle": result.vehicle.name,
        "budget": result.budget_text,
        "waypoints": str(len(result.path_m)),
        "row spacing": "-" if result.spacing_m is None else distance(result.spacing_m),
        "length": f"{distance(result.length_m)} over ground, as predicted",
        "predicted time": time,
        "coverage": f"{result.coverage:.2%} of the land to be seen, as predicted",
        "battery use": "none" if battery is None else f"{battery:.1%}",
        "batteries": "never enough" if result.batteries is None else str(result.batteries),
        "file": str(path) if path else "not written (give --out FILE)",
    }
