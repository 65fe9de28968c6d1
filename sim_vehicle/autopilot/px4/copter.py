"""PX4 with a multirotor: its parameters, and how it takes off, lands and comes home.

Names, defaults and ranges from PX4 v1.17 (``multicopter_*_params.yaml``, ``navigator``, ``commander``,
``land_detector``) with the defaults of multirotors (``rc.mc_defaults``).
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.spec import GRAVITY_M_S2
from sim_vehicle.autopilot.model import Setting, setting, vertical_landing
from sim_vehicle.motion.legs import KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

_TABLE = {
    "MPC_XY_CRUISE": Setting(5.0, 3.0, 20.0, "m/s", "horizontal speed that no mission sets"),
    "MPC_XY_VEL_MAX": Setting(12.0, 0.0, 20.0, "m/s", "greatest horizontal speed"),
    "MPC_ACC_HOR": Setting(3.0, 2.0, 15.0, "m/s^2", "horizontal acceleration"),
    "MPC_JERK_AUTO": Setting(4.0, 1.0, 80.0, "m/s^3", "jerk"),
    "MPC_XY_TRAJ_P": Setting(0.5, 0.1, 1.0, "", "share of the acceleration in corners"),
    "MPC_XY_ERR_MAX": Setting(2.0, 0.1, 10.0, "m", "distance behind at which the trajectory waits"),
    "MPC_XY_P": Setting(0.95, 0.0, 2.0, "1/s", "gain of the horizontal position"),
    "MPC_Z_P": Setting(1.0, 0.1, 1.5, "1/s", "gain of the height"),
    "MPC_XY_VEL_P_ACC": Setting(1.8, 1.2, 5.0, "1/s", "proportional gain of the horizontal velocity"),
    "MPC_XY_VEL_I_ACC": Setting(0.4, 0.0, 60.0, "1/s^2", "integral gain of the horizontal velocity"),
    "MPC_XY_VEL_D_ACC": Setting(0.2, 0.1, 2.0, "", "derivative gain of the horizontal velocity"),
    "MPC_Z_VEL_P_ACC": Setting(4.0, 2.0, 15.0, "1/s", "proportional gain of the vertical velocity"),
    "MPC_Z_VEL_I_ACC": Setting(2.0, 0.2, 3.0, "1/s^2", "integral gain of the vertical velocity"),
    "MPC_Z_VEL_D_ACC": Setting(0.0, 0.0, 2.0, "", "derivative gain of the vertical velocity"),
    "MPC_Z_V_AUTO_UP": Setting(3.0, 0.5, 8.0, "m/s", "climb speed"),
    "MPC_Z_V_AUTO_DN": Setting(1.5, 0.5, 4.0, "m/s", "descent speed"),
    "MPC_Z_VEL_MAX_UP": Setting(3.0, 0.5, 8.0, "m/s", "greatest climb speed"),
    "MPC_Z_VEL_MAX_DN": Setting(1.5, 0.5, 4.0, "m/s", "greatest descent speed"),
    "MPC_ACC_UP_MAX": Setting(4.0, 2.0, 15.0, "m/s^2", "upward acceleration"),
    "MPC_ACC_DOWN_MAX": Setting(3.0, 2.0, 15.0, "m/s^2", "downward acceleration"),
    "MPC_TILTMAX_AIR": Setting(45.0, 20.0, 89.0, "deg", "greatest tilt"),
    "MPC_YAWRAUTO_MAX": Setting(60.0, 5.0, 360.0, "deg/s", "rate of turning"),
    "MPC_YAWRAUTO_ACC": Setting(20.0, 5.0, 360.0, "deg/s^2", "acceleration of turning"),
    "MPC_TKO_SPEED": Setting(1.5, 1.0, 5.0, "m/s", "climb speed of a take-off"),
    "MPC_TKO_RAMP_T": Setting(3.0, 0.0, 5.0, "s", "time of the thrust's build-up"),
    "MPC_LAND_SPEED": Setting(0.7, 0.6, 10.0, "m/s", "landing speed"),
    "MPC_LAND_ALT1": Setting(10.0, 0.0, 122.0, "m", "height at which a landing begins to slow down"),
    "MPC_LAND_ALT2": Setting(5.0, 0.0, 122.0, "m", "height from which the landing speed holds"),
    "MPC_LAND_ALT3": Setting(1.0, 0.0, 122.0, "m", "height from which the crawl speed holds"),
    "MPC_LAND_CRWL": Setting(0.3, 0.1, 10.0, "m/s", "crawl speed"),
    "NAV_ACC_RAD": Setting(2.0, 0.05, 200.0, "m", "acceptance radius"),
    "NAV_MC_ALT_RAD": Setting(0.8, 0.05, 200.0, "m", "height within which a waypoint is reached"),
    "MIS_TAKEOFF_ALT": Setting(2.5, 0.0, 80.0, "m", "least height of a take-off"),
    "MIS_YAW_ERR": Setting(12.0, 0.0, 90.0, "deg", "heading within which a waypoint is reached"),
    "RTL_RETURN_ALT": Setting(30.0, 0.0, 150.0, "m", "height of the way home"),
    "RTL_DESCEND_ALT": Setting(10.0, 0.0, 100.0, "m", "height to wait at before the landing"),
    "RTL_LAND_DELAY": Setting(0.0, -1.0, 300.0, "s", "time to wait there; -1 is for ever"),
    "RTL_MIN_DIST": Setting(10.0, 0.5, 100.0, "m", "distance within which the return may be lower"),
    "RTL_CONE_ANG": Setting(45.0, 0.0, 90.0, "deg", "half angle of the cone of lower returns", integer=True),
    "COM_DISARM_LAND": Setting(2.0, -1.0, 20.0, "s", "time from landing to disarming; 0 never"),
    "COM_SPOOLUP_TIME": Setting(1.0, 0.0, 30.0, "s", "time from arming to thrust"),
    "LNDMC_TRIG_TIME": Setting(1.0, 0.1, 10.0, "s", "time of each of the three stages of landing detection"),
}
# SIH_KDV over SIH_MASS of the SIH quadrotor (airframe 10040).
SIH_DRAG_1_S = 1.0
# For ever, as far as a flight is concerned.
_FOREVER_S = 1e6
_NEVER_DISARM_S = 3599.0


def value_of(spec: VehicleSpec, name: str) -> float:
    """Return the value of a parameter for a vehicle, in the parameter's own unit."""
    return setting(spec, name, PX4_MULTIROTOR.settings)


