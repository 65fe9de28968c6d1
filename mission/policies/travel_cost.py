"""What flying on costs where the budget counts metres or steps: the same from everywhere, at any speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.planners.budget import LengthBudget, StepBudget
from mission.planners.path import Points, drop_coincident
from mission.policies.observation import VehicleReport


@dataclass(frozen=True, slots=True)
class GeometricTravelCost:
    """The travel cost of a budget that counts metres or steps.

    Parameters
    ----------
    budget : LengthBudget or StepBudget
        Its limit does not matter here.
    position_m : tuple of float
        Where the vehicle is, in metres of the farm frame.

    Examples
    --------
    >>> cost = GeometricTravelCost(LengthBudget(50.0, return_to=(0.0, 0.0)), (3.0, 4.0))
    >>> cost.rest([np.empty((0, 2)), np.array([[3.0, 0.0]])])
    [5.0, 7.0]
    >>> cost.legs(np.array([[0.0, 0.0]]), np.array([[3.0, 4.0], [0.0, 2.0]])).tolist()
    [[5.0, 2.0]]
    """

    budget: LengthBudget | StepBudget
    position_m: tuple[float, float]

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return what rests of the path cost, from here through their points and home if that is paid for.

        A point that is named again is a joint of two pieces, which takes no step: in flight it is no stay.
        """
        here = np.asarray(self.position_m, dtype=np.float64)
        return [self.budget.cost(np.vstack((here, drop_coincident(path)))) for path in paths_m]

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return what straight legs cost, float64[n, m], from n points to m others."""
        steps = np.asarray(from_m)[:, None, :] - np.asarray(to_m)[None, :, :]
        length_m: NDArray[np.float64] = np.hypot(steps[..., 0], steps[..., 1])
        if isinstance(self.budget, LengthBudget):
            return length_m
        return np.maximum(np.ceil(length_m / self.budget.step_m - 1e-6), 1.0)

    def change(self, points_m: Points) -> float:  # noqa: ARG002 (the same for every path)
        """Return 0: neither metres nor steps are lost by it."""
        return 0.0


def pays_for_return(vehicle: VehicleReport) -> bool:
    """Return whether the vehicle's budget has to pay for the way home; if that cannot be told, it has to."""
    request = vehicle.request
    place = np.array(request.area.representative_point().coords)
    home = np.array([request.start_xy_m])
    there, and_home = vehicle.travel_cost.rest([place, np.vstack((place, home))])
    back = float(vehicle.travel_cost.legs(place, home)[0, 0])
    return not and_home - there > 0.5 * back
