"""Planners of sgptools and PyPolo as user-defined planners and policies (docs/your-own.md).

Each library runs in a separate virtual environment, because its dependencies conflict with ours: sgptools
needs TensorFlow; PyPolo needs an older NumPy and PyTorch (1 to 2 GB each). Requests and responses are lines
of JSON (``benchmarks/peer_workers``). The first command creates the environments::

    python benchmarks/peers.py FOLDER
    export WBF_MISSION_PEERS=FOLDER
    wbf-mission bench run --scenarios WBF/Miniberry-30-v1 --estimators gp --seeds 10 --out results
        --planners greedy,benchmarks/peers.py:sgptools:method=CMA,benchmarks/peers.py:PyPolo:kernel=AK
"""

from __future__ import annotations

import atexit
import bisect
import contextlib
import json
import math
import os
import shutil
import subprocess
import tempfile
import venv
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from common import end_on_signals, options_of

from mission.planners.budget import StepBudget
from mission.planners.path import PlannedPath
from mission.planners.request import PlanningRequest
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event, PolicyObservation
from mission.policies.policy import Triggers
from wbf_mission import Decision

PACKAGES = {
    "sgptools": ("sgptools==2.0.7",),
    # PyPolo uses functions that NumPy 2 removed; later versions of bezier need NumPy 2.
    "pypolo": ("pypolo==0.0.3", "numpy<2", "bezier<2024.6", "torch==2.13.0"),
}
FOLDER = "WBF_MISSION_PEERS"
"""Environment variable with the folder of the virtual environments."""
WORKERS = "workers"
LAND_POINTS = 900
"""Maximum number of points on which the objective of sgptools is defined."""
_GOALS_AHEAD = 1


class Worker:
    """Process in another virtual environment, with one response line for each request line."""

    def __init__(self, name: str) -> None:
        python = Path(os.environ[FOLDER]) / name / "bin" / "python"
        script = Path(os.environ[FOLDER]) / WORKERS / f"{name}_worker.py"
        # Some libraries write files into the working directory.
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
        """Send a request and return the response.

        Raises
        ------
        RuntimeError
            If the worker ends or responds with an error.
        """
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(question) + "\n")
            self._process.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        response: dict[str, Any] = json.loads(line) if line else {"error": "its program has ended"}
        if "error" in response:
            raise RuntimeError(response["error"])
        return response


@cache
def worker(name: str) -> Worker:
    """Return the worker of this process; the first call starts it."""
    return Worker(name)


@cache
def tour(question: str) -> list[list[float]]:
    """Return the waypoints planned by sgptools (m) for a request in JSON."""
    points_m: list[list[float]] = worker("sgptools").ask(json.loads(question))["points_m"]
    return points_m


def box(request: PlanningRequest) -> dict[str, Any]:
    """Return the common part of all requests: box of possible camera centres, start and budget."""
    x_min, y_min, x_max, y_max = request.area.bounds
    inset = request.footprint_m / 2
    low, high = [x_min + inset, y_min + inset], [x_max - inset, y_max - inset]
    start = np.clip(request.start_xy_m, low, high).tolist()
    return {"low": low, "high": high, "start": start, "limit": request.budget.limit}


def land(request: PlanningRequest) -> list[list[float]]:
    """Return points on the crops' land, one footprint apart, or further for at most `LAND_POINTS` points."""
    area = shapely.union_all([one.area for one in request.crop_areas] or [request.area])
    step = max(request.footprint_m, math.sqrt(area.area / LAND_POINTS))
    x_min, y_min, x_max, y_max = area.bounds
    x, y = np.arange(x_min + step / 2, x_max, step), np.arange(y_min + step / 2, y_max, step)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    found: list[list[float]] = points[shapely.contains_xy(area, points)].tolist()
    return found


def steps_along(points_m: Any, start_m: tuple[float, float], step_m: float) -> Any:
    """Return points one step apart along a path, float64[n, 2] in metres.

    A step budget rounds each leg up to whole steps, so short legs would waste up to half of the budget.
    """
    line = shapely.LineString(np.vstack((start_m, points_m)))
    count = max(1, math.ceil(line.length / step_m - 1e-9))
    found = line.interpolate(np.minimum(step_m * np.arange(1, count + 1), line.length))
    return shapely.get_coordinates(found)


def fitting(points_m: Any, cost: Callable[[Any], float], limit: float) -> Any:
    """Return the longest start of a path that costs at most `limit`."""
    fits = bisect.bisect_right(range(1, len(points_m) + 1), limit, key=lambda count: cost(points_m[:count]))
    return points_m[: max(1, fits)]


