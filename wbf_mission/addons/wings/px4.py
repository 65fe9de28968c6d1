"""PX4 with a fixed wing: limits from its parameters, take-off and return."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.planners.cornering import Cornering
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.parameters import MavParameter, Setting, motion_parameters
from sim_vehicle.autopilot.px4 import no_multirotor
from sim_vehicle.autopilot.px4.firmware import COPTER_STICKS, LOSS, MISSION, RULES, common_parameters
from sim_vehicle.autopilot.stick_rules import Axis, StickRules, WingSticks
from sim_vehicle.motion.legs import KEEP, Circle, Leg, LegKind, Position
from wbf_mission.addons.wings.motion.layout import NPFG, FixedWingLimits
from wbf_mission.addons.wings.procedures import WingProcedures, airspeeds_in_order

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec


class Px4FixedWing(WingProcedures):
    """Procedures of PX4 with a fixed wing; see `wbf_mission.addons.wings.procedures.WingProcedures`."""

    name = "px4"
    parameters = motion_parameters("px4-fixed-wing-motion", __package__)
    least_airspeed = "FW_AIRSPD_MIN"
    takeoff_height = "MIS_TAKEOFF_ALT"
    return_height = "RTL_RETURN_ALT"
    return_kind = "RTL_TYPE"
    land_start_needs_position = False
    holds_at_waypoints = True
    climbs_ahead = False
    turns_to_zero = False

    def limits(self, spec: VehicleSpec) -> FixedWingLimits:
        """Return the flight limits of a vehicle."""
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
            **self.numbers(spec, FixedWingLimits),
            law=NPFG,
            airspeed_min=least,
            airspeed_trim=trim,
            airspeed_max=most,
            roll_rate_max=math.radians(value["FW_R_RMAX"] or 1000.0),
            roll_slew=math.radians(value["FW_PN_R_SLEW_MAX"] or 1000.0),
            climb_rate=min(value["FW_T_CLMB_R_SP"], value["FW_T_CLMB_MAX"]),
            sink_rate=min(value["FW_T_SINK_R_SP"], value["FW_T_SINK_MAX"]),
            takeoff_airspeed=takeoff,
            rotation=liftoff,
            launch=acceleration,
            level_bank=0.1,
            landing_airspeed=value["FW_LND_AIRSPD"] if value["FW_LND_AIRSPD"] > 0.0 else least,
            landing_slope=math.tan(math.radians(value["FW_LND_ANG"])),
            loiter_radius=value["NAV_LOITER_RAD"] or 80.0,
            ramp_s=value["RWTO_RAMP_TIME"] if runway else 0.0,
            ramp_throttle=value["RWTO_MAX_THR"] if runway else 1.0,
            rotation_s=value["RWTO_ROT_TIME"] if runway else 0.0,
            control={},
        )

    def steepest_approach(self, spec: VehicleSpec) -> tuple[str, float] | None:
        """Return FW_LND_ANG: PX4 refuses a mission with a steeper approach."""
        return "FW_LND_ANG", self.value(spec, "FW_LND_ANG")

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return a leg home with a circle above it, and a landing if RTL_LAND_DELAY is not negative."""
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


def fixed_wing_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Return the parameters of a fixed wing."""
    return [
        *common_parameters(spec, system_id, m.MAV_TYPE_FIXED_WING),
        MavParameter("FW_MAN_P_MAX", value=30.0, stored=True, low=0.0, high=90.0, unit="deg"),
        MavParameter("FW_MAN_R_MAX", value=45.0, stored=True, low=0.0, high=90.0, unit="deg"),
    ]


_DEGREE = math.radians(1.0)
_WHOLE = Axis(0.0)
_BY_HAND = WingSticks(
    bank=Setting("FW_MAN_R_MAX", 45.0, _DEGREE),
    up=Setting("FW_MAN_P_MAX", 30.0, _DEGREE),
    down=Setting("FW_MAN_P_MAX", 30.0, _DEGREE),
)
_BY_HEIGHT = WingSticks(
    bank=Setting("FW_R_LIM", 50.0, _DEGREE),
    up=Setting("FW_T_CLMB_R_SP", 3.0),
    down=Setting("FW_T_SINK_R_SP", 2.0),
    by_rate=True,
)
_STICKS = StickRules(
    speeds={Mode.POSITION: None, Mode.ALTITUDE: None, Mode.MANUAL: None},
    needed=COPTER_STICKS.needed,
    level=_WHOLE,
    vertical=_WHOLE,
    turning=_WHOLE,
    turn_rate=Setting("FW_R_LIM", 50.0, _DEGREE),
    wings={Mode.POSITION: _BY_HEIGHT, Mode.ALTITUDE: _BY_HEIGHT, Mode.MANUAL: _BY_HAND},
    loss=LOSS,
)
FIRMWARE = replace(
    no_multirotor(m.MAV_TYPE_FIXED_WING),
    parameter_table=fixed_wing_parameters,
    # PX4 requires a landing in a fixed wing's mission; a return does not count.
    rules=replace(RULES, defaults=replace(RULES.defaults, mission_requirement=2)),
    procedures=Px4FixedWing(),
    takes_off=False,
    # No recording shows a fixed wing's mission that ends with a return.
    behaviour=replace(MISSION, return_lag_s=None),
    cornering=Cornering(2.0),
    sticks=_STICKS,
)
