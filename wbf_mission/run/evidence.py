"""What was seen in a run so far, and what is believed of it."""

from __future__ import annotations

from geo import Farm
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.run.estimation import RunEstimate


class Evidence:
    """Observations of all flights, and the estimate that learns from them.

    Parameters
    ----------
    farm : Farm
    fields : FieldSet
    """

    def __init__(self, farm: Farm, fields: FieldSet) -> None:
        self.estimate: RunEstimate | None = None
        self._farm = farm
        self._fields = fields
        self._parts: list[Observations] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, *parts: Observations, offset_s: float) -> None:
        """Take observations, made `offset_s` after the beginning of the run by the time they tell."""
        told = [part for part in parts if len(part)]
        if not told:
            return
        self._parts += told
        self._count += sum(map(len, told))
        if self.estimate is not None:
            self.estimate.add(told, offset_s)

    @property
    def parts(self) -> tuple[Observations, ...]:
        """All observations, in the parts and the order in which they arrived."""
        return tuple(part for part in self._parts if len(part))

    def observations(self) -> Observations:
        """Return all observations, in the order in which they arrived."""
        if len(self._parts) != 1:
            self._parts = [Observations.concatenate(self._parts, self._fields.names)]
        return self._parts[0]

    def model(self) -> InformationModel:
        """Return what is believed after all observations so far; without an estimate: nothing is known."""
        if self.estimate is not None:
            return self.estimate.current()
        return InformationModel.unknown(self._farm.grid().shape, self._fields)
