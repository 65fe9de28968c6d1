"""Vehicle kind of fixed wings: airframe and electric power.

Drag follows the parabolic polar; n is the load factor of a turn (Anderson, *Aircraft Performance and Design*,
1999, ch. 5)::

    D = q S (CD0 + CL^2 / (pi e AR))     CL = n W / (q S)     q = rho V^2 / 2
    P = (D V + W climb) / efficiency + avionics

`climb` is the rate of change of energy height, which includes a gain of speed. A glide takes at least the
avionics power, because a windmilling propeller returns no energy.

`wbf_mission.addons.wings.motion.kernel` compiles the power model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING

from sim_vehicle.airframe.kind import Movement, VehicleKind
from sim_vehicle.airframe.power_spec import (
    AIR_DENSITY_KG_M3,
    BATTERY_LOSS,
    CONSTANT_POWER,
    DRAG,
    GRAVITY_M_S2,
    MASS,
    OWN_DRAG,
    PER_EFFICIENCY,
    FurtherPowerSpec,
    within,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedWingPowerSpec(FurtherPowerSpec):
    """Parameters of the power model of a fixed wing (`fixed_wing_power`)."""

    # Wing area and span, which give the aspect ratio.
    wing_area_m2: float
    wing_span_m: float
    parasitic_drag: float = 0.025
    """Zero-lift drag coefficient, referred to the wing area."""
    oswald: float = 0.8
    """Span efficiency of the induced drag."""
    efficiency: float = 0.55

    @property
    def drag_area_m2(self) -> float:
        """Equivalent flat-plate area of zero-lift drag."""
        return self.parasitic_drag * self.wing_area_m2

    @property
    def own_drag(self) -> float:
        """Induced drag times squared airspeed."""
        weight = self.mass_kg * GRAVITY_M_S2
        return weight**2 / (0.5 * AIR_DENSITY_KG_M3 * math.pi * self.oswald * self.wing_span_m**2)

    def steady_w(
        self, numbers: NDArray[np.float64], airspeed: float, climb: float, load: float, acceleration: float
    ) -> float:
        """Return the power of steady flight."""
        energy_climb = climb + airspeed * acceleration / GRAVITY_M_S2
        return fixed_wing_power(numbers, airspeed, energy_climb, load)


@dataclass(frozen=True, slots=True)
class FixedWingAirframe:
    """Thrust, lift and ground friction of a fixed wing; its drag is in the power model."""

    thrust_n: float | None = None
    """Thrust at full throttle, at any airspeed; None: by the autopilot's climb rate parameter."""
    # Lift coefficient at zero angle of attack, and its slope per radian.
    lift_level: float = 0.3
    lift_slope: float = 5.0
    turn_share: float = 1.0
    """Turn rate divided by that of a coordinated turn, g tan(bank) / airspeed; below 1: outward slip."""
    elevator_per_lift: float = 0.0
    """Fraction of full elevator that is needed per unit of lift coefficient: static stability divided by
    elevator power. Until pitch control has trimmed a change of airspeed, the nose is too high or too low. 0
    means always trimmed."""
    liftoff_airspeed_m_s: float | None = None
    """Airspeed at which a ground roll under the vehicle's own thrust ends in lift-off; None: the vehicle is
    thrown, or rolls with a fixed acceleration, as the autopilot's parameters say."""
    ground_drag_1_s: float | None = None
    """Deceleration per speed on the ground; None: grass, with a constant deceleration."""

    def __post_init__(self) -> None:
        within(
            "airframe",
            self,
            ("thrust_n", 0.01, 1e5),
            ("lift_level", -1.0, 2.0),
            ("lift_slope", 1.0, 10.0),
            ("turn_share", 0.2, 1.0),
            ("elevator_per_lift", 0.0, 5.0),
            ("liftoff_airspeed_m_s", 1.0, 100.0),
            ("ground_drag_1_s", 0.01, 10.0),
        )


def fixed_wing_power(power: NDArray[np.float64], airspeed: float, climb: float, load: float) -> float:
    """Return the power that a fixed wing draws from the cells of its battery, in watts.

    `power` is float64[COEFFICIENTS]. Below a true airspeed of 1 m/s only constant power is counted. `climb`
    is the energy rate divided by weight: the climb rate in steady flight, plus V a / g when accelerating.
    `load` is the lift over weight, 1 / cos(bank) in a level turn.
    """
    speed2 = airspeed * airspeed
    if speed2 < 1.0:
        return float(power[CONSTANT_POWER])
    drag = power[DRAG] * speed2 + power[OWN_DRAG] * load * load / speed2
    needed = drag * airspeed + power[MASS] * GRAVITY_M_S2 * climb
    total = power[CONSTANT_POWER] + power[PER_EFFICIENCY] * max(needed, 0.0)
    return float(total * (1.0 + power[BATTERY_LOSS] * total))


FIXED_WING = VehicleKind(
    "fixed-wing",
    Movement.CIRCLES,
    base="wing",
    typical="fixed-wing",
    vehicles=resources.files(__package__) / "vehicles",
    power=FixedWingPowerSpec,
    airframe=FixedWingAirframe,
    firmwares={
        "px4": "wbf_mission.addons.wings.px4:FIRMWARE",
        "ardupilot": "wbf_mission.addons.wings.ardupilot:FIRMWARE",
    },
    mav_types=(1,),  # MAV_TYPE_FIXED_WING
)
