"""Fixed wings, as PX4 and as ArduPlane fly them: parameters, take-off, circles, return and landing.

Names, defaults and ranges are those of PX4 1.16 and 1.17 (``fw_lat_long_params.yaml``,
``fw_mode_manager_params.yaml``, ``performance_model_params.c``, ``rc.fw_defaults``, navigator) and of
ArduPlane 4.6 and 4.7 (``Parameters.cpp``, ``AP_TECS.cpp``, ``AP_L1_Control.cpp``, ``AP_Landing.cpp``).
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec, parameter_value
from sim_vehicle.motion.legs import KEEP, Circle, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.fixed_wing.model import WingLimits
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

# A thrown or catapulted aeroplane, and one that rolls; braking on grass.
_THROW_M_S2 = 20.0
_ROLL_M_S2 = 3.0
_BRAKE_M_S2 = 3.0
# A throw gives less than the least airspeed.
_THROW_SHARE = 0.85
# Nearer than this there is no direction from which a landing could be approached.
_APPROACH_M = 30.0
_ARDUPILOT_ROLL_RATE = 75.0

PX4_PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
    {
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
        "FW_TKO_AIRSPD": ParameterSpec(-1.0, -1.0, 100.0, "m/s", "take-off airspeed"),
        "FW_T_ALT_TC": ParameterSpec(5.0, 2.0, 100.0, "s", "time constant of the height"),
        "FW_T_CLMB_MAX": ParameterSpec(5.0, 1.0, 15.0, "m/s", "climb rate at full throttle"),
        "FW_T_CLMB_R_SP": ParameterSpec(3.0, 0.1, 15.0, "m/s", "climb rate"),
        "FW_T_SINK_MAX": ParameterSpec(5.0, 1.0, 15.0, "m/s", "greatest sink rate"),
        "FW_T_SINK_MIN": ParameterSpec(2.0, 1.0, 5.0, "m/s", "sink rate without throttle"),
        "FW_T_SINK_R_SP": ParameterSpec(2.0, 0.1, 15.0, "m/s", "sink rate"),
        "FW_T_TAS_TC": ParameterSpec(5.0, 2.0, 100.0, "s", "time constant of the airspeed"),
        "FW_T_VERT_ACC": ParameterSpec(7.0, 1.0, 10.0, "m/s^2", "vertical acceleration"),
        "MIS_TAKEOFF_ALT": ParameterSpec(30.0, 0.0, 500.0, "m", "take-off height"),
        "NAV_ACC_RAD": ParameterSpec(10.0, 0.05, 200.0, "m", "least acceptance radius"),
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
        "RTL_RETURN_ALT": ParameterSpec(100.0, 0.0, 500.0, "m", "height of the way home"),
        "RTL_TYPE": ParameterSpec(0.0, 0.0, 5.0, "", "1, 2: land as the mission does", integer=True),
        "RWTO_TKOFF": ParameterSpec(0.0, 0.0, 1.0, "", "take-off from a runway", integer=True),
        "RWTO_ROT_AIRSPD": ParameterSpec(-1.0, -1.0, 100.0, "m/s", "airspeed at which the ground is left"),
    }
)
ARDUPILOT_PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
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
        "RLL2SRV_TCONST": ParameterSpec(0.5, 0.4, 1.0, "s", "time constant of the roll"),
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


class Plane:
    """See `sim_vehicle.autopilot.model.FlightProcedures`.

    Parameters
    ----------
    ardupilot : bool
        Whether it is ArduPlane, otherwise PX4.
    """

    def __init__(self, *, ardupilot: bool) -> None:
        self.name = "ardupilot" if ardupilot else "px4"
        self.ardupilot = ardupilot
        self.placed_land_start = ardupilot
        self.parameters: Mapping[str, ParameterSpec] = ARDUPILOT_PARAMETERS if ardupilot else PX4_PARAMETERS

    def _of(self, spec: VehicleSpec, name: str) -> float:
        return parameter_value(spec, name, self.parameters)

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with what parameters decide of its values."""
        limits = self.limits(spec)
        if self.ardupilot:
            takeoff, home = self._of(spec, "TKOFF_ALT"), self._of(spec, "RTL_ALTITUDE")
        else:
            takeoff, home = self._of(spec, "MIS_TAKEOFF_ALT"), self._of(spec, "RTL_RETURN_ALT")
        return replace(
            spec,
            cruise_speed_m_s=limits.airspeed_trim,
            speed_limit_m_s=limits.airspeed_max / 0.95,
            airspeed_limit_m_s=limits.airspeed_max,
            climb_speed_m_s=limits.climb_max,
            descent_speed_m_s=limits.sink_max,
            landing_speed_m_s=max(limits.flare_sink, 0.1),
            acceptance_radius_m=limits.acceptance,
            takeoff_altitude_m=max(takeoff, 1.0),
            return_altitude_m=max(home, 1.0),
        )

    def limits(self, spec: VehicleSpec) -> WingLimits:
        """Return the limits of a vehicle's flight."""
        return self._ardupilot_limits(spec) if self.ardupilot else self._px4_limits(spec)

    def _px4_limits(self, spec: VehicleSpec) -> WingLimits:
        from sim_vehicle.motion.fixed_wing.guidance import NPFG
        from sim_vehicle.motion.fixed_wing.model import WingLimits

        value = {name: self._of(spec, name) for name in self.parameters}
        least, trim, most = _ordered(value["FW_AIRSPD_MIN"], value["FW_AIRSPD_TRIM"], value["FW_AIRSPD_MAX"])
        takeoff = value["FW_TKO_AIRSPD"] if value["FW_TKO_AIRSPD"] > 0.0 else least
        runway = value["RWTO_TKOFF"] > 0.0
        rotation = value["RWTO_ROT_AIRSPD"] if value["RWTO_ROT_AIRSPD"] > 0.0 else takeoff
        return WingLimits(
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
            sink_min=value["FW_T_SINK_MIN"],
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
            along_leg=True,
            ground_min=value["FW_GND_SPD_MIN"],
            takeoff_airspeed=takeoff,
            rotation_airspeed=rotation if runway else _THROW_SHARE * takeoff,
            launch_acceleration=_ROLL_M_S2 if runway else _THROW_M_S2,
            level_height=0.0,
            level_bank=0.1,
            landing_airspeed=value["FW_LND_AIRSPD"] if value["FW_LND_AIRSPD"] > 0.0 else least,
            flare_height=value["FW_LND_FLALT"],
            flare_s=value["FW_LND_FL_TIME"],
            flare_sink=value["FW_LND_FL_SINK"],
            braking=_BRAKE_M_S2,
            landing_slope=math.tan(math.radians(value["FW_LND_ANG"])),
            loiter_radius=value["NAV_LOITER_RAD"] or 80.0,
        )

    def _ardupilot_limits(self, spec: VehicleSpec) -> WingLimits:
        from sim_vehicle.motion.fixed_wing.guidance import L1
        from sim_vehicle.motion.fixed_wing.model import WingLimits

        value = {name: self._of(spec, name) for name in self.parameters}
        least, trim, most = _ordered(value["AIRSPEED_MIN"], value["AIRSPEED_CRUISE"], value["AIRSPEED_MAX"])
        rotation = value["TKOFF_ROTATE_SPD"]
        landing = value["TECS_LAND_ARSPD"]
        return WingLimits(
            law=L1,
            airspeed_min=least,
            airspeed_trim=trim,
            airspeed_max=most,
            bank_limit=math.radians(min(max(value["ROLL_LIMIT_DEG"], 10.0), 75.0)),
            roll_s=value["RLL2SRV_TCONST"],
            roll_rate=math.radians(value["RLL2SRV_RMAX"] or _ARDUPILOT_ROLL_RATE),
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
            rotation_airspeed=rotation if rotation > 0.0 else _THROW_SHARE * least,
            launch_acceleration=_ROLL_M_S2 if rotation > 0.0 else _THROW_M_S2,
            level_height=value["TKOFF_LVL_ALT"],
            level_bank=math.radians(max(value["LEVEL_ROLL_LIMIT"], 1.0)),
            landing_airspeed=landing if landing > 0.0 else 0.5 * (least + trim),
            flare_height=value["LAND_FLARE_ALT"],
            flare_s=value["LAND_FLARE_SEC"],
            flare_sink=value["TECS_LAND_SINK"],
            braking=_BRAKE_M_S2,
            landing_slope=math.tan(math.radians(5.0)),
            loiter_radius=value["WP_LOITER_RAD"] or 60.0,
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle that stands at home."""
        from sim_vehicle.motion.fixed_wing.model import FixedWing

        return FixedWing(spec, self.limits, wind, yaw_rad)

    def steepest_approach(self, spec: VehicleSpec) -> tuple[str, float] | None:
        """Parameter that bounds the slope of an approach and its value in degrees; ArduPlane has none."""
        return None if self.ardupilot else ("FW_LND_ANG", self._of(spec, "FW_LND_ANG"))

    def lands_as_mission(self, spec: VehicleSpec) -> bool:
        """Whether a return flies the landing of the mission, if it has one."""
        return self._of(spec, "RTL_AUTOLAND" if self.ardupilot else "RTL_TYPE") in (1.0, 2.0)

    def holds_at_waypoints(self) -> bool:
        """Whether the hold time of a waypoint counts; ArduPlane does not store it."""
        return not self.ardupilot

    def takeoff_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        here: Position,
        target: Position,
        speed: float,
        heading: Heading,  # noqa: ARG002
    ) -> list[Leg]:
        """Return the climb-out: to the place (PX4), or straight ahead (ArduPlane), up to the height."""
        x, y = here[:2] if self.ardupilot else target[:2]
        return [Leg((x, y, max(target[2], 0.5)), speed, heading=KEEP, kind=LegKind.TAKEOFF)]

    def landing_legs(
        self,
        spec: VehicleSpec,
        above: Position,
        last: Position,
        speed: float,  # noqa: ARG002
    ) -> list[Leg]:
        """Return the straight approach from the place before; without one, a circle down to the ground."""
        x, y, z = above
        landing = self.limits(spec).landing_airspeed
        if math.hypot(x - last[0], y - last[1]) >= _APPROACH_M:
            return [Leg((x, y, 0.0), landing, kind=LegKind.LAND)]
        return [
            Leg((x, y, z), spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LOITER, circle=Circle()),
            Leg((x, y, 0.0), landing, heading=KEEP, kind=LegKind.LAND, circle=Circle()),
        ]

    def return_legs(self, spec: VehicleSpec, last: Position, speed: float, haven: Position) -> list[Leg]:
        """Return the way home and the circle over it; PX4 lands there when RTL_LAND_DELAY says so."""
        x, y, z = last
        home_x, home_y, least = haven
        if self.ardupilot:
            height = self._of(spec, "RTL_ALTITUDE")
            height = max(least, height if height > 0.0 else z, 5.0)
            circle = Circle(self._of(spec, "RTL_RADIUS") or None)
            return [Leg((home_x, home_y, height), speed, kind=LegKind.HOME, circle=circle)]
        legs: list[Leg] = []
        least = max(least, self._of(spec, "RTL_RETURN_ALT"), 5.0)
        circle = Circle(math.copysign(self._of(spec, "RTL_LOITER_RAD"), self._of(spec, "NAV_LOITER_RAD")))
        if z < least - 1.0:
            z = least
            legs.append(Leg((x, y, z), speed, heading=KEEP, kind=LegKind.CLIMB))
        legs.append(Leg((home_x, home_y, z), speed, kind=LegKind.HOME, circle=circle))
        descend = max(self._of(spec, "RTL_DESCEND_ALT"), 5.0)
        delay = self._of(spec, "RTL_LAND_DELAY")
        low = min(z, descend)
        if low < z or delay > 0.0:
            over = (home_x, home_y, low)
            pause = max(delay, 0.0)
            legs.append(Leg(over, speed, 0.0, KEEP, LegKind.DESCEND, pause_s=pause, circle=circle))
        if delay >= 0.0:
            landing = self.limits(spec).landing_airspeed
            legs.append(Leg((home_x, home_y, 0.0), landing, 0.0, KEEP, LegKind.LAND, circle=circle))
        return legs


def _ordered(least: float, trim: float, most: float) -> tuple[float, float, float]:
    """Return the airspeeds in order, whatever the parameters say."""
    trim = max(trim, 3.0)
    return min(least, trim), trim, max(most, trim)


PX4_PLANE = Plane(ardupilot=False)
ARDUPLANE = Plane(ardupilot=True)
