"""PX4 1.17 on multirotors, fixed wings and rovers."""

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
    FIXED_WING_RULES,
    FIXED_WING_STICKS,
    MISSION,
    ROVER_RULES,
    ROVER_STICKS,
    RULES,
    copter_parameters,
    fixed_wing_parameters,
    mavlink_profile,
    rover_parameters,
)
from sim_vehicle.autopilot.px4.fixed_wing import PX4_FIXED_WING
from sim_vehicle.autopilot.px4.rover import PX4_ROVER
from sim_vehicle.autopilot.px4.streams import LINK_NAMES, simulator_urls

__all__ = ["PX4"]


# Groups of the multirotor's controllers, which do not run on the others.
_OF_MULTIROTORS = ("FLW_", "HTE_", "LNDMC_", "MC_", "MPC_")
_COPTER = Firmware(
    title="PX4",
    mavlink=mavlink_profile(m.MAV_TYPE_QUADROTOR),
    rules=RULES,
    profile=PROFILE,
    parameter_table=copter_parameters,
    procedures=PX4_MULTIROTOR,
    takes_off=True,
    behaviour=MISSION,
    # NAV_ACC_RAD. Less it cannot hold: the error of its height estimate, 0.55 m, counts in the radius.
    cornering=Cornering(2.0, overshoots=True),
    reference=partial(reference_parameters, "px4"),
    sticks=COPTER_STICKS,
    strays_m=strays_m,
    return_height=("RTL_RETURN_ALT", 1.0),
)
PX4 = Autopilot(
    name="px4",
    title="PX4",
    firmwares={
        "multirotor": _COPTER,
        "fixed-wing": replace(
            _COPTER,
            mavlink=mavlink_profile(m.MAV_TYPE_FIXED_WING),
            parameter_table=fixed_wing_parameters,
            rules=FIXED_WING_RULES,
            procedures=PX4_FIXED_WING,
            takes_off=False,
            # A wing's mission that ends with a return was not recorded.
            behaviour=replace(MISSION, return_lag_s=None),
            cornering=Cornering(2.0),
            reference=partial(reference_parameters, "px4", without=_OF_MULTIROTORS),
            sticks=FIXED_WING_STICKS,
            strays_m=None,
            return_height=None,
        ),
        "rover": replace(
            _COPTER,
            mavlink=mavlink_profile(m.MAV_TYPE_GROUND_ROVER),
            parameter_table=rover_parameters,
            rules=ROVER_RULES,
            procedures=PX4_ROVER,
            cornering=Cornering(),
            reference=partial(reference_parameters, "px4", without=_OF_MULTIROTORS),
            sticks=ROVER_STICKS,
            strays_m=None,
            return_height=None,
        ),
    },
    simulator_urls=simulator_urls,
    link_names=LINK_NAMES,
)
