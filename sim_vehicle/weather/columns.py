"""Columns of wind blocks and gust filters, constants of wind laws; importable without a compiler."""

from __future__ import annotations

from geo.texts import FOOT_M

# Laws of the mean wind over height, values of SHEAR_LAW.
CONSTANT, LOGARITHMIC, POWER, SQUARE_ROOT = 0.0, 1.0, 2.0, 3.0
# Columns of a wind block: wind and mean wind at the reference height (m/s), and the dependence on height.
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
"""Height above which ArduPilot's simulator has its full wind."""
LOWEST_M, HIGHEST_M = 3.0 * FOOT_M, 1000.0 * FOOT_M
"""Heights of the mean wind profile in MIL-F-8785C; beyond them, the wind at the nearer height is used."""
# Columns of a forming filter: decay per step, contribution of the first state to the second state.
# NOISE_* are the lower triangle of the Cholesky factor of the noise covariance.
(
    DECAY,
    LEAK,
    NOISE_FIRST,
    NOISE_MIXED,
    NOISE_SECOND,
) = range(5)
