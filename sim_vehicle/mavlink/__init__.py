"""The simulated vehicle: an autopilot that speaks MAVLink, on the mission executor."""

from sim_vehicle.mavlink.vehicle import SimVehicle
from sim_vehicle.pilot.outcome import Outcome

__all__ = ["Outcome", "SimVehicle"]
