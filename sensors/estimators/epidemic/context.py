"""A second look: what the network believes of a cell's neighbours tells more of the cell itself.

The classes of cells that were not observed depend on each other: an outbreak is connected, and a farm has a
known number of them. Further networks therefore see, besides the features of observations, the probabilities
that the network before gave to all cells (auto-context; Tu & Bai 2010, "Auto-context and its application to
high-level vision tasks and 3D brain image segmentation").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.epidemic.features import SEEN_INFECTED, SEEN_REMOVED, UNKNOWN
from sensors.estimators.epidemic.rings import REACH, Rings

Cells = NDArray[np.intp]
Floats32 = NDArray[np.float32]

_RINGS = Rings.that_end_at((1, 2, 4, 5, 8, 10, 18, 32, 64, 2 * REACH**2))
_SICK = (SEEN_INFECTED, SEEN_REMOVED)
_OWN_AND_OVERALL = 5
_LEAST = 1e-5
_LOG_SCALE = 1.0 / 3.0

N_CONTEXT = len(_SICK) * len(_RINGS.scales) + _OWN_AND_OVERALL


def context_features(
    codes: NDArray[np.uint8],
    x: Cells,
    y: Cells,
    probabilities: Floats32,
    seeds: int,
    rows: Cells | None = None,
) -> Floats32:
    """Return what is believed around some cells: plants expected to be infected and lost in each ring.

    The logarithms of the cell's own two probabilities follow, and of the whole field the part expected to be
    infected, and the lost plants, expected and seen, for each seed of the disease.

    Parameters
    ----------
    codes : uint8[W + 2 REACH, H + 2 REACH]
        See `sensors.estimators.epidemic.features.padded_codes`.
    x, y : intp[n]
        All cells that can carry the disease.
    probabilities : float32[n, 3]
        What is believed of them; of observed cells it is not used.
    seeds : int
        Number of outbreaks that the model lets begin.
    rows : intp[m], optional
        Which of the cells are asked for; all by default.

    Returns
    -------
    float32[m, N_CONTEXT]
    """
    expected = np.stack([codes == code for code in _SICK]).astype(np.float32)
    unknown = codes[x + REACH, y + REACH] == UNKNOWN
    expected[:, x[unknown] + REACH, y[unknown] + REACH] = probabilities[unknown, 1:].T
    totals = expected.sum(axis=(1, 2), dtype=np.float64)
    if rows is not None:
        x, y, probabilities = x[rows], y[rows], probabilities[rows]
    out = np.empty((len(x), N_CONTEXT), np.float32)
    out[:, :-_OWN_AND_OVERALL] = _RINGS.sums(expected, x, y).T
    own = out[:, -_OWN_AND_OVERALL:]
    own[:, :2] = _LOG_SCALE * np.log(probabilities[:, 1:] + np.float32(_LEAST))
    own[:, 2] = totals[0] / max(len(unknown), 1)
    own[:, 3] = totals[1] / max(seeds, 1)
    own[:, 4] = np.count_nonzero(codes == SEEN_REMOVED) / max(seeds, 1)
    return out
