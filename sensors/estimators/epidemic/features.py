"""What is known around a cell, in numbers: observed healthy, infected and lost plants at each distance.

A map of codes says what is known of every cell. The features of a cell are, for each ring of distances around
it, how many cells have each code; the cell itself is left out. They do not change under rotation and
reflection, and depend only on cells at most `REACH` away along each axis. A few numbers about the whole field
follow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.epidemic.rings import REACH, Rings

UNKNOWN, SEEN_SUSCEPTIBLE, SEEN_INFECTED, SEEN_REMOVED, NO_HOST_CODE = range(5)
"""Codes of cells: not observed, three classes, and land without the crop (or beside the farm)."""

RINGS = Rings.that_end_at((1, 2, 4, 5, 8, 9, 10, 13, 18, 20, 26, 36, 50, 65, 90, 2 * REACH**2))
_SEEN_NUMBERS = 3
_DAY_KNOTS = (0.0, 2.0, 4.0, 6.0, 7.0)
N_OVERALL = _SEEN_NUMBERS + len(_DAY_KNOTS)
_CHUNK_CELLS = 1 << 14
_CLUSTER_LINK = 5
# A box is marked that holds at most so many times the cells in reach, each counted as often as it is.
_LOOSEST_BOX = 4

N_LOCAL = len(RINGS.scales) * NO_HOST_CODE
N_FEATURES = N_LOCAL + N_OVERALL


def padded_codes(hosts: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a map of codes with nothing observed, and a margin of `REACH` cells around it.

    Parameters
    ----------
    hosts : bool[W, H]
        Cells that can carry the disease.

    Returns
    -------
    uint8[W + 2 REACH, H + 2 REACH]
    """
    codes = np.full((hosts.shape[0] + 2 * REACH, hosts.shape[1] + 2 * REACH), NO_HOST_CODE, np.uint8)
    codes[REACH:-REACH, REACH:-REACH][hosts] = UNKNOWN
    return codes


def inner(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the view of a padded map that is the farm itself, [W, H]."""
    return codes[REACH:-REACH, REACH:-REACH]


def local_features(
    codes: NDArray[np.uint8], x: NDArray[np.intp], y: NDArray[np.intp], out: NDArray[np.float32]
) -> None:
    """Write the features of the rings around some cells into the first columns of `out`.

    Parameters
    ----------
    codes : uint8[W + 2 REACH, H + 2 REACH]
        See `padded_codes`.
    x, y : intp[n]
        Cells of the farm.
    out : float32[n, N_FEATURES]
        The last columns, for `overall_features`, are left as they are.
    """
    out[:, :N_LOCAL] = RINGS.counts(codes, NO_HOST_CODE, x, y).T


def overall_features(codes: NDArray[np.uint8], hosts: int, seeds: int, day: int) -> NDArray[np.float32]:
    """Return numbers about the whole field: what was seen of it, and the day.

    They are the part observed, outbreaks seen by those expected, the part seen sick, and the day as weights
    of five knots that it lies between. Sick cells at most five cells apart along each axis count as one
    outbreak.

    Parameters
    ----------
    codes : uint8[W + 2 REACH, H + 2 REACH]
        See `padded_codes`.
    hosts : int
        Number of cells that can carry the disease.
    seeds : int
        Number of outbreaks that the model lets begin.
    day : int
        Days since the first of those that the network was trained for.

    Returns
    -------
    float32[8]
    """
    counts = np.bincount(codes.ravel(), minlength=NO_HOST_CODE + 1)
    sick = int(counts[SEEN_INFECTED] + counts[SEEN_REMOVED])
    observed = sick + int(counts[SEEN_SUSCEPTIBLE])
    outbreaks = 0
    if sick:
        from scipy import ndimage

        is_sick = (codes == SEEN_INFECTED) | (codes == SEEN_REMOVED)
        grown = ndimage.maximum_filter(is_sick.view(np.uint8), size=_CLUSTER_LINK, mode="constant")
        outbreaks = ndimage.label(grown, structure=np.ones((3, 3)))[1]
    share = max(hosts, 1)
    knots = np.interp(day, _DAY_KNOTS, np.arange(len(_DAY_KNOTS)))
    weights = np.maximum(0.0, 1.0 - np.abs(np.arange(len(_DAY_KNOTS)) - knots))
    numbers = observed / share, min(outbreaks / max(seeds, 1), 2.0), sick / share
    return np.array([*numbers, *weights], np.float32)


def set_overall(features: NDArray[np.float32], overall: NDArray[np.float32]) -> None:
    """Write the numbers of `overall_features` into the last columns of rows of features."""
    features[:, -N_OVERALL:] = overall


def cells_in_reach(
    x: NDArray[np.intp], y: NDArray[np.intp], shape: tuple[int, int]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the different cells of a farm whose features, or which themselves, some changed cells touch.

    Examples
    --------
    >>> x, y = cells_in_reach(np.array([0]), np.array([20]), (30, 30))
    >>> len(x), int(x.max()), int(y.min())
    (153, 8, 12)
    """
    axis = np.arange(-REACH, REACH + 1)
    if len(x):
        # Cells near each other, as those of a path: their box is marked, which takes no sorting.
        left, below = int(x.min()) - REACH, int(y.min()) - REACH
        box = int(x.max()) + REACH + 1 - left, int(y.max()) + REACH + 1 - below
        if box[0] * box[1] <= _LOOSEST_BOX * len(x) * len(axis) ** 2:
            touched = np.zeros(box, np.bool_)
            for start in range(0, len(x), _CHUNK_CELLS):
                i, j = x[start : start + _CHUNK_CELLS] - left, y[start : start + _CHUNK_CELLS] - below
                touched[i[:, None, None] + axis[:, None], j[:, None, None] + axis] = True
            on_farm = touched[max(-left, 0) : shape[0] - left, max(-below, 0) : shape[1] - below]
            columns, rows = np.nonzero(on_farm)
            return columns + max(left, 0), rows + max(below, 0)
    found = []
    for start in range(0, len(x), _CHUNK_CELLS):
        i = (x[start : start + _CHUNK_CELLS, None, None] + axis[:, None]) + 0 * axis
        j = (y[start : start + _CHUNK_CELLS, None, None] + axis) + 0 * axis[:, None]
        inside = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
        found.append(np.unique(i[inside] * shape[1] + j[inside]))
    flat = np.unique(np.concatenate(found)) if found else np.empty(0, np.intp)
    columns, rows = np.divmod(flat, shape[1])
    return columns.astype(np.intp), rows.astype(np.intp)
