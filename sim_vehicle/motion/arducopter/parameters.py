"""ArduCopter's parameters that move a multirotor, and the drag of its simulator's airframe.

Names, units, ranges and defaults are those of ArduCopter 4.6; 4.7 renamed many of them and counts in metres.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim_vehicle.airframe.spec import VehicleSpec

PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
    {
        "WPNAV_SPEED": ParameterSpec(1000.0, 20.0, 2000.0, "cm/s", "horizontal speed"),
        "WPNAV_SPEED_UP": ParameterSpec(250.0, 10.0, 1000.0, "cm/s", "climb speed"),
        "WPNAV_SPEED_DN": ParameterSpec(150.0, 10.0, 500.0, "cm/s", "descent speed"),
        "WPNAV_ACCEL": ParameterSpec(250.0, 50.0, 500.0, "cm/s/s", "horizontal acceleration"),
        "WPNAV_ACCEL_C": ParameterSpec(
            0.0, 0.0, 500.0, "cm/s/s", "acceleration in corners; 0 is twice WPNAV_ACCEL"
        ),
        "WPNAV_ACCEL_Z": ParameterSpec(100.0, 50.0, 500.0, "cm/s/s", "vertical acceleration"),
        "WPNAV_JERK": ParameterSpec(1.0, 1.0, 20.0, "m/s/s/s", "horizontal jerk"),
        "WPNAV_RADIUS": ParameterSpec(200.0, 5.0, 1000.0, "cm", "distance at which a waypoint is reached"),
        "WP_YAW_BEHAVIOR": ParameterSpec(
            2.0, 0.0, 3.0, "", "0 keeps the heading, 1 ahead, 2 not on RTL", integer=True
        ),
        "RTL_ALT": ParameterSpec(1500.0, 30.0, 300_000.0, "cm", "least return altitude", integer=True),
        "RTL_SPEED": ParameterSpec(
            0.0, 0.0, 2000.0, "cm/s", "speed of the return; 0 is WPNAV_SPEED", integer=True
        ),
        "RTL_CONE_SLOPE": ParameterSpec(
            3.0, 0.0, 10.0, "", "slope of the cone in which it climbs less; 0 is none"
        ),
        "RTL_CLIMB_MIN": ParameterSpec(0.0, 0.0, 3000.0, "cm", "least climb before the return", integer=True),
        "RTL_LOIT_TIME": ParameterSpec(5000.0, 0.0, 60_000.0, "ms", "wait above home", integer=True),
        "LAND_SPEED": ParameterSpec(50.0, 30.0, 200.0, "cm/s", "last descent speed", integer=True),
        "LAND_SPEED_HIGH": ParameterSpec(
            0.0, 0.0, 500.0, "cm/s", "first one; 0 is WPNAV_SPEED_DN", integer=True
        ),
        "LAND_ALT_LOW": ParameterSpec(
            1000.0, 100.0, 10_000.0, "cm", "height of the last descent", integer=True
        ),
        "PILOT_TKOFF_ALT": ParameterSpec(0.0, 0.0, 1000.0, "cm", "height of a take-off that sets none"),
        "TKOFF_SLEW_TIME": ParameterSpec(2.0, 0.25, 5.0, "s", "throttle from none to full at take-off"),
        "MOT_SPOOL_TIME": ParameterSpec(0.5, 0.05, 2.0, "s", "spooling up of the motors"),
        "ANGLE_MAX": ParameterSpec(3000.0, 1000.0, 8000.0, "cdeg", "largest lean angle", integer=True),
        "ATC_INPUT_TC": ParameterSpec(0.15, 0.0, 1.0, "s", "time constant of the attitude target"),
        "ATC_ACCEL_R_MAX": ParameterSpec(
            110_000.0, 0.0, 180_000.0, "cdeg/s/s", "roll acceleration; 0 is no limit"
        ),
        "ATC_ACCEL_P_MAX": ParameterSpec(
            110_000.0, 0.0, 180_000.0, "cdeg/s/s", "pitch acceleration; 0 is no limit"
        ),
        "ATC_ACCEL_Y_MAX": ParameterSpec(27_000.0, 0.0, 72_000.0, "cdeg/s/s", "yaw acceleration"),
        "ATC_RATE_R_MAX": ParameterSpec(0.0, 0.0, 1080.0, "deg/s", "roll rate; 0 is no limit"),
        "ATC_RATE_P_MAX": ParameterSpec(0.0, 0.0, 1080.0, "deg/s", "pitch rate; 0 is no limit"),
        "ATC_SLEW_YAW": ParameterSpec(6000.0, 500.0, 18_000.0, "cdeg/s", "yaw rate"),
        "PSC_POSXY_P": ParameterSpec(1.0, 0.5, 2.0, "", "horizontal position gain"),
        "PSC_VELXY_P": ParameterSpec(2.0, 0.1, 6.0, "", "horizontal velocity gain"),
        "PSC_VELXY_I": ParameterSpec(1.0, 0.0, 1.0, "", "horizontal velocity integral gain"),
        "PSC_VELXY_D": ParameterSpec(0.25, 0.0, 1.0, "", "horizontal velocity derivative gain"),
        "PSC_VELXY_IMAX": ParameterSpec(
            1000.0, 0.0, 4500.0, "cm/s/s", "most that the integral part may ask for"
        ),
        "PSC_VELXY_FLTE": ParameterSpec(5.0, 0.0, 100.0, "Hz", "filter of the velocity error"),
        "PSC_VELXY_FLTD": ParameterSpec(5.0, 0.0, 100.0, "Hz", "filter of its derivative"),
        "PSC_POSZ_P": ParameterSpec(1.0, 0.5, 3.0, "", "vertical position gain"),
        "PSC_VELZ_P": ParameterSpec(5.0, 1.0, 8.0, "", "vertical velocity gain"),
        "PSC_VELZ_FLTE": ParameterSpec(5.0, 0.0, 100.0, "Hz", "filter of the vertical velocity error"),
        "PSC_ACCZ_P": ParameterSpec(0.5, 0.2, 1.5, "", "vertical acceleration gain"),
        "PSC_ACCZ_I": ParameterSpec(1.0, 0.0, 3.0, "", "vertical acceleration integral gain"),
        "PSC_ACCZ_IMAX": ParameterSpec(800.0, 0.0, 1000.0, "d%", "most of its integral part"),
        "PSC_ACCZ_FLTT": ParameterSpec(0.0, 0.0, 50.0, "Hz", "filter of the vertical acceleration target"),
        "PSC_ACCZ_FLTE": ParameterSpec(20.0, 0.0, 100.0, "Hz", "filter of the vertical acceleration error"),
        "PSC_ANGLE_MAX": ParameterSpec(
            0.0, 0.0, 45.0, "deg", "largest lean angle of the autopilot; 0 is ANGLE_MAX"
        ),
        "PSC_JERK_XY": ParameterSpec(5.0, 1.0, 20.0, "m/s/s/s", "horizontal jerk without waypoints"),
        "PSC_JERK_Z": ParameterSpec(5.0, 5.0, 50.0, "m/s/s/s", "vertical jerk without waypoints"),
    }
)


def lookup(spec: VehicleSpec) -> Callable[[str], float]:
    """Return a lookup function for a vehicle's parameters."""
    own = dict(spec.parameters)

    def get(name: str) -> float:
        return own[name] if name in own else PARAMETERS[name].default

    return get


