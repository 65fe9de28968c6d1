"""``wbf-mission warm-up``."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from typing import Any

from wbf_mission.cli import options
from wbf_mission.cli.output import Output, duration

EXAMPLES = """
Example
wbf-mission warm-up
"""

# Flights that go through what is compiled besides the vehicles' motion: a policy chooses among routes of its
# own kind; `gp` takes the readings of a larger farm in windows first, then in tiles, which are scored apart.
_FLIGHTS: dict[str, dict[str, str]] = {
    "estimator adaptive-disk": {"planner": "spiral", "vehicle": "ideal", "estimator": "adaptive-disk"},
    "estimator gp": {
        "farm": "miniberry-100",
        "planner": "spiral",
        "vehicle": "ideal",
        "estimator": "gp",
        "budget": "6000steps",
    },
    "estimator epidemic, policy greedy": {"policy": "greedy", "estimator": "epidemic"},
    "policy rolling-horizon": {"policy": "rolling-horizon", "vehicle": "ideal"},
    "policy orienteering": {"policy": "orienteering", "vehicle": "ideal"},
}
_TRAINED_IN = "WBF/Miniberry-10-v1"


@options.speaks()
def warm_up_command(output: Output) -> None:
    """Compile everything ahead, once after an installation, so that no later run has to.

    What is compiled is kept in the user's cache; a second warm-up has nothing to do but to look.
    """
    from sim_vehicle.prediction.compile_ahead import compile_all

    steps = _Steps(output)
    compile_all(lambda what, _done, _total: steps.begin(what))
    fly_all(steps.begin)
    if importlib.util.find_spec("gymnasium") is not None:
        steps.begin("training environments")
        _step_batched()
    steps.end()
    wall_time_s = sum(steps.seconds.values())
    rows = {what: duration(seconds) for what, seconds in steps.seconds.items()}
    values = {"seconds": steps.seconds, "wall_time_s": wall_time_s}
    output.result(values, {**rows, "together": duration(wall_time_s)}, title="Ready")


def fly_all(told: Callable[[str], None]) -> None:
    """Fly what goes through everything that is compiled besides the vehicles' motion; each is told before."""
    from wbf_mission.flight import fly
    from wbf_mission.scenario import Scenario

    for what, given in _FLIGHTS.items():
        told(what)
        options: dict[str, Any] = {"farm": "miniberry-10", **given}
        fly(Scenario(**options))


def _step_batched() -> None:
    """Take a step of the training environment that is compiled; it needs the extra ``rl``."""
    import numpy as np

    from wbf_mission.rl.vector_env import SurveyVectorEnv

    # Arrays of a single run are contiguous where those of several are not, and are compiled for apart.
    envs = SurveyVectorEnv(2, _TRAINED_IN)
    envs.reset(seed=0)
    envs.step(np.zeros(2, np.int64))
    envs.close()


class _Steps:
    """Says what is done, and how long it took."""

    def __init__(self, output: Output) -> None:
        self.seconds: dict[str, float] = {}
        self._output = output
        self._what = ""
        self._since_s = 0.0

    def begin(self, what: str) -> None:
        """End the step before and begin one."""
        self.end()
        self._output.note(f"compiling: {what}")
        self._what, self._since_s = what, time.perf_counter()

    def end(self) -> None:
        """End the step, if there is one."""
        if self._what:
            self.seconds[self._what] = time.perf_counter() - self._since_s
            self._what = ""
