"""Simulated vehicle with an autopilot that speaks MAVLink, on top of the mission executor."""

from sim_vehicle.mavlink.vehicle import SimVehicle

__all__ = ["SimVehicle"]
