"""Thrust and drag of a fixed wing, compiled: what energy it gains and loses.

Drag is the parabolic polar, D = q S (CD0 + CL^2 / (pi e AR)) with the lift of the load factor (Anderson,
*Aircraft Performance and Design*, 1999, ch. 5), as in `sim_vehicle.energy.power`. Thrust is
proportional to the throttle and does not depend on the airspeed, as in the simulators of ArduPilot
(``SIM_Plane.cpp``) and PX4 (``sih.cpp``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.records import Record

__all__ = ["drag", "energy_rate"]

Floats = NDArray[np.float64]
_SLOW = 3.0


@compiled(allocates=False)
def drag(limits: Record, airspeed: float, load: float) -> float:
    """Return the drag over the mass, m/s^2.

    Parameters
    ----------
    limits : float64[LIMITS]
    load : float
        Lift over weight.
    """
    v2 = max(airspeed, _SLOW) ** 2
    return float(limits.parasitic * v2 + limits.induced * load * load / v2)


@compiled(allocates=False)
def energy_rate(limits: Record, throttle: float, airspeed: float, load: float) -> float:
    """Return the gain of energy over the weight, m/s: the climb at a steady airspeed."""
    force = limits.thrust * throttle - drag(limits, airspeed, load)
    return float(force * airspeed / GRAVITY_M_S2)
