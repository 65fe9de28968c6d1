"""Commands ``wbf-mission bench list`` and ``bench show``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.exit_codes import ExitCode

if TYPE_CHECKING:
    from wbf_mission.scenario import Scenario

LIST_EXAMPLES = """
Examples
wbf-mission bench list
wbf-mission bench list --families
wbf-mission fly --scenario WBF/Miniberry-30-v1 --planner lawnmower
"""
SHOW_EXAMPLES = """
Examples
wbf-mission bench show WBF/Miniberry-30-Sweep-v1
"""


@options.speaks(quiet=False)
def list_command(
    output: Output,
    families: Annotated[
        bool,
        option(
            "List families of scenarios, each with its differences from the benchmark's default world.",
            "--families",
        ),
    ] = False,
) -> int:
    """List the scenarios of the catalogue; results on the same scenario can be compared.

    A scenario id always has the same settings; a changed scenario gets a new version.
    """
    from msgspec import to_builtins

    from wbf_mission import scenario as known

    if families:
        found = known.families()
        rows = [[family.name, family.about, family.at_home, "\n".join(family.scenarios)] for family in found]
        header = ["family", "what differs", "at home", "scenarios"]
        output.table(to_builtins(found), header, rows, left=True)
        return ExitCode.GOOD
    values = [
        {
            "scenario": name,
            "about": known.about_scenario(name),
            "family": None if (family := known.family_of(name)) is None else family.name,
            "meaning": _meaning(known.load_scenario(name)),
        }
        for name in known.scenario_ids()
    ]
    rows = [[str(listed["scenario"]), str(listed["family"] or ""), str(listed["about"])] for listed in values]
    output.table(values, ["scenario", "family", "what it is"], rows, left=True)
    return ExitCode.GOOD


def _meaning(scenario: Scenario) -> str | None:
    """Return the digest of a scenario's settings; None if the kind of its vehicle is not installed."""
    from sim_vehicle.errors import VehicleError
    from wbf_mission.bench.digests import meaning_of

    try:
        return meaning_of(scenario)
    except VehicleError:
        return None


@options.speaks(quiet=False)
def show_command(
    output: Output, scenario: Annotated[str, typer.Argument(help="Scenario id (see 'bench list') or file.")]
) -> int:
    """Show a scenario: its farm, scored fields and times, and options that differ from the defaults."""
    from msgspec import to_builtins

    from wbf_mission.bench.requests import card_of
    from wbf_mission.scenario import load_scenario

    card = card_of(scenario, load_scenario(scenario))
    output.result(to_builtins(card), card.entries())
    return ExitCode.GOOD


LIST = Command(list_command, LIST_EXAMPLES)
SHOW = Command(show_command, SHOW_EXAMPLES)
