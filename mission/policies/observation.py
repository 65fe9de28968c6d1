"""Observations of policies: only what a computer on the ground can know."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.errors import PlanningError
from mission.planners.budget import LengthBudget, StepBudget
from mission.planners.path import Points, drop_coincident
from mission.planners.request import PlanningRequest
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import ScoreWeights


class Event(Enum):
    """Reason for which a policy is asked."""

    START = "start"
    """Nothing flies yet: every vehicle needs its first path; a path without points keeps it on the ground."""
    OBSERVATIONS = "observations"
    """New observations of the camera."""
    WAYPOINT = "waypoint"
    """A vehicle reached a waypoint of its path."""
    PERIOD = "period"
    """The time between two questions has passed."""
    ENDING = "ending"
    """A vehicle is about to reach the end of its path; then it flies home."""
    LOST = "lost"
    """A vehicle failed or fell silent; its part of the farm is left."""


class Status(Enum):
    """State of a vehicle's flight."""

    READY = "ready"
    """On the ground at its start, before its flight."""
    CLIMBING = "climbing"
    """Taking off; its path can be changed at its height: near the ground it goes straight up."""
    FLYING = "flying"
    """On its path; the path can be changed."""
    CHANGING = "changing"
    """On its path, while a new path is being sent; this has to arrive first."""
    SILENT = "silent"
    """Probably on its path, but silent for a while, or its progress since is not yet known: it flies its plan
    and cannot get a new path."""
    RETURNING = "returning"
    """Flying home or landing; its path cannot be changed any more."""
    PILOTED = "piloted"
    """Taken out of its mission by a pilot, an operator or a safety function; its path is not changed."""
    ENDED = "ended"
    """Back, as planned."""
    LOST = "lost"
    """Failed, or silent for longer than its plan explains."""


class TravelCost(Protocol):
    """Cost of flying for a vehicle from its present position, in the unit of its budget."""

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return the costs of several rests of the path, from here through their points and home.

        A rest is float64[n, 2] in metres of the farm frame; n = 0 is the way home. The budget decides whether
        the way home costs anything. Infinite for a path that the vehicle cannot fly. Decisions are checked by
        these costs.
        """

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return the rough costs of straight legs, float64[n, m], from n points to m others.

        Cheap, to choose among many legs: with the wind, and the mean cost of a turn.
        """

    def change(self, points_m: Points) -> float:
        """Return the cost of leaving the present path for another, besides the way.

        0 if the autopilot keeps its speed, which most do. A policy may compare a new path with the present
        one only if this is above 0.
        """


@dataclass(frozen=True, slots=True)
class ContactArea:
    """Area of sure radio contact, where a vehicle can get a new path: a circle over ground.

    Examples
    --------
    >>> ContactArea((0.0, 0.0), 4.0).away_m((3.0, 4.0))
    1.0
    """

    center_m: tuple[float, float]  # In metres of the farm frame
    radius_m: float  # Below 0: contact is sure nowhere

    @property
    def is_nowhere(self) -> bool:
        """Whether contact is sure nowhere."""
        return self.radius_m < 0.0

    def away_m(self, point_m: tuple[float, float] | NDArray[np.float64]) -> float:
        """Return the distance of a point to the area; 0 within."""
        return max(0.0, math.dist(point_m, self.center_m) - self.radius_m)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleReport:
    """A vehicle by its last telemetry.

    Parameters
    ----------
    system_id : int
        Its MAVLink system id, by which decisions name it.
    request : PlanningRequest
        Its task: area, start, whole budget, footprint, seed.
    position_m : tuple of float
        x and y in metres of the farm frame.
    velocity_m_s : tuple of float
        Over ground, along x and y.
    age_s : float
        Age of position and velocity.
    spent : float
        Cost of the flight until now, for a real flight until the answer, in the unit of the budget.
    rest_m : float64[n, 2]
        The points of its path ahead, the present target first; read-only.
    travel_cost : TravelCost
        Cost of flying on from here.
    battery : float or None
        Fraction of the battery that is left; None if unknown.
    delay_s : float
        Measured delay from an answer to the vehicle's turn, seconds.
    contact : ContactArea or None
        Area in which a path has to end so that another can follow; None: anywhere.
    """

    system_id: int
    request: PlanningRequest
    status: Status
    position_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    age_s: float
    spent: float
    rest_m: Points
    travel_cost: TravelCost
    battery: float | None = None
    delay_s: float = 0.0
    contact: ContactArea | None = None

    def __post_init__(self) -> None:
        rest = np.array(self.rest_m, dtype=np.float64).reshape(-1, 2)
        if not np.isfinite(rest).all():
            msg = f"vehicle {self.system_id}: the rest of its path has a point that is not finite"
            raise PlanningError(msg)
        rest.flags.writeable = False
        object.__setattr__(self, "rest_m", rest)

    @property
    def left(self) -> float:
        """Rest of the budget, in its unit; never below zero."""
        return max(0.0, self.request.budget.limit - self.spent)

    @property
    def steerable(self) -> bool:
        """Whether a decision may change its path."""
        return self.status in (Status.READY, Status.FLYING)

    @property
    def heading_rad(self) -> float:
        """Direction of its motion over ground, from the x-axis towards y; 0 at rest."""
        return math.atan2(self.velocity_m_s[1], self.velocity_m_s[0])


