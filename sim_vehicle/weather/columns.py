"""Columns of a block of the wind, and of the filters that form Dryden's gusts: here without a compiler."""

from __future__ import annotations

# One row of a wind block: the wind and its mean at the reference height (m/s), and how they depend on the
# height.
(
    AIR_EAST,
    AIR_NORTH,
    AIR_UP,
    MEAN_EAST,
    MEAN_NORTH,
    SHEAR_LAW,  # CONSTANT, LOGARITHMIC, POWER or SQUARE_ROOT of the gust kernel.
    SHEAR_NUMBER,  # Roughness length (m), exponent, or height of the full wind (m).
    REFERENCE_HEIGHT,
    HAS_DRYDEN,  # Whether the gusts are Dryden's.
) = range(9)
WIND_ROW = 9
SITL_FULL_M = 60.0
"""Height from which ArduPilot's simulator has the whole of its wind."""
# One filter: decay of one step, share of the first state in the second, and the lower triangle of the
# square root of the noise's covariance.
(
    DECAY,
    LEAK,
    NOISE_FIRST,
    NOISE_MIXED,
    NOISE_SECOND,
) = range(5)
