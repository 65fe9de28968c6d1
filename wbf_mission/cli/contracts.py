"""``wbf-mission check-planner``, ``check-policy``, ``check-estimator``: contracts of what others write."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import Choice

EXAMPLES = """
Examples

wbf-mission check-planner spiral

wbf-mission check-policy greedy:least_weight=0.35

wbf-mission check-policy my_policy.py:MyPolicy

wbf-mission check-estimator my_estimator.py:Mine
"""
_Name = Annotated[
    str, typer.Argument(help="A name with parameters, or FILE.py:NAME of yours.", show_default=False)
]


def check_planner_command(name: _Name, json: options.Json = False) -> int:
    """Check that a planner keeps its contract: budget, area, the same path again."""

    def check(choice: Choice) -> dict[str, Any]:
        from mission.planners import check_planner

        check_planner(choice.name if choice.made is None else choice.made, **choice.params)
        return {}

    return _run(name, "planner", check, as_json=json)


def check_policy_command(name: _Name, json: options.Json = False) -> int:
    """Check that a policy keeps its contract.

    Budget, area, the same answers again, no truth, sensible answers when nothing or all was seen and when a
    vehicle is lost; and how much of its computing time it takes.
    """

    def check(choice: Choice) -> dict[str, Any]:
        from mission.policies.conformance import check_policy

        found = check_policy(choice.name if choice.made is None else choice.made, **choice.params)
        return {"decisions": found.decisions, "time_share": found.time_share}

    return _run(name, "policy", check, as_json=json)


def check_estimator_command(name: _Name, json: options.Json = False) -> int:
    """Check that an estimator keeps its contract: scikit-learn's habits, shapes, ranges, equal maps."""

    def check(choice: Choice) -> dict[str, Any]:
        from sensors.estimators import check_estimator
        from sensors.fields import PAPER_FIELDS
        from wbf_mission.run.estimation import estimator_of

        check_estimator(estimator_of(choice, 0, PAPER_FIELDS))
        return {}

    return _run(name, "estimator", check, as_json=json)


def _run(name: str, what: str, check: Callable[[Choice], dict[str, Any]], *, as_json: bool) -> int:
    from geo.blame import told_error, users_line
    from wbf_mission.own_code import own_choice
    from wbf_mission.scenario.choice import choose

    output = Output(as_json=as_json)
    choice = own_choice(name, what) or choose(name, what)
    broken, measured = None, {}
    try:
        measured = check(choice)
    except AssertionError as error:
        text = str(error) if users_line(error) is None else told_error(error)
        broken = " ".join(text.split()) or "a check failed without saying why"
    except Exception as error:
        if users_line(error) is None or isinstance(error, MemoryError):
            raise
        broken = told_error(error)
    values = {what: str(choice), "keeps": broken is None, "broken": broken, **measured}
    rows = {what: str(choice), "contract": "kept" if broken is None else f"broken: {broken}"}
    if "time_share" in measured:
        rows["computing time"] = f"{measured['time_share']:.1%} of what it has"
        rows["decisions"] = str(measured["decisions"])
    output.result(values, rows)
    return ExitCode.GOOD if broken is None else ExitCode.NOT_GOOD
