"""ArduPlane: what it makes of its parameters that move a fixed wing, its take-off and its return."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.parameters import motion_parameters
from sim_vehicle.autopilot.procedures import FixedWingProcedures, airspeeds_in_order
from sim_vehicle.motion.fixed_wing.layout import STOPPED_M_S
from sim_vehicle.motion.legs import Circle, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.fixed_wing.layout import FixedWingLimits
    from sim_vehicle.motion.legs import Position

__all__ = ["ARDUPLANE"]

_ROLL_RATE = 75.0
_ANY_RATE = 180.0
# It seems to fly until its ground speed is below this, and a filter has noticed that (``is_flying.cpp``).
_SEEMS_TO_FLY_M_S = 1.5
_NOTICES_S = 2.9


class ArduPlane(FixedWingProcedures):
    """See `sim_vehicle.autopilot.procedures.FixedWingProcedures`."""

    name = "ardupilot"
    parameters = motion_parameters("arduplane-motion")
    least_airspeed = "AIRSPEED_MIN"
    takeoff_height = "TKOFF_ALT"
    return_height = "RTL_ALTITUDE"
    land_start_needs_position = True
    holds_at_waypoints = False  # it does not store the time
    climbs_ahead = True
    turns_to_zero = True

    def limits(self, spec: VehicleSpec) -> FixedWingLimits:
        """Limits of a vehicle's flight."""
        from sim_vehicle.motion.fixed_wing.guidance import L1
        from sim_vehicle.motion.fixed_wing.layout import FixedWingLimits

        value = self.values(spec)
        least, trim, most = airspeeds_in_order(
            value["AIRSPEED_MIN"], value["AIRSPEED_CRUISE"], value["AIRSPEED_MAX"]
        )
        rotation = value["TKOFF_ROTATE_SPD"]
        landing = value["TECS_LAND_ARSPD"]
        liftoff, acceleration = self.start_of_flight(spec, rotation, least)
        return FixedWingLimits(
            **self.numbers(spec, FixedWingLimits),
            law=L1,
            airspeed_min=least,
            airspeed_trim=trim,
            airspeed_max=most,
            bank_limit=math.radians(min(max(value["ROLL_LIMIT_DEG"], 10.0), 75.0)),
            roll_rate_max=math.radians(value["RLL2SRV_RMAX"] or _ROLL_RATE),
            roll_slew=math.radians(1000.0),
            climb_max=value["TECS_CLMB_MAX"],
            climb_rate=value["TECS_CLMB_MAX"],
            sink_rate=max(value["TECS_SINK_MAX"], 0.1),
            sink_max=max(value["TECS_SINK_MAX"], 0.1),
            height_s=value["TECS_TIME_CONST"],
            speed_s=value["TECS_TIME_CONST"],
            switch_share=0.0,
            height_acceptance=math.inf,
            landing_height_acceptance=math.inf,
            takeoff_airspeed=trim,
            rotation=liftoff,
            launch=acceleration,
            level_bank=math.radians(max(value["LEVEL_ROLL_LIMIT"], 1.0)),
            landing_airspeed=landing if landing > 0.0 else 0.5 * (least + trim),
            landing_slope=math.tan(math.radians(5.0)),
            loiter_radius=value["WP_LOITER_RAD"] or 60.0,
        )

    def control(self, spec: VehicleSpec) -> Mapping[str, float]:
        """Gains of the control of energy, landing and take-off."""
        value = self.values(spec)
        pitch_max, pitch_min = value["PTCH_LIM_MAX_DEG"], value["PTCH_LIM_MIN_DEG"]
        if value["TECS_PITCH_MAX"] > 0.0:
            pitch_max = min(pitch_max, value["TECS_PITCH_MAX"])
        if value["TECS_PITCH_MIN"] < 0.0:
            pitch_min = max(pitch_min, value["TECS_PITCH_MIN"])
        least = 0.01 * value["THR_MIN"]
        most = max(0.01 * value["THR_MAX"], least + 0.01)
        return {
            **self.numbers(spec),
            "time_s": max(value["TECS_TIME_CONST"], 0.1),
            "tecs_sink_max": max(value["TECS_SINK_MAX"], 0.1),
            "throttle_min": max(least, 0.0),
            "throttle_max": most,
            "pitch_min": math.radians(pitch_min),
            "pitch_max": math.radians(max(pitch_max, pitch_min)),
            "pitch_up_rate": math.radians(value["PTCH2SRV_RMAX_UP"] or _ANY_RATE),
            "pitch_down_rate": math.radians(value["PTCH2SRV_RMAX_DN"] or _ANY_RATE),
            "slope_min": value["ALT_SLOPE_MIN"] or math.inf,
            "takeoff_throttle": 0.01 * value["TKOFF_THR_MAX"] or most,
        }

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Vehicle with the values that parameters decide."""
        friction = None if spec.airframe is None else spec.airframe.ground_drag_1_s
        # The delay counts from when it no longer seems to fly; until it stands it rolls on.
        rolls = math.log(_SEEMS_TO_FLY_M_S / STOPPED_M_S) / friction if friction else 0.0
        delay = max(self.value(spec, "LAND_DISARMDELAY") + _NOTICES_S - rolls, 0.0)
        return replace(super().fit(spec), disarm_delay_s=delay)

    def lands_as_mission(self, spec: VehicleSpec) -> bool:
        """Whether RTL_AUTOLAND has a return fly the landing of the mission."""
        return self.value(spec, "RTL_AUTOLAND") in (1.0, 2.0)

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Route home and the circle over it, for ever."""
        home_x, home_y, least = return_point
        height = self.value(spec, "RTL_ALTITUDE")
        height = max(least, height if height > 0.0 else last[2], 5.0)
        circle = Circle(self.value(spec, "RTL_RADIUS") or None)
        return [Leg((home_x, home_y, height), speed, kind=LegKind.HOME, circle=circle)]


ARDUPLANE = ArduPlane()
