"""The simulated vehicle: an autopilot that speaks MAVLink, on the mission executor."""

from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.mavlink.persona import ARDUPILOT, PX4, Persona, get_persona, persona_names
from sim_vehicle.mavlink.vehicle import SimVehicle
from sim_vehicle.pilot.modes import Outcome

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
