"""``wbf-mission upload``, ``wbf-mission download`` and ``wbf-mission preflight``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from geo.texts import duration
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import MISSION_SUFFIXES, Force, Overwrite, option, refuse_overwrite
from wbf_mission.cli.output import Output, write_and_report
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import ScenarioError

if TYPE_CHECKING:
    from mission.model import Mission
    from wbf_mission.addons.base.inquiry import VehicleSnapshot
    from wbf_mission.preflight.finding import Finding
    from wbf_mission.preflight.run import Preflight
    from wbf_mission.preflight.subject import Circumstances

UPLOAD_EXAMPLES = """
Examples
wbf-mission upload spiral.plan --connect udpin:127.0.0.1:14550
wbf-mission upload spiral.plan --system-id 2 --farm my-farm.geojson --wind 5,270,1
wbf-mission upload rows.waypoints --connect tcp:127.0.0.1:5760 --via mavsdk
"""
DOWNLOAD_EXAMPLES = """
Example
wbf-mission download --connect udpin:127.0.0.1:14550 --out onboard.plan
"""
PREFLIGHT_EXAMPLES = """
Examples
wbf-mission preflight spiral.plan
wbf-mission preflight rows.waypoints --vehicle mapping-quad --autopilot ardupilot --wind 5,270,1
wbf-mission preflight spiral.plan --farm my-farm.geojson --margin 5
wbf-mission preflight survey.plan --farm my-farm.kml --crop wheat --camera dji-p1-35
wbf-mission preflight spiral.plan --connect udpin:127.0.0.1:14550 --json
"""
_CHECKED = options.scenario_options(
    *("farm", "mission", "vehicle", "weather", "camera"),
    without=(
        *options.OF_DAYS,
        *("planner", "policy", "budget", "mission", "partition", "altitude_m", "cruise_speed_m_s"),
        *("acceptance_radius_m", "height_above_ground_m", "terrain", "terrain_frame", "fence_m"),
        *("front_overlap", "side_overlap", "vehicles", "separation", "radio_range_m", "gps_noise_m"),
        *("baro_noise_m", "estimate_errors", "camera_spacing_m", "camera_noise", "false_positive_rate"),
        *("false_negative_rate", "camera_fields", "seed"),
    ),
    defaults={"farm": None},
)
"""Decorator that adds the options of a check: farm, margin, camera, vehicle and weather."""
_MissionFile = Annotated[Path, typer.Argument(help="Mission file: .plan, .waypoints, .json, .kml ...")]


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Options that a check has and a run does not have."""

    camera_interval: Annotated[
        float | None,
        option(
            "The camera's shortest interval between images, s.  [default: the interval of --camera; 0.01 for"
            " the leaf camera]",
            panel=options.CHECK_PANEL,
            parser=options.number,
        ),
    ] = None

    def of(self, file: Path, given: options.Given, output: Output) -> tuple[Mission, Circumstances]:
        """Return a file's mission and the circumstances of its check; print notes of mission and farm."""
        from mission.files import open_mission
        from sim_vehicle.camera.component import MIN_INTERVAL_S
        from wbf_mission.planning.imaging import imaging_of
        from wbf_mission.preflight.subject import Circumstances, level_of_plan
        from wbf_mission.run.resolve import farm_of

        mission, notes = open_mission(file)
        output.notes(notes, file.name)
        interval_s = self.camera_interval
        if interval_s is not None and not 0.0 < interval_s <= 3600.0:
            msg = f"--camera-interval {interval_s:g} is out of range: give seconds above 0, up to 3600"
            raise ScenarioError(msg)
        chosen, named = given.scenario(), given.farm()
        farm = None if named is None else farm_of(named)[0]
        output.notes(() if farm is None else farm.notes, "farm")
        imaging = None
        if chosen.camera.model is not None:
            imaging = imaging_of(chosen.camera, chosen.mission, level_of_plan(mission, chosen.vehicle))
        if interval_s is None and imaging is not None:
            interval_s = imaging.camera.min_interval_s
        return mission, Circumstances(
            chosen.vehicle,
            chosen.weather,
            farm,
            chosen.mission.margin_m,
            chosen.mission.max_altitude_m,
            MIN_INTERVAL_S if interval_s is None else interval_s,
            footprint=chosen.camera.footprint,
            imaging=imaging,
        )


