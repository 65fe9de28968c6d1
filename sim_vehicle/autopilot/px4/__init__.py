"""PX4 1.17 for multirotors: take-off, landing and return, and the autopilot.

Add-ons derive PX4's firmwares for fixed wings and rovers from the firmware of this module.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from mission.autopilots import PX4 as PROFILE
from mission.link.codec.dialect import mavlink as m
from mission.planners.cornering import Cornering
from sim_vehicle.airframe.navigation_errors import carried_aside_m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot import Autopilot, Firmware
from sim_vehicle.autopilot.parameters import motion_parameters, reference_parameters
from sim_vehicle.autopilot.procedures import FlightProcedures, over_and_down, vertical_landing
from sim_vehicle.autopilot.px4.firmware import (
    COPTER_STICKS,
    LINK_NAMES,
    MISSION,
    RULES,
    copter_parameters,
    drag_of,
    mavlink_profile,
    simulator_urls,
)
from sim_vehicle.motion.legs import KEEP, Leg, LegKind

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

__all__ = ["PX4", "no_multirotor"]

# These are MPC_THR_MIN and 1 / MC_ROLL_P of the reference airframe (SIH 10040).
_LOWEST_THRUST = 0.12
_SIH_ATTITUDE_S = 1.0 / 6.5
# This pause is longer than any flight.
_FOREVER_S = 1e6
_NEVER_DISARM_S = 3599.0


class Px4MultirotorProcedures(FlightProcedures):
    """Flight procedures of PX4 multirotors."""

    name = "px4"
    parameters = motion_parameters("px4-multirotor-motion")
    orbit_within_m = 2.0  # This is _horizontal_acceptance_radius of FlightTaskOrbit.

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with speeds, heights and limits from its parameters."""
        value = self.values(spec)
        fastest = max(value["MPC_XY_VEL_MAX"], 0.5)
        disarm = value["COM_DISARM_LAND"]
        lean = GRAVITY_M_S2 * math.tan(math.radians(value["MPC_TILTMAX_AIR"]))
        drag = drag_of(spec)
        return replace(
            spec,
            cruise_speed_m_s=min(value["MPC_XY_CRUISE"], fastest),
            # Missions may command 95 % of `speed_limit_m_s`.
            speed_limit_m_s=fastest / 0.95,
            airspeed_limit_m_s=min(spec.airspeed_limit_m_s, lean / drag if drag > 0.0 else math.inf),
            climb_speed_m_s=value["MPC_Z_V_AUTO_UP"],
            descent_speed_m_s=value["MPC_Z_V_AUTO_DN"],
            landing_speed_m_s=min(value["MPC_LAND_SPEED"], value["MPC_Z_VEL_MAX_DN"]),
            acceleration_m_s2=value["MPC_ACC_HOR"],
            jerk_m_s3=value["MPC_JERK_AUTO"],
            vertical_acceleration_m_s2=min(value["MPC_ACC_UP_MAX"], value["MPC_ACC_DOWN_MAX"]),
            vertical_jerk_m_s3=value["MPC_JERK_AUTO"],
            yaw_rate_rad_s=math.radians(value["MPC_YAWRAUTO_MAX"]),
            yaw_acceleration_rad_s2=math.radians(value["MPC_YAWRAUTO_ACC"]),
            acceptance_radius_m=value["NAV_ACC_RAD"],
            takeoff_altitude_m=max(value["MIS_TAKEOFF_ALT"], 0.5),
            return_altitude_m=max(value["RTL_RETURN_ALT"], 0.5),
            disarm_delay_s=disarm if disarm > 0.0 else _NEVER_DISARM_S,
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion model of a multirotor under PX4 that stands at home."""
        from sim_vehicle.motion.px4.model import Px4Multirotor

        return Px4Multirotor(spec, self.law, wind, yaw_rad)

    def law(self, spec: VehicleSpec) -> NDArray[np.float64]:
        """Return the constants of the compiled motion, `sim_vehicle.motion.px4.kernel.LAW`."""
        from sim_vehicle.motion.columns import row_of
        from sim_vehicle.motion.px4.kernel import LAW, SIH_THRUST_M_S2

        number = self.numbers(spec)
        response = spec.attitude_response_s
        number |= {
            "dt": spec.step_s,
            "takeoff_speed": min(number["takeoff_speed"], number["max_up"]),
            "land_speed": min(number["land_speed"], number["max_down"]),
            "land_alt1": max(number["land_alt1"], number["land_alt2"]),
            # The land detector has three stages; with a distance sensor each stage takes LNDMC_TRIG_TIME.
            "land_time": 3.0 * number["land_time"],
            "drag": drag_of(spec),
            "attitude": 1.0 / (_SIH_ATTITUDE_S if response is None else response),
            "thrust_low": _LOWEST_THRUST * SIH_THRUST_M_S2,
            "thrust_high": SIH_THRUST_M_S2,
        }
        return row_of(LAW, number)

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the legs of a take-off: straight up, then to the position of the item if it is elsewhere."""
        x, y, z = target
        radius = spec.acceptance_radius_m
        height = max(z, here[2], self.value(spec, "MIS_TAKEOFF_ALT"))
        legs = [Leg((here[0], here[1], height), speed, radius, KEEP, LegKind.TAKEOFF)]
        if math.hypot(x - here[0], y - here[1]) > radius:
            legs.append(Leg((x, y, height), speed, radius, heading))
        return legs

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the leg to a position (none within the acceptance radius), and the leg straight down."""
        return over_and_down(spec, above, last, speed, spec.acceptance_radius_m)

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return the legs of a return: climb, home at cruise speed, optional loiter, landing."""
        x, y, z = last
        home_x, home_y, least = return_point
        cruise = spec.cruise_speed_m_s
        distance = math.hypot(x - home_x, y - home_y) + spec.return_margin_m
        height = return_height_m(spec, distance, z, least)
        legs: list[Leg] = []
        if z < height:
            legs.append(Leg((x, y, height), cruise, heading=KEEP, kind=LegKind.CLIMB))
        legs.append(Leg((home_x, home_y, height), cruise, kind=LegKind.HOME))
        delay = self.value(spec, "RTL_LAND_DELAY")
        if delay != 0.0:
            wait = min(self.value(spec, "RTL_DESCEND_ALT"), height)
            pause = delay if delay > 0.0 else _FOREVER_S
            over = (home_x, home_y, wait)
            legs.append(Leg(over, cruise, heading=KEEP, kind=LegKind.DESCEND, pause_s=pause))
        legs.append(vertical_landing(spec, home_x, home_y))
        return legs


def return_height_m(spec: VehicleSpec, distance_m: float, height_m: float, least_m: float = 0.0) -> float:
    """Return the return altitude, which is lower within a cone round home but never below `height_m`.

    Source: PX4 v1.17, ``RTL::calculate_return_alt_from_cone_half_angle``.

    Examples
    --------
    >>> from sim_vehicle.autopilot import with_autopilot
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> quad = with_autopilot(get_vehicle("quad"), "px4")
    >>> [round(return_height_m(quad, d, 3.0), 1) for d in (1.0, 6.0, 9.0, 50.0)]
    [3.0, 6.0, 9.0, 30.0]
    """
    value = PX4_MULTIROTOR.value
    most = max(value(spec, "RTL_RETURN_ALT"), least_m)
    radius = value(spec, "NAV_ACC_RAD")
    angle = value(spec, "RTL_CONE_ANG")
    height = most
    if angle > 0.0:
        if distance_m <= radius:
            height = 2.0 * distance_m
        else:
            if distance_m <= value(spec, "RTL_MIN_DIST"):
                height = min(distance_m / math.tan(math.radians(min(max(angle, 1.0), 89.0))), most)
            height = max(height, 2.0 * radius)
    return max(min(height, most), height_m)


def strays_m(spec: VehicleSpec) -> float:
    """Return the lateral drift due to estimate errors, as the standard deviation per axis (m)."""
    return carried_aside_m(PX4_MULTIROTOR.value(spec, "MPC_XY_P"))


PX4_MULTIROTOR = Px4MultirotorProcedures()
# Prefixes of parameters of the multirotor's controllers.
_OF_MULTIROTORS = ("FLW_", "HTE_", "LNDMC_", "MC_", "MPC_")
PX4 = Autopilot(
    name="px4",
    title="PX4",
    firmwares={
        "multirotor": Firmware(
            title="PX4",
            mavlink=mavlink_profile(m.MAV_TYPE_QUADROTOR),
            rules=RULES,
            profile=PROFILE,
            parameter_table=copter_parameters,
            procedures=PX4_MULTIROTOR,
            takes_off=True,
            behaviour=MISSION,
            # Default of NAV_ACC_RAD. PX4 misses smaller radii, because its estimated height is 0.55 m off.
            cornering=Cornering(2.0, overshoots=True),
            reference=partial(reference_parameters, "px4"),
            sticks=COPTER_STICKS,
            strays_m=strays_m,
            return_height=("RTL_RETURN_ALT", 1.0),
        )
    },
    simulator_urls=simulator_urls,
    link_names=LINK_NAMES,
)


def no_multirotor(mav_type: int) -> Firmware:
    """Return the part of the firmware that other kinds of vehicles share with multirotors."""
    return replace(
        PX4.firmwares["multirotor"],
        mavlink=mavlink_profile(mav_type),
        reference=partial(reference_parameters, "px4", without=_OF_MULTIROTORS),
        strays_m=None,
        return_height=None,
    )
