"""ArduPilot 4.7 for multirotors (ArduCopter); add-ons provide ArduPlane and Rover."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mission.autopilots import ARDUPILOT as PROFILE
from sim_vehicle.autopilot.ardupilot.copter import ARDUCOPTER
from sim_vehicle.autopilot.ardupilot.firmware import (
    COLD_BOOT,
    COPTER_MAVLINK,
    COPTER_RULES,
    COPTER_STICKS,
    MISSION,
    copter_parameters,
)
from sim_vehicle.autopilot.autopilot import Autopilot, Firmware
from sim_vehicle.autopilot.parameters import reference_parameters

__all__ = ["ARDUPILOT", "ROOMY_PROFILE"]


def _simulator_urls(index: int) -> tuple[str, ...]:
    """Return the address of instance `index` of SITL, which listens on TCP port 5760 + 10 `index`."""
    return (f"tcpin:127.0.0.1:{5760 + 10 * index}",)


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
    simulator_urls=_simulator_urls,
)
