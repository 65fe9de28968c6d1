"""Vehicle kind of fixed wings."""

from __future__ import annotations

from importlib import resources

from sim_vehicle.airframe.kind import Movement, VehicleKind
from wbf_mission.addons.wings.power import FixedWingAirframe, FixedWingPowerSpec

__all__ = ["FIXED_WING"]

FIXED_WING = VehicleKind(
    "fixed-wing",
    Movement.CIRCLES,
    base="wing",
    typical="fixed-wing",
    vehicles=resources.files(__package__) / "vehicles",
    power=FixedWingPowerSpec,
    airframe=FixedWingAirframe,
    firmwares={
        "px4": "wbf_mission.addons.wings.px4:FIRMWARE",
        "ardupilot": "wbf_mission.addons.wings.ardupilot:FIRMWARE",
    },
    mav_types=(1,),  # MAV_TYPE_FIXED_WING
)
