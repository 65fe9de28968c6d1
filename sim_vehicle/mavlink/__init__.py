"""The simulated vehicle: an autopilot that speaks MAVLink, on the mission executor."""

from sim_vehicle.mavlink.vehicle import SimVehicle

__all__ = ["SimVehicle"]
