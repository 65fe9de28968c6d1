"""Flights and transfers by MAVSDK, an implementation independent of our own."""

from geo.imports import load_extra
from mission.errors import LinkError

load_extra("mavsdk", "mavsdk", "--via mavsdk needs", LinkError)
