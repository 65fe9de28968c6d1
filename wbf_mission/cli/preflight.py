"""``wbf-mission preflight``, and the same check before an upload."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import Scenario, ScenarioError, VehicleOptions, WeatherOptions

if TYPE_CHECKING:
    from mission.model import Mission
    from wbf_mission.preflight.finding import Finding, Report
    from wbf_mission.preflight.run import Preflight
    from wbf_mission.preflight.vehicle.snapshot import VehicleSnapshot

_CHECK = "What is checked"
EXAMPLES = """
Examples

wbf-mission preflight spiral.plan

wbf-mission preflight rows.waypoints --vehicle mapping-quad --autopilot ardupilot --wind 5,270,1

wbf-mission preflight spiral.plan --farm my-farm.geojson --margin 5

wbf-mission preflight spiral.plan --connect udpin:127.0.0.1:14550 --json
"""
_HEADER = ["", "item", "finding", "measured", "what to do"]


@options.scenario_options(
    VehicleOptions,
    WeatherOptions,
    without=("vehicles", "separation", "radio_range_m", "gps_noise_m", "baro_noise_m", "seed"),
)
def preflight_command(
    given: options.Given,
    file: Annotated[Path, typer.Argument(help="Mission file: .plan, .waypoints or .json.")],
    farm: Annotated[
        str | None,
        typer.Option(
            help="Farm whose obstacles count: a name or a GeoJSON file.  [default: none]",
            autocompletion=options.complete("farm"),
            rich_help_panel=_CHECK,
            show_default=False,
        ),
    ] = None,
    margin: Annotated[
        float,
        typer.Option(
            help="Metres that the flown path stays away from fence and obstacles.",
            parser=options.number,
            rich_help_panel=_CHECK,
        ),
    ] = 2.0,
    camera_interval: Annotated[
        float | None,
        typer.Option(
            help="The camera's shortest interval between images, s.  [default: 0.01, the leaf camera's]",
            parser=options.number,
            rich_help_panel=_CHECK,
            show_default=False,
        ),
    ] = None,
    connect: Annotated[
        str | None,
        typer.Option(
            help="Ask the vehicle behind this link, too: udpin:, udpout:, tcp: or tcpin:HOST:PORT, or"
            " serial:DEVICE:BAUD.",
            rich_help_panel=_CHECK,
            show_default=False,
        ),
    ] = None,
    system_id: Annotated[
        int | None,
        typer.Option(
            help="With --connect: the vehicle's system id.  [default: the first one heard]",
            parser=options.whole_number_in(1, 255),
            rich_help_panel=_CHECK,
            show_default=False,
        ),
    ] = None,
    wait: options.Wait = 10.0,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Check a mission file before it is flown, and with --connect the vehicle that is to fly it.

    Exit code 1 tells that there are errors; warnings and notes are none.
    """
    from geo import get_farm
    from mission.files import read_mission
    from sim_vehicle.camera.component import MIN_INTERVAL_S
    from wbf_mission.preflight.run import Circumstances, check_mission

    output = Output(as_json=json, quiet=quiet)
    if not 0.0 <= margin <= 1000.0:
        msg = f"--margin {margin:g} is out of range: give 0 to 1000 metres"
        raise ScenarioError(msg)
    if camera_interval is not None and not 0.0 < camera_interval <= 3600.0:
        msg = f"--camera-interval {camera_interval:g} is out of range: give seconds above 0, up to 3600"
        raise ScenarioError(msg)
    if system_id is not None and connect is None:
        msg = "--system-id goes with --connect: give the link to the vehicle, or leave it out"
        raise ScenarioError(msg)
    mission = read_mission(file)
    chosen = given.scenario()
    surroundings = None if farm is None else get_farm(farm)
    snapshot, assumed = None, False
    if connect is not None:
        named = given.file is not None or "vehicle" in given.changes
        snapshot = _ask(output, connect, wait, system_id)
        chosen = _fitted(chosen, snapshot, named=named, autopilot=given.changes.get("autopilot"))
        assumed = not named
    with output.progress() as progress:
        progress("predicting", 0, 1)
        checked = check_mission(
            mission,
            Circumstances(
                chosen.vehicle,
                chosen.weather,
                surroundings,
                margin,
                MIN_INTERVAL_S if camera_interval is None else camera_interval,
                assumed,
                snapshot,
            ),
        )
        progress("predicting", 1, 1)
    _show(output, file, checked)
    return ExitCode.NOT_GOOD if checked.report.has_errors else ExitCode.GOOD


