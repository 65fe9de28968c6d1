"""ArduPlane: its parameters that move a fixed wing, its take-off and its return.

Names, defaults and ranges are those of ArduPlane 4.6 and 4.7 (``Parameters.cpp``, ``AP_TECS.cpp``,
``AP_L1_Control.cpp``, ``AP_Landing.cpp``).
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec
from sim_vehicle.autopilot.fixed_wing import (
    BRAKE_M_S2,
    ROLL_M_S2,
    THROW_M_S2,
    THROW_SHARE,
    FixedWingProcedures,
    in_order,
)
from sim_vehicle.motion.legs import KEEP, Circle, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.fixed_wing.model import FixedWingLimits
    from sim_vehicle.motion.legs import Heading, Position

__all__ = ["ARDUPLANE"]

_ROLL_RATE = 75.0
PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
    {
        "AIRSPEED_CRUISE": ParameterSpec(12.0, 1.0, 100.0, "m/s", "cruise airspeed"),
        "AIRSPEED_MAX": ParameterSpec(22.0, 5.0, 100.0, "m/s", "greatest airspeed"),
        "AIRSPEED_MIN": ParameterSpec(9.0, 5.0, 100.0, "m/s", "least airspeed"),
        "LAND_FLARE_ALT": ParameterSpec(3.0, 0.0, 30.0, "m", "flare height"),
        "LAND_FLARE_SEC": ParameterSpec(2.0, 0.0, 10.0, "s", "flare time"),
        "LEVEL_ROLL_LIMIT": ParameterSpec(5.0, 0.0, 45.0, "deg", "bank near the ground", integer=True),
        "MIN_GROUNDSPEED": ParameterSpec(0.0, 0.0, 100.0, "m/s", "least ground speed"),
        "NAVL1_DAMPING": ParameterSpec(0.75, 0.6, 1.0, "", "damping of L1"),
        "NAVL1_PERIOD": ParameterSpec(17.0, 1.0, 60.0, "s", "period of L1"),
        "NAVL1_XTRACK_I": ParameterSpec(0.02, 0.0, 0.1, "", "integral of the cross-track angle"),
        "RLL2SRV_RMAX": ParameterSpec(
            0.0, 0.0, 180.0, "deg/s", "greatest roll rate, 0 for none", integer=True
        ),
        "RLL2SRV_TCONST": ParameterSpec(0.5, 0.1, 1.0, "s", "time constant of the roll"),
        "ROLL_LIMIT_DEG": ParameterSpec(45.0, 0.0, 90.0, "deg", "greatest bank"),
        "RTL_ALTITUDE": ParameterSpec(100.0, -1.0, 5000.0, "m", "height of the return, -1 keeps the height"),
        "RTL_AUTOLAND": ParameterSpec(0.0, 0.0, 4.0, "", "1, 2: land as the mission does", integer=True),
        "RTL_RADIUS": ParameterSpec(
            0.0, -32767.0, 32767.0, "m", "radius over home, 0: WP_LOITER_RAD", integer=True
        ),
        "TECS_CLMB_MAX": ParameterSpec(5.0, 0.1, 20.0, "m/s", "climb rate at full throttle"),
        "TECS_LAND_ARSPD": ParameterSpec(-1.0, -1.0, 127.0, "m/s", "landing airspeed"),
        "TECS_LAND_SINK": ParameterSpec(0.25, 0.0, 2.0, "m/s", "sink rate in the flare"),
        "TECS_SINK_MAX": ParameterSpec(5.0, 0.0, 20.0, "m/s", "greatest sink rate"),
        "TECS_SINK_MIN": ParameterSpec(2.0, 0.1, 10.0, "m/s", "sink rate without throttle"),
        "TECS_TIME_CONST": ParameterSpec(5.0, 3.0, 10.0, "s", "time constant of height and airspeed"),
        "TECS_VERT_ACC": ParameterSpec(7.0, 1.0, 10.0, "m/s^2", "vertical acceleration"),
        "TKOFF_ALT": ParameterSpec(50.0, 0.0, 200.0, "m", "take-off height"),
        "TKOFF_LVL_ALT": ParameterSpec(10.0, 0.0, 50.0, "m", "height up to which the wings stay level"),
        "TKOFF_ROTATE_SPD": ParameterSpec(0.0, 0.0, 100.0, "m/s", "airspeed at which a runway is left"),
        "WP_LOITER_RAD": ParameterSpec(
            60.0, -32767.0, 32767.0, "m", "radius of circles, positive clockwise", integer=True
        ),
        "WP_RADIUS": ParameterSpec(90.0, 1.0, 32767.0, "m", "acceptance radius", integer=True),
    }
)


class ArduPlane(FixedWingProcedures):
    """See `sim_vehicle.autopilot.fixed_wing.FixedWingProcedures`."""

    name = "ardupilot"
    parameters = PARAMETERS
    least_airspeed = "AIRSPEED_MIN"
    takeoff_height = "TKOFF_ALT"
    return_height = "RTL_ALTITUDE"
    land_start_needs_position = True
    holds_at_waypoints = False  # it does not store the time

    def limits(self, spec: VehicleSpec) -> FixedWingLimits:
        """Limits of a vehicle's flight."""
        from sim_vehicle.motion.fixed_wing.guidance import L1
        from sim_vehicle.motion.fixed_wing.model import FixedWingLimits

        value = {name: self.value(spec, name) for name in self.parameters}
        least, trim, most = in_order(value["AIRSPEED_MIN"], value["AIRSPEED_CRUISE"], value["AIRSPEED_MAX"])
        rotation = value["TKOFF_ROTATE_SPD"]
        landing = value["TECS_LAND_ARSPD"]
        return FixedWingLimits(
            law=L1,
            airspeed_min=least,
            airspeed_trim=trim,
            airspeed_max=most,
            bank_limit=math.radians(min(max(value["ROLL_LIMIT_DEG"], 10.0), 75.0)),
            roll_s=value["RLL2SRV_TCONST"],
            roll_rate=math.radians(value["RLL2SRV_RMAX"] or _ROLL_RATE),
            roll_slew=math.radians(1000.0),
            climb_max=value["TECS_CLMB_MAX"],
            climb_rate=value["TECS_CLMB_MAX"],
            sink_min=value["TECS_SINK_MIN"],
            sink_rate=max(value["TECS_SINK_MAX"], 0.1),
            sink_max=max(value["TECS_SINK_MAX"], 0.1),
            height_s=value["TECS_TIME_CONST"],
            speed_s=value["TECS_TIME_CONST"],
            vertical_acceleration=value["TECS_VERT_ACC"],
            period=value["NAVL1_PERIOD"],
            damping=value["NAVL1_DAMPING"],
            integral=value["NAVL1_XTRACK_I"],
            switch_share=0.0,
            acceptance=value["WP_RADIUS"],
            height_acceptance=math.inf,
            along_leg=False,
            ground_min=value["MIN_GROUNDSPEED"],
            takeoff_airspeed=trim,
            rotation_airspeed=rotation if rotation > 0.0 else THROW_SHARE * least,
            launch_acceleration=ROLL_M_S2 if rotation > 0.0 else THROW_M_S2,
            level_height=value["TKOFF_LVL_ALT"],
            level_bank=math.radians(max(value["LEVEL_ROLL_LIMIT"], 1.0)),
            landing_airspeed=landing if landing > 0.0 else 0.5 * (least + trim),
            flare_height=value["LAND_FLARE_ALT"],
            flare_s=value["LAND_FLARE_SEC"],
            flare_sink=value["TECS_LAND_SINK"],
            braking=BRAKE_M_S2,
            landing_slope=math.tan(math.radians(5.0)),
            loiter_radius=value["WP_LOITER_RAD"] or 60.0,
        )

    def steepest_approach(self, spec: VehicleSpec) -> tuple[str, float] | None:  # noqa: ARG002
        """None: it takes any approach."""
        return None

    def lands_as_mission(self, spec: VehicleSpec) -> bool:
        """Whether RTL_AUTOLAND has a return fly the landing of the mission."""
        return self.value(spec, "RTL_AUTOLAND") in (1.0, 2.0)

    def takeoff_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        here: Position,
        target: Position,
        speed: float,
        heading: Heading,  # noqa: ARG002
    ) -> list[Leg]:
        """Climb-out straight ahead, up to the height."""
        end = (here[0], here[1], max(target[2], 0.5))
        return [Leg(end, speed, heading=KEEP, kind=LegKind.TAKEOFF)]

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
