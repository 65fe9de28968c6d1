"""What a policy answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from mission.errors import AnswerError
from mission.planners.path import Points


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """A path that was thought of, for the record of a run.

    Parameters
    ----------
    system_id : int
        For which vehicle.
    points_m : float64[n, 2]
        Metres of the farm frame.
    value : float
        What it promises, in the policy's own measure; more is better.
    cost : float
        What it costs, in the unit of the vehicle's budget.
    """

    system_id: int
    points_m: Points
    value: float
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """New rests of the paths of one or several vehicles, or to go on.

    Parameters
    ----------
    paths : mapping of int to float64[n, 2]
        By system id the points to fly through from now on, in metres of the farm frame; the vehicle then
        flies home. No points: fly home now (a vehicle whose mission does not lead home, the ideal robot, ends
        where it is); at the start: do not fly. Vehicles that are not named go on.
    reason : str
        Why, in a few words, for the record.
    alternatives : tuple of Alternative
        What else was thought of, the chosen ones among them; the best first.
    spacing_m : mapping of int to float
        Distance between neighbouring rows of a path, where it has such a thing; for reports.

    Raises
    ------
    AnswerError
        If points are no finite pairs.

    Examples
    --------
    >>> NO_CHANGE.changes
    False
    >>> Decision({1: [[0.0, 0.0], [5.0, 0.0]]}).paths[1].shape
    (2, 2)
    """

    paths: Mapping[int, Points] = field(default_factory=dict)
    reason: str = ""
    alternatives: tuple[Alternative, ...] = ()
    spacing_m: Mapping[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        taken = {}
        for system_id, points in self.paths.items():
            array = np.array(points, dtype=np.float64)
            if array.size == 0:
                array = np.empty((0, 2))
            if array.ndim != 2 or array.shape[1] != 2:
                shape = array.shape
                msg = f"vehicle {system_id}: a path is finite (x, y) points, not an array of shape {shape}"
                raise AnswerError(msg, "no points")
            if not np.isfinite(array).all():
                worst = array[~np.isfinite(array)][0]
                msg = f"vehicle {system_id}: a path is finite (x, y) points, but a coordinate is {worst}"
                raise AnswerError(msg, "not finite")
            array.flags.writeable = False
            taken[int(system_id)] = array
        object.__setattr__(self, "paths", MappingProxyType(taken))
        object.__setattr__(self, "spacing_m", MappingProxyType(dict(self.spacing_m)))

    @property
    def changes(self) -> bool:
        """Whether any vehicle gets another path."""
        return bool(self.paths)


NO_CHANGE = Decision()
"""Everybody flies on as before."""

GO_ON = NO_CHANGE
"""Its name before version 0.2, for policies that were written for it."""