def drag_of(spec: VehicleSpec) -> float:
    """Return the drag over mass and airspeed (1/s): the vehicle's, or that of the reference airframe."""
    return SIH_DRAG_1_S if spec.linear_drag_1_s is None else spec.linear_drag_1_s


class Px4MultirotorAutopilot:
    """See `sim_vehicle.autopilot.model.FlightProcedures`."""

    name = "px4"
    settings: Mapping[str, Setting] = MappingProxyType(_TABLE)

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with the speeds, heights and limits that its parameters say."""

        def value(name: str) -> float:
            return value_of(spec, name)

        fastest = max(value("MPC_XY_VEL_MAX"), 0.5)
        disarm = value("COM_DISARM_LAND")
        lean = GRAVITY_M_S2 * math.tan(math.radians(value("MPC_TILTMAX_AIR")))
        drag = drag_of(spec)
        return replace(
            spec,
            cruise_speed_m_s=min(value("MPC_XY_CRUISE"), fastest),
            # Missions may command 95 % of the limit.
            speed_limit_m_s=fastest / 0.95,
            airspeed_limit_m_s=min(spec.airspeed_limit_m_s, lean / drag if drag > 0.0 else math.inf),
            climb_speed_m_s=value("MPC_Z_V_AUTO_UP"),
            descent_speed_m_s=value("MPC_Z_V_AUTO_DN"),
            landing_speed_m_s=min(value("MPC_LAND_SPEED"), value("MPC_Z_VEL_MAX_DN")),
            acceleration_m_s2=value("MPC_ACC_HOR"),
            jerk_m_s3=value("MPC_JERK_AUTO"),
            vertical_acceleration_m_s2=min(value("MPC_ACC_UP_MAX"), value("MPC_ACC_DOWN_MAX")),
            vertical_jerk_m_s3=value("MPC_JERK_AUTO"),
            yaw_rate_rad_s=math.radians(value("MPC_YAWRAUTO_MAX")),
            yaw_acceleration_rad_s2=math.radians(value("MPC_YAWRAUTO_ACC")),
            acceptance_radius_m=value("NAV_ACC_RAD"),
            takeoff_altitude_m=max(value("MIS_TAKEOFF_ALT"), 0.5),
            return_altitude_m=max(value("RTL_RETURN_ALT"), 0.5),
            disarm_delay_s=disarm if disarm > 0.0 else _NEVER_DISARM_S,
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle that stands at home."""
        from sim_vehicle.motion.px4.model import Px4Multirotor

        return Px4Multirotor(spec, wind, yaw_rad)

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the legs of a take-off: straight up, then to its place if that is aside."""
        x, y, z = target
        radius = spec.acceptance_radius_m
        height = max(z, here[2], value_of(spec, "MIS_TAKEOFF_ALT"))
        legs = [Leg((here[0], here[1], height), speed, radius, KEEP, LegKind.TAKEOFF)]
        if math.hypot(x - here[0], y - here[1]) > radius:
            legs.append(Leg((x, y, height), speed, radius, heading))
        return legs

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs to a place, unless it is within the acceptance radius, and down to the ground."""
        x, y, z = above
        legs: list[Leg] = []
        if math.hypot(x - last[0], y - last[1]) > spec.acceptance_radius_m:
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
        """Return the legs home: up, home at the cruise speed, down to wait if so told, and down."""
        x, y, z = last
        home_x, home_y, least = haven
        cruise = spec.cruise_speed_m_s
        height = return_height_m(spec, math.hypot(x - home_x, y - home_y), z, least)
        legs: list[Leg] = []
        if z < height:
            legs.append(Leg((x, y, height), cruise, heading=KEEP, kind=LegKind.CLIMB))
        legs.append(Leg((home_x, home_y, height), cruise, kind=LegKind.HOME))
        delay = value_of(spec, "RTL_LAND_DELAY")
        if delay != 0.0:
            wait = min(value_of(spec, "RTL_DESCEND_ALT"), height)
            pause = delay if delay > 0.0 else _FOREVER_S
            over = (home_x, home_y, wait)
            legs.append(Leg(over, cruise, heading=KEEP, kind=LegKind.DESCEND, pause_s=pause))
        legs.append(vertical_landing(spec, home_x, home_y))
        return legs


