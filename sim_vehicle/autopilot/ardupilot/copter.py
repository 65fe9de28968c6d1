"""ArduCopter: its parameters that move a multirotor, its take-off, landing and way home.

Names, units, ranges and defaults are those of ArduCopter 4.6; 4.7 renamed many of them and counts in metres.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.spec import GRAVITY_M_S2
from sim_vehicle.autopilot.model import Setting, vertical_landing
from sim_vehicle.motion.legs import ALONG, KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

SETTINGS: Mapping[str, Setting] = MappingProxyType(
    {
        "WPNAV_SPEED": Setting(1000.0, 20.0, 2000.0, "cm/s", "horizontal speed"),
        "WPNAV_SPEED_UP": Setting(250.0, 10.0, 1000.0, "cm/s", "climb speed"),
        "WPNAV_SPEED_DN": Setting(150.0, 10.0, 500.0, "cm/s", "descent speed"),
        "WPNAV_ACCEL": Setting(250.0, 50.0, 500.0, "cm/s/s", "horizontal acceleration"),
        "WPNAV_ACCEL_C": Setting(
            0.0, 0.0, 500.0, "cm/s/s", "acceleration in corners; 0 is twice WPNAV_ACCEL"
        ),
        "WPNAV_ACCEL_Z": Setting(100.0, 50.0, 500.0, "cm/s/s", "vertical acceleration"),
        "WPNAV_JERK": Setting(1.0, 1.0, 20.0, "m/s/s/s", "horizontal jerk"),
        "WPNAV_RADIUS": Setting(200.0, 5.0, 1000.0, "cm", "distance at which a waypoint is reached"),
        "WP_YAW_BEHAVIOR": Setting(
            2.0, 0.0, 3.0, "", "0 keeps the heading, 1 ahead, 2 not on RTL", integer=True
        ),
        "RTL_ALT": Setting(1500.0, 30.0, 300_000.0, "cm", "least height of the way home", integer=True),
        "RTL_SPEED": Setting(
            0.0, 0.0, 2000.0, "cm/s", "speed of the way home; 0 is WPNAV_SPEED", integer=True
        ),
        "RTL_CONE_SLOPE": Setting(3.0, 0.0, 10.0, "", "slope of the cone in which it climbs less; 0 is none"),
        "RTL_CLIMB_MIN": Setting(0.0, 0.0, 3000.0, "cm", "least climb before the way home", integer=True),
        "RTL_LOIT_TIME": Setting(5000.0, 0.0, 60_000.0, "ms", "wait above home", integer=True),
        "LAND_SPEED": Setting(50.0, 30.0, 200.0, "cm/s", "last descent speed", integer=True),
        "LAND_SPEED_HIGH": Setting(0.0, 0.0, 500.0, "cm/s", "first one; 0 is WPNAV_SPEED_DN", integer=True),
        "LAND_ALT_LOW": Setting(1000.0, 100.0, 10_000.0, "cm", "height of the last descent", integer=True),
        "PILOT_TKOFF_ALT": Setting(0.0, 0.0, 1000.0, "cm", "height of a take-off that sets none"),
        "TKOFF_SLEW_TIME": Setting(2.0, 0.25, 5.0, "s", "throttle from none to full at take-off"),
        "MOT_SPOOL_TIME": Setting(0.5, 0.05, 2.0, "s", "spooling up of the motors"),
        "ANGLE_MAX": Setting(3000.0, 1000.0, 8000.0, "cdeg", "largest lean angle", integer=True),
        "ATC_INPUT_TC": Setting(0.15, 0.0, 1.0, "s", "time constant of the attitude target"),
        "ATC_ACCEL_R_MAX": Setting(110_000.0, 0.0, 180_000.0, "cdeg/s/s", "roll acceleration; 0 is no limit"),
        "ATC_ACCEL_P_MAX": Setting(
            110_000.0, 0.0, 180_000.0, "cdeg/s/s", "pitch acceleration; 0 is no limit"
        ),
        "ATC_ACCEL_Y_MAX": Setting(27_000.0, 0.0, 72_000.0, "cdeg/s/s", "yaw acceleration"),
        "ATC_RATE_R_MAX": Setting(0.0, 0.0, 1080.0, "deg/s", "roll rate; 0 is no limit"),
        "ATC_RATE_P_MAX": Setting(0.0, 0.0, 1080.0, "deg/s", "pitch rate; 0 is no limit"),
        "ATC_SLEW_YAW": Setting(6000.0, 500.0, 18_000.0, "cdeg/s", "yaw rate"),
        "PSC_POSXY_P": Setting(1.0, 0.5, 2.0, "", "horizontal position gain"),
        "PSC_VELXY_P": Setting(2.0, 0.1, 6.0, "", "horizontal velocity gain"),
        "PSC_VELXY_I": Setting(1.0, 0.0, 1.0, "", "horizontal velocity integral gain"),
        "PSC_VELXY_D": Setting(0.25, 0.0, 1.0, "", "horizontal velocity derivative gain"),
        "PSC_VELXY_IMAX": Setting(1000.0, 0.0, 4500.0, "cm/s/s", "most that the integral part may ask for"),
        "PSC_VELXY_FLTE": Setting(5.0, 0.0, 100.0, "Hz", "filter of the velocity error"),
        "PSC_VELXY_FLTD": Setting(5.0, 0.0, 100.0, "Hz", "filter of its derivative"),
        "PSC_POSZ_P": Setting(1.0, 0.5, 3.0, "", "vertical position gain"),
        "PSC_VELZ_P": Setting(5.0, 1.0, 8.0, "", "vertical velocity gain"),
        "PSC_VELZ_FLTE": Setting(5.0, 0.0, 100.0, "Hz", "filter of the vertical velocity error"),
        "PSC_ACCZ_P": Setting(0.5, 0.2, 1.5, "", "vertical acceleration gain"),
        "PSC_ACCZ_I": Setting(1.0, 0.0, 3.0, "", "vertical acceleration integral gain"),
        "PSC_ACCZ_IMAX": Setting(800.0, 0.0, 1000.0, "d%", "most of its integral part"),
        "PSC_ACCZ_FLTT": Setting(0.0, 0.0, 50.0, "Hz", "filter of the vertical acceleration target"),
        "PSC_ACCZ_FLTE": Setting(20.0, 0.0, 100.0, "Hz", "filter of the vertical acceleration error"),
        "PSC_ANGLE_MAX": Setting(
            0.0, 0.0, 45.0, "deg", "largest lean angle of the autopilot; 0 is ANGLE_MAX"
        ),
        "PSC_JERK_XY": Setting(5.0, 1.0, 20.0, "m/s/s/s", "horizontal jerk without waypoints"),
        "PSC_JERK_Z": Setting(5.0, 5.0, 50.0, "m/s/s/s", "vertical jerk without waypoints"),
    }
)
_RTL_ALT_MIN_M = 2.0
_LEAST_CONE = 0.5
# From landed to disarmed: the motors spool down.
_SPOOL_DOWN_S = 0.35


def lookup(spec: VehicleSpec) -> Callable[[str], float]:
    """Return what tells the parameters of a vehicle by their names."""
    own = dict(spec.parameters)

    def get(name: str) -> float:
        return own[name] if name in own else SETTINGS[name].default

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


class ArduCopterAutopilot:
    """See `sim_vehicle.autopilot.model.FlightProcedures`."""

    name = "ardupilot"
    settings: Mapping[str, Setting] = SETTINGS

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with those of its values that parameters decide."""
        get = lookup(spec)
        return replace(
            spec,
            cruise_speed_m_s=min(0.01 * get("WPNAV_SPEED"), spec.top_speed_m_s),
            climb_speed_m_s=0.01 * get("WPNAV_SPEED_UP"),
            descent_speed_m_s=0.01 * get("WPNAV_SPEED_DN"),
            landing_speed_m_s=0.01 * get("LAND_SPEED"),
            airspeed_limit_m_s=min(spec.airspeed_limit_m_s, fastest_airspeed_m_s(spec)),
            acceleration_m_s2=0.01 * get("WPNAV_ACCEL"),
            vertical_acceleration_m_s2=0.01 * get("WPNAV_ACCEL_Z"),
            yaw_rate_rad_s=math.radians(0.01 * get("ATC_SLEW_YAW")),
            yaw_acceleration_rad_s2=math.radians(0.01 * (get("ATC_ACCEL_Y_MAX") or 72_000.0)),
            acceptance_radius_m=0.01 * get("WPNAV_RADIUS"),
            takeoff_altitude_m=0.01 * get("PILOT_TKOFF_ALT") or spec.takeoff_altitude_m,
            return_altitude_m=0.01 * get("RTL_ALT"),
            disarm_delay_s=_SPOOL_DOWN_S,
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle that stands at home."""
        from sim_vehicle.motion.arducopter.model import ArduCopter

        return ArduCopter(spec, wind, yaw_rad)

    def takeoff_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        here: Position,
        target: Position,
        speed: float,
        heading: Heading,
    ) -> list[Leg]:
        """Return the leg of a take-off: straight up, wherever its place is."""
        keep = KEEP if heading == ALONG else heading
        top = (here[0], here[1], max(target[2], here[2]))
        return [Leg(top, speed, heading=keep, kind=LegKind.TAKEOFF)]

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs to a place and down to the ground there."""
        x, y, z = above
        legs: list[Leg] = []
        if math.hypot(x - last[0], y - last[1]) > 0.05:
            legs.append(Leg((x, y, z), speed, kind=LegKind.HOME))
        legs.append(vertical_landing(spec, x, y))
        return legs

    def return_legs(
        self,
        spec: VehicleSpec,
        last: Position,
        speed: float,  # noqa: ARG002
        haven: Position,
    ) -> list[Leg]:
        """Return the legs home: up, less near home, straight home, a wait, and down."""
        get = lookup(spec)
        x, y, z = last
        home_x, home_y, least = haven
        lowest = max(_RTL_ALT_MIN_M, z + 0.01 * get("RTL_CLIMB_MIN"))
        height = max(spec.return_altitude_m, least, lowest)
        slope = get("RTL_CONE_SLOPE")
        if slope >= _LEAST_CONE:
            height = min(height, max(slope * math.hypot(x - home_x, y - home_y), lowest))
        back = 0.01 * get("RTL_SPEED") or spec.cruise_speed_m_s
        look = ALONG if get("WP_YAW_BEHAVIOR") in (1.0, 3.0) else KEEP
        wait = 0.001 * get("RTL_LOIT_TIME")
        return [
            Leg((x, y, height), back, spec.acceptance_radius_m, KEEP, LegKind.CLIMB),
            Leg((home_x, home_y, height), back, heading=look, kind=LegKind.HOME, pause_s=wait),
            vertical_landing(spec, home_x, home_y),
        ]


ARDUCOPTER = ArduCopterAutopilot()
