"""Vehicle kind of rovers."""

from __future__ import annotations

from importlib import resources

from sim_vehicle.airframe.kind import Movement, VehicleKind
from wbf_mission.addons.rovers.power import RoverPowerSpec

__all__ = ["ROVER"]

ROVER = VehicleKind(
    "rover",
    Movement.DRIVES,
    base="rover",
    typical="rover",
    vehicles=resources.files(__package__) / "vehicles",
    power=RoverPowerSpec,
    firmwares={
        "px4": "wbf_mission.addons.rovers.px4:FIRMWARE",
        "ardupilot": "wbf_mission.addons.rovers.ardupilot:FIRMWARE",
    },
    mav_types=(10,),  # MAV_TYPE_GROUND_ROVER
)
