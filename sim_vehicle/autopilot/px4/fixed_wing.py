"""PX4 with a fixed wing: its parameters, its take-off and its return.

Names, defaults and ranges are those of PX4 1.16 and 1.17 (``fw_lat_long_params.yaml``,
``fw_mode_manager_params.yaml``, ``performance_model_params.c``, ``rc.fw_defaults``, navigator).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec, whole
from sim_vehicle.autopilot.procedures import FixedWingProcedures, airspeeds_in_order
from sim_vehicle.motion.legs import KEEP, Circle, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.fixed_wing.limits import FixedWingLimits
    from sim_vehicle.motion.legs import Position

__all__ = ["PX4_FIXED_WING"]

PARAMETERS: Mapping[str, ParameterSpec] = {
    "FW_AIRSPD_MAX": ParameterSpec(20.0, 0.5, 100.0, "m/s", "greatest airspeed"),
    "FW_AIRSPD_MIN": ParameterSpec(10.0, 0.5, 100.0, "m/s", "least airspeed"),
    "FW_AIRSPD_TRIM": ParameterSpec(15.0, 0.5, 100.0, "m/s", "cruise airspeed"),
    "FW_GND_SPD_MIN": ParameterSpec(5.0, 0.0, 40.0, "m/s", "least ground speed"),
    "FW_LND_AIRSPD": ParameterSpec(-1.0, -1.0, 100.0, "m/s", "landing airspeed"),
    "FW_LND_ANG": ParameterSpec(5.0, 1.0, 45.0, "deg", "steepest landing slope"),
    "FW_LND_FLALT": ParameterSpec(0.5, 0.0, 100.0, "m", "flare height"),
    "FW_LND_FL_SINK": ParameterSpec(0.25, 0.0, 2.0, "m/s", "sink rate in the flare"),
    "FW_LND_FL_TIME": ParameterSpec(1.0, 0.1, 5.0, "s", "flare time"),
    "FW_PN_R_SLEW_MAX": ParameterSpec(90.0, 0.0, 1000.0, "deg/s", "rate of the bank set-point"),
    "FW_R_LIM": ParameterSpec(50.0, 35.0, 75.0, "deg", "greatest bank"),
    "FW_R_RMAX": ParameterSpec(70.0, 0.0, 1000.0, "deg/s", "greatest roll rate"),
    "FW_R_TC": ParameterSpec(0.4, 0.2, 1.0, "s", "time constant of the roll"),
    "FW_THR_TRIM": ParameterSpec(0.6, 0.0, 1.0, "", "throttle of level flight at the cruise airspeed"),
    "FW_TKO_AIRSPD": ParameterSpec(-1.0, -1.0, 100.0, "m/s", "take-off airspeed"),
    "FW_T_ALT_TC": ParameterSpec(5.0, 2.0, 100.0, "s", "time constant of the height"),
    "FW_T_CLMB_MAX": ParameterSpec(5.0, 1.0, 15.0, "m/s", "climb rate at full throttle"),
    "FW_T_CLMB_R_SP": ParameterSpec(3.0, 0.1, 15.0, "m/s", "climb rate"),
    "FW_T_HRATE_FF": ParameterSpec(0.3, 0.0, 1.0, "", "share of a demanded climb rate without lag"),
    "FW_T_RLL2THR": ParameterSpec(15.0, 0.0, 20.0, "", "throttle for turns"),
    "FW_T_SINK_MAX": ParameterSpec(5.0, 1.0, 15.0, "m/s", "greatest sink rate"),
    "FW_T_SINK_MIN": ParameterSpec(2.0, 1.0, 5.0, "m/s", "sink rate without throttle"),
    "FW_T_SINK_R_SP": ParameterSpec(2.0, 0.1, 15.0, "m/s", "sink rate"),
    "FW_T_STE_R_TC": ParameterSpec(0.4, 0.0, 2.0, "s", "filter of the energy rate"),
    "FW_T_TAS_TC": ParameterSpec(5.0, 2.0, 100.0, "s", "time constant of the airspeed"),
    "FW_T_THR_DAMPING": ParameterSpec(0.05, 0.0, 1.0, "", "damping of the throttle"),
    "FW_T_THR_INTEG": ParameterSpec(0.02, 0.0, 1.0, "", "gain of the integral of the throttle"),
    "FW_T_VERT_ACC": ParameterSpec(7.0, 1.0, 10.0, "m/s^2", "vertical acceleration"),
    "MIS_TAKEOFF_ALT": ParameterSpec(30.0, 0.0, 500.0, "m", "take-off height"),
    "NAV_ACC_RAD": ParameterSpec(10.0, 0.05, 200.0, "m", "least acceptance radius"),
    "NAV_FW_ALTL_RAD": ParameterSpec(5.0, 0.05, 200.0, "m", "tolerance of the height before a landing"),
    "NAV_FW_ALT_RAD": ParameterSpec(10.0, 0.05, 200.0, "m", "tolerance of heights"),
    "NAV_LOITER_RAD": ParameterSpec(80.0, -1000.0, 1000.0, "m", "radius of circles, positive clockwise"),
    "NPFG_DAMPING": ParameterSpec(0.7, 0.1, 1.0, "", "damping of the path guidance"),
    "NPFG_PERIOD": ParameterSpec(10.0, 1.0, 100.0, "s", "period of the path guidance"),
    "NPFG_SW_DST_MLT": ParameterSpec(0.32, 0.1, 1.0, "", "share of the track error bound to turn at"),
    "RTL_DESCEND_ALT": ParameterSpec(100.0, 0.0, 500.0, "m", "height of the circle over home"),
    "RTL_LAND_DELAY": ParameterSpec(
        -1.0, -1.0, 3600.0, "s", "circling over home before landing, -1 for ever"
    ),
    "RTL_LOITER_RAD": ParameterSpec(80.0, 25.0, 1000.0, "m", "radius of the circle over home"),
    "RTL_RETURN_ALT": ParameterSpec(100.0, 0.0, 500.0, "m", "return altitude"),
    "RTL_TYPE": whole(0.0, 0.0, 5.0, "", "1, 2: land as the mission does"),
    "RWTO_TKOFF": whole(0.0, 0.0, 1.0, "", "take-off from a runway"),
    "RWTO_MAX_THR": ParameterSpec(1.0, 0.0, 1.0, "", "throttle of the take-off roll"),
    "RWTO_RAMP_TIME": ParameterSpec(2.0, 1.0, 15.0, "s", "rise of the throttle of the take-off roll"),
    "RWTO_ROT_AIRSPD": ParameterSpec(
        -1.0, -1.0, 100.0, "m/s", "airspeed at which the ground is left, -1: 0.9 of that of the take-off"
    ),
    "RWTO_ROT_TIME": ParameterSpec(1.0, 0.1, 10.0, "s", "from lift-off to the climb-out"),
}


class Px4FixedWing(FixedWingProcedures):
    """See `sim_vehicle.autopilot.procedures.FixedWingProcedures`."""

    name = "px4"
    parameters = PARAMETERS
    least_airspeed = "FW_AIRSPD_MIN"
    takeoff_height = "MIS_TAKEOFF_ALT"
    return_height = "RTL_RETURN_ALT"
    land_start_needs_position = False
    holds_at_waypoints = True
    climbs_ahead = False
    turns_to_zero = False

    def limits(self, spec: VehicleSpec) -> FixedWingLimits:
        """Limits of a vehicle's flight."""
        from sim_vehicle.motion.fixed_wing.guidance import NPFG
        from sim_vehicle.motion.fixed_wing.limits import FixedWingLimits

        value = self.values(spec)
        least, trim, most = airspeeds_in_order(
            value["FW_AIRSPD_MIN"], value["FW_AIRSPD_TRIM"], value["FW_AIRSPD_MAX"]
        )
        takeoff = value["FW_TKO_AIRSPD"] if value["FW_TKO_AIRSPD"] > 0.0 else least
        runway = value["RWTO_TKOFF"] > 0.0
        rotation = value["RWTO_ROT_AIRSPD"] if value["RWTO_ROT_AIRSPD"] > 0.0 else 0.9 * takeoff
        rotation = min(rotation, takeoff)
        liftoff, acceleration = self.start_of_flight(spec, rotation if runway else 0.0, takeoff)
        return FixedWingLimits(
            law=NPFG,
            airspeed_min=least,
            airspeed_trim=trim,
            airspeed_max=most,
            bank_limit=math.radians(value["FW_R_LIM"]),
            roll_s=value["FW_R_TC"],
            roll_rate=math.radians(value["FW_R_RMAX"] or 1000.0),
            roll_slew=math.radians(value["FW_PN_R_SLEW_MAX"] or 1000.0),
            climb_max=value["FW_T_CLMB_MAX"],
            climb_rate=min(value["FW_T_CLMB_R_SP"], value["FW_T_CLMB_MAX"]),
            sink_rate=min(value["FW_T_SINK_R_SP"], value["FW_T_SINK_MAX"]),
            sink_max=value["FW_T_SINK_MAX"],
            height_s=value["FW_T_ALT_TC"],
            speed_s=value["FW_T_TAS_TC"],
            vertical_acceleration=value["FW_T_VERT_ACC"],
            period=value["NPFG_PERIOD"],
            damping=value["NPFG_DAMPING"],
            integral=0.0,
            switch_share=value["NPFG_SW_DST_MLT"],
            acceptance=value["NAV_ACC_RAD"],
            height_acceptance=value["NAV_FW_ALT_RAD"],
            landing_height_acceptance=value["NAV_FW_ALTL_RAD"],
            ground_min=value["FW_GND_SPD_MIN"],
            takeoff_airspeed=takeoff,
            rotation_airspeed=liftoff,
            launch_acceleration=acceleration,
            level_height=0.0,
            level_bank=0.1,
            landing_airspeed=value["FW_LND_AIRSPD"] if value["FW_LND_AIRSPD"] > 0.0 else least,
            flare_height=value["FW_LND_FLALT"],
            flare_s=value["FW_LND_FL_TIME"],
            flare_sink=value["FW_LND_FL_SINK"],
            landing_slope=math.tan(math.radians(value["FW_LND_ANG"])),
            loiter_radius=value["NAV_LOITER_RAD"] or 80.0,
            ramp_s=value["RWTO_RAMP_TIME"] if runway else 0.0,
            ramp_throttle=value["RWTO_MAX_THR"] if runway else 1.0,
            rotation_s=value["RWTO_ROT_TIME"] if runway else 0.0,
            height_ahead=value["FW_T_HRATE_FF"],
            level_throttle=value["FW_THR_TRIM"],
            sink_min=value["FW_T_SINK_MIN"],
            total_integrator=value["FW_T_THR_INTEG"],
            total_damping=value["FW_T_THR_DAMPING"],
            total_s=value["FW_T_STE_R_TC"],
            total_for_load=value["FW_T_RLL2THR"],
        )

    def steepest_approach(self, spec: VehicleSpec) -> tuple[str, float] | None:
        """FW_LND_ANG: PX4 refuses a mission with a steeper approach."""
        return "FW_LND_ANG", self.value(spec, "FW_LND_ANG")

    def lands_as_mission(self, spec: VehicleSpec) -> bool:
        """Whether RTL_TYPE has a return fly the landing of the mission."""
        return self.value(spec, "RTL_TYPE") in (1.0, 2.0)

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Route home and the circle over it; it lands there when RTL_LAND_DELAY says so."""
        x, y, z = last
        home_x, home_y, least = return_point
        legs: list[Leg] = []
        least = max(least, self.value(spec, "RTL_RETURN_ALT"), 5.0)
        circle = Circle(math.copysign(self.value(spec, "RTL_LOITER_RAD"), self.value(spec, "NAV_LOITER_RAD")))
        if z < least - 1.0:
            z = least
            legs.append(Leg((x, y, z), speed, heading=KEEP, kind=LegKind.CLIMB))
        legs.append(Leg((home_x, home_y, z), speed, kind=LegKind.HOME, circle=circle))
        descend = max(self.value(spec, "RTL_DESCEND_ALT"), 5.0)
        delay = self.value(spec, "RTL_LAND_DELAY")
        low = min(z, descend)
        if low < z or delay > 0.0:
            over = (home_x, home_y, low)
            pause = max(delay, 0.0)
            legs.append(Leg(over, speed, 0.0, KEEP, LegKind.DESCEND, pause_s=pause, circle=circle))
        if delay >= 0.0:
            landing = self.limits(spec).landing_airspeed
            legs.append(Leg((home_x, home_y, 0.0), landing, 0.0, KEEP, LegKind.LAND, circle=circle))
        return legs


PX4_FIXED_WING = Px4FixedWing()