def check_before_upload(
    output: Output, mission: Mission, connect: str, *, vehicle: str | None, wait_s: float, force: bool
) -> Report:
    """Check what is to go up to the vehicle behind a link, and tell errors and warnings.

    The vehicle is asked for its parameters; how it stands there matters for a start only.

    Raises
    ------
    PreflightError
        If there are errors, unless `force`.
    """
    from wbf_mission.preflight.finding import Concern
    from wbf_mission.preflight.run import Circumstances, check_mission

    snapshot = _ask(output, connect, wait_s, None)
    base = Scenario() if vehicle is None else Scenario(vehicle=vehicle)
    chosen = _fitted(base, snapshot, named=vehicle is not None, autopilot=None)
    circumstances = Circumstances(chosen.vehicle, assumed=vehicle is None, snapshot=snapshot)
    report = check_mission(mission, circumstances).report.about(Concern.PLAN, Concern.PARAMETERS)
    tell(output, report)
    if not force:
        report.require_no_errors("nothing was sent")
    return report


def tell(output: Output, report: Report) -> None:
    """Say errors and warnings on stderr, and notes unless they are not wanted."""
    from wbf_mission.preflight.finding import Severity

    for finding in report.findings:
        if finding.severity is Severity.NOTE:
            output.note(f"preflight: {finding}")
        else:
            label = "preflight error" if finding.severity is Severity.ERROR else "preflight"
            output.warn(f"{label}: {finding}")


def _ask(output: Output, url: str, wait_s: float, system_id: int | None) -> VehicleSnapshot:
    from wbf_mission.preflight.vehicle.asking import ask_vehicle

    return ask_vehicle(url, wait_s=wait_s, system_id=system_id, note=output.note)


def _fitted(chosen: Scenario, snapshot: VehicleSnapshot, *, named: bool, autopilot: str | None) -> Scenario:
    """Return a scenario with the autopilot that was heard, and a typical vehicle where none is named."""
    from mission.transfer.vehicles import Vehicle
    from wbf_mission.live.discovery import fitted_to, typical_vehicle
    from wbf_mission.scenario import scenario_with

    heard = Vehicle(snapshot.system_id, 1, snapshot.autopilot, snapshot.vehicle_type)
    if not named:
        chosen = scenario_with(chosen, {"vehicle": typical_vehicle(heard)})
    fitted = fitted_to(chosen, heard)
    if autopilot not in (None, fitted.vehicle.autopilot):
        msg = f"--autopilot {autopilot}, but {heard.profile.name} is heard: leave --autopilot out"
        raise ScenarioError(msg)
    return fitted


def _show(output: Output, file: Path, checked: Preflight) -> None:
    subject, report = checked.subject, checked.report
    snapshot, prediction = subject.snapshot, subject.prediction
    values: dict[str, Any] = {
        "file": str(file),
        "vehicle": subject.vehicle.name,
        "autopilot": subject.profile.name,
        "system_id": None if snapshot is None else snapshot.system_id,
        **report.counts,
        "predicted_time_s": None if prediction is None else prediction.duration_s,
        "predicted_energy_wh": None if prediction is None else prediction.energy_wh,
        "findings": [finding.summary() for finding in report.findings],
    }
    title = f"{file.name}: {subject.vehicle.name}, {subject.profile.name}; " + ", ".join(
        f"{number} {name if number != 1 else name.removesuffix('s')}"
        for name, number in report.counts.items()
    )
    output.table(values, _HEADER, [_row(one) for one in report.findings], title=title, left=True)


def _row(finding: Finding) -> list[str]:
    measured = "" if finding.measure is None else str(finding.measure)
    where = finding.where.removeprefix("mission ")
    return [finding.severity.value, where, finding.text, measured, finding.fix]
