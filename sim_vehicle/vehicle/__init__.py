"""The simulated vehicle: an autopilot that speaks MAVLink, on the mission executor."""

from sim_vehicle.vehicle.modes import Mode, Outcome
from sim_vehicle.vehicle.persona import ARDUPILOT, PX4, Persona, get_persona, persona_names
from sim_vehicle.vehicle.vehicle import SimVehicle

__all__ = [
    "ARDUPILOT",
    "PX4",
    "Mode",
    "Outcome",
    "Persona",
    "SimVehicle",
    "get_persona",
    "persona_names",
]
