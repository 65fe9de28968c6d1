"""PX4 1.17 for multirotors; add-ons derive the firmwares of fixed wings and rovers from it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mission.autopilots import PX4 as PROFILE
from mission.link.codec.dialect import mavlink as m
from mission.planners.cornering import Cornering
from sim_vehicle.autopilot.autopilot import Autopilot, Firmware
from sim_vehicle.autopilot.parameters import reference_parameters
from sim_vehicle.autopilot.px4.copter import PX4_MULTIROTOR, strays_m
from sim_vehicle.autopilot.px4.firmware import (
    COPTER_STICKS,
    LINK_NAMES,
    MISSION,
    RULES,
    copter_parameters,
    mavlink_profile,
    simulator_urls,
)

__all__ = ["PX4", "no_multirotor"]


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
            # Default of NAV_ACC_RAD; PX4 misses a smaller radius, because its height error is 0.55 m.
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
