"""The planners of sgptools and PyPolo as planners and policies of one's own (docs/your-own.md).

Each runs in a virtual environment of its own, which ``benchmarks/peers.py`` makes, because their libraries do
not fit beside ours; questions and answers cross as lines of JSON (``benchmarks/peer_workers``).
"""

from __future__ import annotations

import atexit
import bisect
import contextlib
import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scratch import end_on_signals

from mission.planners.path import PlannedPath
from mission.planners.request import PlanningRequest
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event, PolicyObservation
from mission.policies.policy import Triggers
from wbf_mission import Decision

FOLDER = "WBF_MISSION_PEERS"
"""The environment variable that tells where the virtual environments are."""
_GOALS_AHEAD = 1


class Worker:
    """A program in another virtual environment, which answers line by line."""

    def __init__(self, name: str) -> None:
        python = Path(os.environ[FOLDER]) / name / "bin" / "python"
        script = Path(os.environ[f"{FOLDER}_WORKERS"]) / f"{name}_worker.py"
        # Some libraries leave files where they run.
        end_on_signals()
        self._folder = tempfile.TemporaryDirectory()
        self._process = subprocess.Popen(
            [python, script],
            cwd=self._folder.name,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        atexit.register(self.close)
        self._answer()

    def ask(self, question: dict[str, Any]) -> dict[str, Any]:
        """Return the answer.

        Raises
        ------
        RuntimeError
            If the worker ends, or has none.
        """
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(question) + "\n")
            self._process.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """End the program."""
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        told: dict[str, Any] = json.loads(line) if line else {"error": "its program has ended"}
        if "error" in told:
            raise RuntimeError(told["error"])
        return told


_workers: dict[str, Worker] = {}


def worker(name: str) -> Worker:
    """Return the worker of this process; it is started when it is asked for first."""
    if name not in _workers:
        _workers[name] = Worker(name)
    return _workers[name]


def box(request: PlanningRequest) -> dict[str, Any]:
    """Return what every question tells: the box that the camera's middle may reach, and the start."""
    x_min, y_min, x_max, y_max = request.area.bounds
    inset = request.footprint_m / 2
    low, high = [x_min + inset, y_min + inset], [x_max - inset, y_max - inset]
    return {"low": low, "high": high, "start": list(np.clip(request.start_xy_m, low, high)), "seed": 0}


_tours: dict[str, Any] = {}


def tour(question: dict[str, Any]) -> Any:
    """Return the points of a tour, float64[n, 2] in metres; the same question is asked once."""
    key = json.dumps(question)
    if key not in _tours:
        _tours[key] = np.array(worker("sgptools").ask(question)["points_m"], dtype=np.float64)
    return _tours[key]


def sgptools(
    request: PlanningRequest, /, *, method: str = "ContinuousSGP", reach_m: float = 0.6, max_steps: int = 100
) -> PlannedPath:
    """Plan by a method of sgptools: ContinuousSGP, GreedySGP, CMA or HexCover.

    Its plan depends on farm, start and budget alone, so that it is asked once for each.

    Parameters
    ----------
    request : PlanningRequest
    method : str
    reach_m : float
        Length scale of the kernel.
    max_steps : int
        Of the optimiser.
    """
    # What a metre costs, by a leg of half the farm's width: a budget may be of steps or seconds.
    x, y = request.start_xy_m
    leg_m = 0.5 * (request.area.bounds[2] - request.area.bounds[0])
    length_m = request.budget.limit * leg_m / request.cost(np.array([[x + leg_m, y]]))
    question = {
        **box(request),
        "method": method,
        "length_m": length_m,
        "reach_m": reach_m,
        "cell_m": request.footprint_m,
        "max_steps": max_steps,
    }
    points = tour(question)
    # Steps are counted in whole ones for each leg; what is too much is left out at the end.
    fits = bisect.bisect_right(
        range(1, len(points) + 1), request.budget.limit, key=lambda count: request.cost(points[:count])
    )
    return PlannedPath(points[: max(1, fits)], None, method)


class PyPolo:
    """PyPolo's myopic planning as a policy: one goal after the other, by what was seen of both diseases.

    Parameters
    ----------
    kernel : {"RBF", "AK"}
        Stationary, or the attentive kernel.
    reach_m : float
        Length scale of the stationary kernel at the start; it is learned.
    """

    def __init__(self, kernel: str = "AK", reach_m: float = 0.6) -> None:
        self.kernel, self.reach_m = kernel, reach_m
        self._told = 0

    @property
    def triggers(self) -> Triggers:
        """When a goal is reached."""
        return Triggers(waypoints=True)

    def start(self) -> None:
        """Begin a flight."""
        self._told = 0

    def decide(self, observation: PolicyObservation) -> Decision:
        """Fly to PyPolo's next goal, as far as the budget goes."""
        if observation.event is Event.LOST or not observation.steerable:
            return NO_CHANGE
        vehicle = observation.steerable[0]
        if len(vehicle.rest_m) > _GOALS_AHEAD:
            return NO_CHANGE
        ask = worker("pypolo").ask
        if observation.event is Event.START:
            ask({"ask": "start", **box(vehicle.request), "kernel": self.kernel, "reach_m": self.reach_m})
        here = np.asarray(vehicle.position_m if len(vehicle.rest_m) == 0 else vehicle.rest_m[-1])
        goal = ask({"ask": "goal", "position": here.tolist(), "seen": self._seen(observation)})["goal"]
        path = np.vstack((vehicle.rest_m, [goal]))
        for share in (1.0, 0.8, 0.6, 0.4, 0.2, 0.1, 0.05):
            path[-1] = here + share * (np.asarray(goal) - here)
            if vehicle.travel_cost.rest([path])[0] <= vehicle.left:
                return Decision({vehicle.system_id: path}, reason="goal")
        return NO_CHANGE

    def _seen(self, observation: PolicyObservation) -> list[list[float]]:
        """What came since the last question: x, y in metres and how sick both plants look, 0 to 1."""
        seen, begin = observation.observations, self._told
        self._told = len(seen)
        side = observation.farm.grid().cell_size_m
        chosen = [observation.fields.index(one.name) for one in observation.fields.diseases]
        values = 1.0 - np.nan_to_num(seen.values[begin:, chosen], nan=1.0).clip(0.0, 1.0).mean(axis=1)
        places = np.stack((seen.x[begin:], seen.y[begin:]), axis=1) * side + 0.5 * side
        return np.column_stack((places, values)).tolist()
