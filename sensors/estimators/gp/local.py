"""Posteriors of a Gaussian process for farms of any size.

`LocalPosterior` is for lengthscales that are short compared with the farm. This class solves tiles of about
eight lengthscales separately, each with the observations in the tile and up to seven lengthscales around it.
`WholePosterior` is for long lengthscales. This class approximates the process by sine functions over the
whole farm, and observations add to the sums of a regression. Both classes use all observations: merging
repeated observations of a cell is exact. The parameter `weights` reduces the influence of observations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import cholesky, exp, product, solve_lower
from geo.linear_algebra_kernels import add_product
from geo.system import in_parallel
from sensors.estimators.days import pass_day
from sensors.estimators.gp import tile as gp_tile
from sensors.estimators.gp.held_tile import HeldTile
from sensors.estimators.gp.lattice import Mask, NodeLattice
from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel

TILE_LENGTHS = 8.0
REACH_LENGTHS = 7.0
FAR_REACH_LENGTHS = 10.0
LITTLE_NOISE = 0.1
"""If the ratio of noise to amplitude is less, observations act farther away, through other observations."""
LEAST_NOISE = 0.003
"""If the ratio of noise to amplitude is less, tiles do not approximate the posterior accurately."""
TOUCH_LENGTHS = 5.0
_LEAST_TILE_CELLS = 16
_OUTSIDE_LENGTHS = 2.5
_LEAST_INFORMATION = 1e-3
_BATCH = 4096
_BATCHES = 16
_ROWS_AT_ONCE = 64
_MOST_HELD = 48  # About 5 MB each

_Sums = NDArray[np.floating]


class Spectrum:
    """Sine functions on a box, with their prior variances (Solin & Särkkä 2020, eq. 21 and 56).

    A function is left out if observations of the given density reduce the function's variance by less than a
    thousandth.

    `density` is the greatest number of observations per cell. `roots` are the square roots of the functions'
    variances along each axis. `terms`, int64[n, 2], has the pairs of indices of the products that are used.
    """

    def __init__(self, kernel: RbfKernel, sides: tuple[float, float], density: float = 1.0) -> None:
        self.sides = sides
        lengths = kernel.length_x, kernel.length_y
        highest = self._highest(kernel, density)
        angles = []
        for length, side in zip(lengths, sides, strict=True):
            frequency = math.pi / side * length
            angles.append(frequency * np.arange(1, max(1, int(highest / frequency)) + 1))
        squares = angles[0][:, None] ** 2 + angles[1][None, :] ** 2
        self.terms = np.ascontiguousarray(np.argwhere(squares <= highest**2), np.int64)
        if not len(self.terms):
            self.terms = np.zeros((1, 2), np.int64)
        root = (2.0 * math.pi) ** 0.25
        x, y = (
            root * math.sqrt(length) * exp(-0.25 * angle**2)
            for length, angle in zip(lengths, angles, strict=True)
        )
        self.roots: tuple[Floats, Floats] = (x * math.sqrt(kernel.amplitude), y)

    @staticmethod
    def _highest(kernel: RbfKernel, density: float) -> float:
        """Return the highest frequency of a function in use, in units of the inverse lengthscale."""
        scale = 2.0 * math.pi * kernel.length_x * kernel.length_y * kernel.amplitude
        least = min(0.1, _LEAST_INFORMATION * kernel.noise / (scale * density))
        return math.sqrt(-2.0 * math.log(least))

    @classmethod
    def fewest_functions(cls, kernel: RbfKernel, sides: tuple[float, float], density: float = 1.0) -> float:
        """Return a lower bound of the number of functions without computing the functions."""
        highest = cls._highest(kernel, density)
        along_x, along_y = (
            highest * side / (math.pi * length)
            for side, length in zip(sides, (kernel.length_x, kernel.length_y), strict=True)
        )
        # A quarter ellipse has at least as many lattice points as its area less the lengths of its half-axes.
        return 0.25 * math.pi * along_x * along_y - along_x - along_y


class LocalPosterior:
    """Posterior that is solved tile by tile, for lengthscales that are short compared with the farm.

    `hosts`, if given, returns the part of a mask of cells at given indices. Tiles on which no masked cell
    depends keep the prior.
    """

    def __init__(
        self, shape: tuple[int, int], kernel: RbfKernel, hosts: Callable[[Any], Mask] | None = None
    ) -> None:
        self.kernel = kernel
        lengths = kernel.length_x, kernel.length_y
        tile = [max(TILE_LENGTHS * length, float(_LEAST_TILE_CELLS)) for length in lengths]
        self.lattice = NodeLattice(shape, kernel, (tile[0], tile[1]))
        x, y = self.lattice.x, self.lattice.y
        little = kernel.noise < LITTLE_NOISE * kernel.amplitude
        reach_lengths = FAR_REACH_LENGTHS if little else REACH_LENGTHS
        self._reach = tuple(math.ceil(reach_lengths * length) for length in lengths)
        self._touch = tuple(math.ceil(TOUCH_LENGTHS * length) for length in lengths)
        sides = [
            float(np.diff(axis.edges).max() * axis.step + 2 * reach + 2 * length)
            for axis, reach, length in zip((x, y), self._reach, lengths, strict=True)
        ]
        spectrum = Spectrum(kernel, (sides[0], sides[1]))
        self._functions = spectrum.roots, spectrum.terms
        firsts_and_steps = x.first, y.first, x.step, y.step
        self._geometry = x.edges, y.edges, firsts_and_steps, shape, self._reach, spectrum.sides
        # Observed cells as x * H + y, ascending, and the sums of each cell's weights, weighted values, and
        # observations since the last solution.
        self._cells = np.empty(0, np.int64)
        self._sums = np.empty((0, 3))
        self._waiting = np.zeros((x.tiles, y.tiles), np.bool_)
        self._solved = self._waiting.copy()
        self._held: dict[tuple[int, int], HeldTile] = {}  # In the order of their last use
        self._wanted = ~self._waiting if hosts is None else self.lattice.tiles_of(hosts)

    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Add observations with weights, or remove observations, if all weights are negative."""
        parts = np.ones(len(values)) if weights is None else weights
        cells = x.astype(np.int64) * self.lattice.shape[1] + y
        further = np.unique(cells)
        where = np.searchsorted(self._cells, further)
        is_new = np.append(self._cells, -1)[where] != further
        # Few cells are new, so inserting them is much faster than sorting all cells again.
        self._cells = np.insert(self._cells, where[is_new], further[is_new])
        self._sums = np.insert(self._sums, where[is_new], 0.0, axis=0)
        weighted = np.column_stack([parts, parts * values, np.ones(len(values))])
        np.add.at(self._sums, np.searchsorted(self._cells, cells), weighted)
        spans = [
            part
            for axis, cells, reach in zip((self.lattice.x, self.lattice.y), (x, y), self._reach, strict=True)
            for part in axis.reached(cells, reach)
        ]
        for i0, i1, j0, j1 in np.unique(np.stack(spans, axis=1), axis=0).tolist():
            reached = slice(i0, i1 + 1), slice(j0, j1 + 1)
            self._waiting[reached] = self._wanted[reached]
        sign = -1.0 if (parts < 0.0).any() else 1.0
        self._add_to_held(np.column_stack([x, y, sign * parts, values]), sign)

    def _add_to_held(self, seen: Floats, sign: float) -> None:
        """Add observations to the held tiles that they reach, which then need not be solved again."""
        added = np.zeros_like(self._waiting)

        def work(tiles: Sequence[tuple[int, int]]) -> None:
            for tile in tiles:
                added[tile] = self._held[tile].add(seen, sign, self.lattice.posterior)

        reached = [tile for tile in self._held if self._waiting[tile]]
        in_parallel(work, reached)
        for tile in reached:
            used = self._held.pop(tile)
            if added[tile]:
                self._held[tile] = used
        self.lattice.changed(added)
        self._waiting &= ~added

    def solve(self) -> None:
        """Solve the tiles that are within reach of new observations."""
        kernel = self.kernel
        parameters = kernel.length_x, kernel.length_y, kernel.noise, kernel.amplitude
        tiles = np.ascontiguousarray(np.argwhere(self._waiting))  # Functions are compiled for one layout
        places = self.lattice.places_of(tiles)
        posterior = self.lattice.posterior

        def work(numbers: Sequence[int]) -> None:
            part = slice(numbers[0], numbers[-1] + 1)
            gp_tile.solve_tiles(
                tiles[part], places[part], self._geometry, self._cells, self._sums, self._touch,
                parameters, *self._functions, posterior,
            )  # fmt: skip

        in_parallel(work, range(len(tiles)))
        again = self._solved[self._waiting]
        self._hold(tiles[again], places[again])
        self._solved |= self._waiting
        self.lattice.changed(self._waiting)
        self._waiting[:] = False
        self._sums[:, 2] = 0.0

    def _hold(self, tiles: NDArray[np.int64], places: NDArray[np.int64]) -> None:
        """Hold those of the solved tiles that have more observed cells than functions."""
        made: dict[int, HeldTile] = {}

        def work(numbers: Sequence[int]) -> None:
            for number in numbers:
                frame = gp_tile.frame_of(tiles[number], self._geometry)
                seen = gp_tile.gather(self._cells, self._sums, self.lattice.shape[1], frame[1])
                if len(seen) > len(self._functions[1]):
                    at = frame, places[number], self.lattice
                    made[number] = HeldTile(seen, *at, self.kernel.noise, self._functions)

        in_parallel(work, range(len(tiles)))
        for number in sorted(made):
            self._held[tuple(tiles[number].tolist())] = made[number]
        for tile in list(self._held)[:-_MOST_HELD]:
            del self._held[tile]


