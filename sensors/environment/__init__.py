"""The hidden state of the farm: epidemics and soil humidity over days."""

from sensors.dynamics.epidemic import CCR, TYLCV, EpidemicParameters
from sensors.dynamics.soil import SoilParameters
from sensors.environment.environment import Environment, Provenance
from sensors.environment.generate import generate_environment
from sensors.environment.model import DISEASES, EnvironmentModel

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
