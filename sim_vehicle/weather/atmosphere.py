"""Models of the air near the ground: mean wind over height, and Dryden's turbulence.

The module needs no compiler. It names the columns of wind blocks and gust filters, which compiled functions
read.

Dryden's turbulence is the low-altitude disturbance model of MIL-F-8785C (3.7.3). MIL-HDBK-1797 writes the
same spectra with other length scales. Below 1000 ft the intensities and the length scales depend on the
height h (ft) and on the wind at 20 ft, W20::

    sigma_w = 0.1 W20       sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4
    L_w = h                 L_u = L_v = h / (0.177 + 0.000823 h)^1.2

The gust components are u along the mean wind, v across the mean wind, and w upward. The one-sided spectra
over the wave number W (rad/m) are ::

    Phi_u = sigma^2 2L/pi 1 / (1 + (LW)^2)      Phi_v, Phi_w = sigma^2 L/pi (1 + 3(LW)^2) / (1 + (LW)^2)^2

A vehicle that flies through a frozen field at the airspeed V meets the wave number W at the frequency
W V / 2 pi. With T = L/V the forming filters are sqrt(2T) / (1 + Ts) for u and
sqrt(T) (1 + sqrt(3) Ts) / (1 + Ts)^2 for v and w. The filters are discretised exactly. The filter for v and w
combines a Gauss-Markov process x1 and its first-order lag x2 as ``(sqrt(3) x1 + (1 - sqrt(3)) x2) /
sqrt(2)``. Each time step applies the transition matrix and the Cholesky factor of the noise covariance. The
initial state is stationary.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geo.texts import FOOT_M
from sim_vehicle.airframe.power_spec import within
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Laws of the mean wind over height; these are the values of SHEAR_LAW.
CONSTANT, LOGARITHMIC, POWER, SQUARE_ROOT = 0.0, 1.0, 2.0, 3.0
_LAWS = {"log": LOGARITHMIC, "power": POWER, "sitl": SQUARE_ROOT}
# Columns of a wind block: wind and mean wind at the reference height (m/s), and how they vary with height.
(
    AIR_EAST,
    AIR_NORTH,
    AIR_UP,
    MEAN_EAST,
    MEAN_NORTH,
    SHEAR_LAW,  # CONSTANT, LOGARITHMIC, POWER or SQUARE_ROOT.
    SHEAR_NUMBER,  # Parameter of the law: roughness length (m), exponent, or height of the full wind (m).
    REFERENCE_HEIGHT,
    HAS_DRYDEN,  # 1 if the gusts are Dryden's, else 0.
) = range(9)
WIND_ROW = 9
SITL_FULL_M = 60.0
"""Height above which the wind in ArduPilot's simulator has its full speed."""
LOWEST_M, HIGHEST_M = 3.0 * FOOT_M, 1000.0 * FOOT_M
"""Range of heights of MIL-F-8785C's mean wind profile; outside it, the wind at the nearer end is used."""
# Columns of a forming filter: DECAY is the decay per step, and LEAK is the contribution of the first state to
# the second state. The NOISE columns are the lower triangle of the Cholesky factor of the noise covariance.
(
    DECAY,
    LEAK,
    NOISE_FIRST,
    NOISE_MIXED,
    NOISE_SECOND,
) = range(5)

_KNOT_M_S = 1852.0 / 3600.0
_LOWEST_FT, _HIGHEST_FT = 10.0, 1000.0
REFERENCE_M = 20.0 * FOOT_M
"""Height at which W20 is measured."""
LEVELS_W20_M_S = {"light": 15.0 * _KNOT_M_S, "moderate": 30.0 * _KNOT_M_S, "severe": 45.0 * _KNOT_M_S}
"""Wind W20 at the three levels of MIL-F-8785C: 15, 30 and 45 knots."""


@dataclass(frozen=True, slots=True)
class WindShear:
    """Profile of the mean wind over height; raises VehicleError for an unknown law or a number out of range.

    Examples
    --------
    >>> round(WindShear("log", roughness_m=0.1).factor(2.0, 10.0), 4)
    0.6505
    """

    law: str = "log"
    """Law of the profile. "log" is ``ln(h / roughness)`` and "power" is ``h ** exponent``, each relative to
    the value at the reference height of the wind. "sitl" is the profile of ArduPilot's simulator
    (SIM_WIND_T 0): the given wind from `SITL_FULL_M` up, and ``sqrt(h / SITL_FULL_M)`` of it below."""
    roughness_m: float = 0.1
    """Roughness length of the ground: 0.03 m for grass, 0.1 m for low crops, 0.25 m for high crops (Wieringa
    1992). MIL-F-8785C uses 0.15 ft near airfields and 2 ft elsewhere."""
    exponent: float = 1.0 / 7.0
    """Exponent of the power law; 1/7 is usual over open land."""

    def __post_init__(self) -> None:
        if self.law not in _LAWS:
            raise VehicleError(f"wind shear {self.law!r} is not a law: give {' or '.join(_LAWS)}")
        if not 1e-5 <= self.roughness_m <= 0.7:
            raise VehicleError(f"wind shear: roughness length {self.roughness_m} m is outside 0.00001..0.7")
        if not 0.0 <= self.exponent <= 1.0:
            raise VehicleError(f"wind shear: exponent {self.exponent} is outside 0..1")

    def factor(self, height_m: float, reference_m: float) -> float:
        """Return the mean wind at a height, relative to the mean wind at the reference height.

        Heights are limited to 3 to 1000 ft, except in profile "sitl", whose wind falls to 0 at the ground.
        """
        if self.law == "sitl":
            return math.sqrt(min(max(height_m, 0.0), SITL_FULL_M) / SITL_FULL_M)
        height = min(max(height_m, LOWEST_M), HIGHEST_M)
        if self.law == "power":
            return float((height / reference_m) ** self.exponent)
        return math.log(height / self.roughness_m) / math.log(reference_m / self.roughness_m)

    @property
    def columns(self) -> tuple[float, float]:
        """Values of SHEAR_LAW and SHEAR_NUMBER in a wind block."""
        number = {"log": self.roughness_m, "power": self.exponent, "sitl": SITL_FULL_M}
        return _LAWS[self.law], number[self.law]


