"""The environment: the true state of a farm's diseases and continuous fields on each day."""

from sensors.dynamics.epidemic import CCR, TYLCV, EpidemicParameters
from sensors.dynamics.soil import SoilParameters
from sensors.environment.environment import Environment, Provenance
from sensors.environment.generate import generate_environment
from sensors.environment.storage import load_environment, save_environment

__all__ = [
    "CCR",
    "TYLCV",
    "Environment",
    "EpidemicParameters",
    "Provenance",
    "SoilParameters",
    "generate_environment",
    "load_environment",
    "save_environment",
]
