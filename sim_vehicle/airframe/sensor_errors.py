"""Errors of the satellite receiver, the barometer, and the position estimate that follows both.

The error of a receiver along an axis is the sum of a first-order Gauss-Markov process (atmosphere, orbits)
and white noise (receiver), as in Rankin, *An error model for sensor simulation: GPS and differential GPS*,
IEEE PLANS 1994. Beard and McLain (*Small Unmanned Aircraft*, 2012, section 7.5) use Rankin's numbers. The
process has a standard deviation of 4.7 m along a horizontal axis and 9.2 m upwards, and a time constant of
1100 s. The white noise has a deviation of 0.4 m horizontally and 0.7 m upwards. The dilutions of precision
are 1.3 (horizontal) and 1.8. `SensorNoise` sets the size of the errors; the ratios are fixed.

The error of a barometer has the same two parts (Sabatini and Genovese, *Sensors* 13(11), 2013). The autopilot
measures heights from the barometer's reading at power-up. The estimate follows the sensors with a time
constant of 2 s. The autopilot flies by the estimate: the estimated position follows the plan, and the true
position differs from it by the error (docs/decisions/0011).

Errors are drawn on a fixed grid of 0.1 s from one random stream per sensor. The errors of one sensor depend
neither on the time step of the simulation nor on the other sensor.
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
"""Time constant of the receiver's slow error."""
VERTICAL = 9.2 / 4.7
"""Ratio of the slow vertical error to the slow error along a horizontal axis."""
WHITE, WHITE_UP = 0.4 / 4.7, 0.7 / 9.2
"""Ratio of the white noise to the slow error, along a horizontal axis and upwards."""
HDOP, VDOP = 1.3, 1.8
BAROMETER_TIME_CONSTANT_S = 600.0
BAROMETER_WHITE = 0.2
FILTER_S = 2.0
"""Time constant with which the estimate follows the sensors."""
GROUND_M = 5.0
"""Height below which the vertical error fades out of the motion, because the ground stops a descent."""


class SensorErrors(NamedTuple):
    """Errors at one time: estimate or measurement minus truth (m)."""

    # Errors of the autopilot's estimate; `up_m` is the error of the height above the start.
    east_m: float
    north_m: float
    up_m: float
    # Errors of the satellite receiver.
    gps_east_m: float
    gps_north_m: float
    gps_up_m: float
    barometer_m: float
    """Error of the barometer's height."""


class Sensed(NamedTuple):
    """True and measured positions of a vehicle: east, north, up from home (m)."""

    believed_m: tuple[float, float, float]
    true_m: tuple[float, float, float]
    gps_m: tuple[float, float, float]
    barometer_m: float
    """Barometric height."""
    drift_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """True velocity minus estimated velocity."""

    @classmethod
    def exact(cls, place_m: tuple[float, float, float]) -> Sensed:
        """Return the readings of error-free sensors at a position."""
        return cls(place_m, place_m, place_m, place_m[2])


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Sizes of the sensor errors of a vehicle; raises VehicleError if a number is out of range.

    Examples
    --------
    >>> SensorNoise(1.5).horizontal_accuracy_m, SensorNoise().is_off
    (2.121320343559643, True)
    """

    gps_m: float = 0.0
    """Standard deviation of the receiver's slow error along each horizontal axis; 0 for an exact receiver.
    Typical values are 1 to 2 m without corrections, 0.5 m with SBAS, 0.01 m with RTK."""
    barometer_m: float = 0.0
    """Standard deviation of the barometer's slow error; 0 for an exact barometer."""
    seed: np.random.SeedSequence | int = 0
    estimate_errors: bool = False
    """Whether height and velocity have the errors of PX4's estimate
    (`sim_vehicle.airframe.estimate_errors`)."""

    def __post_init__(self) -> None:
        within("sensor noise", self, ("gps_m", 0.0, 100.0), ("barometer_m", 0.0, 20.0))

    @property
    def is_off(self) -> bool:
        """Whether receiver and barometer are exact."""
        return self.gps_m == 0.0 and self.barometer_m == 0.0

    @property
    def of_estimate(self) -> EstimateErrors | None:
        """Errors of the autopilot's state estimate; None for an exact estimate."""
        return EstimateErrors(child_seed(self.seed, "estimate")) if self.estimate_errors else None

    @property
    def horizontal_accuracy_m(self) -> float:
        """Standard deviation of the receiver's horizontal error, with both axes combined."""
        return math.sqrt(2.0) * self.gps_m

    @property
    def vertical_accuracy_m(self) -> float:
        """Standard deviation of the receiver's vertical error."""
        return VERTICAL * self.gps_m

    def of_vehicle(self, system_id: int) -> SensorNoise:
        """Return this noise with a seed for one vehicle of a fleet; vehicle 1 keeps the present seed."""
        if system_id == 1:
            return self
        return replace(self, seed=child_seed(self.seed, f"vehicle-{system_id}"))


class NavigationErrors:
    """Errors of one vehicle's sensors over time.

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
        """Return the errors at a time, which may be up to 5 minutes before the time of the last call."""
        row = self._row(max(0.0, time_s) / GRID_S)
        east, north, _, height, gps_east, gps_north, gps_up, barometer = row
        return SensorErrors(
            east, north, height - self._zero_m, gps_east, gps_north, gps_up, barometer - self._zero_m
        )

    def sense(self, position_m: tuple[float, float, float], time_s: float) -> Sensed:
        """Return the true position and the sensor readings of a vehicle, from its planned position."""
        x, y, z = position_m
        now = self.at(time_s)
        before = self.at(time_s - GRID_S) if time_s >= GRID_S else now
        # Aloft the vehicle holds its estimated height. Near the ground the error is faded out.
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
        """Return the row at a fractional index of the grid, interpolated linearly."""
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
        """Return standard normal numbers: 4 for slow errors (GPS 3, barometer 1), then 4 for white noise."""
        gps, barometer = (
            random.standard_normal((count, 2, n)) for random, n in zip(self._random, (3, 1), strict=True)
        )
        return np.concatenate((gps, barometer), axis=2).reshape(count, 8)

    def _draw(self) -> NDArray[np.float64]:
        """Return the next block: 4 errors of the estimate (GPS 3, barometer 1), then 4 of the sensors."""
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
    """Return the values of the first-order recursion ``y[i] = decay y[i-1] + noise[i]``."""
    values = []
    for value in noise.tolist():
        last = decay * last + value
        values.append(last)
    return np.array(values)
