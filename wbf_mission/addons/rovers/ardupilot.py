"""ArduPilot's Rover: driving limits and control law from its parameters."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot import Firmware
from sim_vehicle.autopilot.ardupilot import ROOMY_PROFILE
from sim_vehicle.autopilot.ardupilot.firmware import (
    COPTER_MAVLINK,
    DEADZONE,
    MISSION,
    PLAIN_MAVLINK,
    PLAIN_MODES,
    PLAIN_RULES,
    RELEASE,
    battery_actions,
    vehicle_parameters,
)
from sim_vehicle.autopilot.behaviour import Mode, actions_by_value
from sim_vehicle.autopilot.parameters import Setting, motion_parameters, reference_parameters
from sim_vehicle.autopilot.stick_rules import StickLoss, StickRules, bits
from wbf_mission.addons.rovers.motion.layout import RoverLimits
from wbf_mission.addons.rovers.procedures import RoverProcedures

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Leg, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind
_SKID = 73.0
# Largest acceptance radius. The vehicle stays this near to its S-curve target, which rounds corners.
_FOLLOWS_M = 0.3
# ArduPilot's Rover stays armed at home, so its delay until disarming is the longest possible.
_NEVER_DISARM_S = 3599.0
# Maximum snap of the S-curves, m/s^4 (AR_WPNAV_SNAP_MAX); acceleration limit if no parameter sets a limit.
_SNAP = 15.0
_ANY_ACCELERATION = 20.0
# Time constants of ArduPilot's simulator: of the speed's response to throttle, and of skid steering.
_DRIVE_LAG_S = 20.0 / 10.0
_TRACK_LAG_S = 0.2


class ArduRover(RoverProcedures):
    """Procedures of ArduPilot's Rover; see `wbf_mission.addons.rovers.procedures.RoverProcedures`."""

    name = "ardupilot"
    parameters = motion_parameters("rover-motion", __package__)

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with the speeds and the acceptance radius set by its parameters."""
        cruise, limit = self.value(spec, "WP_SPEED"), spec.speed_limit_m_s
        return replace(
            spec,
            cruise_speed_m_s=cruise,
            speed_limit_m_s=max(limit, cruise / 0.95),
            acceptance_radius_m=self.limits(spec).acceptance,
            disarm_delay_s=_NEVER_DISARM_S,
        )

    def limits(self, spec: VehicleSpec) -> RoverLimits:
        """Return the driving limits of a vehicle."""
        value = self.values(spec)
        skid = value["SERVO1_FUNCTION"] == _SKID
        acceleration = value["ATC_ACCEL_MAX"] or spec.acceleration_m_s2
        turns = skid and value["WP_PIVOT_ANGLE"] > 5.0
        return RoverLimits(
            speed_max=max(spec.speed_limit_m_s, value["WP_SPEED"]),
            acceleration=acceleration,
            deceleration=value["ATC_DECEL_MAX"] or acceleration,
            turn_radius=0.0 if skid else value["TURN_RADIUS"],
            turn_rate=math.radians(value["ATC_STR_RAT_MAX"] or 1000.0),
            lateral=value["ATC_TURN_MAX_G"] * GRAVITY_M_S2,
            steering_s=0.2,
            ahead_gain=0.7,
            ahead_min=0.6,
            ahead_max=5.0,
            pivot_begin=math.radians(value["WP_PIVOT_ANGLE"]) if turns else 0.0,
            pivot_end=math.radians(5.0),
            pivot_rate=math.radians(value["WP_PIVOT_RATE"] or 60.0),
            acceptance=min(value["WP_RADIUS"], _FOLLOWS_M),
            corner_gain=1.0,
            corner_max=value["WP_RADIUS"],
            passes=True,
        )

    def law(self, spec: VehicleSpec) -> NDArray[np.float64]:
        """Return the numbers of the compiled motion as a `wbf_mission.addons.rovers.motion.ardurover.LAW`."""
        from sim_vehicle.motion.columns import row_of
        from wbf_mission.addons.rovers.motion.ardurover import LAW

        value, number, dt, limits = self.values(spec), self.numbers(spec), spec.step_s, self.limits(spec)
        skid = value["SERVO1_FUNCTION"] == _SKID
        accel = value["ATC_ACCEL_MAX"] or _ANY_ACCELERATION
        decel = value["ATC_DECEL_MAX"] or accel
        path = min(accel, decel)
        if value["WP_ACCEL"] > 0.0:
            path = min(path, value["WP_ACCEL"])
        jerk = value["WP_JERK"] or path
        cruise, throttle = value["CRUISE_SPEED"], 0.01 * value["CRUISE_THROTTLE"]
        number |= {
            "dt": dt,
            "accel": path,
            "accel_z": path,
            "jerk": jerk,
            "snap": _SNAP,
            "corner": limits.lateral,
            "wp_radius": max(value["WP_RADIUS"], limits.turn_radius),
            "pace_filter": min(1.0, dt * jerk / path),
            "error_filter": _share(dt, value["PSC_VEL_FLTE"]),
            "acceleration": accel,
            "deceleration": decel,
            "lateral": limits.lateral,
            "turn_speed": math.sqrt(0.5 * limits.lateral * limits.turn_radius),
            "steer_acceleration": math.radians(value["ATC_STR_ACC_MAX"] or 1e5),
            "steer_rate": math.radians(value["ATC_STR_RAT_MAX"] or 1e5),
            "steer_filter": _share(dt, value["ATC_STR_RAT_FLTE"]),
            "tightest": 0.0 if skid else max(limits.turn_radius, 0.1),
            "steer_lag": min(1.0, dt / _TRACK_LAG_S),
            "pivot_angle": limits.pivot_begin,
            "pivot_rate": math.radians(value["WP_PIVOT_RATE"] or value["ATC_STR_RAT_MAX"] or 1e5),
            "pivot_delay": value["WP_PIVOT_DELAY"] / dt,
            "drive_base": throttle / cruise if cruise > 0.0 else 0.0,
            "drive_filter": _share(dt, value["ATC_SPEED_FLTE"]),
            "top_speed": spec.speed_limit_m_s,
            "drive_lag": min(1.0, dt / _DRIVE_LAG_S),
        }
        return row_of(LAW, number)

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return a leg home at RTL_SPEED, with a stop at the end."""
        speed = self.value(spec, "RTL_SPEED") or spec.cruise_speed_m_s
        return super().return_legs(spec, last, speed, return_point)

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle at rest at home."""
        from wbf_mission.addons.rovers.motion.model import ArduRover as Driven

        return Driven(spec, self.limits, self.law, wind, yaw_rad)


def _share(dt: float, frequency_hz: float) -> float:
    """Return a low-pass filter's gain per step; a frequency of 0 disables the filter."""
    return dt / (dt + 1.0 / (2.0 * math.pi * frequency_hz)) if frequency_hz > 0.0 else 1.0


