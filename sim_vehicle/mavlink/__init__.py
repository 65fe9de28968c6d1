"""Simulated vehicle whose autopilot speaks MAVLink; it is built on the mission executor."""

from sim_vehicle.mavlink.vehicle import SimVehicle

__all__ = ["SimVehicle"]
