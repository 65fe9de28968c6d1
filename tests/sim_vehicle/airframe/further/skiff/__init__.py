"""A kind of vehicle as another package would give it: boats, and an autopilot with a firmware for them."""

from dataclasses import dataclass, replace
from importlib import resources
from types import MappingProxyType

from sim_vehicle.airframe.kind import Movement, VehicleKind
from wbf_mission.addons.rovers.kind import RoverPowerSpec


@dataclass(frozen=True, slots=True)
class Hull:
    """Table ``[airframe]`` of a boat's vehicle file."""

    length_m: float = 1.5
    turn_lengths: float = 1.5


@dataclass(frozen=True, slots=True)
class HullPower(RoverPowerSpec):
    """Water brakes by the square of the speed: its drag as that of so much more area in air."""

    rolling_resistance: float = 0.001
    drag_area_m2: float = 16.0


BOAT = VehicleKind(
    "boat",
    Movement.DRIVES,
    base="skiff",
    typical="skiff",
    vehicles=resources.files(__name__),
    power=HullPower,
    airframe=Hull,
    procedures="skiff.steering:STEERING",
    shown_as="rover",
    mav_types=(11,),
)


def __getattr__(name):
    """Make the autopilot when it is asked for: a list of vehicles does not need it."""
    if name != "TIDE":
        raise AttributeError(name)
    from sim_vehicle.autopilot.ardupilot import ARDUPILOT
    from skiff.steering import TIDAL

    rover = ARDUPILOT.for_vehicle("rover")
    boat = replace(rover, title="Tide", procedures=TIDAL)
    return replace(ARDUPILOT, name="tide", title="Tide", firmwares=MappingProxyType({"boat": boat}))
