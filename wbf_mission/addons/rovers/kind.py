"""Vehicle kind of rovers: power for rolling resistance, drag and acceleration, without recuperation.

`wbf_mission.addons.rovers.motion.kernel` compiles the power model.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING

from sim_vehicle.airframe.kind import Movement, VehicleKind
from sim_vehicle.airframe.power_spec import (
    BATTERY_LOSS,
    CONSTANT_POWER,
    DRAG,
    GRAVITY_M_S2,
    MASS,
    OWN_DRAG,
    PER_EFFICIENCY,
    FurtherPowerSpec,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverPowerSpec(FurtherPowerSpec):
    """Parameters of the power model of a ground vehicle (`rover_power`)."""

    rolling_resistance: float = 0.08
    """Rolling drag divided by weight."""
    drag_area_m2: float = 0.2
    """Drag coefficient times frontal area."""
    efficiency: float = 0.6
    avionics_w: float = 15.0

    @property
    def own_drag(self) -> float:
        """Rolling resistance of the vehicle (N)."""
        return self.rolling_resistance * (self.mass_kg * GRAVITY_M_S2)

    def steady_w(
        self, numbers: NDArray[np.float64], airspeed: float, climb: float, load: float, acceleration: float
    ) -> float:
        """Return the power of steady driving."""
        return rover_power(numbers, airspeed, airspeed, acceleration)


def rover_power(power: NDArray[np.float64], speed: float, airspeed: float, acceleration: float) -> float:
    """Return the power that a ground vehicle draws from the cells of its battery, in watts.

    `power` is float64[COEFFICIENTS]. The ground speed is at least 0. Airspeed and acceleration are those
    along the direction of travel; the airspeed is above `speed` in a head wind, negative in a strong tail
    wind.
    """
    pull = power[OWN_DRAG] + power[DRAG] * airspeed * abs(airspeed) + power[MASS] * acceleration
    total = power[CONSTANT_POWER] + power[PER_EFFICIENCY] * max(pull * speed, 0.0)
    return float(total * (1.0 + power[BATTERY_LOSS] * total))


ROVER = VehicleKind(
    "rover",
    Movement.DRIVES,
    base="rover",
    typical="rover",
    vehicles=resources.files(__package__) / "vehicles",
    power=RoverPowerSpec,
    firmwares={
        "px4": "wbf_mission.addons.rovers.px4:FIRMWARE",
        "ardupilot": "wbf_mission.addons.rovers.ardupilot:FIRMWARE",
    },
    mav_types=(10,),  # MAV_TYPE_GROUND_ROVER
)
