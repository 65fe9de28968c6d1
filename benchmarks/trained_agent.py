"""The agents of ``train_agents.py``: what their network is told, and how they fly in a benchmark.

As a policy of one's own (docs/your-own.md) an agent needs neither torch nor stable-baselines3:

    wbf-mission bench run --planners benchmarks/trained_agent.py:TrainedAgent:file=agents/ppo.npz ...
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.seeds import stream
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import PolicyObservation
from mission.policies.policy import Triggers
from sensors.fields import FieldSet
from sensors.scoring.score import ScoreWeights

MOVES = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
"""East, north, west, south: actions 1 to 4 of the environments; a mission has no place for a stay."""
_NEAR, _BLOCK, _FAR, _PARTS = 7, 3, 7, 4
_WINDOW = _BLOCK * _FAR
_MARGIN = _WINDOW // 2
_Floats = NDArray[np.float32]


class View:
    """Makes the numbers that a network is told, the same in training and in flight.

    Five maps of each cell: whether it was not seen, how uncertain and how sick it is believed to be, and what
    it is worth (each weighted as the score does), and whether it must not be flown to. Of them 7 x 7 cells
    around the robot, and means of 7 x 7 blocks of 3 x 3 cells; of the first four also means of 4 x 4 parts of
    the farm. Then position, what is left of the budget, and which of the four moves are possible.
    """

    size = 5 * (_NEAR**2 + _FAR**2) + 4 * _PARTS**2 + 3 + len(MOVES)

    def __init__(self, farm: Farm, fields: FieldSet, allowed: NDArray[np.bool_]) -> None:
        masks = fields.masks(farm.grid())
        weights = np.array(ScoreWeights.of(fields).field, np.float32)
        self._shape = width, height = allowed.shape
        self._weights = (weights / weights.sum())[:, None, None] * masks
        self._sick = np.array([field.kind == "disease" for field in fields])
        self._worth = self._weights.sum(axis=0)
        self._blocked = np.ones((width + 2 * _MARGIN, height + 2 * _MARGIN), np.float32)
        self._inside = np.s_[..., _MARGIN : _MARGIN + width, _MARGIN : _MARGIN + height]
        self._blocked[self._inside] = ~allowed
        self._starts = [np.arange(_PARTS) * side // _PARTS for side in self._shape]
        parts = [np.diff([*starts, side]) for starts, side in zip(self._starts, self._shape, strict=True)]
        self._part_cells = np.outer(*parts).astype(np.float32)

    def possible(self, cells: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which moves lead to where the robot may fly, bool[n, 4], from cells int[n, 2]."""
        x, y = np.moveaxis(cells[:, None] + MOVES + _MARGIN, -1, 0)
        free: NDArray[np.bool_] = self._blocked[x, y] == 0.0
        return free

    def __call__(
        self, value: _Floats, uncertainty: _Floats, seen: _Floats, cells: NDArray[np.integer], left: _Floats
    ) -> _Floats:
        """Return float32[n, size] for maps [n, k, W, H] and [n, W, H], cells [n, 2], what is left [n]."""
        count = len(value)
        maps = np.zeros((count, 5, *self._blocked.shape), np.float32)
        farm = maps[self._inside]
        farm[:, 0] = 1.0 - seen
        farm[:, 1] = np.einsum("bkxy,kxy->bxy", np.minimum(uncertainty, 1.0), self._weights)
        sick = self._weights[self._sick]
        farm[:, 2] = np.einsum("bkxy,kxy->bxy", 1.0 - value[:, self._sick], sick)
        farm[:, 3] = self._worth
        maps[:, 4] = self._blocked
        window = np.arange(_WINDOW)
        x, y = cells[:, 0, None, None] + window[:, None], cells[:, 1, None, None] + window
        around = np.moveaxis(maps[np.arange(count)[:, None, None], :, x, y], -1, 1)
        far = around.reshape(count, 5, _FAR, _BLOCK, _FAR, _BLOCK).mean(axis=(3, 5))
        first = (_WINDOW - _NEAR) // 2
        near = around[:, :, first : first + _NEAR, first : first + _NEAR]
        whole = farm[:, :4]
        for axis, starts in zip((2, 3), self._starts, strict=True):
            whole = np.add.reduceat(whole, starts, axis=axis)
        place = (cells + 0.5) / np.array(self._shape)
        parts = [near, far, whole / self._part_cells, place, left[:, None], self.possible(cells)]
        return np.concatenate([part.reshape(count, -1) for part in parts], axis=1).astype(np.float32)


class Network:
    """A perceptron with rectified linear units, from the arrays ``weight_0``, ``bias_0``, ... of a file."""

    def __init__(self, path: Path) -> None:
        with np.load(path, allow_pickle=False) as arrays:
            self._layers = [
                (arrays[f"weight_{number}"], arrays[f"bias_{number}"]) for number in range(len(arrays) // 2)
            ]

    def __call__(self, numbers: _Floats) -> _Floats:
        """Return what is preferred, float32[n, 4]: more is better."""
        for number, (weight, bias) in enumerate(self._layers):
            numbers = numbers @ weight.T + bias
            if number < len(self._layers) - 1:
                numbers = np.maximum(numbers, 0.0)
        return numbers


def draws(seed: int) -> np.random.Generator:
    """Return what the moves of a run are drawn from."""
    return stream(seed, "trained agent")


class TrainedAgent:
    """Flies one robot cell by cell where the network of a file prefers to go; it is asked at every cell.

    A second cell is planned as if the first one told nothing new, so that the robot always has a path. With
    `draw` a move is drawn with the probabilities that the network's numbers are the logarithms of, as in
    training by PPO, from the run's seed: equal runs are equal. Without, it is the best one.
    """

    triggers = Triggers(observations=1)

    def __init__(self, file: str, draw: bool = False) -> None:
        self._network, self._draw = Network(Path(file)), draw
        self.start()

    def start(self) -> None:
        """Forget the farm of the run before."""
        self._view: View | None = None
        self._rng: np.random.Generator | None = None

    def decide(self, observation: PolicyObservation) -> Decision:
        """Return the next two cells."""
        farm, model, vehicle = observation.farm, observation.model, observation.vehicles[0]
        grid = farm.grid()
        if self._view is None:
            self._view = View(farm, observation.fields, grid.owned)
            self._rng = draws(vehicle.request.seed)
        seen = np.zeros(grid.shape, np.float32)
        seen[observation.observations.x, observation.observations.y] = 1.0
        size_m, limit = farm.cell_size_m, vehicle.request.budget.limit
        points = np.array([vehicle.position_m])
        cell = np.floor(points[0] / size_m).astype(np.int64)
        for ahead in range(min(2, int(vehicle.left))):
            left = np.array([(vehicle.left - 1.0 - ahead) / (limit - 1.0)], np.float32)
            told = self._view(model.value[None], model.uncertainty[None], seen[None], cell[None], left)
            preferred = np.where(self._view.possible(cell[None]), self._network(told), -np.inf)[0]
            if self._draw and ahead == 0:
                assert self._rng is not None
                preferred += self._rng.gumbel(size=len(MOVES))
            cell = cell + MOVES[np.argmax(preferred)]
            seen[tuple(cell)] = 1.0
            # Telemetry is rounded: a step that is longer than a cell by a hair would cost two.
            way = (cell + 0.5) * size_m - points[-1]
            points = np.vstack((points, points[-1] + way * min(1.0, size_m / np.hypot(*way))))
        points = points[1:]
        return Decision({vehicle.system_id: points}, reason="trained") if len(points) else NO_CHANGE