def _fitted(circumstances: Circumstances, given: options.Given, snapshot: VehicleSnapshot) -> Circumstances:
    """Return the circumstances with the autopilot of the connected vehicle.

    Without ``--vehicle``, a typical vehicle of the connected vehicle's kind is assumed. Raises ScenarioError
    if ``--autopilot`` names another autopilot.
    """
    from mission.transfer.vehicles import Vehicle
    from wbf_mission.addons.base.links import fitted_to, typical_vehicle
    from wbf_mission.scenario import scenario_with

    chosen = given.scenario()
    heard = Vehicle(snapshot.system_id, 1, snapshot.autopilot, snapshot.vehicle_type)
    assumed = given.file is None and "vehicle" not in given.changes
    if assumed:
        chosen = scenario_with(chosen, {"vehicle": typical_vehicle(heard)})
    fitted, autopilot = fitted_to(chosen, heard), given.changes.get("autopilot")
    if autopilot not in (None, fitted.vehicle.autopilot):
        msg = f"--autopilot {autopilot}, but {heard.profile.name} is heard: leave --autopilot out"
        raise ScenarioError(msg)
    return replace(circumstances, vehicle=fitted.vehicle, assumed=assumed, snapshot=snapshot)


@_CHECKED
@options.speaks()
@options.gives("around", Surroundings)
def upload_command(
    given: options.Given,
    output: Output,
    file: _MissionFile,
    around: Surroundings,
    force: Force = False,
    connect: options.Connect = "udpin:127.0.0.1:14550",
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
    via: options.Via = "own",
) -> int:
    """Check a mission file, upload it (mission, fence, rally points), download it again and compare.

    The file is checked as by preflight --connect, by default for a typical vehicle of the connected kind.
    Exit code 5 means that the vehicle refused the mission, or stored it but will not fly it.
    """
    from wbf_mission.addons.base.links import upload_checked, via_named

    mission, circumstances = around.of(file, given, output)
    with output.progress():
        report, checked = upload_checked(
            mission,
            connect,
            partial(_fitted, circumstances, given),
            output.events,
            wait_s=wait,
            system_id=system_id,
            force=force,
            open_driver=via_named(via).driver,
        )
    rejected = report.accepted is False
    if rejected:
        reason = report.texts[-1] if report.texts else "it gives no reason"
        output.warn(
            f"system {report.system_id} stored the mission, but would not fly it: {reason}; correct the "
            f"mission and upload it again"
        )
    rows = {"vehicle": report.vehicle}
    for name, count in report.items.items():
        bad = rejected and name == "mission"
        rows[name] = f"{count} items, " + ("stored, but rejected by the vehicle" if bad else "verified")
    rows["messages"] = (
        f"{report.messages_sent} sent, {report.messages_received} received, {report.retries} retries"
        if report.messages_sent
        else "not reported by MAVSDK"
    )
    rows["time"] = duration(report.duration_s)
    findings = [finding.summary() for finding in checked.findings]
    values = {"file": str(file), **report.summary(), "findings": findings}
    output.result(values, rows, title="Uploaded, but rejected" if rejected else "Uploaded")
    return ExitCode.REFUSED if rejected else ExitCode.GOOD


@options.speaks()
def download_command(
    output: Output,
    out: Annotated[Path, option("Mission file to write: .plan, .waypoints, .json, .kml ...")],
    connect: options.Connect = "udpin:127.0.0.1:14550",
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
    via: options.Via = "own",
    overwrite: Overwrite = False,
) -> None:
    """Download the mission, the fence and the rally points of a vehicle into a file."""
    from mission.files import Firmware, writer_for
    from mission.ground.link import download
    from wbf_mission.addons.base.links import via_named

    refuse_overwrite(out, suffixes=MISSION_SUFFIXES, overwrite=overwrite)
    writer_for(out)
    with output.progress() as progress:
        mission, report = download(
            connect,
            wait_s=wait,
            system_id=system_id,
            progress=progress,
            note=output.note,
            open_driver=via_named(via).driver,
        )
    firmware = Firmware(report.autopilot) if report.autopilot in set(Firmware) else Firmware.GENERIC
    write_and_report(output, mission, out, firmware)
    rows = {
        "vehicle": report.vehicle,
        **{name: f"{count} items" for name, count in report.items.items()},
        "time": duration(report.duration_s),
        "file": str(out),
    }
    values = report.summary()
    for of_uploads in ("verified", "accepted", "remarks", "texts"):
        del values[of_uploads]
    output.result({"file": str(out), **values}, rows, title="Downloaded")