_MAVLINK = replace(
    PLAIN_MAVLINK,
    modes=replace(
        PLAIN_MODES,
        rows=(
            (0, Mode.MANUAL, "MANUAL"),
            (1, Mode.ALTITUDE, "ACRO"),
            (3, Mode.POSITION, "STEERING"),
            (4, Mode.HOLD, "HOLD"),
            (10, Mode.MISSION, "AUTO"),
            (11, Mode.RTL, "RTL"),
            (15, Mode.GUIDED, "GUIDED"),
            (15, Mode.TAKEOFF, "GUIDED"),
            (4, Mode.LAND, "HOLD"),
            (5, Mode.HOLD, "LOITER"),
            (7, Mode.MANUAL, "SIMPLE"),
            (12, Mode.RTL, "SMART_RTL"),
        ),
    ),
    unsupported=COPTER_MAVLINK.unsupported | {int(m.MAV_CMD_CONDITION_YAW)},
)
_RULES = replace(
    PLAIN_RULES,
    fence_actions=actions_by_value(WARN="0", RETURN="1 3", HOLD="2 4 5"),
    link_actions=actions_by_value(NONE="0", RETURN="1 2"),
    battery_actions=battery_actions(WARN="0", RETURN="1 3 4", HOLD="2 6", TERMINATE="5"),
)
_STICKS = StickRules(
    speeds={Mode.MANUAL: None, Mode.ALTITUDE: None, Mode.POSITION: None},
    level=DEADZONE,
    vertical=DEADZONE,
    turning=DEADZONE,
    turn_rate=Setting("ATC_STR_RAT_MAX", 120.0, math.radians(1.0)),
    overrides=True,
    drives=True,
    throttle_middle=0.0,
    pwm_half=400.0,
    loss=StickLoss(
        timeout=Setting("FS_TIMEOUT", 1.5),
        action=Setting("FS_ACTION", 2.0),
        actions=actions_by_value(NONE="0", RETURN="1 3", HOLD="2 4 6", TERMINATE="5"),
        release=RELEASE,
        exceptions=bits(),
        arming=Setting("FS_THR_ENABLE", 1.0),
        lost="Radio Failsafe",
        regained="Radio Failsafe Cleared",
    ),
)
FIRMWARE = Firmware(
    title="Rover",
    mavlink=_MAVLINK,
    rules=_RULES,
    profile=ROOMY_PROFILE,
    parameter_table=vehicle_parameters,
    procedures=ArduRover(),
    behaviour=MISSION,
    reference=partial(reference_parameters, "rover", package=__package__),
    sticks=_STICKS,
    takes_off=True,
)
