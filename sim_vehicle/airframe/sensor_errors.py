"""Errors of a vehicle's believed position: those of satellite positions and of the barometer.

A receiver's error along an axis is a first-order Gauss-Markov process, from the atmosphere and the orbits,
and white noise, from the receiver; so has it Rankin (*An error model for sensor simulation: GPS and
differential GPS*, IEEE PLANS 1994), whose numbers Beard and McLain (*Small Unmanned Aircraft*, 2012,
section 7.5) use: standard deviations of 4.7 m and 0.4 m along a horizontal axis and of 9.2 m and 0.7 m
upwards, a time constant of 1100 s, dilutions of precision of 1.3 and 1.8. `SensorNoise` keeps their
proportions and the time constant, and takes the size.

A barometer's error has the same parts (Sabatini and Genovese, *Sensors* 13(11), 2013), and the autopilot
counts heights from what it read when it was switched on. The estimate follows the sensors with a time
constant of two seconds, and the autopilot flies by it: what it believes is what was planned, and the truth is
beside it by the error. Decision 0011 says why.

Everything is drawn on a fixed grid of 0.1 s from streams of its own, so it does not depend on how the flight
was stepped, nor one sensor on the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import exp, expm1
from geo.seeds import child_seed, stream
from sim_vehicle.airframe.estimate_errors import EstimateErrors
from sim_vehicle.airframe.power_spec import within

__all__ = ["NavigationErrors", "Sensed", "SensorErrors", "SensorNoise"]

GRID_S = 0.1
BLOCK = 1024
_KEPT = 4

TIME_CONSTANT_S = 1100.0
"""Of a receiver's slow error."""
VERTICAL = 9.2 / 4.7
"""Slow vertical error over the one along a horizontal axis."""
WHITE, WHITE_UP = 0.4 / 4.7, 0.7 / 9.2
"""White noise over the slow error of the axis."""
HDOP, VDOP = 1.3, 1.8
BAROMETER_TIME_CONSTANT_S = 600.0
BAROMETER_WHITE = 0.2
FILTER_S = 2.0
"""Time constant with which the estimate follows the sensors."""
GROUND_M = 5.0
"""Below this height the vertical error fades out of the motion: the ground ends a descent, not a number."""


class SensorErrors(NamedTuple):
    """Errors at one time, estimate less truth; metres."""

    # Of the autopilot's estimate; the height is that above the start.
    east_m: float
    north_m: float
    up_m: float
    # Of the receiver.
    gps_east_m: float
    gps_north_m: float
    gps_up_m: float
    barometer_m: float
    """Of the barometer's height."""


class Sensed(NamedTuple):
    """Where a vehicle is, in truth and by its sensors: east, north, up about home."""

    believed_m: tuple[float, float, float]
    true_m: tuple[float, float, float]
    gps_m: tuple[float, float, float]
    barometer_m: float
    """Height by the barometer."""
    drift_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Velocity of the truth less the believed one."""

    @classmethod
    def exact(cls, place_m: tuple[float, float, float]) -> Sensed:
        """Return the readings of sensors without errors."""
        return cls(place_m, place_m, place_m, place_m[2])


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """How wrong a vehicle's sensors are; VehicleError if a number is out of range.

    Examples
    --------
    >>> SensorNoise(1.5).horizontal_accuracy_m, SensorNoise().is_off
    (2.121320343559643, True)
    """

    gps_m: float = 0.0
    """Standard deviation of the slow error of the satellite position along each horizontal axis; 0 is an
    exact receiver. Without corrections 1 to 2 m, with SBAS 0.5 m, RTK 0.01 m."""
    barometer_m: float = 0.0
    """Standard deviation of the barometer's slow error; 0 is an exact barometer."""
    seed: np.random.SeedSequence | int = 0
    estimate_errors: bool = False
    """Whether the height and velocities that PX4 estimates are wrong as recorded
    (`sim_vehicle.airframe.estimate_errors`)."""

    def __post_init__(self) -> None:
        within("sensor noise", self, ("gps_m", 0.0, 100.0), ("barometer_m", 0.0, 20.0))

    @property
    def is_off(self) -> bool:
        """Whether receiver and barometer are exact."""
        return self.gps_m == 0.0 and self.barometer_m == 0.0

    @property
    def of_estimate(self) -> EstimateErrors | None:
        """The errors of the autopilot's own estimate; None for an exact one."""
        return EstimateErrors(child_seed(self.seed, "estimate")) if self.estimate_errors else None

    @property
    def horizontal_accuracy_m(self) -> float:
        """Standard deviation of the receiver's horizontal error, of both axes together."""
        return math.sqrt(2.0) * self.gps_m

    @property
    def vertical_accuracy_m(self) -> float:
        """Standard deviation of the receiver's vertical error."""
        return VERTICAL * self.gps_m

    def of_vehicle(self, system_id: int) -> SensorNoise:
        """Return the noise of one of several vehicles; that of the first is this one."""
        if system_id == 1:
            return self
        return replace(self, seed=child_seed(self.seed, f"vehicle-{system_id}"))


