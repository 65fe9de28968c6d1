"""``wbf-mission check``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output

if TYPE_CHECKING:
    from mission.check.registry import CheckResult

EXAMPLES = """
Examples

wbf-mission check udpin:127.0.0.1:14550

wbf-mission check tcp:127.0.0.1:5760 --only mission --only transfer

wbf-mission check udpin:127.0.0.1:14540 --fly --json
"""


def check_command(
    url: Annotated[
        str | None,
        typer.Argument(
            help=f"The link: {options.LINKS}",
            show_default=False,
        ),
    ] = None,
    fly: Annotated[bool, typer.Option("--fly", help="Also run the checks that arm and fly.")] = False,
    only: Annotated[
        list[str] | None, typer.Option(help="Only this check or group of checks; may be repeated.")
    ] = None,
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
    list_checks: Annotated[bool, typer.Option("--list", help="List the checks.")] = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Check whether a vehicle does what ground software expects of a MAVLink autopilot.

    It never arms unless --fly is given, and puts the vehicle's plans back. Exit code 1: something required
    does not hold.
    """
    from mission.check import Verdict, all_checks, check_vehicle

    output = Output(as_json=json, quiet=quiet)
    if list_checks:
        rows = [[one.id, one.required_of, one.text, one.suffers] for one in all_checks()]
        values = [
            {"id": one.id, "required_of": one.required_of, "text": one.text, "suffers": one.suffers}
            for one in all_checks()
        ]
        headings = ["check", "required of", "what must hold", "otherwise trouble for"]
        output.table(values, headings, rows, title="Checks", left=True)
        return
    if url is None:
        msg = "give the link to the vehicle, such as udpin:127.0.0.1:14550, or --list"
        raise typer.BadParameter(msg)

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
    output.table(report.summary(), ["check", "", "what must hold", "seen"], rows, title=title, left=True)
    if not report.passed:
        raise typer.Exit(1)
