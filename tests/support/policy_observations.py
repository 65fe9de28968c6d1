"""Situations for tests of policies: vehicles of one cell a step over a Miniberry."""

import numpy as np

from geo.farms import get_farm
from mission.planners import PlanningRequest, StepBudget
from mission.policies.observation import Event, GeometricTravelCost, PolicyObservation, Status, VehicleReport
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import PAPER_WEIGHTS

NOWHERE = np.empty((0, 2))


def report(system_id=1, *, farm="miniberry-30", area=None, budget=None, steps=200.0, seed=3, **known):
    farm = get_farm(farm)
    budget = StepBudget(steps, farm.cell_size_m) if budget is None else budget
    area = farm.owner_area if area is None else area
    request = PlanningRequest(area, farm.home_m, budget, farm.cell_size_m, seed=seed)
    here = known.get("here", farm.home_m)
    return VehicleReport(
        system_id,
        request,
        known.get("status", Status.READY),
        here,
        (0.0, 0.0),
        0.0,
        known.get("spent", 0.0),
        known.get("rest", NOWHERE),
        known.get("travel_cost", GeometricTravelCost(budget, here)),
        contact=known.get("contact"),
    )


def observation(*vehicles, farm="miniberry-30", event=Event.START, model=None, seen=None):
    farm = get_farm(farm)
    if model is None:
        model = InformationModel.uniform(farm.grid().shape, value=(1, 1, 0.4), uncertainty=1)
    seen = Observations.empty() if seen is None else seen
    return PolicyObservation(event, 0.0, 6, farm, PAPER_FIELDS, PAPER_WEIGHTS, model, seen, vehicles, 2.0)
