"""All plants of a farm, judged by the networks after each observation.

What the rings around a cell add to the first layers is kept, and found anew only for cells that an
observation touches. Numbers about the whole field add the same to every cell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.epidemic.context import context_features
from sensors.estimators.epidemic.features import N_FEATURES, N_LOCAL, local_features, overall_features
from sensors.estimators.epidemic.network import Network

Cells = NDArray[np.intp]
Floats32 = NDArray[np.float32]


class FieldJudge:
    """The class probabilities of all cells that can carry the disease, after all further looks.

    Parameters
    ----------
    network : Network
        With its `further` networks.
    codes : uint8[W + 2 REACH, H + 2 REACH]
        See `sensors.estimators.epidemic.features.padded_codes`; not copied.
    x, y : intp[n]
        The cells, in C order.
    seeds : int
        Number of outbreaks that the model lets begin.
    day : int
        Days since the first of those that the network was trained for.
    """

    def __init__(
        self, network: Network, codes: NDArray[np.uint8], x: Cells, y: Cells, seeds: int, day: int
    ) -> None:
        self._stages = (network, *network.further)
        self._codes, self._x, self._y = codes, x, y
        self._seeds, self._day = seeds, day
        self._local = [np.empty((len(x), stage.weights[0].shape[1]), np.float32) for stage in self._stages]
        self.touch(np.arange(len(x)))

    def touch(self, rows: Cells) -> None:
        """Look anew at the surroundings of some of the cells, because the codes changed there."""
        seen = np.zeros((len(rows), N_FEATURES), np.float32)
        local_features(self._codes, self._x[rows], self._y[rows], seen)
        for kept, stage in zip(self._local, self._stages, strict=True):
            kept[rows] = seen[:, :N_LOCAL] @ stage.weights[0][:N_LOCAL]

    def probabilities(self, overall: Floats32 | None = None, found: Floats32 | None = None) -> Floats32:
        """Return what is believed of the cells without their own readings, float32[n, 3].

        Parameters
        ----------
        overall : float32[8], optional
            The numbers about the whole field, if they are known.
        found : float32[n, 3], optional
            What a network before the first one believes, if this is a further one alone.
        """
        if overall is None:
            overall = overall_features(self._codes, len(self._x), self._seeds, self._day)
        for kept, stage in zip(self._local, self._stages, strict=True):
            first = stage.weights[0]
            values = kept + (overall @ first[N_LOCAL:N_FEATURES] + stage.biases[0])
            if found is not None:
                context = context_features(self._codes, self._x, self._y, found, self._seeds)
                values += context @ first[N_FEATURES:]
            found = stage.after_first(values)
        assert found is not None
        return found