@dataclass(frozen=True, slots=True, eq=False)
class PolicyObservation:
    """The knowledge of a policy when it is asked.

    Parameters
    ----------
    event : Event
        Reason of the question.
    time_s : float
        Seconds since the mission began; 0 before.
    day : int
        Day of the environment.
    fields : FieldSet
        The fields that are sensed and scored.
    weights : ScoreWeights
        Costs of errors.
    model : InformationModel
        The estimate of the farm. Its arrays are read-only and valid until the answer.
    observations : Observations
        All observations until now, in the order of their arrival.
    vehicles : tuple of VehicleReport
        In the order of their system ids.
    compute_s : float
        Time limit of the answer, seconds. A later answer is not flown.
    """

    event: Event
    time_s: float
    day: int
    farm: Farm
    fields: FieldSet
    weights: ScoreWeights
    model: InformationModel
    observations: Observations
    vehicles: tuple[VehicleReport, ...]
    compute_s: float

    @property
    def steerable(self) -> tuple[VehicleReport, ...]:
        """The vehicles whose paths may be changed."""
        return tuple(vehicle for vehicle in self.vehicles if vehicle.steerable)

    def vehicle(self, system_id: int) -> VehicleReport:
        """Return the vehicle of this system id.

        Raises
        ------
        PlanningError
            If there is none.
        """
        for vehicle in self.vehicles:
            if vehicle.system_id == system_id:
                return vehicle
        known = ", ".join(str(vehicle.system_id) for vehicle in self.vehicles)
        msg = f"no vehicle has the system id {system_id}; there are {known}"
        raise PlanningError(msg)


@dataclass(frozen=True, slots=True)
class GeometricTravelCost:
    """The travel cost of a budget that counts metres or steps.

    Parameters
    ----------
    budget : LengthBudget or StepBudget
        Its limit does not matter here.
    position_m : tuple of float
        Position of the vehicle, in metres of the farm frame.

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
        """Return the costs of rests of the path, from here through their points, and home if the budget pays.

        A repeated point is a joint of two pieces and takes no step: in flight it is no stay.
        """
        here = np.asarray(self.position_m, dtype=np.float64)
        return [self.budget.cost(np.vstack((here, drop_coincident(path)))) for path in paths_m]

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return the costs of straight legs, float64[n, m], from n points to m others."""
        steps = np.asarray(from_m)[:, None, :] - np.asarray(to_m)[None, :, :]
        length_m: NDArray[np.float64] = np.hypot(steps[..., 0], steps[..., 1])
        if isinstance(self.budget, LengthBudget):
            return length_m
        return np.maximum(np.ceil(length_m / self.budget.step_m - 1e-6), 1.0)

    def change(self, points_m: Points) -> float:  # noqa: ARG002 (the same for every path)
        """Return 0: a change takes neither metres nor steps."""
        return 0.0


def pays_for_return(vehicle: VehicleReport) -> bool:
    """Return whether the vehicle's budget pays for the way home; true if that is not clear."""
    request = vehicle.request
    place = np.array(request.area.representative_point().coords)
    home = np.array([request.start_xy_m])
    there, and_home = vehicle.travel_cost.rest([place, np.vstack((place, home))])
    back = float(vehicle.travel_cost.legs(place, home)[0, 0])
    return not and_home - there > 0.5 * back