class WholePosterior:
    """Posterior in sine functions over the whole farm, for long lengthscales."""

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel, spectrum: Spectrum) -> None:
        self.kernel = kernel
        self.lattice = NodeLattice(shape, kernel, (float(shape[0]), float(shape[1])))
        self._spectrum = spectrum
        self._middle = tuple(0.5 * (side - 1) for side in shape)
        functions = len(spectrum.terms)
        self._precision = np.eye(functions)  # The lower triangle is not used
        self._response = np.zeros((functions, 2))
        self._waiting = False

    @staticmethod
    def spectrum_of_farm(
        shape: tuple[int, int], kernel: RbfKernel, observations: int, most_functions: float = math.inf
    ) -> Spectrum | None:
        """Return the functions for a farm and its observations; None if over `most_functions` are needed."""
        sides = [
            side + 2.0 * _OUTSIDE_LENGTHS * length
            for side, length in zip(shape, (kernel.length_x, kernel.length_y), strict=True)
        ]
        density = min(1.0, observations / (shape[0] * shape[1]))
        if Spectrum.fewest_functions(kernel, (sides[0], sides[1]), density) > most_functions:
            return None
        spectrum = Spectrum(kernel, (sides[0], sides[1]), density)
        return spectrum if len(spectrum.terms) <= most_functions else None

    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Add observations with weights; negative weights remove observations."""
        for start in range(0, len(x), _BATCH * _BATCHES):
            found: dict[int, tuple[_Sums, _Sums]] = {}

            def work(begins: Sequence[int], found: dict[int, tuple[_Sums, _Sums]] = found) -> None:
                for begin in begins:
                    part = slice(begin, begin + _BATCH)
                    functions = self._functions(x[part], y[part])
                    data = np.stack([values[part], np.ones(len(functions))])
                    counted = functions if weights is None else weights[part, None] * functions
                    found[begin] = _upper_product(counted.T, functions), product(data, counted).T

            in_parallel(work, range(start, min(start + _BATCH * _BATCHES, len(x)), _BATCH))
            # The sums are added in a fixed order, so that the result does not depend on the number of cores.
            for begin in sorted(found):
                self._precision += found[begin][0] / self.kernel.noise
                self._response += found[begin][1] / self.kernel.noise
        self._waiting = self._waiting or len(x) > 0

    def pass_day(self, correlation: float) -> None:
        """Advance to a later day; `correlation` (0..1) is the field's correlation between the two days."""
        self._precision, self._response = pass_day(self._precision, self._response, correlation)
        self._waiting = True

    def solve(self) -> None:
        """Bring the posterior at the nodes up to date."""
        if not self._waiting:
            return
        self._waiting = False
        factor = cholesky(self._precision)
        weights = solve_lower(factor, self._response.copy())
        along_x, along_y = (
            self._sines(axis.places, k) for k, axis in enumerate((self.lattice.x, self.lattice.y))
        )
        self.lattice.places_of(np.zeros((1, 2), np.int64))
        posterior = self.lattice.posterior[0]

        def work(columns: Sequence[int]) -> None:
            part = slice(columns[0], columns[-1] + 1)
            terms = self._spectrum.terms
            gp_tile.fill_nodes(factor, weights, along_x[:, part].copy(), along_y, terms, posterior[:, part])

        in_parallel(work, range(len(along_x[0])))
        posterior[2] = self.kernel.amplitude - posterior[2]
        self.lattice.changed(np.ones((1, 1), np.bool_))

    def _sines(self, places: Floats, k: int) -> NDArray[np.floating]:
        half = 0.5 * self._spectrum.sides[k]
        middle = self._middle[k]
        box = middle - half, middle + half
        return gp_tile.sines(places, *box, self._spectrum.roots[k])

    def _functions(self, x: Cells, y: Cells) -> NDArray[np.floating]:
        """Return the values of the m functions at n cells, float64[n, m]."""
        a, b = self._sines(x.astype(np.float64), 0), self._sines(y.astype(np.float64), 1)
        first, second = self._spectrum.terms.T
        functions = np.empty((len(x), len(first)))
        for begin in range(0, len(x), _ROWS_AT_ONCE):
            part = slice(begin, begin + _ROWS_AT_ONCE)  # Whole factors would take twice the product's memory
            np.multiply(a.T[part][:, first], b.T[part][:, second], out=functions[part])
        return functions


def _upper_product(a: _Sums, b: _Sums) -> _Sums:
    """Return a product of matrices, float64[n, n], but leave the blocks below the diagonal zero."""
    found = np.zeros((len(a), len(a)))
    for first in range(0, len(a), _ROWS_AT_ONCE):
        left = np.ascontiguousarray(a[first : first + _ROWS_AT_ONCE])
        rows = found[first : first + len(left)]
        add_product(1.0, left, b, rows, 0, len(left), 0, len(b), first, len(a))
    return found
