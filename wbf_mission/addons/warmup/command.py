"""``wbf-mission warm-up``."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from geo.errors import WbfMissionError
from geo.imports import entry_points, load_entry
from geo.texts import duration
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import TargetError
from wbf_mission.cli.output import Output

EXAMPLES = """
Example
wbf-mission warm-up
"""

# Flights that run all compiled functions except the functions of vehicle motion. Each policy has its own
# route search, and `gp` has extra functions for farms that need tiles.
_FLIGHTS: dict[str, dict[str, str]] = {
    "estimator adaptive-disk": {"planner": "spiral", "vehicle": "ideal", "estimator": "adaptive-disk"},
    "estimator gp": {
        "farm": "miniberry-100",
        "planner": "spiral",
        "vehicle": "ideal",
        "estimator": "gp",
        "budget": "6000steps",
    },
    "policy greedy, default estimator": {"policy": "greedy"},
    "policy rolling-horizon": {"policy": "rolling-horizon", "vehicle": "ideal"},
    "policy orienteering": {"policy": "orienteering", "vehicle": "ideal"},
}
GROUP = "wbf_mission.warm_ups"
"""Group of entry points for functions that compile an add-on and announce each step to a callback."""


@options.speaks()
def warm_up_command(output: Output) -> None:
    """Compile all functions once after an installation, so that no later run has to.

    Compiled code is kept in the user's cache, so a second warm-up only checks the cache.
    """
    from wbf_mission.addons.base.simulator import compile_all

    begun: list[tuple[str, float]] = []

    def begin(what: str) -> None:
        output.note(f"compiling: {what}")
        begun.append((what, time.perf_counter()))

    compile_all(lambda what, _done, _total: begin(what))
    fly_all(begin)
    for entry in entry_points(GROUP):
        try:
            load_entry(entry, f"the warm-up {entry.name}", TargetError)(begin)
        except WbfMissionError as error:  # such as an extra that is not installed
            output.note(str(error))
    ends = [*(since_s for _, since_s in begun[1:]), time.perf_counter()]
    seconds = {what: end_s - since_s for (what, since_s), end_s in zip(begun, ends, strict=True)}
    wall_time_s = sum(seconds.values())
    rows = {what: duration(taken_s) for what, taken_s in seconds.items()}
    values = {"seconds": seconds, "wall_time_s": wall_time_s}
    output.result(values, {**rows, "together": duration(wall_time_s)}, title="Ready")


def fly_all(announce: Callable[[str], None]) -> None:
    """Fly all of `_FLIGHTS`, and announce each flight before its start."""
    from wbf_mission.flight import fly
    from wbf_mission.scenario import Scenario

    for what, given in _FLIGHTS.items():
        announce(what)
        options: dict[str, Any] = {"farm": "miniberry-10", **given}
        fly(Scenario(**options))


COMMAND = Command(warm_up_command, EXAMPLES)
