"""How much wider apart vehicles are planned than they stay, since none knows exactly where it is."""

from __future__ import annotations

import math

from sim_vehicle.airframe.estimate_errors import HEIGHT_M
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot.registry import estimate_errs, with_autopilot
from wbf_mission.scenario import VehicleOptions

__all__ = ["clearance_m", "ground_clearance_m", "height_error_m"]

_DEVIATIONS = 3.0
_STEPS_PER_M = 10


def clearance_m(first_m: float, second_m: float) -> float:
    """Return how much nearer to each other two vehicles may be than they believe.

    Three standard deviations of what their errors, which are independent, differ by, up to the next 0.1 m.

    Parameters
    ----------
    first_m, second_m : float
        Standard deviations of their errors.

    Examples
    --------
    >>> clearance_m(0.0, 0.0), clearance_m(0.3, 0.4), clearance_m(0.0, 0.51)
    (0.0, 1.5, 1.6)
    """
    return math.ceil(_DEVIATIONS * math.hypot(first_m, second_m) * _STEPS_PER_M - 1e-9) / _STEPS_PER_M


def ground_clearance_m(options: VehicleOptions) -> float:
    """Return how much nearer to each other over ground two vehicles of a run may be than they believe.

    The swings of an erring estimate are as large as those by gusts, for which there is room anyway.
    """
    return clearance_m(options.gps_noise_m, options.gps_noise_m)


def height_error_m(options: VehicleOptions, spec: VehicleSpec) -> float:
    """Return the standard deviation of a vehicle's error about its height over where it took off."""
    errs = options.estimate_errors and estimate_errs(with_autopilot(spec, options.autopilot))
    # The barometer erred at take-off, too.
    return math.hypot(HEIGHT_M if errs else 0.0, math.sqrt(2.0) * options.baro_noise_m)
