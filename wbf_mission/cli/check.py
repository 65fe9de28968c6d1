"""``wbf-mission check``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import Choice

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
    fly: Annotated[bool, option("Also run the checks that arm and fly.", "--fly")] = False,
    only: Annotated[list[str] | None, option("Only this check or group of checks; may be repeated.")] = None,
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
    list_checks: Annotated[bool, option("List the checks.", "--list")] = False,
) -> None:
    """Check whether a vehicle does what ground software expects of a MAVLink autopilot.

    It never arms unless --fly is given, and puts the vehicle's plans back. Exit code 1: something required
    does not hold.
    """
    from wbf_mission.addons.check import Verdict, all_checks, check_vehicle

    if list_checks:
        keys = ("id", "required_of", "text", "suffers")
        rows = [[getattr(one, key) for key in keys] for one in all_checks()]
        values = [dict(zip(keys, row, strict=True)) for row in rows]
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


CONTRACT_EXAMPLES = """
Examples
wbf-mission check-planner spiral
wbf-mission check-planner my_planner.py:zigzag --land convex
wbf-mission check-policy greedy:least_weight=0.35
wbf-mission check-policy my_policy.py:MyPolicy
wbf-mission check-estimator my_estimator.py:Mine
"""
_Name = Annotated[str, typer.Argument(help="A name with parameters, or FILE.py:NAME of yours.")]


@options.speaks(quiet=False)
def check_planner_command(
    output: Output,
    name: _Name,
    land: Annotated[
        str | None,
        option(
            "The kinds of land that it is made for, separated by commas: convex, concave, pierced, apart"
            " (parts that do not hang together).",
            "--land",
            metavar="KINDS",
            show_default="all",
        ),
    ] = None,
) -> int:
    """Check that a planner keeps its contract: budget, area, the same path again."""
    from mission.planners.conformance import LANDS, check_planner

    lands = LANDS if land is None else tuple(one.strip() for one in land.split(","))
    return _run(output, name, "planner", lambda choice: check_planner(choice.chosen, lands, **choice.params))


@options.speaks(quiet=False)
def check_policy_command(output: Output, name: _Name) -> int:
    """Check that a policy keeps its contract.

    Budget, area, the same answers again, no truth, sensible answers when nothing or all was seen and when a
    vehicle is lost; and how much of its computing time it takes.
    """
    from mission.policies.conformance import check_policy

    return _run(output, name, "policy", lambda choice: check_policy(choice.chosen, **choice.params))


@options.speaks(quiet=False)
def check_estimator_command(output: Output, name: _Name) -> int:
    """Check that an estimator keeps its contract: scikit-learn's habits, shapes, ranges, equal maps."""
    from sensors.estimators import check_estimator
    from sensors.fields import PAPER_FIELDS
    from wbf_mission.run.estimation import estimator_of

    return _run(
        output, name, "estimator", lambda choice: check_estimator(estimator_of(choice, 0, PAPER_FIELDS))
    )


def _run(output: Output, name: str, what: str, check: Callable[[Choice], Any]) -> int:
    """Check what is named; what a check measured, if anything, is told, too."""
    from geo.errors import told_error, users_line
    from wbf_mission.own_code import own_choice
    from wbf_mission.scenario.choice import choose

    choice = own_choice(name, what) or choose(name, what)
    broken, measured = None, None
    try:
        measured = check(choice)
    except AssertionError as error:
        text = str(error) if users_line(error) is None else told_error(error)
        broken = " ".join(text.split()) or "a check failed without saying why"
    except Exception as error:
        if users_line(error) is None or isinstance(error, MemoryError):
            raise
        broken = told_error(error)
    values = {what: str(choice), "keeps": broken is None, "broken": broken}
    rows = {what: str(choice), "contract": "kept" if broken is None else f"broken: {broken}"}
    if measured is not None:
        values |= {"decisions": measured.decisions, "time_share": measured.time_share}
        rows["computing time"] = f"{measured.time_share:.1%} of what it has"
        rows["decisions"] = str(measured.decisions)
    output.result(values, rows)
    return ExitCode.GOOD if broken is None else ExitCode.NOT_GOOD
