"""Electric power of a flight state, and endurance and range in steady motion.

**Rotorcraft** (`multirotor_power`). The formula follows from momentum and blade-element theory (Leishman,
*Principles of Helicopter Aerodynamics*, 2nd ed., 2006, ch. 2 and 5) for a tilted disc. The thrust T carries
the weight, overcomes the drag and gives the acceleration::

    P = (T (k v + Vn) + P0 (T/W)^1.5 (1 + 3 Vt^2 / Utip^2)) / efficiency + avionics
    P0 = delta/8 rho s A Utip^3          v: T = 2 rho A v sqrt(Vt^2 + (Vn + v)^2)

Vn and Vt are the components of the airspeed normal to the disc and in its plane. T Vn is the power of drag,
climb and acceleration. For level flight with T = W the formula becomes the closed form of Zeng, Xu and Zhang,
"Energy minimization for wireless communication with rotary-wing UAV", IEEE Trans. Wireless Commun. 18(4),
2019, eq. (12). The exponent 1.5 of the profile power holds for rotors of fixed pitch, which turn faster for
more thrust. Momentum theory does not hold for a disc that sinks into its own wake (Vn < 0). A rotorcraft that
descends or brakes recovers the fraction `REGAINED` of T Vn. This fraction is the slope near hover of
Leishman's measured curve for the vortex ring state (eq. 2.96).

Other kinds of vehicles have their own formulas (`FurtherPowerSpec`).

The battery loses ``I^2 R`` in its internal resistance, so the power from the cells is ``P (1 + R P / U^2)``
with the nominal voltage U. All functions of this module return the power from the cells; energies are
integrals of this power.

The functions are plain Python. `sim_vehicle.motion.stepping` compiles the formula of rotorcraft.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.airframe.power_spec import (
    AIR_DENSITY_KG_M3,
    BATTERY_LOSS,
    COEFFICIENTS,
    CONSTANT_POWER,
    DRAG,
    GRAVITY_M_S2,
    INDUCED_FACTOR,
    INDUCED_FLOW,
    MASS,
    OWN_DRAG,
    PER_EFFICIENCY,
    PROFILE,
    TIP_SPEED,
    PowerSpec,
)
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.airframe.power_spec import AnyPowerSpec, BatterySpec
    from sim_vehicle.airframe.spec import VehicleSpec

REGAINED = 0.2
# Step of the search for the best speeds.
_STEP_M_S = 0.1
# Lowest airspeed of a fixed wing, divided by its cruise speed, if the autopilot sets no lower limit.
_SLOWEST = 0.8


def power_coefficients(power: AnyPowerSpec | None, battery: BatterySpec | None = None) -> NDArray[np.float64]:
    """Return the constants of a power model, float64[COEFFICIENTS]; zeros without a power model."""
    numbers = np.zeros(COEFFICIENTS)
    if power is None:
        return numbers
    weight = power.mass_kg * GRAVITY_M_S2
    numbers[MASS] = power.mass_kg
    numbers[DRAG] = 0.5 * AIR_DENSITY_KG_M3 * power.drag_area_m2
    numbers[CONSTANT_POWER] = power.avionics_w + power.camera_w
    numbers[PER_EFFICIENCY] = 1.0 / power.efficiency
    if battery is not None:
        resistance = battery.resistance_ohm + battery.polarization_ohm
        numbers[BATTERY_LOSS] = resistance / battery.nominal_voltage_v**2
    if isinstance(power, PowerSpec):
        numbers[INDUCED_FLOW] = 0.5 / (AIR_DENSITY_KG_M3 * power.disc_area_m2)
        numbers[INDUCED_FACTOR] = power.induced_factor
        numbers[PROFILE] = profile_power_w(power) / weight**1.5
        numbers[TIP_SPEED] = 3.0 / power.tip_speed_m_s**2
    else:
        numbers[OWN_DRAG] = power.own_drag
    return numbers


def profile_power_w(power: PowerSpec) -> float:
    """Return the profile power in hover: the shaft power that overcomes the drag of the blades (W)."""
    blades = power.blade_drag / 8.0 * power.solidity * power.disc_area_m2
    return AIR_DENSITY_KG_M3 * blades * power.tip_speed_m_s**3


def multirotor_power(
    power: NDArray[np.float64],
    air_x: float,
    air_y: float,
    climb: float,
    acc_x: float,
    acc_y: float,
    acc_z: float,
) -> float:
    """Return the power that a rotorcraft draws from the cells of its battery (W).

    Parameters
    ----------
    power : float64[COEFFICIENTS]
    air_x, air_y : float
        Horizontal airspeed.
    climb : float
        Vertical speed, upward.
    acc_x, acc_y, acc_z : float
        Acceleration.
    """
    mass = power[MASS]
    if mass == 0.0:
        return 0.0
    air2 = air_x * air_x + air_y * air_y
    air = sqrt(air2)
    force_x = power[DRAG] * air * air_x + mass * acc_x
    force_y = power[DRAG] * air * air_y + mass * acc_y
    lift = max(mass * (GRAVITY_M_S2 + acc_z), 0.0)
    thrust2 = force_x * force_x + force_y * force_y + lift * lift
    if thrust2 < 1e-9:
        return float(power[CONSTANT_POWER])
    thrust = sqrt(thrust2)
    normal = (force_x * air_x + force_y * air_y + lift * climb) / thrust
    within2 = max(air2 + climb * climb - normal * normal, 0.0)
    hover2 = thrust * power[INDUCED_FLOW]
    into = max(normal, 0.0)
    # Newton's method starts above the root and approaches the root without overshoot.
    induced = sqrt(hover2)
    for _ in range(8):
        through = into + induced
        speed = sqrt(within2 + through * through)
        step = (induced * speed - hover2) / (speed + induced * through / speed)
        induced -= step
        if step < 1e-6 * induced:
            break
    shaft = thrust * (power[INDUCED_FACTOR] * induced + (normal if normal > 0.0 else REGAINED * normal))
    shaft += power[PROFILE] * thrust * sqrt(thrust) * (1.0 + power[TIP_SPEED] * within2)
    total = power[CONSTANT_POWER] + power[PER_EFFICIENCY] * max(shaft, 0.0)
    return float(total * (1.0 + power[BATTERY_LOSS] * total))


def flight_power_w(
    power: AnyPowerSpec,
    airspeed_m_s: float = 0.0,
    climb_m_s: float = 0.0,
    *,
    load_factor: float = 1.0,
    acceleration_m_s2: float = 0.0,
    battery: BatterySpec | None = None,
) -> float:
    """Return the electric power of steady motion at an airspeed and a climb rate (W).

    Parameters
    ----------
    power : PowerSpec or FurtherPowerSpec
    airspeed_m_s : float
        Horizontal airspeed (rotorcraft), airspeed along the path (fixed wing), or ground speed without wind.
    climb_m_s : float
        Climb rate, upward; ignored for ground vehicles.
    load_factor : float
        Lift divided by weight, for a fixed wing in a turn or a rotorcraft that accelerates vertically.
    acceleration_m_s2 : float
        Acceleration along the direction of motion.
    battery : BatterySpec, optional
        Battery; the losses in its resistance are added.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> quad = get_vehicle("quad")
    >>> 170.0 < flight_power_w(quad.power) < 180.0
    True
    """
    numbers = power_coefficients(power, battery)
    if isinstance(power, PowerSpec):
        up = GRAVITY_M_S2 * (load_factor - 1.0)
        return multirotor_power(numbers, airspeed_m_s, 0.0, climb_m_s, acceleration_m_s2, 0.0, up)
    return power.steady_w(numbers, airspeed_m_s, climb_m_s, load_factor, acceleration_m_s2)


@dataclass(frozen=True, slots=True)
class Best:
    """Best endurance and best range of a vehicle with a full battery, each with its airspeed."""

    endurance_s: float
    endurance_speed_m_s: float
    range_m: float
    range_speed_m_s: float


def endurance_s(spec: VehicleSpec, airspeed_m_s: float, *, used_fraction: float = 1.0) -> float:
    """Return the time (s) after which steady motion has used a fraction of the battery.

    An airspeed of 0 means hover. Raises VehicleError if the vehicle has no battery or no power model.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> round(endurance_s(get_vehicle("quad"), 0.0) / 60.0)
    30
    """
    if spec.battery is None or spec.power is None:
        raise VehicleError(f"vehicle {spec.name} has no battery: its endurance is unlimited")
    power_w = flight_power_w(spec.power, airspeed_m_s, battery=spec.battery)
    return used_fraction * spec.battery.capacity_wh * WH_J / power_w


def best_speeds(spec: VehicleSpec, *, least_airspeed_m_s: float | None = None) -> Best:
    """Return the best endurance and the best range of a vehicle, each with its airspeed.

    ``least_airspeed_m_s`` is the autopilot's lower limit of the airspeed of a fixed wing. The default is 0.8
    of the cruise speed. Raises VehicleError if the vehicle has no battery or no power model.
    """
    slowest, fastest = 0.0, spec.fastest_m_s
    if spec.circles:
        slowest = _SLOWEST * spec.cruise_speed_m_s if least_airspeed_m_s is None else least_airspeed_m_s
        fastest = spec.airspeed_limit_m_s
    elif spec.drives:
        slowest = _STEP_M_S
    speeds = np.arange(slowest, fastest + 0.5 * _STEP_M_S, _STEP_M_S)
    times = np.array([endurance_s(spec, float(speed)) for speed in speeds])
    distances = times * speeds
    longest, farthest = int(np.argmax(times)), int(np.argmax(distances))
    return Best(
        float(times[longest]), float(speeds[longest]), float(distances[farthest]), float(speeds[farthest])
    )