def return_height_m(spec: VehicleSpec, distance_m: float, height_m: float, least_m: float = 0.0) -> float:
    """Return the height of the way home: lower within a cone about home, never lower than the vehicle is.

    PX4 v1.17, ``RTL::calculate_return_alt_from_cone_half_angle``.

    Examples
    --------
    >>> from sim_vehicle.autopilot import with_autopilot
    >>> from sim_vehicle.airframe.spec import get_vehicle
    >>> quad = with_autopilot(get_vehicle("quad"), "px4")
    >>> [round(return_height_m(quad, d, 3.0), 1) for d in (1.0, 6.0, 9.0, 50.0)]
    [3.0, 6.0, 9.0, 30.0]
    """
    most = max(value_of(spec, "RTL_RETURN_ALT"), least_m)
    radius = value_of(spec, "NAV_ACC_RAD")
    angle = value_of(spec, "RTL_CONE_ANG")
    height = most
    if angle > 0.0:
        if distance_m <= radius:
            height = 2.0 * distance_m
        else:
            if distance_m <= value_of(spec, "RTL_MIN_DIST"):
                height = min(distance_m / math.tan(math.radians(min(max(angle, 1.0), 89.0))), most)
            height = max(height, 2.0 * radius)
    return max(min(height, most), height_m)


PX4_MULTIROTOR = Px4MultirotorAutopilot()