# The airframe of ArduPilot's simulator (`SIM_Frame.h`, default model): 3 kg, 0.18 m2 of discs, and as much
# drag at 15.08 m/s as 45 degrees of tilt overcome; the momentum drag of the rotors, a part of it, is linear.
# Its coefficient (0.2 there) is the one with which speed builds up as in recorded flights at 5 to 10 m/s.
_MASS_KG, _DISC_M2, _MOMENTUM = 3.0, 0.18, 0.34
_REFERENCE_M_S, _REFERENCE_RAD = 15.08, math.radians(45.0)
_AIR_KG_M3, _REFERENCE_AIR_KG_M3 = 1.225, 1.157


def drag_of(spec: VehicleSpec) -> tuple[float, float]:
    """Return the drag over mass and airspeed: the constant part (1/s), and the one over airspeed (1/m)."""
    if spec.linear_drag_1_s is not None:
        return spec.linear_drag_1_s, 0.0
    weight = _MASS_KG * GRAVITY_M_S2
    momentum = _MOMENTUM * math.sqrt(weight * _AIR_KG_M3 * _DISC_M2)
    whole = weight * math.tan(_REFERENCE_RAD)
    rest = whole - momentum * math.cos(_REFERENCE_RAD) * _REFERENCE_M_S
    rest *= _AIR_KG_M3 / _REFERENCE_AIR_KG_M3
    return momentum / _MASS_KG, rest / _REFERENCE_M_S**2 / _MASS_KG


def fastest_airspeed_m_s(spec: VehicleSpec) -> float:
    """Return the airspeed at which the drag takes all the lean that is allowed."""
    get = lookup(spec)
    lean = math.radians(get("PSC_ANGLE_MAX") or 0.01 * get("ANGLE_MAX"))
    most, (linear, square) = GRAVITY_M_S2 * math.tan(lean), drag_of(spec)
    if square > 0.0:
        return (math.sqrt(linear * linear + 4.0 * square * most) - linear) / (2.0 * square)
    return most / linear if linear > 0.0 else math.inf
