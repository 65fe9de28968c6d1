"""The model of an environment: two diseases and the soil."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from sensors.dynamics.epidemic import CCR, TYLCV, EpidemicParameters
from sensors.dynamics.soil import SoilParameters

Disease = Literal["tylcv", "ccr"]
DISEASES: tuple[Disease, ...] = ("tylcv", "ccr")
"""Names of the diseases, in the order of the first axis of the fields."""


@dataclass(frozen=True, slots=True)
class EnvironmentModel:
    """Parameters of the three fields.

    Parameters
    ----------
    tylcv : EpidemicParameters
        Tomato yellow leaf curl virus; its hosts are all tomato cells of the farm and its neighbours.
    ccr : EpidemicParameters
        Charcoal rot; its hosts are all strawberry cells.
    soil : SoilParameters
        Soil humidity.

    Examples
    --------
    >>> EnvironmentModel().epidemic("ccr").likelihood
    0.15
    """

    tylcv: EpidemicParameters = TYLCV
    ccr: EpidemicParameters = CCR
    soil: SoilParameters = field(default_factory=SoilParameters)

    def epidemic(self, disease: Disease) -> EpidemicParameters:
        """Parameters of a disease."""
        return self.tylcv if disease == "tylcv" else self.ccr
