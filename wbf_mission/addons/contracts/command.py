"""Commands ``wbf-mission check-planner``, ``check-policy`` and ``check-estimator``."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import Choice

EXAMPLES = """
Examples
wbf-mission check-planner spiral
wbf-mission check-planner my_planner.py:zigzag --land convex
wbf-mission check-policy greedy:least_weight=0.35
wbf-mission check-policy my_policy.py:MyPolicy
wbf-mission check-estimator my_estimator.py:Mine
"""
_Name = Annotated[str, typer.Argument(help="Name, and parameters if any, or FILE.py:NAME of your own code.")]


@options.speaks(quiet=False)
def check_planner_command(
    output: Output,
    name: _Name,
    land: Annotated[
        str | None,
        option(
            "Kinds of land on which the planner is checked, separated by commas: convex, concave, pierced,"
            " apart (disconnected parts).",
            "--land",
            metavar="KINDS",
            show_default="all",
        ),
    ] = None,
) -> int:
    """Check that a planner fulfils its contract: repeatable paths within the budget and the area."""
    from wbf_mission.addons.contracts.planners import LANDS, check_planner

    lands = LANDS if land is None else tuple(kind.strip() for kind in land.split(","))
    return _run(output, name, "planner", lambda choice: check_planner(choice.chosen, lands, **choice.params))


@options.speaks(quiet=False)
def check_policy_command(output: Output, name: _Name) -> int:
    """Check that a policy fulfils its contract.

    Its paths must stay within the budget and the area, its answers must be repeatable and must not use the
    truth. The policy must also answer if no cell or every cell was observed, or if a vehicle is lost. The
    command prints the fraction of the allowed computing time that an answer takes.
    """
    from wbf_mission.addons.contracts.policies import check_policy

    return _run(output, name, "policy", lambda choice: check_policy(choice.chosen, **choice.params))


@options.speaks(quiet=False)
def check_estimator_command(output: Output, name: _Name) -> int:
    """Check that an estimator fulfils its contract: valid, repeatable maps, scikit-learn's conventions."""
    from sensors.fields import PAPER_FIELDS
    from wbf_mission.addons.contracts.estimators import check_estimator
    from wbf_mission.run.estimation import estimator_of

    return _run(
        output, name, "estimator", lambda choice: check_estimator(estimator_of(choice, 0, PAPER_FIELDS))
    )


def _run(output: Output, name: str, what: str, check: Callable[[Choice], Any]) -> int:
    """Run a contract check on a named planner, policy or estimator, and print its result."""
    from geo.errors import WbfMissionError, told_error, users_line
    from wbf_mission.own_code import own_choice
    from wbf_mission.scenario.choice import choose

    own = own_choice(name, what)
    choice = own or choose(name, what)
    broken, measured = None, None
    try:
        with contextlib.redirect_stdout(sys.stderr):
            measured = check(choice)
    except AssertionError as error:
        text = str(error) if users_line(error) is None else told_error(error)
        broken = " ".join(text.split()) or "a check failed without a message"
    except (Exception, SystemExit) as error:
        # A call with wrong arguments, or a copy of an object that allows none, fails outside the user's code
        if isinstance(error, MemoryError) or (
            users_line(error) is None and (own is None or isinstance(error, WbfMissionError))
        ):
            raise
        broken = told_error(error)
    values = {what: str(choice), "keeps": broken is None, "broken": broken}
    rows = {what: str(choice), "contract": "kept" if broken is None else f"broken: {broken}"}
    if measured is not None:
        values |= {"decisions": measured.decisions, "time_share": measured.time_share}
        rows["computing time"] = f"{measured.time_share:.1%} of the allowed time"
        rows["decisions"] = str(measured.decisions)
    output.result(values, rows)
    return ExitCode.GOOD if broken is None else ExitCode.NOT_GOOD


PLANNER = Command(check_planner_command, EXAMPLES)
POLICY = Command(check_policy_command, EXAMPLES)
ESTIMATOR = Command(check_estimator_command, EXAMPLES)
