"""The policy that was trained by reinforcement learning: from cell to cell, as a small network has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.seeds import stream
from mission.policies.chart import Chart, LegCosts
from mission.policies.decision import GO_ON, Decision
from mission.policies.network import Network, NetworkView
from mission.policies.policy import LEAST_S, Asking
from mission.policies.situation import Situation, Status, VehicleReport
from mission.policies.steering import affordable

__all__ = ["SHIPPED", "Learned"]

SHIPPED = Path(__file__).with_name("learned.npz")
"""The network of the package."""
_MOVES = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
_NEVER = np.float32(-1e9)


class Learned:
    """Fly from cell to cell as a network says that was trained in the environment of ``WBF/Miniberry-30-v1``.

    It was trained by PPO (`tools/train_policy.py`) with adaptive disks, one robot and a decision for each
    cell. Here it is asked after some observations: it flies on for a few cells of its path, then the next
    ones are drawn as if what will be seen there were what is believed.

    Parameters
    ----------
    every : int
        Asked after so many observations.
    ahead : int
        So many cells are planned.
    keep : int
        So many points of the present path stay, as a vehicle flies on until it hears of the new one.
    network : str
        The file of another network; by default the one of the package.

    Raises
    ------
    PlanningError
        If the network cannot be used.
    """

    def __init__(self, every: int = 8, ahead: int = 40, keep: int = 3, network: str = "") -> None:
        self._every, self._ahead, self._keep = int(every), max(1, int(ahead)), max(0, int(keep))
        path = Path(network) if network else SHIPPED
        self._network = Network.load(path, NetworkView.size, len(_MOVES))
        self.start()

    @property
    def asking(self) -> Asking:
        """After some observations."""
        return Asking(observations=self._every, least_s=LEAST_S)

    def start(self) -> None:
        """Forget the run before."""
        self._view: NetworkView | None = None
        self._rngs: dict[int, Generator] = {}
        self._charts: dict[int, Chart] = {}

    def decide(self, situation: Situation) -> Decision:
        """Draw the next cells of every vehicle, in turn; each knows where the others will have been."""
        if self._view is None:
            self._view = NetworkView(situation.farm, situation.fields, situation.weights)
        seen = np.zeros(situation.model.shape, np.float32)
        seen[situation.observations.x, situation.observations.y] = 1.0
        steerable = {one.system_id for one in situation.steerable}
        for one in situation.vehicles:
            if one.system_id not in steerable and one.status in (
                Status.CLIMBING,
                Status.CHANGING,
                Status.SILENT,
            ):
                self._pass_over(seen, self._cells_of(situation, one.rest_m))
        paths = {}
        for vehicle in situation.steerable:
            points = affordable(vehicle, self._path(situation, vehicle, seen))
            if len(points):
                paths[vehicle.system_id] = points
        return Decision(paths, reason="as learned") if paths else GO_ON

    def _path(
        self, situation: Situation, vehicle: VehicleReport, seen: NDArray[np.float32]
    ) -> NDArray[np.float64]:
        """Return the points of a vehicle's further path, and mark in `seen` what it will see."""
        assert self._view is not None
        rng = self._rngs.get(vehicle.system_id)
        if rng is None:
            rng = self._rngs[vehicle.system_id] = stream(vehicle.request.seed, "learned")
        size_m, free = situation.farm.cell_size_m, self._free(situation, vehicle)
        kept = vehicle.rest_m[: self._keep]
        cell = self._cells_of(situation, np.vstack((np.array([vehicle.position_m]), kept)))[-1]
        self._pass_over(seen, self._cells_of(situation, kept))
        value, limit = situation.model.value[None], vehicle.request.budget.limit
        per_cell = LegCosts.of(vehicle, size_m).per_cell
        steps: list[NDArray[np.int64]] = []
        for number in range(self._ahead):
            left = max(0.0, (vehicle.left - number * per_cell) / limit)
            view = self._view(value, seen[None], cell[None], np.array([left], np.float32))
            wishes = self._network(view)[0]
            there = cell + _MOVES
            wishes[~self._may(free, there)] = _NEVER
            if wishes.max() == _NEVER:
                break
            cell = there[int(np.argmax(wishes + rng.gumbel(size=len(wishes))))]
            self._pass_over(seen, cell[None])
            steps.append(cell)
        ahead = (np.array(steps).reshape(-1, 2) + 0.5) * size_m
        chart = self._charts[vehicle.system_id]
        return chart.inside(vehicle.position_m, np.vstack((kept, ahead)))

    def _free(self, situation: Situation, vehicle: VehicleReport) -> NDArray[np.bool_]:
        """Return the cells that a vehicle may fly to, bool[W, H]."""
        chart = self._charts.get(vehicle.system_id)
        shape, request = situation.model.shape, vehicle.request
        if chart is None:
            size_m = situation.farm.cell_size_m
            chart = Chart.of(request.area, shape, size_m, request.footprint_m)
            self._charts[vehicle.system_id] = chart
        cells = np.repeat(np.repeat(chart.free, chart.block, axis=0), chart.block, axis=1)
        free: NDArray[np.bool_] = cells[: shape[0], : shape[1]]
        return free

    @staticmethod
    def _may(free: NDArray[np.bool_], cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        inside = ((cells >= 0) & (cells < free.shape)).all(axis=1)
        x, y = np.clip(cells, 0, np.array(free.shape) - 1).T
        may: NDArray[np.bool_] = inside & free[x, y]
        return may

    @staticmethod
    def _cells_of(situation: Situation, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the cells of points, the nearest ones of those beyond the farm."""
        cells = np.floor(np.asarray(points_m) / situation.farm.cell_size_m).astype(np.int64)
        return np.clip(cells, 0, np.array(situation.model.shape) - 1)

    @staticmethod
    def _pass_over(seen: NDArray[np.float32], cells: NDArray[np.int64]) -> None:
        seen[cells[:, 0], cells[:, 1]] = 1.0
