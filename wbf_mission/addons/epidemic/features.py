"""Features of cells for the networks: counts of observed plants of each class at each distance.

A map of codes has the observed class of each cell. The features of a cell are the counts of each code in
each ring of distances around the cell, without the cell itself. The counts are invariant under rotation and
reflection, and depend only on cells at most `REACH` away along each axis. A few features of the whole field
are appended.

The classes of unobserved cells depend on each other: an outbreak is connected, and a farm has a known number
of outbreaks. Refinement networks therefore also see the previous network's probabilities of all cells
(auto-context; Tu & Bai 2010, "Auto-context and its application to high-level vision tasks and 3D brain image
segmentation").

Sums over rings are compiled. Cells are in C order. Runs of neighbouring cells along y share work, so that the
features of all cells of a crop take little more time than the features of a few rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.linear_algebra import log

REACH = 8
"""Greatest distance of a ring's cells along each axis, in cells."""

Cells = NDArray[np.intp]
Floats32 = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """Rings of neighbours around a cell."""

    # intp[REACH + 1, REACH + 1]: a neighbour's ring by its distances along x and y; -1 for the cell itself.
    number: Cells
    # float32[rings]: factor of the sums over each ring, the inverse square root of its size, which gives all
    # features similar variances.
    scales: Floats32

    @classmethod
    def that_end_at(cls, ends: tuple[int, ...]) -> Rings:
        """Return rings that end at these squared distances; the last must be at least ``2 REACH^2``.

        >>> rings = Rings.that_end_at((1, 2, 128))
        >>> rings.number[:2, :3].tolist(), (rings.scales**-2).round().tolist()
        ([[-1, 0, 2], [0, 1, 2]], [4.0, 4.0, 280.0])
        """
        axis = np.arange(REACH + 1)
        squares = axis[:, None] ** 2 + axis**2
        number = np.searchsorted(ends, squares)
        number[0, 0] = -1
        # A pair of distances along x and y also stands for its mirror images.
        images = np.where(axis > 0, 2, 1)
        sizes = np.bincount(number[squares > 0], (images[:, None] * images)[squares > 0], len(ends))
        return cls(number.astype(np.intp), (1.0 / np.sqrt(sizes)).astype(np.float32))

    def sums(self, planes: Floats32, x: Cells, y: Cells) -> Floats32:
        """Return the scaled sum of each map over each ring, float32[maps * rings, n].

        `planes` have a margin of `REACH` cells. The rings of the first map are first.
        """
        out = np.zeros((len(planes), len(self.scales), len(x)), np.float32)
        _sum(planes, x, y, self.number, out)
        out *= self.scales[:, None]
        return out.reshape(len(out) * len(self.scales), len(x))


@compiled(nogil=True)
def _run_end(x: Cells, y: Cells, start: int) -> int:
    """Return the end index of the run of neighbouring cells along y that begins at index `start`."""
    end = start + 1
    while end < len(x) and x[end] == x[start] and y[end] == y[end - 1] + 1:
        end += 1
    return end


@compiled(nogil=True)
def _add(both: Floats32, number: Cells, out: Floats32) -> None:
    """Add the sum of two columns, at the same distance along x, to the rings of a run of cells.

    `both` is the sum of the two columns, from `REACH` cells before the run to `REACH` cells after the run.
    """
    count = out.shape[1]
    for away in range(REACH + 1):
        ring = number[away]
        if ring < 0:
            continue
        target = out[ring]
        below, above = both[REACH - away :], both[REACH + away :]
        if away == 0:
            for j in range(count):
                target[j] += below[j]
        else:
            for j in range(count):
                target[j] += below[j] + above[j]


@compiled(nogil=True)
def _sum(planes: Floats32, x: Cells, y: Cells, number: Cells, out: Floats32) -> None:
    both = np.empty(planes.shape[2], np.float32)
    start = 0
    while start < len(x):
        end = _run_end(x, y, start)
        length = end - start + 2 * REACH
        for plane in range(len(planes)):
            for away in range(REACH + 1):
                left = planes[plane, x[start] + REACH - away, y[start] :]
                right = planes[plane, x[start] + REACH + away, y[start] :]
                for j in range(length):
                    both[j] = left[j] if away == 0 else left[j] + right[j]
                _add(both, number[away], out[plane, :, start:end])
        start = end


