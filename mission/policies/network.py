"""A small network that was trained elsewhere, run by numpy alone."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mission.errors import PlanningError

__all__ = ["Network"]

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
