"""ArduPlane: limits of a fixed wing from its parameters, take-off and return."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from mission.autopilots import ARDUPILOT as PROFILE
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from mission.planners.cornering import Cornering
from sim_vehicle.autopilot import Firmware
from sim_vehicle.autopilot.ardupilot import ROOMY_PROFILE
from sim_vehicle.autopilot.ardupilot.firmware import (
    DEADZONE,
    MISSION,
    PLAIN_MAVLINK,
    PLAIN_MODES,
    PLAIN_RULES,
    RELEASE,
    UNSUPPORTED,
    battery_actions,
    vehicle_parameters,
)
from sim_vehicle.autopilot.behaviour import Action, Mode, actions_by_value
from sim_vehicle.autopilot.parameters import Setting, motion_parameters, reference_parameters
from sim_vehicle.autopilot.stick_rules import StickLoss, StickRules, WingSticks, bits
from sim_vehicle.motion.legs import Circle, Leg, LegKind
from wbf_mission.addons.wings.motion.layout import L1, STOPPED_M_S, FixedWingLimits
from wbf_mission.addons.wings.procedures import WingProcedures, airspeeds_in_order

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mission.model import MissionItem
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.parameters import RuntimeParameters
    from sim_vehicle.motion.legs import Position
_ROLL_RATE = 75.0
_ANY_RATE = 180.0
# ArduPlane assumes flight until the filtered ground speed is lower than this (``is_flying.cpp``).
_SEEMS_TO_FLY_M_S = 1.5
_NOTICES_S = 2.9


class ArduPlane(WingProcedures):
    """Procedures of ArduPlane; see `wbf_mission.addons.wings.procedures.WingProcedures`."""

    name = "ardupilot"
    parameters = motion_parameters("arduplane-motion", __package__)
    least_airspeed = "AIRSPEED_MIN"
    takeoff_height = "TKOFF_ALT"
    return_height = "RTL_ALTITUDE"
    return_kind = "RTL_AUTOLAND"
    land_start_needs_position = True
    holds_at_waypoints = False  # The hold time is not stored
    climbs_ahead = True
    turns_to_zero = True

    def limits(self, spec: VehicleSpec) -> FixedWingLimits:
        """Return the flight limits of a vehicle."""
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
            takeoff_airspeed=trim,
            rotation=liftoff,
            launch=acceleration,
            level_bank=math.radians(max(value["LEVEL_ROLL_LIMIT"], 1.0)),
            landing_airspeed=landing if landing > 0.0 else 0.5 * (least + trim),
            landing_slope=math.tan(math.radians(5.0)),
            loiter_radius=value["WP_LOITER_RAD"] or 60.0,
            control=self.numbers(spec) | _control(value),
        )

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with the values that its parameters set."""
        friction = None if spec.airframe is None else spec.airframe.ground_drag_1_s
        # ArduPlane's delay begins when it no longer assumes flight; the vehicle may still roll then.
        rolls = math.log(_SEEMS_TO_FLY_M_S / STOPPED_M_S) / friction if friction else 0.0
        delay = max(self.value(spec, "LAND_DISARMDELAY") + _NOTICES_S - rolls, 0.0)
        return replace(super().fit(spec), disarm_delay_s=delay)

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return a leg home with an endless circle above home."""
        home_x, home_y, least = return_point
        height = self.value(spec, "RTL_ALTITUDE")
        height = max(least, height if height > 0.0 else last[2], 5.0)
        circle = Circle(self.value(spec, "RTL_RADIUS") or None)
        return [Leg((home_x, home_y, height), speed, kind=LegKind.HOME, circle=circle)]


def _control(value: Mapping[str, float]) -> dict[str, float]:
    """Return the gains of energy control, landing and take-off that are not parameters."""
    pitch_max, pitch_min = value["PTCH_LIM_MAX_DEG"], value["PTCH_LIM_MIN_DEG"]
    if value["TECS_PITCH_MAX"] > 0.0:
        pitch_max = min(pitch_max, value["TECS_PITCH_MAX"])
    if value["TECS_PITCH_MIN"] < 0.0:
        pitch_min = max(pitch_min, value["TECS_PITCH_MIN"])
    least = 0.01 * value["THR_MIN"]
    most = max(0.01 * value["THR_MAX"], least + 0.01)
    return {
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


def arduplane_landing(items: Sequence[MissionItem], parameters: RuntimeParameters) -> str | None:
    """Return the reason against arming if a return would ignore the landing sequence; else None."""
    has_landing = any(item.command == Command.DO_LAND_START for item in items)
    if has_landing and parameters.settings.get("RTL_AUTOLAND", 0.0) == 0.0:
        return "DO_LAND_START set and RTL_AUTOLAND disabled"
    return None


_MAVLINK = replace(
    PLAIN_MAVLINK,
    identity=replace(
        PLAIN_MAVLINK.identity,
        mav_type=int(m.MAV_TYPE_FIXED_WING),
        banner="ArduPlane V4.7.0 (1511f271)",
    ),
    modes=replace(
        PLAIN_MODES,
        rows=(
            (0, Mode.MANUAL, "MANUAL"),
            (6, Mode.ALTITUDE, "FBWB"),
            (7, Mode.POSITION, "CRUISE"),
            (10, Mode.MISSION, "AUTO"),
            (11, Mode.RTL, "RTL"),
            (12, Mode.HOLD, "LOITER"),
            (13, Mode.TAKEOFF, "TAKEOFF"),
            (15, Mode.GUIDED, "GUIDED"),
            (26, Mode.LAND, "AUTOLAND"),
            (1, Mode.HOLD, "CIRCLE"),
            (2, Mode.MANUAL, "STABILIZE"),
            (3, Mode.MANUAL, "TRAINING"),
            (4, Mode.MANUAL, "ACRO"),
            (5, Mode.MANUAL, "FBWA"),
            (8, Mode.MANUAL, "AUTOTUNE"),
        ),
        after_takeoff=Mode.TAKEOFF,
    ),
    unsupported=UNSUPPORTED | {int(m.MAV_CMD_CONDITION_YAW)},
)
_RULES = replace(
    PLAIN_RULES,
    fence_actions=actions_by_value(WARN="0", RETURN="1 6 7", HOLD="8", LAND="9"),
    link_actions=actions_by_value(NONE="0", RETURN="1 2 3"),
    battery_actions=battery_actions(WARN="0", RETURN="1 6", LAND="2 4 5", TERMINATE="3"),
    landed=("Throttle disarmed", "Auto disarmed"),
)
_DEGREE = math.radians(1.0)
# Custom modes MANUAL, TRAINING, ACRO and AUTOTUNE.
_BY_HAND = frozenset({0, 3, 4, 8})
_WING = WingSticks(
    bank=Setting("ROLL_LIMIT_DEG", 45.0, _DEGREE),
    up=Setting("PTCH_LIM_MAX_DEG", 20.0, _DEGREE),
    down=Setting("PTCH_LIM_MIN_DEG", -25.0, _DEGREE),
)
_STICKS = StickRules(
    # MANUAL covers STABILIZE and FBWA; ALTITUDE is FBWB, and POSITION is CRUISE.
    speeds={Mode.MANUAL: None, Mode.ALTITUDE: None, Mode.POSITION: None},
    level=DEADZONE,
    vertical=DEADZONE,
    turning=DEADZONE,
    turn_rate=Setting("ROLL_LIMIT_DEG", 45.0, _DEGREE),
    wings=dict.fromkeys((Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION), _WING),
    landing_abort=Setting("LAND_ABORT_THR", 0.0),
    without=_BY_HAND,
    overrides=True,
    pwm_half=400.0,
    loss=StickLoss(
        timeout=Setting("RC_FS_TIMEOUT", 1.0),
        action=Setting("FS_LONG_ACTN", 0.0),
        actions=actions_by_value(NONE="0", RETURN="1"),
        exceptions=bits(),
        in_stick_modes=Action.RETURN,
        release=RELEASE,
        delay=Setting("FS_LONG_TIMEOUT", 5.0),
        arming=Setting("THR_FAILSAFE", 1.0),
        delayed="RC Short Failsafe: switched to CIRCLE",
        lost="RC Long Failsafe: switched to RTL",
        regained="RC Failsafe Cleared",
    ),
)
# ArduPlane also stores a waypoint's acceptance and pass radius, and a take-off's pitch.
_PROFILE = replace(
    ROOMY_PROFILE,
    lossy={
        **PROFILE.lossy,
        Command.NAV_WAYPOINT: frozenset({"param4"}),
        Command.NAV_TAKEOFF: frozenset({"param2", "param3", "param4"}),
    },
)
FIRMWARE = Firmware(
    title="ArduPlane",
    mavlink=_MAVLINK,
    rules=_RULES,
    profile=_PROFILE,
    parameter_table=vehicle_parameters,
    procedures=ArduPlane(),
    behaviour=replace(MISSION, refuses_to_arm=arduplane_landing),
    reference=partial(reference_parameters, "arduplane", package=__package__),
    sticks=_STICKS,
    # The vehicle flies up to a waypoint; WP_RADIUS does not make the vehicle turn earlier.
    cornering=Cornering(2.0),
)
