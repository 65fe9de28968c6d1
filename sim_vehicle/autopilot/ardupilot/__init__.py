"""ArduPilot 4.7 for multirotors (ArduCopter): take-off, landing and return, and the autopilot.

Add-ons provide ArduPlane and Rover.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from mission.autopilots import ARDUPILOT as PROFILE
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot import Autopilot, Firmware
from sim_vehicle.autopilot.ardupilot.firmware import (
    COLD_BOOT,
    COPTER_MAVLINK,
    COPTER_RULES,
    COPTER_STICKS,
    MISSION,
    copter_parameters,
)
from sim_vehicle.autopilot.parameters import motion_parameters, reference_parameters
from sim_vehicle.autopilot.procedures import FlightProcedures, over_and_down, vertical_landing
from sim_vehicle.motion.legs import ALONG, KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

__all__ = ["ARDUPILOT", "ROOMY_PROFILE"]

_RTL_ALT_MIN_M = 2.0
_LEAST_CONE = 0.5
# Time from landing to disarming, during which the motors spool down.
_SPOOL_DOWN_S = 0.35
# Lag of the attitude behind its target, caused by rate loops and motors.
_ATTITUDE_S = 0.05
# On the ground the throttle decreases for 1 s. Then the land detector needs another second.
_LAND_DETECTOR_S = 2.0
# Airframe of ArduPilot's simulator (`SIM_Frame.h`, default model): 3 kg, 0.18 m2 of rotor discs.
# The drag of this airframe balances a tilt of 45 degrees at 15.08 m/s.
# The linear momentum drag of the rotors is a part of the drag.
# Its coefficient 0.34 is fitted to recorded flights at 5 to 10 m/s; the simulator uses 0.2.
_MASS_KG, _DISC_M2, _MOMENTUM = 3.0, 0.18, 0.34
_REFERENCE_M_S, _REFERENCE_RAD = 15.08, math.radians(45.0)
_AIR_KG_M3, _REFERENCE_AIR_KG_M3 = 1.225, 1.157


class ArduCopterProcedures(FlightProcedures):
    """Flight procedures of ArduCopter."""

    name = "ardupilot"
    parameters = motion_parameters("arducopter-motion")

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with speeds, limits, radius and altitudes from its parameters."""
        value = self.values(spec)
        return replace(
            spec,
            cruise_speed_m_s=min(0.01 * value["WPNAV_SPEED"], spec.top_speed_m_s),
            climb_speed_m_s=0.01 * value["WPNAV_SPEED_UP"],
            descent_speed_m_s=0.01 * value["WPNAV_SPEED_DN"],
            landing_speed_m_s=0.01 * value["LAND_SPEED"],
            airspeed_limit_m_s=min(spec.airspeed_limit_m_s, _fastest_airspeed_m_s(spec, value)),
            acceleration_m_s2=0.01 * value["WPNAV_ACCEL"],
            vertical_acceleration_m_s2=0.01 * value["WPNAV_ACCEL_Z"],
            yaw_rate_rad_s=math.radians(0.01 * value["ATC_SLEW_YAW"]),
            yaw_acceleration_rad_s2=math.radians(0.01 * (value["ATC_ACCEL_Y_MAX"] or 72_000.0)),
            acceptance_radius_m=0.01 * value["WPNAV_RADIUS"],
            takeoff_altitude_m=0.01 * value["PILOT_TKOFF_ALT"] or spec.takeoff_altitude_m,
            return_altitude_m=0.01 * value["RTL_ALT"],
            disarm_delay_s=_SPOOL_DOWN_S,
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion model of a multirotor under ArduCopter that stands at home."""
        from sim_vehicle.motion.arducopter.model import ArduCopter

        return ArduCopter(spec, self.law, wind, yaw_rad)

    def law(self, spec: VehicleSpec) -> NDArray[np.float64]:
        """Return the constants of the compiled motion, `sim_vehicle.motion.arducopter.control.LAW`."""
        from sim_vehicle.motion.arducopter.control import HOVER_THROTTLE, LAW
        from sim_vehicle.motion.columns import row_of

        value, number, dt = self.values(spec), self.numbers(spec), spec.step_s
        accel = number["accel"]
        drag, drag_2 = drag_of(spec)
        turn_rate = math.radians(value["ATC_RATE_R_MAX"]), math.radians(value["ATC_RATE_P_MAX"])
        turn_accel = math.radians(0.01 * min(value["ATC_ACCEL_R_MAX"], value["ATC_ACCEL_P_MAX"]))
        limit = min((rate for rate in turn_rate if rate > 0.0), default=math.inf) * GRAVITY_M_S2
        snap = turn_accel * GRAVITY_M_S2 if turn_accel > 0.0 else math.inf
        jerk, jerk_z = min(value["WPNAV_JERK"], limit), number["shape_jerk_z"]
        for name in ("PSC_ACCZ_FLTT", "PSC_ACCZ_FLTE"):
            if value[name] > 0.0:
                most = min(GRAVITY_M_S2, number["accel_z"]) * 2.0 * math.pi * value[name] / 5.0
                jerk_z = min(jerk_z, most)
        # Throttle gains are per cm/s^2, for a throttle range of 1000.
        hover = GRAVITY_M_S2 / HOVER_THROTTLE
        spool_s = value["MOT_SPOOL_TIME"] + HOVER_THROTTLE * value["TKOFF_SLEW_TIME"]
        input_s, lag_s = value["ATC_INPUT_TC"], spec.attitude_response_s
        number |= {
            "dt": dt,
            "drag": drag,
            "drag_2": drag_2,
            "error_filter": _share(dt, value["PSC_VELXY_FLTE"]),
            "rate_filter": _share(dt, value["PSC_VELXY_FLTD"]),
            "error_z_filter": _share(dt, value["PSC_VELZ_FLTE"]),
            "acc_z_p": 0.1 * value["PSC_ACCZ_P"] * hover,
            "acc_z_i": 0.1 * value["PSC_ACCZ_I"] * hover,
            "acc_z_imax": max(0.001 * value["PSC_ACCZ_IMAX"], HOVER_THROTTLE) * hover,
            "corner": 0.01 * value["WPNAV_ACCEL_C"] or 2.0 * accel,
            "pace_filter": min(1.0, dt * value["WPNAV_JERK"] / accel),
            "jerk": jerk,
            "snap": 0.5 * min(snap, jerk * math.pi / (2.0 * max(input_s, 0.1))),
            "shape_jerk": min(value["PSC_JERK_XY"], limit, 0.5 * math.sqrt(accel * snap)),
            "shape_jerk_z": jerk_z,
            "most_lean": GRAVITY_M_S2 * math.tan(_lean_rad(value)),
            "target_filter": 1.0 - math.exp(-dt / max(input_s, 1e-3)),
            "lean_filter": 1.0 - math.exp(-dt / (_ATTITUDE_S if lag_s is None else lag_s)),
            "speed_up": spec.climb_speed_m_s,
            "speed_down": spec.descent_speed_m_s,
            "land_slow": spec.landing_speed_m_s,
            "land_low": max(0.01 * value["LAND_ALT_LOW"], 1.0),
            "spool_steps": round(spool_s / dt),
            "detect_steps": round(_LAND_DETECTOR_S / dt),
            "yaw_rate": spec.yaw_rate_rad_s,
            "yaw_accel": spec.yaw_acceleration_rad_s2,
            "looks_ahead": value["WP_YAW_BEHAVIOR"] > 0.0,
        }
        return row_of(LAW, number)

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the leg of a take-off: straight up, because the position of the item is ignored."""
        keep = KEEP if heading == ALONG else heading
        top = (here[0], here[1], max(target[2], here[2]))
        return [Leg(top, speed, heading=keep, kind=LegKind.TAKEOFF)]

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs to a position and straight down to the ground."""
        return over_and_down(spec, above, last, speed)

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return the legs of a return: climb (lower near home), straight home, loiter, landing."""
        value = self.values(spec)
        x, y, z = last
        home_x, home_y, least = return_point
        lowest = max(_RTL_ALT_MIN_M, z + 0.01 * value["RTL_CLIMB_MIN"])
        height = max(spec.return_altitude_m, least, lowest)
        slope = value["RTL_CONE_SLOPE"]
        if slope >= _LEAST_CONE:
            height = min(height, max(slope * math.hypot(x - home_x, y - home_y), lowest))
        back = 0.01 * value["RTL_SPEED"] or spec.cruise_speed_m_s
        heading = ALONG if value["WP_YAW_BEHAVIOR"] in (1.0, 3.0) else KEEP
        wait = 0.001 * value["RTL_LOIT_TIME"]
        return [
            Leg((x, y, height), back, spec.acceptance_radius_m, KEEP, LegKind.CLIMB),
            Leg((home_x, home_y, height), back, heading=heading, kind=LegKind.HOME, pause_s=wait),
            vertical_landing(spec, home_x, home_y),
        ]


def _share(dt: float, frequency_hz: float) -> float:
    """Return the gain of a low-pass filter per step; a frequency of 0 means no filter."""
    return 1.0 - math.exp(-2.0 * math.pi * frequency_hz * dt) if frequency_hz > 0.0 else 1.0


def _lean_rad(value: Mapping[str, float]) -> float:
    """Return the maximum lean angle."""
    return math.radians(value["PSC_ANGLE_MAX"] or 0.01 * value["ANGLE_MAX"])


def drag_of(spec: VehicleSpec) -> tuple[float, float]:
    """Return two coefficients of the drag over mass: of the airspeed (1/s) and of its square (1/m)."""
    if spec.linear_drag_1_s is not None:
        return spec.linear_drag_1_s, 0.0
    weight = _MASS_KG * GRAVITY_M_S2
    momentum = _MOMENTUM * math.sqrt(weight * _AIR_KG_M3 * _DISC_M2)
    whole = weight * math.tan(_REFERENCE_RAD)
    rest = whole - momentum * math.cos(_REFERENCE_RAD) * _REFERENCE_M_S
    rest *= _AIR_KG_M3 / _REFERENCE_AIR_KG_M3
    return momentum / _MASS_KG, rest / _REFERENCE_M_S**2 / _MASS_KG


def _fastest_airspeed_m_s(spec: VehicleSpec, value: Mapping[str, float]) -> float:
    """Return the airspeed at which the drag balances the maximum lean angle."""
    most, (linear, square) = GRAVITY_M_S2 * math.tan(_lean_rad(value)), drag_of(spec)
    if square > 0.0:
        return (math.sqrt(linear * linear + 4.0 * square * most) - linear) / (2.0 * square)
    return most / linear if linear > 0.0 else math.inf


ARDUCOPTER = ArduCopterProcedures()


# Copters have 690 bytes of storage for rally points of 15 bytes each (StorageManager.cpp). Other vehicles
# have 9842 bytes for missions (655 items with home), 672 for the fence and 750 for rally points.
_COPTER_PROFILE = replace(PROFILE, capacity=(649, 70, 46))
ROOMY_PROFILE = replace(PROFILE, capacity=(654, 84, 50))
ARDUPILOT = Autopilot(
    name="ardupilot",
    title="ArduPilot",
    firmwares={
        "multirotor": Firmware(
            title="ArduCopter",
            mavlink=COPTER_MAVLINK,
            rules=COPTER_RULES,
            profile=_COPTER_PROFILE,
            parameter_table=copter_parameters,
            procedures=ARDUCOPTER,
            behaviour=replace(MISSION, rejected_text="", no_takeoff_text="Auto: Missing Takeoff Cmd"),
            cold_boot=COLD_BOOT,
            reference=partial(reference_parameters, "arducopter"),
            sticks=COPTER_STICKS,
            return_height=("RTL_ALT", 0.01),
        ),
    },
    simulator_urls=lambda index: (f"tcpin:127.0.0.1:{5760 + 10 * index}",),  # as SITL
)
