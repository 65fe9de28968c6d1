"""Errors of a vehicle's navigation: receiver, barometer, position estimate and PX4's state estimate.

**Receiver, barometer and position estimate** (`NavigationErrors`). The error of a satellite receiver along an
axis is the sum of a first-order Gauss-Markov process (atmosphere, orbits) and white noise (receiver), as in
Rankin, *An error model for sensor simulation: GPS and differential GPS*, IEEE PLANS 1994. Beard and McLain
(*Small Unmanned Aircraft*, 2012, section 7.5) use Rankin's numbers. The process has a standard deviation of
4.7 m along a horizontal axis and 9.2 m upwards, and a time constant of 1100 s. The white noise has a
deviation of 0.4 m horizontally and 0.7 m upwards. Dilutions of precision: 1.3 horizontal, 1.8 vertical.
`SensorNoise` sets the size of the errors; the ratios are fixed.

The error of a barometer has the same two parts (Sabatini and Genovese, *Sensors* 13(11), 2013). Height 0 of
the autopilot is the barometer's reading at power-up. The estimate follows the sensors with a time constant of
2 s. The autopilot flies by the estimate: the estimated position follows the plan, and the true position
differs from the estimated position by the error (docs/decisions/0011).

Errors are drawn on a fixed grid of 0.1 s from one random stream per sensor. The errors of one sensor depend
neither on the time step of the simulation nor on the other sensor.

**PX4's state estimate** (`EstimateErrors`) has errors of the height and of the velocity. In all recorded
flights of PX4 (v1.17, SIH) the estimated height jumps up and down by a little more than 1 m during the first
two minutes after arming. Later the height only drifts. The estimated velocity has an error throughout the
flight: the accelerometers and gyroscopes of SIH are noisy, and the estimator follows the receiver slowly,
like a Kalman filter of positions (damping 0.7). The vehicle holds a wrong velocity until the position
controller corrects the resulting position error. A part of the velocity error, the push, also accelerates the
vehicle: tilt errors move the vehicle and not the estimate, and corrections move the estimate and not the
vehicle.

The numbers are measured on eight flights: six of quadrotors, one of a rover and one of an aeroplane. The
velocity error is the difference between the estimated velocity and the rate of change of the estimated
position, on the six flights of quadrotors. The push is measured on the two of these with recorded attitudes:

============================  ===================================================================
jumps of the height           90 % change the error's sign; size 1.0 m or more (tenth percentile
                              1.05 m, median 1.24 m, ninetieth 1.76 m); the last after 117 to 121 s
time between jumps            median 0.2 to 0.4 s, mean 0.8 to 1.1 s, ninetieth percentile 2.2 s
drift of the height           deviation 0.29 m; correlation 0.96 over 1 s, 0.63 over 5 s, 0.3 over 10 s
horizontal velocity           deviation per axis 0.214 m/s (0.14 to 0.28 in parts of flights), normally
                              distributed; correlation 0.70 over 2 s, 0.51 over 3 s, 0.2 over 5 s, 0 over
                              8 s; equal along and across the nose, at any speed, turn and acceleration
push                          acceleration of the estimate that neither thrust nor drag explains: -0.5 (and
                              -0.53) 1/s times the error, and 0.62 to 0.78 of the change of the error
vertical velocity             deviation 0.11 m/s; correlation 0.77 over 1 s, 0.57 over 3 s, 0.38 over 5 s
============================  ===================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.linear_algebra import exp, expm1
from geo.seeds import child_seed, stream
from sim_vehicle.airframe.power_spec import within

GRID_S = 0.1
"""Interval between two errors."""
# Number of grid times in a block of sensor errors, and number of blocks kept.
BLOCK, _KEPT = 1024, 4
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

# Parameters of the errors of PX4's state estimate.
COLUMNS = 6
"""Number of errors: height (m), velocity east, north, up (m/s), push east, north (m/s^2)."""
SETTLED_S = 119.0
"""Time after the first take-off during which the estimated height jumps (s)."""
LEAST_LEVEL_M = 0.5
"""Minimum of the absolute height error between two jumps."""
LEVEL_SCALE_M = 0.15
"""Mean of the exponentially distributed excess of the absolute height error over `LEAST_LEVEL_M`."""
MEDIAN_DWELL_S, DWELL_SIGMA = 0.35, 1.44
"""Median (s) and log-standard deviation of the time between jumps, which is log-normally distributed."""
DRIFT_M, DRIFT_S = 0.29, 3.8
"""Standard deviation and time constant of the height drift, a second-order Gauss-Markov process."""
HEIGHT_M = math.sqrt((LEAST_LEVEL_M + LEVEL_SCALE_M) ** 2 + LEVEL_SCALE_M**2 + DRIFT_M**2)
"""Standard deviation of the height error in the phase of jumps, 0.73 m."""
VELOCITY_M_S, VELOCITY_S, VELOCITY_DAMPING = 0.214, 2.25, 0.73
"""Standard deviation, time constant and damping of the horizontal velocity error, per axis."""
PUSH_1_S, UNSEEN = 0.5, 0.3
"""Gains of the push: on the velocity error (1/s), and on the rate of change of the velocity error."""
CLIMB_M_S, CLIMB_S = 0.1, 2.3
"""Standard deviation and time constant of the vertical velocity error, drawn independently of the drift."""


def carried_aside_m(gain_1_s: float) -> float:
    """Return the lateral drift caused by the velocity error: standard deviation per horizontal axis (m).

    The vehicle holds a velocity with the error e until the position controller corrects the position x:
    dx/dt = e - P x, with the controller's gain P and the second-order process e of `EstimateErrors`. In the
    steady state all derivatives of covariances are 0 (Lyapunov's equation), which gives the variance of x.
    The formula neglects the push and turns. In 240 flights of random paths, the distance from home at the
    start of the return varied by 0.23 m (one standard deviation).

    Examples
    --------
    >>> round(carried_aside_m(0.95), 2), carried_aside_m(0.0)
    (0.21, inf)
    """
    if not gain_1_s > 0.0:
        return math.inf
    damping, stiffness = 2.0 * VELOCITY_DAMPING / VELOCITY_S, VELOCITY_S**-2
    lag = gain_1_s + damping
    return VELOCITY_M_S * math.sqrt(lag / (gain_1_s * (gain_1_s * lag + stiffness)))


@dataclass(frozen=True, slots=True)
class EstimateErrors:
    """Errors of one vehicle's state estimate.

    Examples
    --------
    >>> errors = EstimateErrors(1)
    >>> bool((errors.first(50) == errors.first(3000)[:50]).all())
    True
    """

    seed: np.random.SeedSequence | int = 0

    def first(self, count: int) -> NDArray[np.float64]:
        """Return the first `count` errors (estimate minus truth), one every `GRID_S` from the first take-off.

        All error processes start at 0.

        Returns
        -------
        float64[count, COLUMNS]
        """
        errors = np.empty((count, COLUMNS))
        errors[:, 0] = self._drift("height-drift", count, DRIFT_M, DRIFT_S, 1.0)
        jumps = self._jumps()[:count]
        errors[: len(jumps), 0] += jumps
        errors[:, 1] = self._drift("velocity-east", count, VELOCITY_M_S, VELOCITY_S, VELOCITY_DAMPING)
        errors[:, 2] = self._drift("velocity-north", count, VELOCITY_M_S, VELOCITY_S, VELOCITY_DAMPING)
        errors[:, 3] = self._drift("velocity-up", count, CLIMB_M_S, CLIMB_S, 1.0)
        change = np.diff(errors[:, 1:3], axis=0, prepend=0.0) / GRID_S
        errors[:, 4:6] = -PUSH_1_S * errors[:, 1:3] - UNSEEN * change
        return errors

    def _drift(
        self, name: str, count: int, deviation: float, time_s: float, damping: float
    ) -> NDArray[np.float64]:
        # `first` and `second` follow from the poles of the sampled process; `variance` is the variance of the
        # process with drive 1.
        decay = math.exp(-damping * GRID_S / time_s)
        first = 2.0 * decay * math.cos(math.sqrt(1.0 - damping * damping) * GRID_S / time_s)
        second = -decay * decay
        variance = (1.0 - second) / ((1.0 + second) * ((1.0 - second) ** 2 - first * first))
        noise = stream(self.seed, name).standard_normal(count)
        return _compiled_recursion()(noise, first, second, deviation / math.sqrt(variance))

    def _jumps(self) -> NDArray[np.float64]:
        random = stream(self.seed, "height-jumps")
        jumps = np.zeros(round(SETTLED_S / GRID_S))
        side, time_s = 1.0 if random.random() < 0.5 else -1.0, 0.0
        while True:
            time_s += max(GRID_S, MEDIAN_DWELL_S * math.exp(DWELL_SIGMA * random.standard_normal()))
            first = round(time_s / GRID_S)
            if first >= len(jumps):
                return jumps
            side = -side
            jumps[first:] = side * (LEAST_LEVEL_M + LEVEL_SCALE_M * random.standard_exponential())


def recur(noise: NDArray[np.float64], first: float, second: float, drive: float) -> NDArray[np.float64]:
    """Return y[k] = first y[k-1] + second y[k-2] + drive noise[k], from rest."""
    result = np.empty_like(noise)
    last = before = 0.0
    for k in range(len(noise)):
        last, before = first * last + second * before + drive * noise[k], last
        result[k] = last
    return result


@cache
def _compiled_recursion() -> Callable[..., NDArray[np.float64]]:
    """Return `recur`, compiled only at its first use: flights without errors need no compiler."""
    return compiled(nogil=True)(recur)


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
    """Whether height and velocity have the errors of PX4's state estimate (`EstimateErrors`)."""

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
        """Return this noise with a separate seed for each vehicle of a fleet; vehicle 1 keeps the seed."""
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
        """Return true position and sensor readings of a vehicle whose estimate is at the planned position."""
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
        return block[index % BLOCK]

    def _normal(self, count: int) -> NDArray[np.float64]:
        """Return rows of standard normals: 4 for slow errors (GPS 3, barometer 1), then 4 for white noise."""
        gps, barometer = (
            random.standard_normal((count, 2, n)) for random, n in zip(self._random, (3, 1), strict=True)
        )
        return np.concatenate((gps, barometer), axis=2).reshape(count, 8)

    def _draw(self) -> NDArray[np.float64]:
        """Return the next block: rows of 4 estimate errors (GPS 3, barometer 1), then 4 sensor errors."""
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