def sgptools(
    request: PlanningRequest,
    /,
    *,
    method: str = "ContinuousSGP",
    reach_m: float = 0.5,
    variance: float = 0.68,
    noise: float = 0.26,
    waypoints: int = 125,
    max_steps: int | None = None,
) -> PlannedPath:
    """Plan by a method of sgptools: ContinuousSGP, CMA or HexCover.

    The plan depends only on farm, start and budget, so that plans are cached for the process.

    Parameters
    ----------
    request : PlanningRequest
    method : str
    reach_m, variance, noise : float
        Lengthscale and variance of the kernel, and variance of the noise. The defaults are maximum-likelihood
        values for the standardized illness of 500 plants on Miniberry-30: medians over ten of the tuning
        environments of ``benchmarks/tune_baselines.py``.
    waypoints : int
        Number of waypoints of ContinuousSGP and CMA.
    max_steps : int, optional
        Maximum number of optimiser steps of ContinuousSGP and CMA, by default the method's own.
    """
    # Cost of a metre, from a leg of half the farm's width: the budget may be in steps or seconds.
    x, y = request.start_xy_m
    leg_m = 0.5 * (request.area.bounds[2] - request.area.bounds[0])
    length_m = request.budget.limit * leg_m / request.cost(np.array([[x + leg_m, y]]))
    if isinstance(request.budget, StepBudget):
        length_m = request.budget.limit * request.budget.step_m
    question = {
        **box(request),
        "seed": 0,
        "method": method,
        "length_m": length_m,
        "reach_m": reach_m,
        "variance": variance,
        "noise": noise,
        "land": land(request),
        "waypoints": waypoints,
        "max_steps": max_steps,
    }
    points = np.array(tour(json.dumps(question)), dtype=np.float64)
    if isinstance(request.budget, StepBudget):
        points = steps_along(points, request.start_xy_m, request.budget.step_m)
    return PlannedPath(fitting(points, request.cost, request.budget.limit), None, method)


class PyPolo:
    """Policy with PyPolo's myopic planning of one goal at a time, from observations of both diseases.

    Parameters
    ----------
    kernel : {"RBF", "AK"}
        Stationary kernel, or attentive kernel.
    mean, deviation : float
        Mean and standard deviation of the plants' illness, 0 to 1. The defaults are from the tuning
        environments of ``benchmarks/tune_baselines.py`` on Miniberry-30.
    """

    def __init__(self, kernel: str = "AK", mean: float = 0.0204, deviation: float = 0.0768) -> None:
        self.kernel, self.mean, self.deviation = kernel, mean, deviation
        self._sent = 0

    @property
    def triggers(self) -> Triggers:
        """Trigger at each reached goal."""
        return Triggers(waypoints=True)

    def start(self) -> None:
        """Start a flight."""
        self._sent = 0

    def decide(self, observation: PolicyObservation) -> Decision:
        """Return the pilot survey, then the path to PyPolo's next goal, within the budget."""
        if observation.event is Event.LOST or not observation.steerable:
            return NO_CHANGE
        vehicle = observation.steerable[0]
        if observation.event is Event.START:
            seed = int(np.random.default_rng(vehicle.request.seed).integers(2**31))
            given = {"kernel": self.kernel, "mean": self.mean, "deviation": self.deviation, "seed": seed}
            pilot = worker("pypolo").ask({"ask": "start", **box(vehicle.request), **given})["pilot"]
            path = steps_along(pilot, vehicle.position_m, vehicle.request.footprint_m)
            path = fitting(path, lambda rest: vehicle.travel_cost.rest([rest])[0], vehicle.left)
            return Decision({vehicle.system_id: path}, reason="pilot survey")
        if len(vehicle.rest_m) > _GOALS_AHEAD:
            return NO_CHANGE
        here = np.asarray(vehicle.position_m if len(vehicle.rest_m) == 0 else vehicle.rest_m[-1])
        question = {"ask": "goal", "position": here.tolist(), "seen": self._seen(observation)}
        goal = worker("pypolo").ask(question)["goal"]
        path = np.vstack((vehicle.rest_m, [goal]))
        for share in (1.0, 0.8, 0.6, 0.4, 0.2, 0.1, 0.05):
            path[-1] = here + share * (np.asarray(goal) - here)
            if vehicle.travel_cost.rest([path])[0] <= vehicle.left:
                return Decision({vehicle.system_id: path}, reason="goal")
        return NO_CHANGE

    def _seen(self, observation: PolicyObservation) -> list[list[float]]:
        """Return the observations since the last request: x, y (m) and illness of both plants, 0 to 1."""
        seen, begin = observation.observations, self._sent
        self._sent = len(seen)
        side = observation.farm.grid().cell_size_m
        chosen = [observation.fields.index(one.name) for one in observation.fields.diseases]
        values = 1.0 - np.nan_to_num(seen.values[begin:, chosen], nan=1.0).clip(0.0, 1.0).mean(axis=1)
        places = np.stack((seen.x[begin:], seen.y[begin:]), axis=1) * side + 0.5 * side
        return np.column_stack((places, values)).tolist()


def prepare(folder: Path) -> None:
    """Create missing virtual environments, and copy the worker programs into the folder."""
    shutil.copytree(Path(__file__).with_name("peer_workers"), folder / WORKERS, dirs_exist_ok=True)
    for name, packages in PACKAGES.items():
        if not (folder / name / "made").exists():
            print(f"making {folder / name} with {', '.join(packages)}")
            venv.create(folder / name, with_pip=True, clear=True)
            python = folder / name / "bin" / "python"
            subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
            (folder / name / "made").touch()


def main() -> None:
    """Create the virtual environments."""
    parser = options_of(__doc__)
    parser.add_argument("folder", type=Path, help="where the virtual environments are or go")
    folder = parser.parse_args().folder
    prepare(folder)
    print(f"now: export {FOLDER}={folder.resolve()}")


if __name__ == "__main__":
    main()
