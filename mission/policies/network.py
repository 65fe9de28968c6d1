"""A small network that was trained elsewhere, run by numpy alone."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.errors import PlanningError
from sensors.fields import FieldSet
from sensors.scoring.score import ScoreWeights

__all__ = ["Network", "NetworkView"]

_MOST_BYTES = 16_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """Layers of weights with rectified linear units between them.

    Parameters
    ----------
    layers : tuple of (float32[m, n], float32[m])
        Weights and biases of each layer.
    """

    layers: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]

    @classmethod
    def load(cls, path: Path, inputs: int, outputs: int) -> Network:
        """Read a network from an ``.npz`` file: ``weight_0``, ``bias_0``, ...; nothing is unpickled.

        Parameters
        ----------
        path : Path
        inputs, outputs : int
            How many numbers it takes and gives.

        Raises
        ------
        PlanningError
            If the file cannot be read, or holds no such network.
        """
        try:
            if path.stat().st_size > _MOST_BYTES:
                raise ValueError("it is too large")
            with np.load(path, allow_pickle=False) as held:
                count = len(held.files) // 2
                layers = tuple(
                    (held[f"weight_{k}"].astype(np.float32), held[f"bias_{k}"].astype(np.float32))
                    for k in range(count)
                )
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            msg = f"network {path}: cannot be read: {error}; give an .npz file of tools/train_policy.py"
            raise PlanningError(msg) from None
        sizes = [inputs]
        for weight, bias in layers:
            fits = weight.ndim == 2 and weight.shape[1] == sizes[-1] and bias.shape == weight.shape[:1]
            if not fits or not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                msg = (
                    f"network {path}: layer {len(sizes)} does not take {sizes[-1]} numbers, or is not finite"
                )
                raise PlanningError(msg)
            sizes.append(len(weight))
        if len(sizes) < 2 or sizes[-1] != outputs:
            msg = f"network {path}: it gives {sizes[-1]} numbers instead of {outputs}"
            raise PlanningError(msg)
        return cls(layers)

    def __call__(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the outputs for each row of inputs, float32[n, outputs]."""
        last = len(self.layers) - 1
        for number, (weight, bias) in enumerate(self.layers):
            inputs = inputs @ weight.T + bias
            if number < last:
                inputs = np.maximum(inputs, np.float32(0.0))
        return inputs


_NEAR = 7
_BLOCK, _FAR = 3, 9
_WHOLE = 6
_WINDOW = _BLOCK * _FAR
_MARGIN = _WINDOW // 2
_Floats = NDArray[np.float32]


class NetworkView:
    """Makes numbers of what is known, for a network; the same numbers in training and in flight.

    Four maps, of each cell: whether it was seen, how sick its plants are believed to be and what they are
    worth, by the weights of their diseases, and whether it lies beyond the farm. Of them it takes 7 x 7 cells
    around the vehicle, and the means of 9 x 9 blocks of 3 x 3 cells; of the first three also the means of
    6 x 6 parts of the farm; and position and what is left of the budget.

    Parameters
    ----------
    farm : Farm
    fields : FieldSet
    weights : ScoreWeights
        What errors cost.

    Attributes
    ----------
    size : int
        How many numbers.
    """

    size = 4 * (_NEAR**2 + _FAR**2) + 3 * _WHOLE**2 + 3

    def __init__(self, farm: Farm, fields: FieldSet, weights: ScoreWeights) -> None:
        grid = farm.grid()
        masks = fields.masks(grid)
        self._shape = width, height = grid.shape
        self._diseases = np.array([field.kind == "disease" for field in fields])
        by_field = np.array(weights.field, np.float32)[self._diseases]
        self._worth = by_field[:, None, None] * masks[self._diseases]
        padded = (width + 2 * _MARGIN, height + 2 * _MARGIN)
        self._static = np.zeros((2, *padded), np.float32)
        self._static[1] = 1.0
        inside = np.s_[_MARGIN : _MARGIN + width, _MARGIN : _MARGIN + height]
        self._static[0][inside] = self._worth.sum(axis=0)
        self._static[1][inside] = ~grid.owned
        self._inside = (..., *inside)
        self._starts = [np.arange(_WHOLE) * side // _WHOLE for side in (width, height)]
        parts = [np.diff([*starts, side]) for starts, side in zip(self._starts, self._shape, strict=True)]
        self._part_cells = np.outer(*parts).astype(np.float32)

    def __call__(self, value: _Floats, seen: _Floats, cells: NDArray[np.integer], left: _Floats) -> _Floats:
        """Return the numbers of several situations.

        Parameters
        ----------
        value : float32[B, k, W, H]
            The estimate of each field.
        seen : float32[B, W, H]
            1 where something was seen.
        cells : int[B, 2]
            Where the vehicle is.
        left : float32[B]
            Which part of the budget is left.

        Returns
        -------
        float32[B, size]
        """
        count = len(value)
        maps = np.empty((count, 4, *self._static.shape[1:]), np.float32)
        maps[:, 0] = 1.0
        maps[:, 1] = 0.0
        maps[:, 2:] = self._static
        maps[:, 0][self._inside] = seen
        maps[:, 1][self._inside] = np.einsum("bkxy,kxy->bxy", 1.0 - value[:, self._diseases], self._worth)
        window = np.arange(_WINDOW)
        run = np.arange(count)[:, None, None]
        x, y = cells[:, 0, None, None] + window[:, None], cells[:, 1, None, None] + window
        around = np.moveaxis(maps[run, :, x, y], -1, 1)
        far = around.reshape(count, 4, _FAR, _BLOCK, _FAR, _BLOCK).mean(axis=(3, 5))
        first = (_WINDOW - _NEAR) // 2
        near = around[:, :, first : first + _NEAR, first : first + _NEAR]
        whole = maps[:, :3][self._inside]
        for axis, starts in zip((2, 3), self._starts, strict=True):
            whole = np.add.reduceat(whole, starts, axis=axis)
        whole = whole / self._part_cells
        place = (cells + 0.5) / np.array(self._shape)
        parts = [near, far, whole, place, left[:, None]]
        return np.concatenate([part.reshape(count, -1) for part in parts], axis=1).astype(np.float32)
