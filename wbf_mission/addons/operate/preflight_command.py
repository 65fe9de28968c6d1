"""``wbf-mission preflight``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbf_mission.addons.operate.checked_missions import (
    CHECKED,
    Surroundings,
    fitted_circumstances,
    read_and_report,
)
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import ScenarioError

if TYPE_CHECKING:
    from wbf_mission.preflight.finding import Finding
    from wbf_mission.preflight.run import Preflight

EXAMPLES = """
Examples
wbf-mission preflight spiral.plan
wbf-mission preflight rows.waypoints --vehicle mapping-quad --autopilot ardupilot --wind 5,270,1
wbf-mission preflight spiral.plan --farm my-farm.geojson --margin 5
wbf-mission preflight survey.plan --farm my-farm.kml --crop wheat --camera dji-p1-35
wbf-mission preflight spiral.plan --connect udpin:127.0.0.1:14550 --json
"""
BEGINNERS = (
    *("--connect", "--farm", "--vehicle", "--autopilot", "--wind", "--camera"),
    *("--margin", "--max-altitude", "--json"),
)
_HEADER = ["", "item", "finding"]


@CHECKED
@options.speaks()
@options.gives("around", Surroundings)
def preflight_command(
    given: options.Given,
    output: Output,
    file: Annotated[Path, typer.Argument(help="Mission file: .plan, .waypoints, .json, .kml ...")],
    around: Surroundings,
    connect: Annotated[str | None, options.link("Link to the vehicle, which is then checked, too")] = None,
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
        msg = "--system-id goes with --connect: give the link to the vehicle, or leave it out"
        raise ScenarioError(msg)
    mission = read_and_report(file, output)
    circumstances = around.circumstances(given, mission, output)
    snapshot = None
    if connect is not None:
        snapshot = ask_vehicle(connect, wait_s=wait, system_id=system_id, note=output.note)
        circumstances = fitted_circumstances(circumstances, given, snapshot)
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
    output.table(values, _HEADER, rows, title=title, left=True, lines=True)


def _row(finding: Finding) -> list[str]:
    """Return the cells of a finding; several lines each, to fit a narrow terminal."""
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


COMMAND = Command(preflight_command, EXAMPLES, BEGINNERS)
