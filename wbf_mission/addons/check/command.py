"""``wbf-mission check``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output

if TYPE_CHECKING:
    from wbf_mission.addons.check.registry import CheckResult

EXAMPLES = """
Examples
wbf-mission check udpin:127.0.0.1:14550
wbf-mission check tcp:127.0.0.1:5760 --only mission --only transfer
wbf-mission check udpin:127.0.0.1:14540 --fly --json
"""


@options.speaks()
def check_command(
    output: Output,
    url: Annotated[
        str | None,
        typer.Argument(help=f"The link: {options.LINKS}"),
    ] = None,
    fly: Annotated[bool, option("Also run checks that arm the vehicle or fly it.", "--fly")] = False,
    only: Annotated[list[str] | None, option("Run only this check or group; may be repeated.")] = None,
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
    list_checks: Annotated[bool, option("List the checks.", "--list")] = False,
) -> None:
    """Check that a vehicle's autopilot behaves on MAVLink as ground software expects.

    The vehicle is not armed unless --fly is given, and its plans are restored at the end. The exit code is 1
    if a required check failed.
    """
    from wbf_mission.addons.check import Verdict, all_checks, check_vehicle

    if list_checks:
        keys = ("id", "required_of", "text", "suffers")
        rows = [[getattr(check, key) for key in keys] for check in all_checks()]
        values = [dict(zip(keys, row, strict=True)) for row in rows]
        headings = ["check", "required of", "requirement", "affected if it fails"]
        output.table(values, headings, rows, title="Checks", left=True)
        return
    if url is None:
        raise typer.BadParameter("give the link to the vehicle, such as udpin:127.0.0.1:14550, or --list")

    def tell(result: CheckResult) -> None:
        output.note(f"{result.verdict.value:8}{result.check.id}{': ' + result.told if result.told else ''}")

    report = check_vehicle(url, fly=fly, only=only or (), system_id=system_id, wait_s=wait, on_result=tell)
    for text in report.warnings:
        output.warn(text)
    marks = {Verdict.PASSED: "holds", Verdict.SKIPPED: "skipped", Verdict.FAILED: "FAILS"}
    rows = [
        [
            result.check.id,
            marks[result.verdict] if result.required or result.verdict is not Verdict.FAILED else "fails",
            result.check.text,
            result.told,
        ]
        for result in report.results
    ]
    vehicle = report.vehicle
    title = f"{vehicle.profile.name}, system {vehicle.system_id} on {report.name}"
    output.table(report.summary(), ["check", "", "requirement", "seen"], rows, title=title, left=True)
    if not report.passed:
        raise typer.Exit(1)


COMMAND = Command(check_command, EXAMPLES)
