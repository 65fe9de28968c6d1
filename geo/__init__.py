"""Where things are: units, the local frame, farms, their cells and farm files."""

from geo.errors import FarmError, WbfMissionError
from geo.farm import Crop, Farm, Patch
from geo.farms import farm_names, get_farm
from geo.frame import LocalFrame
from geo.geojson import load_farm, save_farm
from geo.grid import FarmGrid
from geo.units import FOOT_M

__all__ = [
    "FOOT_M",
    "Crop",
    "Farm",
    "FarmError",
    "FarmGrid",
    "LocalFrame",
    "Patch",
    "WbfMissionError",
    "farm_names",
    "get_farm",
    "load_farm",
    "save_farm",
]
