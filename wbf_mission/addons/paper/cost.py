"""Cost figure: processor time of one estimate and of one score, by observations and farm size."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from threadpoolctl import threadpool_limits

from geo.atomic import atomic_write
from geo.errors import WbfMissionError
from geo.farms import get_farm
from geo.grid import FarmGrid
from geo.reading import misfit
from sensors.estimators import make_estimator
from sensors.estimators.base import Estimator, prepare_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from wbf_mission.addons.base.plots import new_sheet, save_sheet
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError

FARMS = ("miniberry-10", "miniberry-30", "miniberry-100", "waterberry")
ESTIMATORS = ("adaptive-disk", "gp", "gp-sklearn")
"""Estimators of this project, and the Gaussian process of the paper's published code."""
NUMBERS = (1, 3, 10, 30, 100, 300, 1000, 3000, 10_000)
_PARAMETERS: dict[str, dict[str, Any]] = {"gp-sklearn": {"max_points": 300, "max_entries": 20_000_000}}
"""With larger values, 1000 observations on the smallest farm, or 1 on the full farm, take too long."""
SCORE = "score"
"""Name of the scoring cost, used in place of an estimator."""
LIMIT_S = 5.0
_ENOUGH_S = 0.2
_MOST_TIMES = 5
_DAY = 6
_BLUES = ("#86b6ef", "#3987e5", "#1c5cab", "#0b2f5c")
_TITLES = {
    "adaptive-disk": "adaptive disk",
    "gp": "Gaussian process",
    "gp-sklearn": "the paper's Gaussian process",
}
_GREY = "#52514e"


