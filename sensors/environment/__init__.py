"""The hidden state of the farm: epidemics and soil humidity over days."""

from sensors.environment.environment import Environment, Provenance
from sensors.environment.epidemic import CCR, TYLCV, EpidemicParameters
from sensors.environment.generate import generate_environment
from sensors.environment.model import DISEASES, EnvironmentModel
from sensors.environment.soil import SoilParameters

__all__ = [
    "CCR",
    "DISEASES",
    "TYLCV",
    "Environment",
    "EnvironmentModel",
    "EpidemicParameters",
    "Provenance",
    "SoilParameters",
    "generate_environment",
]
