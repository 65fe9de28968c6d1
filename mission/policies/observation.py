"""What a policy is told when it is asked: all that a computer on the ground can know, and nothing else."""

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
    """Why a policy is asked."""

    START = "start"
    """Nothing flies yet: every vehicle needs its first path, or one without points to stay."""
    OBSERVATIONS = "observations"
    """The camera told something new."""
    WAYPOINT = "waypoint"
    """A vehicle reached a waypoint of its path."""
    PERIOD = "period"
    """The time between two questions has passed."""
    ENDING = "ending"
    """A vehicle is about to reach the end of its path; then it flies home."""
    LOST = "lost"
    """A vehicle failed, or was heard of no more; its part of the farm is left."""


class Status(Enum):
    """What a vehicle is doing."""

    READY = "ready"
    """On the ground at its start, before its flight."""
    CLIMBING = "climbing"
    """Taking off; its path can be changed when it is at its height: near the ground it goes straight up."""
    FLYING = "flying"
    """On its path; the path can be changed."""
    CHANGING = "changing"
    """On its path, while another one is on its way to it; that one has to arrive first."""
    SILENT = "silent"
    """On its path as far as is known, but not heard of for a while, or not yet how far it is since then: it
    flies its plan and cannot be told of another one."""
    RETURNING = "returning"
    """On its way home, or landing; its path cannot be changed any more."""
    PILOTED = "piloted"
    """Taken out of its mission by a pilot, an operator or a safety function; nobody changes its path then."""
    ENDED = "ended"
    """Back, as it was meant to be."""
    LOST = "lost"
    """Failed, or silent for longer than its plan explains: nobody counts on it."""


class TravelCost(Protocol):
    """What flying costs one vehicle from where it is now, in the unit of its budget."""

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return what each of several rests of the path costs, from here through its points and home.

        Each is float64[n, 2] in metres of the farm frame; n = 0 is the way home. Whether the way home is
        paid for is the budget's matter. Infinite for a path that the vehicle cannot fly. This is what a
        decision is held to.
        """

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return roughly what straight legs cost, float64[n, m], from n points to m others.

        Cheap, for choosing among many: wind counts, turns count as a mean one.
        """

    def change(self, points_m: Points) -> float:
        """Return what it costs, besides the way, to leave the present path for another one.

        0 where the autopilot goes on at its speed. Most ways to fly change their path for nothing, so that a
        policy may compare what it found with the present path only where this is more than 0.
        """


@dataclass(frozen=True, slots=True)
class ContactArea:
    """Where a vehicle is surely heard, and told of another path: a circle over ground.

    Examples
    --------
    >>> ContactArea((0.0, 0.0), 4.0).away_m((3.0, 4.0))
    1.0
    """

    center_m: tuple[float, float]  # In metres of the farm frame
    radius_m: float  # Below 0 there is no such place

    @property
    def is_nowhere(self) -> bool:
        """Whether it is nowhere sure that another path arrives."""
        return self.radius_m < 0.0

    def away_m(self, point_m: tuple[float, float] | NDArray[np.float64]) -> float:
        """Return how far a point is from it; 0 within."""
        return max(0.0, math.dist(point_m, self.center_m) - self.radius_m)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleReport:
    """One vehicle, as its telemetry told of it last.

    Parameters
    ----------
    system_id : int
        Its MAVLink system id, the name by which decisions speak of it.
    request : PlanningRequest
        Its task: area, start, whole budget, footprint, seed.
    position_m : tuple of float
        x and y in metres of the farm frame.
    velocity_m_s : tuple of float
        Over ground, along x and y.
    age_s : float
        How old position and velocity are.
    spent : float
        What the flight has cost so far, and a real one costs until the answer, in the unit of the budget.
    rest_m : float64[n, 2]
        The points of its path that are still to be reached, the present target first; read-only.
    travel_cost : TravelCost
        What rests of the path cost from here.
    battery : float or None
        Fraction of the battery that is left; None if nobody told.
    delay_s : float
        Seconds from an answer until the vehicle turns, as measured so far.
    contact : ContactArea or None
        Where a path has to end so that another one can follow it; None: anywhere.
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
        """What is left of the budget, in its unit; never below zero."""
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
    """What is known when a policy is asked.

    Parameters
    ----------
    event : Event
        Why it is asked.
    time_s : float
        Seconds since the mission began; 0 before.
    day : int
        Day of the environment.
    fields : FieldSet
        What is sensed and scored.
    weights : ScoreWeights
        What errors cost.
    model : InformationModel
        What is believed of the farm. Its arrays are read-only and hold until the answer.
    observations : Observations
        All that arrived so far, in their order.
    vehicles : tuple of VehicleReport
        In the order of their system ids.
    compute_s : float
        Seconds that the answer may take. What comes later is not flown.
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
