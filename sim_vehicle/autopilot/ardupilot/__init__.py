"""ArduPilot 4.7: ArduCopter, ArduPlane and Rover."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mission.autopilots import ARDUPILOT as PROFILE
from mission.model import Command
from mission.planners.cornering import Cornering
from sim_vehicle.autopilot.ardupilot.copter import ARDUCOPTER
from sim_vehicle.autopilot.ardupilot.firmware import (
    COLD_BOOT,
    COPTER_MAVLINK,
    COPTER_RULES,
    COPTER_STICKS,
    MISSION,
    PLANE_MAVLINK,
    PLANE_RULES,
    PLANE_STICKS,
    ROVER_MAVLINK,
    ROVER_RULES,
    ROVER_STICKS,
    arduplane_landing,
    copter_parameters,
    vehicle_parameters,
)
from sim_vehicle.autopilot.ardupilot.fixed_wing import ARDUPLANE
from sim_vehicle.autopilot.ardupilot.rover import ARDUROVER
from sim_vehicle.autopilot.autopilot import Autopilot, Firmware
from sim_vehicle.autopilot.parameters import reference_parameters

__all__ = ["ARDUPILOT"]


def _simulator_urls(index: int) -> tuple[str, ...]:
    """Port of SITL: it listens on TCP 5760 + 10 i."""
    return (f"tcpin:127.0.0.1:{5760 + 10 * index}",)


# StorageManager.cpp: copters have 690 bytes for rally points, of 15 each. All others have 9842 bytes for
# missions, 655 items with home, 672 for the fence and 750 for rally points.
_COPTER_PROFILE = replace(PROFILE, capacity=(649, 70, 46))
_ROOMY_PROFILE = replace(PROFILE, capacity=(654, 84, 50))
# ArduPlane stores the acceptance and pass radii of waypoints, and the pitch of a take-off.
_PLANE_PROFILE = replace(
    _ROOMY_PROFILE,
    lossy={
        **PROFILE.lossy,
        Command.NAV_WAYPOINT: frozenset({"param4"}),
        Command.NAV_TAKEOFF: frozenset({"param2", "param3", "param4"}),
    },
)
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
        "fixed-wing": Firmware(
            title="ArduPlane",
            mavlink=PLANE_MAVLINK,
            rules=PLANE_RULES,
            profile=_PLANE_PROFILE,
            parameter_table=vehicle_parameters,
            procedures=ARDUPLANE,
            behaviour=replace(MISSION, refuses_to_arm=arduplane_landing),
            reference=partial(reference_parameters, "arduplane"),
            sticks=PLANE_STICKS,
            # Flown to, not turned before as within WP_RADIUS.
            cornering=Cornering(2.0),
        ),
        "rover": Firmware(
            title="Rover",
            mavlink=ROVER_MAVLINK,
            rules=ROVER_RULES,
            profile=_ROOMY_PROFILE,
            parameter_table=vehicle_parameters,
            procedures=ARDUROVER,
            behaviour=MISSION,
            reference=partial(reference_parameters, "rover"),
            sticks=ROVER_STICKS,
            takes_off=True,
        ),
    },
    simulator_urls=_simulator_urls,
)
