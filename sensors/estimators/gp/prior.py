"""Priors of the Gaussian process: means and kernels, learned from simulated environments.

The simulations have separate seeds. They give the mean, and the covariance of cells at each distance. Let S
be this covariance for a set of cells, and K the kernel's covariance for these cells. The fitted kernel
minimises ``log det K + trace(K^-1 S)``, which is the Kullback-Leibler divergence up to a constant factor and
term. Simulations also give the link from means to a disease's classes (`sensors.estimators.gp.classes`).
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.atomic import atomic_write
from geo.grid import FarmGrid
from geo.linear_algebra import exp, inverse_of_factor, log, product
from geo.seeds import stream
from geo.system import warn_of_cache
from sensors.dynamics.continuous import ContinuousDynamics, Measured
from sensors.dynamics.epidemic import MAX_DAYS, EpidemicParameters, simulate_outbreak, value_table
from sensors.errors import EstimatorError
from sensors.estimators.base import Step, no_step
from sensors.estimators.gp.classes import ClassLink, link_slope, window_of
from sensors.estimators.gp.rbf import (
    SINGULAR_COST,
    Floats,
    RbfKernel,
    factor_covariance,
    kernel_gradient,
    least_in_box,
)
from sensors.fields import Field, FieldSet

VERSION = 3
"""Version, part of the digests that name files; raise it with every change of the learned priors."""
_WINDOW = 1000
_SIMULATED_CELLS = 8_000_000
_MOST_SIMULATIONS = 400
_FEWEST_SIMULATIONS = 8
_LAGS = 14
_LINK_SIMULATIONS = 60
_PIECE_CELLS = 64
_WHOLE_CELLS = 128 * 128
_SOIL_SIMULATIONS = 128
_SOIL_CELLS = 48
_SOIL_LATTICE = 14
_LEAST_VARIANCE = 1e-7
_LENGTH_BOUNDS = (0.5, 64.0)

_in_memory: dict[str, tuple[FieldPrior, ...]] = {}


@dataclass(frozen=True, slots=True)
class FieldPrior:
    """The prior of a field: mean, kernel and, for a disease with sick plants, the link to classes."""

    mean: float
    kernel: RbfKernel
    link: ClassLink | None = None


def learn_priors(
    grid: FarmGrid, fields: FieldSet, day: int, seed: int, folder: Path, step: Step = no_step
) -> tuple[FieldPrior, ...]:
    """Return the priors of all fields on a day, from memory or a file in the folder, or learn them.

    A file that cannot be used is replaced. If the folder cannot be written, every process repeats the
    simulations, which take one or two seconds.
    """
    if not 0 <= day <= MAX_DAYS:
        raise EstimatorError(f"gp: day {day} is not in 0..{MAX_DAYS}, the days of an environment")
    contents = {
        "version": VERSION,
        "fields": [
            (field.name, field.dynamics.kind, field.crops, asdict(field.dynamics)) for field in fields
        ],
        "shape": grid.shape,
        "day": day,
        "seed": seed,
        **({} if all(field.is_simulated for field in fields) else {"cell_size_m": grid.cell_size_m}),
    }
    digest = hashlib.sha256(json.dumps(contents, sort_keys=True, default=str).encode())
    digest.update(grid.further_crops.encode())
    digest.update(np.ascontiguousarray(grid.crop).data)
    key = digest.hexdigest()[:32]
    if key not in _in_memory:
        path = folder / f"{key}.json"
        priors = _load(path, fields)
        if priors is None:
            learned = []
            for number, field in enumerate(fields):
                step(number / len(fields))
                learned.append(_learn(field, grid, day, seed))
            priors = tuple(learned)
            step(1.0)
            _save(priors, path, fields)
        _in_memory[key] = priors
    return _in_memory[key]


def _learn(field: Field, grid: FarmGrid, day: int, seed: int) -> FieldPrior:
    if isinstance(field.dynamics, Measured):
        return measured_prior(field.dynamics, field.default, grid.cell_size_m)
    if field.kind == "disease":
        return disease_prior(field.epidemic, field.hosts(grid), day, seed, field.name)
    return continuous_prior(field.continuous, grid.shape, day, seed, field.name)


def measured_prior(parameters: Measured, default: float, cell_size_m: float) -> FieldPrior:
    """Return the prior of a field that has no dynamic model, from the given parameters.

    >>> measured_prior(Measured(correlation_length_m=10.0, spread=0.5, noise=0.1), 0.5, 2.0).kernel
    RbfKernel(length_x=5.0, length_y=5.0, noise=0.010000000000000002, amplitude=0.25)
    """
    length = parameters.correlation_length_m / cell_size_m
    return FieldPrior(default, RbfKernel(length, length, parameters.noise**2, parameters.spread**2))


def disease_prior(
    parameters: EpidemicParameters, hosts: NDArray[np.bool_], day: int, seed: int, name: str
) -> FieldPrior:
    """Return the prior of a disease on its hosts.

    For a farm of more than a million cells, the simulated land is a window full of hosts, with as many seeds
    per host as the farm.
    """
    count = int(np.count_nonzero(hosts))
    if not count:
        return FieldPrior(1.0, RbfKernel(2.0, 2.0, _LEAST_VARIANCE, _LEAST_VARIANCE))
    seeds = parameters.seed_count(hosts.shape)
    land = hosts
    if hosts.size > _WINDOW**2:
        land = np.ones((_WINDOW, _WINDOW), np.bool_)
        seeds = max(1, round(seeds * land.size / count))
    parameters = parameters.on_window(hosts.shape, seeds)
    values = np.asarray(value_table(parameters, day), np.float64)
    number = min(_MOST_SIMULATIONS, max(_FEWEST_SIMULATIONS, _SIMULATED_CELLS // land.size))
    total, sick, products = 0.0, 0, np.zeros((_LAGS, _LAGS))
    inside = land.astype(np.float64)
    for i in range(number):
        onset = simulate_outbreak(land, parameters, day, stream(seed, "gp", name, str(i)))
        # Illness (1 minus the value) is 0 almost everywhere, so that the products are exact.
        illness = np.where(land, 1.0 - values[onset.view(np.uint8)], 0.0)
        total += float(illness.sum())
        sick += int(np.count_nonzero(illness))
        products += _lagged_products(illness, _LAGS)
    pairs = _lagged_products(inside, _LAGS) * number
    mean = total / (number * inside.sum())
    # No pairs of cells exist at lags beyond the field's size. Fourier transforms give counts up to rounding.
    width, height = (int(np.count_nonzero(along > 0.5)) for along in (pairs[:, 0], pairs[0]))
    covariance = products[:width, :height] / np.maximum(pairs[:width, :height], 1.0) - mean**2
    x, y = (part.ravel() for part in np.indices(covariance.shape))
    moments = covariance[np.abs(x[:, None] - x), np.abs(y[:, None] - y)]
    kernel = _nearest_kernel(x, y, moments, _LENGTH_BOUNDS)
    part = sick / (number * float(inside.sum()))
    if not 0.0 < part < 1.0:
        return FieldPrior(1.0 - mean, kernel)
    outbreaks = _outbreaks(land, parameters, values, day, seed, name)
    slope = link_slope(kernel, float(mean), part, outbreaks)
    return FieldPrior(1.0 - mean, kernel, ClassLink(float(mean), part, slope))


def _outbreaks(
    land: NDArray[np.bool_], parameters: EpidemicParameters, values: Floats, day: int, seed: int, name: str
) -> Iterator[tuple[Floats, NDArray[np.bool_], float, np.random.Generator]]:
    """Yield windows of simulated farms, from which `link_slope` learns.

    Each window is yielded with the probability of an outbreak. Outbreaks are rare in windows of a farm with
    more than 128 x 128 cells. For such farms, only windows with an outbreak are simulated; for smaller farms
    the probability is given as 1. The seeds of the disease are arrivals of a Poisson process.
    """
    whole = land.size <= _WHOLE_CELLS
    piece = land if whole else np.ones((_PIECE_CELLS, _PIECE_CELLS), np.bool_)
    assert parameters.seeds is not None
    expected = parameters.seeds * piece.size / np.count_nonzero(land)
    there = 1.0 if whole else -math.expm1(-expected)
    for number in range(_LINK_SIMULATIONS):
        rng = stream(seed, "gp", name, "link", str(number))
        drawn = parameters
        if not whole:
            # The seeds are the arrivals until time 1, given that the first arrival is before time 1.
            first = -math.log1p(-float(rng.random()) * there) / expected
            drawn = replace(parameters, seeds=1 + int(rng.poisson(expected * max(0.0, 1.0 - first))))
        onset = simulate_outbreak(piece, drawn, day, rng)
        window = window_of(piece, rng)
        ill = np.where(piece, 1.0 - values[onset.view(np.uint8)], 0.0)
        yield ill[window], piece[window], there, rng


def continuous_prior(
    parameters: ContinuousDynamics, shape: tuple[int, int], day: int, seed: int, name: str = "soil"
) -> FieldPrior:
    """Return the prior of a continuous field. A coarse grid suffices, as humps scale with the farm."""
    rngs = [stream(seed, "gp", name, str(number)) for number in range(_SOIL_SIMULATIONS)]
    fields = parameters.simulate_coarse(shape, (day,), _SOIL_CELLS, rngs)[0]
    coarse = fields.shape[1:]
    lattice = [np.unique(np.linspace(0, side - 1, _SOIL_LATTICE).round().astype(int)) for side in coarse]
    x, y = (part.ravel() for part in np.meshgrid(*lattice, indexing="ij"))
    mean = float(fields.mean())
    seen = fields[:, x, y] - mean
    kernel = _nearest_kernel(x, y, product(seen.T, seen) / len(seen), _LENGTH_BOUNDS)
    length_x, length_y = (
        length * side / cells
        for length, side, cells in zip((kernel.length_x, kernel.length_y), shape, coarse, strict=True)
    )
    return FieldPrior(mean, RbfKernel(length_x, length_y, kernel.noise, kernel.amplitude))


def _lagged_products(field: Floats, lags: int) -> Floats:
    """Return, for each lag (i, j), the sum of field[x, y] * field[x + i, y + j], float64[lags, lags]."""
    from scipy import fft

    shape = [fft.next_fast_len(side + lags, real=True) for side in field.shape]
    spectrum = fft.rfft2(field, shape)
    return fft.irfft2(spectrum.real**2 + spectrum.imag**2, shape)[:lags, :lags]


def _nearest_kernel(
    x: NDArray[np.integer], y: NDArray[np.integer], moments: Floats, length_bounds: tuple[float, float]
) -> RbfKernel:
    """Return the kernel that diverges least (see the module) from the given moments of cells at x, y."""
    variance = float(np.trace(moments)) / len(moments)
    if variance < 2 * _LEAST_VARIANCE:
        return RbfKernel(2.0, 2.0, _LEAST_VARIANCE, _LEAST_VARIANCE)
    dx2, dy2 = (np.subtract.outer(a, a).astype(np.float64) ** 2 for a in (x, y))
    part = (math.log(1e-4), math.log(2.0))
    length = (math.log(length_bounds[0]), math.log(length_bounds[1]))
    best, least = np.empty(4), np.inf
    for start in (1.5, 6.0):
        first = log([start, start, 0.2, 0.8])
        found = least_in_box(_divergence, first, (dx2, dy2, moments / variance), [length, length, part, part])
        if found.fun < least:
            best, least = found.x, found.fun
    length_x, length_y, noise, amplitude = exp(best).tolist()
    return RbfKernel(length_x, length_y, noise * variance, amplitude * variance)


def _divergence(theta: Floats, dx2: Floats, dy2: Floats, moments: Floats) -> tuple[float, Floats]:
    """Return ``(log det K + trace(K^-1 S)) / 2`` and its gradient ``trace((K^-1 - K^-1 S K^-1) dK) / 2``."""
    smooth, factor = factor_covariance(theta, dx2, dy2)
    if factor is None:
        return SINGULAR_COST, np.zeros(len(theta))
    inverse = inverse_of_factor(factor)
    explained = product(inverse, moments)
    cost = float(log(factor.diagonal()).sum() + 0.5 * np.trace(explained))
    inner = inverse - product(explained, inverse)
    return cost, 0.5 * kernel_gradient(theta, smooth, inner, dx2, dy2)


def _save(priors: tuple[FieldPrior, ...], path: Path, fields: FieldSet) -> None:
    contents = {name: asdict(prior) for name, prior in zip(fields.names, priors, strict=True)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as file:
            json.dump(contents, file, indent=1)
    except OSError as error:
        warn_of_cache(path.parent, error)


def _load(path: Path, fields: FieldSet) -> tuple[FieldPrior, ...] | None:
    """Return the priors in a file, or None if the file is missing or cannot be used."""
    try:
        contents = json.loads(path.read_text(encoding="utf-8"))
        priors = tuple(_prior_of(contents[name]) for name in fields.names)
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return priors if all(math.isfinite(prior.mean) for prior in priors) else None


def _prior_of(contents: dict[str, Any]) -> FieldPrior:
    link = None if contents["link"] is None else ClassLink(**contents["link"])
    if link is not None and not (0.0 < link.illness <= link.sick < 1.0 and 0.0 <= link.slope < math.inf):
        raise ValueError(f"{link} is not a link")
    return FieldPrior(float(contents["mean"]), RbfKernel(**contents["kernel"]), link)
