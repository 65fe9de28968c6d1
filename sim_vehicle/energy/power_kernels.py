"""The power models, compiled for the motion kernels."""

from __future__ import annotations

from geo.compiled import compiled
from sim_vehicle.energy import power

__all__ = ["fixed_wing_power", "multirotor_power", "rover_power"]

multirotor_power = compiled(allocates=False)(power.multirotor_power)
fixed_wing_power = compiled(allocates=False)(power.fixed_wing_power)
rover_power = compiled(allocates=False)(power.rover_power)
