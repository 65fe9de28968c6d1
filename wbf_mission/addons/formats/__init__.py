"""File formats that the core lacks: missions (`missions`) and farms (`farm_files`); command ``convert``."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wbf_mission.addons.formats.missions import FORMATS as FORMATS
else:
    from geo.imports import attach

    __getattr__, __dir__, __all__ = attach(__name__)