@_CHECKED
@options.speaks()
@options.gives("around", Surroundings)
def preflight_command(
    given: options.Given,
    output: Output,
    file: _MissionFile,
    around: Surroundings,
    connect: Annotated[str | None, options.link("Link to a vehicle that is to be checked, too")] = None,
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
) -> int:
    """Check a mission file before the flight, and with --connect also the vehicle.

    Each finding has a code, which docs/preflight.md explains. Exit code 1 means that there are errors;
    warnings and notes do not count.
    """
    from wbf_mission.addons.base.inquiry import ask_vehicle
    from wbf_mission.preflight.run import check_mission

    if system_id is not None and connect is None:
        msg = "--system-id needs --connect: give the link to the vehicle, or leave out --system-id"
        raise ScenarioError(msg)
    mission, circumstances = around.of(file, given, output)
    snapshot = None
    if connect is not None:
        snapshot = ask_vehicle(connect, wait_s=wait, system_id=system_id, note=output.note)
        circumstances = _fitted(circumstances, given, snapshot)
    with output.progress() as progress:
        progress("predicting", 0, 1)
        checked = check_mission(mission, circumstances)
        progress("predicting", 1, 1)
    _show(output, file, checked, None if snapshot is None else snapshot.system_id)
    return ExitCode.NOT_GOOD if checked.report.has_errors else ExitCode.GOOD


def _show(output: Output, file: Path, checked: Preflight, system_id: int | None) -> None:
    subject, report = checked.subject, checked.report
    prediction = None if subject.stopped is not None else subject.prediction
    values: dict[str, Any] = {
        "file": str(file),
        "vehicle": subject.vehicle.name,
        "autopilot": subject.profile.name,
        "system_id": system_id,
        **report.counts,
        "predicted_time_s": None if prediction is None else prediction.duration_s,
        "length_m": None if prediction is None else prediction.ground_length_m,
        "predicted_energy_wh": None if prediction is None else prediction.energy_wh,
        "coverage": None if prediction is None else subject.coverage,
        "findings": [finding.summary() for finding in report.findings],
    }
    title = f"{file.name}: {subject.vehicle.name}, {subject.profile.name}; " + ", ".join(
        f"{number} {name if number != 1 else name.removesuffix('s')}"
        for name, number in report.counts.items()
    )
    rows = [_row(finding) for finding in report.findings]
    output.table(values, ["", "item", "finding"], rows, title=title, left=True, lines=True)


def _row(finding: Finding) -> list[str]:
    """Return the cells of a finding; each cell has several lines, to fit a narrow terminal."""
    plan = "" if finding.plan == "mission" else f"{finding.plan} "
    item = [plan.strip()] if finding.item is None else [f"{plan}{finding.item}", finding.command]
    if finding.count > 1:
        item.append(f"and {finding.count - 1} more")
    texts = [finding.text]
    if finding.measure is not None:
        texts.append(f"measured: {finding.measure}")
    if finding.fix:
        texts.append(f"to do: {finding.fix}")
    return [f"{finding.severity.value}\n{finding.code}", "\n".join(filter(None, item)), "\n".join(texts)]


_OF_CHECKS = (
    *("--connect", "--farm", "--vehicle", "--autopilot", "--wind", "--camera"),
    *("--margin", "--max-altitude"),
)
UPLOAD = Command(upload_command, UPLOAD_EXAMPLES, (*_OF_CHECKS, "--system-id", "--force"))
DOWNLOAD = Command(download_command, DOWNLOAD_EXAMPLES)
PREFLIGHT = Command(preflight_command, PREFLIGHT_EXAMPLES, (*_OF_CHECKS, "--json"))
