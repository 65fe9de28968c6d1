"""What each day of a run gave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from sensors.scoring.information import InformationModel
from wbf_mission.maps.report import FarmReport
from wbf_mission.run.estimation import ScoreHistory

KEPT_DAYS_BYTES = 128_000_000
"""Truth and estimate of every day are kept if those of all days together take no more."""


@dataclass(frozen=True, slots=True, eq=False)
class DayRecord:
    """One day of a run.

    Parameters
    ----------
    day : int
    report : FarmReport or None
        What the estimate at the end of the day says of the farm; None without an estimate.
    truth : float32[n, W, H] or None
        The environment of the day; None on large farms, where only the last day's is kept.
    model : InformationModel or None
        The estimate at the end of the day, without class probabilities; None as for `truth`.
    """

    day: int
    report: FarmReport | None
    truth: NDArray[np.float32] | None = None
    model: InformationModel | None = None

    def summary(self, history: ScoreHistory, flights: int, observations: int) -> dict[str, Any]:
        """Return plain values for JSON.

        Parameters
        ----------
        history : ScoreHistory
            The run's.
        flights, observations : int
            How many there were on the day.
        """
        own = history.of_day(self.day)
        last = own.entries[-1] if own.entries else None
        return {
            "day": self.day,
            "flights": flights,
            "observations": observations,
            "scored_times": len(own.entries),
            "score": own.score,
            "final_score": None if last is None else last.score,
            "losses": {} if last is None else dict(zip(last.fields, last.field_loss, strict=True)),
            "report": None if self.report is None else self.report.to_dict(),
        }


def keeps_days(farm: Farm, fields: int, days: int) -> bool:
    """Return whether truth and estimate of every day of a run are kept.

    >>> from geo.farms import get_farm
    >>> keeps_days(get_farm("miniberry-100"), 3, 15), keeps_days(get_farm("waterberry"), 3, 2)
    (True, False)
    """
    # Truth, value and uncertainty, four bytes each.
    return days * 3 * 4 * fields * farm.width_cells * farm.height_cells <= KEPT_DAYS_BYTES
