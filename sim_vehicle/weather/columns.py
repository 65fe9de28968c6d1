"""Columns of wind blocks and gust filters, and numbers of wind laws; the module needs no compiler."""

from __future__ import annotations

from geo.texts import FOOT_M

# Laws of the mean wind over height; these are the values of SHEAR_LAW.
CONSTANT, LOGARITHMIC, POWER, SQUARE_ROOT = 0.0, 1.0, 2.0, 3.0
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