UNKNOWN, SEEN_SUSCEPTIBLE, SEEN_INFECTED, SEEN_REMOVED, NO_HOST_CODE = range(5)
"""Codes of cells: unobserved, the three observed classes, and land without the crop or outside the farm."""

RINGS = Rings.that_end_at((1, 2, 4, 5, 8, 9, 10, 13, 18, 20, 26, 36, 50, 65, 90, 2 * REACH**2))
_SEEN_NUMBERS = 3
_DAY_KNOTS = (0.0, 2.0, 4.0, 6.0, 7.0)
N_OVERALL = _SEEN_NUMBERS + len(_DAY_KNOTS)
_CHUNK_CELLS = 1 << 14
_CLUSTER_LINK = 5

N_LOCAL = len(RINGS.scales) * NO_HOST_CODE
N_FEATURES = N_LOCAL + N_OVERALL


def padded_codes(hosts: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a map of codes without observations, uint8[W + 2 REACH, H + 2 REACH].

    The map has a margin of `REACH` cells.
    """
    codes = np.full((hosts.shape[0] + 2 * REACH, hosts.shape[1] + 2 * REACH), NO_HOST_CODE, np.uint8)
    codes[REACH:-REACH, REACH:-REACH][hosts] = UNKNOWN
    return codes


def inner(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a view of a padded map without its margin, [W, H]."""
    return codes[REACH:-REACH, REACH:-REACH]


def local_features(codes: NDArray[np.uint8], x: Cells, y: Cells) -> Floats32:
    """Return the scaled counts of each code 1..4 in each ring of some cells, float32[n, N_LOCAL]."""
    if not len(x):
        return np.empty((0, N_LOCAL), np.float32)
    # The sums read only cells within `REACH`.
    left, low = int(x.min()), int(y.min())
    near = codes[left : int(x.max()) + 2 * REACH + 1, low : int(y.max()) + 2 * REACH + 1]
    planes = np.stack([near == code for code in range(1, NO_HOST_CODE + 1)]).astype(np.float32)
    return RINGS.sums(planes, x - left, y - low).T


def overall_features(codes: NDArray[np.uint8], hosts: int, seeds: int, day: int) -> NDArray[np.float32]:
    """Return the features of the whole field, float32[8].

    The features are: observed fraction, ratio of observed to expected outbreaks, fraction observed as sick,
    and the day as interpolation weights of five knots. `day` counts from the network's first day. Sick cells
    at most five cells apart along each axis count as one outbreak.
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


def cells_in_reach(
    x: NDArray[np.intp], y: NDArray[np.intp], shape: tuple[int, int]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return all cells of a farm that are at most `REACH` along each axis from a changed cell (x, y).

    >>> x, y = cells_in_reach(np.array([0]), np.array([20]), (30, 30))
    >>> len(x), int(x.max()), int(y.min())
    (153, 8, 12)
    """
    if not len(x):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    # The cells are marked in their bounding box, so that no sorting is needed.
    left, low = int(x.min()) - REACH, int(y.min()) - REACH
    touched = np.zeros((int(x.max()) + REACH + 1 - left, int(y.max()) + REACH + 1 - low), np.bool_)
    axis = np.arange(-REACH, REACH + 1)
    for start in range(0, len(x), _CHUNK_CELLS):
        part = slice(start, start + _CHUNK_CELLS)
        i, j = x[part] - left, y[part] - low
        touched[i[:, None, None] + axis[:, None], j[:, None, None] + axis] = True
    on_farm = touched[max(-left, 0) : shape[0] - left, max(-low, 0) : shape[1] - low]
    columns, rows = np.nonzero(on_farm)
    return columns + max(left, 0), rows + max(low, 0)


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
    """Return the context features of some cells, float32[n, N_CONTEXT].

    The features are: expected numbers of infected and of lost plants in each ring around the cell; the
    logarithms of the cell's own probabilities of these two classes; and, for the whole field, the expected
    infected fraction, and the expected and the observed number of lost plants per seed of the disease.

    `x` and `y` list all host cells. `rows` selects the host cells of the result.
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
    own[:, :2] = _LOG_SCALE * log(probabilities[:, 1:] + np.float32(_LEAST))
    own[:, 2] = totals[0] / max(len(unknown), 1)
    own[:, 3] = totals[1] / max(seeds, 1)
    own[:, 4] = np.count_nonzero(codes == SEEN_REMOVED) / max(seeds, 1)
    return out