def _term(height_m: float) -> tuple[float, float]:
    feet = min(max(height_m / FOOT_M, _LOWEST_FT), _HIGHEST_FT)
    return feet, 0.177 + 0.000823 * feet


def length_scales_m(height_m: float) -> tuple[float, float, float]:
    """Return the length scales along, across and up (m); heights are clipped to 10 to 1000 ft.

    Examples
    --------
    >>> [round(scale, 1) for scale in length_scales_m(304.8)]
    [304.8, 304.8, 304.8]
    >>> [round(scale, 1) for scale in length_scales_m(10.0)]
    [67.4, 67.4, 10.0]
    """
    feet, term = _term(height_m)
    side = feet / term**1.2 * FOOT_M
    return side, side, feet * FOOT_M


def intensities_m_s(height_m: float, w20_m_s: float) -> tuple[float, float, float]:
    """Return the standard deviations of the gusts along, across and up (m/s).

    Examples
    --------
    >>> [round(sigma, 3) for sigma in intensities_m_s(10.0, 7.7)]
    [1.454, 1.454, 0.77]
    """
    vertical = 0.1 * w20_m_s
    side = vertical / _term(height_m)[1] ** 0.4
    return side, side, vertical


def spectrum(
    component: str,
    frequency_hz: NDArray[np.float64],
    intensity_m_s: float,
    length_m: float,
    airspeed_m_s: float,
) -> NDArray[np.float64]:
    """Return the one-sided spectral density of a gust at frequencies of encounter, in (m/s)^2/Hz.

    `component` is "u", "v" or "w". The integral of the density is the square of `intensity_m_s`.
    """
    time_s = length_m / airspeed_m_s
    x2 = (2.0 * np.pi * np.asarray(frequency_hz, dtype=np.float64) * time_s) ** 2
    if component == "u":
        return np.asarray(4.0 * intensity_m_s**2 * time_s / (1.0 + x2))
    return np.asarray(2.0 * intensity_m_s**2 * time_s * (1.0 + 3.0 * x2) / (1.0 + x2) ** 2)


@dataclass(frozen=True, slots=True)
class Turbulence:
    """Dryden's turbulence for a flight; raises VehicleError if a number is out of range.

    Examples
    --------
    >>> Turbulence(LEVELS_W20_M_S["light"], height_m=20.0, airspeed_m_s=8.0).w20_m_s
    7.716666666666667
    """

    w20_m_s: float
    """Wind at 6.1 m (20 ft), from which the intensities follow."""
    height_m: float = 10.0
    """Height of the flight, which sets the length scales; the intensities vary with the present height."""
    airspeed_m_s: float = 8.0
    """Airspeed of the flight through the gust field."""

    def __post_init__(self) -> None:
        ranges = (("w20_m_s", 0.0, 60.0), ("height_m", 0.0, 10_000.0), ("airspeed_m_s", 0.1, 200.0))
        within("turbulence", self, *ranges)

    def filters(self, step_s: float) -> NDArray[np.float64]:
        """Return the forming filters for a time step (`sim_vehicle.weather.gust_kernel.forming_filters`)."""
        table = np.zeros((3, 5))
        for row, length_m in zip(table, length_scales_m(self.height_m), strict=True):
            part = step_s * self.airspeed_m_s / length_m
            decay = math.exp(-part)
            row[DECAY], row[LEAK] = decay, decay * part
            first = -math.expm1(-2.0 * part)
            mixed = 0.5 - decay * decay * (part + 0.5)
            second = 0.5 - decay * decay * (part * part + part + 0.5)
            row[NOISE_FIRST] = math.sqrt(first)
            row[NOISE_MIXED] = mixed / row[NOISE_FIRST]
            row[NOISE_SECOND] = math.sqrt(max(0.0, second - row[NOISE_MIXED] * row[NOISE_MIXED]))
        return table

    @staticmethod
    def beginning(noise: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return an initial state of the filters, float64[5], drawn with standard normal numbers."""
        state = noise.copy()
        for at in (1, 3):
            state[at + 1] = 0.5 * (noise[at] + noise[at + 1])
        return state
