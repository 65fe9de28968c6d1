"""Generates ensembles: many environments of one farm, generated in parallel and stored in a folder."""

from typing import TYPE_CHECKING

from geo.imports import attach

if TYPE_CHECKING:
    from wbf_mission.addons.ensembles.ensemble import Ensemble as Ensemble
    from wbf_mission.addons.ensembles.ensemble import generate_ensemble as generate_ensemble
else:
    __getattr__, __dir__, __all__ = attach(__name__)
