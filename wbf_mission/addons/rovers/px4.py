"""PX4 with a rover: driving limits from its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.planners.cornering import Cornering
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.parameters import MavParameter, Setting, motion_parameters
from sim_vehicle.autopilot.px4 import no_multirotor
from sim_vehicle.autopilot.px4.firmware import AXIS, LOSS, RULES, common_parameters
from sim_vehicle.autopilot.stick_rules import StickRules
from wbf_mission.addons.rovers.motion.layout import RoverLimits
from wbf_mission.addons.rovers.procedures import RoverProcedures

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
_DIFFERENTIAL = 6.0
_GRIP_M_S2 = 0.4 * GRAVITY_M_S2
# Rover of the simulator (`sih.cpp`): force of full throttle, rolling resistance over weight, wheel base,
# maximum wheel angle and cornering stiffness. The simulator steps every 4 ms, but filters its outputs only in
# steps with new outputs, which arrive every 10 ms.
_SIH_ROVER = 5.0
_SIH_FORCE_N = 400.0
_SIH_ROLLING = 0.3
_SIH_WHEEL_BASE_M = 0.321
_SIH_STEERING_RAD = math.radians(30.0)
_SIH_STIFFNESS_N_RAD = 500.0
_SIH_STEPS = 10.0 / 4.0


class Px4Rover(RoverProcedures):
    """Procedures of PX4 with a rover; see `wbf_mission.addons.rovers.procedures.RoverProcedures`."""

    name = "px4"
    parameters = motion_parameters("px4-rover-motion", __package__)

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with the speeds and the acceptance radius set by its parameters."""
        limit = self.value(spec, "RO_SPEED_LIM")
        cruise = limit if limit > 0.0 else spec.cruise_speed_m_s
        limit = limit / 0.95 if limit > 0.0 else spec.speed_limit_m_s
        return replace(
            spec,
            cruise_speed_m_s=cruise,
            speed_limit_m_s=max(limit, cruise / 0.95),
            acceptance_radius_m=self.limits(spec).acceptance,
        )

    def limits(self, spec: VehicleSpec) -> RoverLimits:
        """Return the driving limits of a vehicle."""
        value = self.values(spec)
        skid = value["CA_AIRFRAME"] == _DIFFERENTIAL
        rate = value["RO_YAW_RATE_LIM"]
        limit = value["RO_SPEED_LIM"]
        speed_max = limit if limit > 0.0 else spec.speed_limit_m_s
        turn_rate = math.radians(rate) if rate > 0.0 else spec.yaw_rate_rad_s * 2.0
        radius = value["RA_WHEEL_BASE"] / math.tan(value["RA_MAX_STR_ANG"])
        accel = value["RO_YAW_ACCEL_LIM"]
        cuts = not skid and value["RA_ACC_RAD_MAX"] > 0.0
        own = RoverLimits(
            **self.numbers(spec, RoverLimits),
            speed_max=speed_max,
            acceleration=_own(value["RO_ACCEL_LIM"], spec.acceleration_m_s2),
            deceleration=_own(value["RO_DECEL_LIM"], spec.acceleration_m_s2),
            turn_radius=0.0 if skid else radius,
            turn_rate=turn_rate,
            lateral=_GRIP_M_S2,
            steering_s=0.2,
            ahead_max=max(value["PP_LOOKAHD_MAX"], value["PP_LOOKAHD_MIN"]),
            pivot_begin=value["RD_TRANS_DRV_TRN"] if skid else 0.0,
            pivot_end=min(value["RD_TRANS_TRN_DRV"], value["RD_TRANS_DRV_TRN"]),
            pivot_rate=math.radians(rate) if rate > 0.0 else spec.yaw_rate_rad_s,
            # The corner radius is the radius at the front wheels (wheel base divided by the sine).
            corner_gain=value["RA_ACC_RAD_GAIN"] / math.cos(value["RA_MAX_STR_ANG"]) if cuts else 0.0,
            corner_max=max(value["RA_ACC_RAD_MAX"], value["NAV_ACC_RAD"]),
            passes=False,
            yaw_acceleration=math.radians(accel) if accel > 0.0 else 1e5,
            jerk=max(value["RO_JERK_LIM"], 0.0),
            corner_slows=value["RO_SPEED_RED"] if value["RO_SPEED_RED"] > 0.0 else -1.0,
            corner_least=radius * turn_rate,
            corner_most=value["RO_MAX_THR_SPEED"] or speed_max,
            simulated={},
        )
        if value["SIH_VEHICLE_TYPE"] != _SIH_ROVER:
            return own
        # The simulated rover's tyres hold in every turn, so the lateral acceleration has no limit.
        simulated = self.numbers(spec) | _simulated(own, value, spec.step_s)
        return replace(own, lateral=math.inf, simulated=simulated)


def _simulated(law: RoverLimits, value: Mapping[str, float], step_s: float) -> dict[str, float]:
    """Return the values of PX4's simulated rover that are not parameters."""
    latitude, longitude = math.radians(value["SIH_LOC_LAT0"]), math.radians(value["SIH_LOC_LON0"])
    sine, cosine = math.sin(latitude), math.cos(latitude)
    steer_speed = math.radians(value["RA_STR_RATE_LIM"]) if value["RA_STR_RATE_LIM"] > 0.0 else 1e5
    return {
        "throttle_speed": law.corner_most,
        "wheel_base": _SIH_WHEEL_BASE_M,
        "steer_max": _SIH_STEERING_RAD,
        "steer_step": steer_speed / _SIH_STEERING_RAD * step_s,
        "force": _SIH_FORCE_N / value["SIH_MASS"],
        "friction": _SIH_ROLLING * GRAVITY_M_S2,
        "grip": _SIH_STIFFNESS_N_RAD / value["SIH_MASS"],
        "turn_grip": _SIH_STIFFNESS_N_RAD / value["SIH_IZZ"],
        "turn_damping": value["SIH_KDW"] / value["SIH_IZZ"],
        "actuator_share": -math.expm1(-step_s / (value["SIH_T_TAU"] * _SIH_STEPS)),
        "drag": value["SIH_KDV"] / value["SIH_MASS"],
        "north_1": -sine * math.cos(longitude),
        "north_2": -sine * math.sin(longitude),
        "north_3": cosine,
        "east_1": -math.sin(longitude),
        "east_2": math.cos(longitude),
    }


def _own(value: float, otherwise: float) -> float:
    return value if value > 0.0 else otherwise


def rover_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Return the parameters of a rover."""
    return common_parameters(spec, system_id, m.MAV_TYPE_GROUND_ROVER)


_DEGREE = math.radians(1.0)
_STICKS = StickRules(
    speeds={Mode.POSITION: None, Mode.MANUAL: None},
    needed=frozenset({Mode.POSITION, Mode.MANUAL}),
    impossible=frozenset({Mode.ALTITUDE}),
    level=AXIS,
    vertical=AXIS,
    turning=AXIS,
    turn_rate=Setting("RO_YAW_RATE_LIM", 0.0, _DEGREE),
    drives=True,
    loss=LOSS,
)
FIRMWARE = replace(
    no_multirotor(m.MAV_TYPE_GROUND_ROVER),
    parameter_table=rover_parameters,
    # An armed rover counts as driving.
    rules=replace(RULES, idle=None),
    procedures=Px4Rover(),
    cornering=Cornering(),
    sticks=_STICKS,
)
