"""Flights and transfers by MAVSDK, an implementation of MAVLink independent of this project's code."""

from geo.imports import load_extra
from mission.errors import LinkError

load_extra("mavsdk", "mavsdk", "--via mavsdk needs", LinkError)
