"""``wbf-mission upload``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from geo.texts import duration
from wbf_mission.addons.operate.checked_missions import (
    CHECKED,
    Surroundings,
    fitted_circumstances,
    read_and_report,
)
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import Force
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

EXAMPLES = """
Examples
wbf-mission upload spiral.plan --connect udpin:127.0.0.1:14550
wbf-mission upload spiral.plan --system-id 2 --farm my-farm.geojson --wind 5,270,1
wbf-mission upload rows.waypoints --connect tcp:127.0.0.1:5760 --via mavsdk
"""
BEGINNERS = (
    *("--connect", "--farm", "--vehicle", "--autopilot", "--wind", "--camera"),
    *("--margin", "--max-altitude", "--system-id", "--force"),
)


@CHECKED
@options.speaks()
@options.gives("around", Surroundings)
def upload_command(
    given: options.Given,
    output: Output,
    file: Annotated[Path, typer.Argument(help="Mission file: .plan, .waypoints, .json, .kml ...")],
    around: Surroundings,
    force: Force = False,
    connect: options.Connect = "udpin:127.0.0.1:14550",
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
    via: options.Via = "own",
) -> int:
    """Check a mission file, upload it (mission, fence, rally points), download it again and compare.

    The check is that of preflight --connect; without --vehicle, a typical vehicle of the connected vehicle's
    kind is assumed. Exit code 5 means that the vehicle refused the mission, or stored it but will not fly it.
    """
    from wbf_mission.addons.base.links import upload_checked, via_named

    mission = read_and_report(file, output)
    circumstances = around.circumstances(given, mission, output)
    with output.progress():
        report, checked = upload_checked(
            mission,
            connect,
            partial(fitted_circumstances, circumstances, given),
            output.events,
            wait_s=wait,
            system_id=system_id,
            force=force,
            open_driver=via_named(via).driver,
        )
    rejected = report.accepted is False
    if rejected:
        reason = report.texts[-1] if report.texts else "it says no reason"
        output.warn(
            f"system {report.system_id} holds the mission, but would not fly it: {reason}; correct it and"
            " upload it again"
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


COMMAND = Command(upload_command, EXAMPLES, BEGINNERS)
