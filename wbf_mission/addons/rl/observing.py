"""Observations of an agent: position, remaining budget, the estimate and its uncertainty; never the truth.

Maps hold the means of square blocks of cells, at most `MOST_BLOCKS` blocks along a side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from geo.compiled import compiled
from wbf_mission.addons.rl.errors import TrainingError
from wbf_mission.addons.rl.task import MOVE_NAMES, SurveyTask

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_BLOCKS = 64


class Shown:
    """Spaces and observations of a task.

    `block` is the side of a map block in cells, by default the smallest that `MOST_BLOCKS` allows.
    `map_shape` counts blocks along x and y. Raises TrainingError unless `block` is from 1 to the farm's size.
    """

    def __init__(self, task: SurveyTask, block: int | None = None) -> None:
        width, height = task.grid.shape
        longest = max(width, height)
        self.task = task
        self.block = -(-longest // MOST_BLOCKS) if block is None else block
        if not isinstance(self.block, int) or not 1 <= self.block <= longest:
            raise TrainingError(f"block {block!r}: give a whole number of cells from 1 to {longest}")
        self.map_shape = -(-width // self.block), -(-height // self.block)

    def action_space(self) -> spaces.Discrete[Any]:
        """Return the space of the moves of one robot."""
        return spaces.Discrete(len(MOVE_NAMES))

    def space(self) -> spaces.Dict:
        """Return the observation space of one robot."""
        maps = (len(self.task.fields), *self.map_shape)
        parts: dict[str, spaces.Space[Any]] = {
            "position": _unit((2,)),
            "left": _unit((2,)),
            "value": _unit(maps),
            "uncertainty": _unit(maps),
            "seen": _unit(self.map_shape),
        }
        if self.task.robots > 1:
            parts["others"] = _unit((self.task.robots - 1, 2))
        return spaces.Dict(parts)

    def positions(self, cells: NDArray[np.integer]) -> NDArray[np.float32]:
        """Return the centres of cells as fractions of the farm's width and height, float32[..., 2]."""
        parts: NDArray[np.float64] = (cells + 0.5) / np.array(self.task.grid.shape)
        return parts.astype(np.float32)

    def maps(self, array: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the block means, limited to 0..1, float32[n, blocks along x, blocks along y]."""
        out = np.empty((len(array), *self.map_shape), np.float32)
        block_means(np.ascontiguousarray(array), self.block, out)
        return out


def _unit(shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(0.0, 1.0, shape, np.float32)


@compiled(nogil=True, allocates=False)
def block_means(array: NDArray[np.float32], block: int, out: NDArray[np.float32]) -> None:
    """Write the means of square blocks of maps to `out`, limited to 0..1.

    `array` is float32[n, W, H], and `out` float32[n, ceil(W / block), ceil(H / block)]; blocks at the far
    borders are smaller.
    """
    number, width, height = array.shape
    for k in range(number):
        for column in range(out.shape[1]):
            x0, x1 = column * block, min((column + 1) * block, width)
            for row in range(out.shape[2]):
                y0, y1 = row * block, min((row + 1) * block, height)
                total = 0.0
                for x in range(x0, x1):
                    for y in range(y0, y1):
                        total += array[k, x, y]
                mean = total / ((x1 - x0) * (y1 - y0))
                out[k, column, row] = np.float32(min(max(mean, 0.0), 1.0))