class Cost(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Processor time (s) of one estimate of three fields, or of one score, over the whole farm."""

    method: str
    """Name of an estimator, or `SCORE`."""
    farm: str
    cells: int
    observations: int
    """0 for a score."""
    cpu_s: float | None
    """None if the time was above the limit, or the estimator refused for lack of memory."""
    machine: str


_T = TypeVar("_T")
_decoder = msgspec.json.Decoder(list[Cost])


def measured_costs(
    path: Path,
    *,
    farms: Sequence[str] = FARMS,
    numbers: Sequence[int] = NUMBERS,
    limit_s: float = LIMIT_S,
    progress: Progress = silent,
) -> list[Cost]:
    """Return the costs of all methods on all farms; measure the costs that the file at `path` lacks.

    A method that exceeds the limit on a farm is not measured there with more observations; `numbers` must
    therefore ascend. Raises ResultError if the file is not a list of costs.
    """
    found = kept_costs(path) if path.exists() else []
    wanted = [(method, farm) for farm in farms for method in (*ESTIMATORS, SCORE)]
    for number, (method, farm) in enumerate(wanted):
        progress("costs", number, len(wanted))
        if any((one.method, one.farm) == (method, farm) for one in found):
            continue
        with threadpool_limits(1):
            found += _measured(method, farm, numbers, limit_s)
        with atomic_write(path, "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(found), indent=1))
    progress("costs", len(wanted), len(wanted))
    return found


def kept_costs(path: Path) -> list[Cost]:
    """Read the file that `measured_costs` writes; raise ResultError if it is not a list of costs."""
    try:
        return _decoder.decode(path.read_bytes())
    except msgspec.ValidationError as error:
        msg = f"{path}: holds no costs ({misfit(error)}); remove it"
    except (msgspec.MsgspecError, UnicodeDecodeError):
        msg = f"{path}: is not valid JSON; remove it"
    raise ResultError(msg)


def _measured(method: str, name: str, numbers: Sequence[int], limit_s: float) -> Iterator[Cost]:
    grid = get_farm(name).grid()
    cells = grid.shape[0] * grid.shape[1]
    machine = f"{platform.machine()}, Python {platform.python_version()}"
    if method == SCORE:
        yield Cost(SCORE, name, cells, 0, _score_s(grid), machine)
        return
    seen = _observations(grid, max(numbers))
    for n in (0, *numbers):
        try:
            cpu_s: float | None = _estimate_s(method, grid, seen[: max(n, 1)])
        except (WbfMissionError, MemoryError):
            cpu_s = None
        if n == 0:
            continue  # The first estimate in a process also loads libraries and compiled code.
        if cpu_s is not None and cpu_s > limit_s:
            cpu_s = None
        yield Cost(method, name, cells, n, cpu_s, machine)
        if cpu_s is None:
            return


def _observations(grid: FarmGrid, n: int) -> Observations:
    """Return `n` observations in random cells, with made-up values."""
    rng = np.random.default_rng(0)
    x, y = (rng.integers(0, side, n) for side in grid.shape)
    sick = rng.choice([0.5, 1.0], (n, 2), p=[0.05, 0.95])
    values = np.column_stack([sick, 0.5 + 0.3 * np.sin(x / 30)])
    times_s = np.arange(n, dtype=np.float64)
    return Observations(x.astype(np.int32), y.astype(np.int32), times_s, np.full(n, _DAY, np.int32), values)


def _estimate_s(method: str, grid: FarmGrid, seen: Observations) -> float:
    def prepared() -> Estimator:
        # Learning, once per farm and day before a flight, is not part of an estimate's cost.
        estimator = make_estimator(method, random_state=1, **_PARAMETERS.get(method, {}))
        estimator.fit(grid)
        prepare_estimator(estimator, [_DAY])
        return estimator

    return _median_s(prepared, lambda estimator: estimator.partial_fit(seen).predict())


def _score_s(grid: FarmGrid) -> float:
    masks = np.stack([field.mask(grid) for field in PAPER_FIELDS])
    truth = np.ones((len(PAPER_FIELDS), *grid.shape), np.float32)
    estimate = np.full_like(truth, 0.9)
    return _median_s(lambda: RunningScore(truth, masks), lambda running: running.add(estimate))


def _median_s(prepared: Callable[[], _T], work: Callable[[_T], object]) -> float:
    """Return the median processor time of some repetitions (s)."""
    times_s: list[float] = []
    while not times_s or (sum(times_s) < _ENOUGH_S and len(times_s) < _MOST_TIMES):
        one = prepared()
        begin_s = time.process_time()
        work(one)
        times_s.append(time.process_time() - begin_s)
        del one  # Two estimators of the full farm would need too much memory.
    return float(np.median(times_s))


def plot_costs(costs: Sequence[Cost], paths: Sequence[Path], limit_s: float = LIMIT_S) -> None:
    """Draw the cost of estimates, in one panel per estimator, and the cost of scores against farm size."""
    from matplotlib.lines import Line2D

    farms = sorted({cost.farm: cost.cells for cost in costs}.items(), key=lambda one: one[1])
    colours = {farm: _BLUES[k % len(_BLUES)] for k, (farm, _) in enumerate(farms)}
    figure = new_sheet(11.5, 3.9)
    *panels, last = figure.subplots(1, len(ESTIMATORS) + 1, sharey=True)
    for axes, method in zip(panels, ESTIMATORS, strict=True):
        for farm, colour in colours.items():
            own = [cost for cost in costs if (cost.method, cost.farm) == (method, farm)]
            done = [(one.observations, one.cpu_s) for one in own if one.cpu_s is not None]
            stopped = [(one.observations, limit_s) for one in own if one.cpu_s is None]
            axes.plot(*np.array(done).reshape(-1, 2).T, color=colour, marker="o", markersize=4, linewidth=1.6)
            if done and stopped:
                axes.plot(*np.array([done[-1], stopped[0]]).T, color=colour, linestyle=":", linewidth=1.2)
            if stopped:
                axes.plot(*stopped[0], color=colour, marker="x", markersize=8, markeredgewidth=2)
        axes.axhline(limit_s, color="#898781", linewidth=0.9)
        axes.set(xscale="log", yscale="log", xlabel="observations")
        axes.set_title(_TITLES[method], fontsize=9)
    most = max((cost.observations for cost in costs), default=1)
    for axes in panels:
        axes.set_xlim(0.7, 1.4 * max(most, 1))
    scores = sorted((row.cells, row.cpu_s) for row in costs if row.method == SCORE and row.cpu_s is not None)
    last.plot(*np.array(scores).reshape(-1, 2).T, color=_GREY, linewidth=1.2)
    for farm, cells in farms:
        own_s = [cost.cpu_s for cost in costs if (cost.method, cost.farm) == (SCORE, farm)]
        last.plot([cells] * len(own_s), own_s, color=colours[farm], marker="o", markersize=5, linestyle="")
    last.set(xscale="log", yscale="log", xlabel="cells of the farm")
    last.set_title("score of three fields", fontsize=9)
    panels[0].set_ylabel("processor seconds")
    for axes in (*panels, last):
        axes.grid(True, which="major", alpha=0.3)
        axes.tick_params(labelsize=8)
    handles = [Line2D([], [], color=colour, marker="o", label=farm) for farm, colour in colours.items()]
    label = f"more than {limit_s:g} s, or refused"
    handles.append(Line2D([], [], linestyle="", color=_GREY, marker="x", markeredgewidth=2, label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)
    save_sheet(figure, paths)
