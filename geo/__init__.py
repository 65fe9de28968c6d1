"""Geography: units, the local frame, farms, crop maps and farm files."""

from typing import TYPE_CHECKING

from geo.imports import attach

if TYPE_CHECKING:
    from geo.errors import FarmError as FarmError
    from geo.errors import WbfMissionError as WbfMissionError
    from geo.farm import Farm as Farm
    from geo.farm import Obstacle as Obstacle
    from geo.farm import Patch as Patch
    from geo.farm_file import load_farm as load_farm
    from geo.farms import farm_names as farm_names
    from geo.farms import get_farm as get_farm
    from geo.frame import LocalFrame as LocalFrame
    from geo.geojson import save_farm as save_farm
    from geo.grid import Crop as Crop
    from geo.grid import FarmGrid as FarmGrid
    from geo.texts import FOOT_M as FOOT_M
else:
    __getattr__, __dir__, __all__ = attach(__name__)