class NavigationErrors:
    """The errors of one vehicle's sensors over time.

    Examples
    --------
    >>> errors = NavigationErrors(SensorNoise(2.0, seed=1))
    >>> errors.at(10.0) == NavigationErrors(SensorNoise(2.0, seed=1)).at(10.0)
    True
    >>> errors.at(10.0).up_m
    0.0
    """

    def __init__(self, noise: SensorNoise) -> None:
        self.noise = noise
        sizes = np.array([noise.gps_m, noise.gps_m, VERTICAL * noise.gps_m, noise.barometer_m])
        times = np.array([TIME_CONSTANT_S] * 3 + [BAROMETER_TIME_CONSTANT_S])
        self._decay = exp(-GRID_S / times)
        self._drive = sizes * np.sqrt(-expm1(-2.0 * GRID_S / times))
        self._white = sizes * np.array([WHITE, WHITE, WHITE_UP, BAROMETER_WHITE])
        self._random = (stream(noise.seed, "gps"), stream(noise.seed, "barometer"))
        self._slow = sizes * self._normal(1)[0, :4]
        self._filtered = self._slow.copy()
        self._zero_m = float(self._slow[3])
        self._blocks: dict[int, NDArray[np.float64]] = {}
        self._drawn = 0

    def at(self, time_s: float) -> SensorErrors:
        """Return the errors at a time since the start, at most some minutes before the latest asked for."""
        row = self._row(max(0.0, time_s) / GRID_S)
        east, north, _, height, gps_east, gps_north, gps_up, barometer = row
        return SensorErrors(
            east, north, height - self._zero_m, gps_east, gps_north, gps_up, barometer - self._zero_m
        )

    def sense(self, position_m: tuple[float, float, float], time_s: float) -> Sensed:
        """Return the readings of a vehicle whose motion, flown by the estimate, is at a position."""
        x, y, z = position_m
        now = self.at(time_s)
        before = self.at(time_s - GRID_S) if time_s >= GRID_S else now
        # Where the vehicle is aloft it holds the height that it believes; down to the ground that fades.
        aloft = min(1.0, max(0.0, z) / max(GROUND_M, 2.0 * abs(now.up_m)))
        true = (x - now.east_m, y - now.north_m, z - aloft * now.up_m)
        return Sensed(
            (x, y, true[2] + now.up_m),
            true,
            (true[0] + now.gps_east_m, true[1] + now.gps_north_m, true[2] + now.gps_up_m),
            true[2] + now.barometer_m,
            (
                (before.east_m - now.east_m) / GRID_S,
                (before.north_m - now.north_m) / GRID_S,
                aloft * (before.up_m - now.up_m) / GRID_S,
            ),
        )

    def _row(self, place: float) -> list[float]:
        """Return the row at a position of the grid, in between that of the straight line."""
        index = int(place)
        part = place - index
        first: list[float] = self._at_index(index).tolist()
        if part < 1e-9:
            return first
        second: list[float] = self._at_index(index + 1).tolist()
        return [a + part * (b - a) for a, b in zip(first, second, strict=True)]

    def _at_index(self, index: int) -> NDArray[np.float64]:
        number = index // BLOCK
        while number >= self._drawn:
            self._blocks[self._drawn] = self._draw()
            self._blocks.pop(self._drawn - _KEPT, None)
            self._drawn += 1
        block = self._blocks.get(number)
        if block is None:
            block, index = self._blocks[self._drawn - _KEPT], 0
        row: NDArray[np.float64] = block[index % BLOCK]
        return row

    def _normal(self, count: int) -> NDArray[np.float64]:
        """Return standard normal numbers: of the slow errors, then white ones, each (gps 3, barometer)."""
        gps, barometer = (
            random.standard_normal((count, 2, n)) for random, n in zip(self._random, (3, 1), strict=True)
        )
        return np.concatenate((gps, barometer), axis=2).reshape(count, 8)

    def _draw(self) -> NDArray[np.float64]:
        """Return the next block: the estimate's errors (gps 3, barometer), then the sensors'."""
        noise = self._normal(BLOCK)
        block = np.empty((BLOCK, 8))
        keep = math.exp(-GRID_S / FILTER_S)
        for k in range(4):
            slow = _follow(self._drive[k] * noise[:, k], float(self._decay[k]), float(self._slow[k]))
            read = slow + self._white[k] * noise[:, 4 + k]
            followed = _follow((1.0 - keep) * read, keep, float(self._filtered[k]))
            block[:, k], block[:, 4 + k] = followed, read
            self._slow[k], self._filtered[k] = slow[-1], followed[-1]
        return block


def _follow(noise: NDArray[np.float64], decay: float, last: float) -> NDArray[np.float64]:
    """Return the first-order recursion ``y[i] = decay y[i-1] + noise[i]``."""
    values = []
    for value in noise.tolist():
        last = decay * last + value
        values.append(last)
    return np.array(values)
