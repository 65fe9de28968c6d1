"""Observations of policies: the information available on the ground during a flight."""

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
    """Reason why a policy is asked for a decision."""

    START = "start"
    """Before take-off: every vehicle needs its first path. With a path without points, it does not fly."""
    OBSERVATIONS = "observations"
    """New camera observations arrived."""
    WAYPOINT = "waypoint"
    """A vehicle reached a waypoint of its path."""
    PERIOD = "period"
    """The period of `Triggers.period_s` has passed since the last decision."""
    ENDING = "ending"
    """A vehicle is about to reach the end of its path, after which the vehicle flies home."""
    LOST = "lost"
    """A vehicle failed or fell silent, so its part of the farm remains uncovered."""


class Status(Enum):
    """State of a vehicle's flight."""

    READY = "ready"
    """On the ground before the flight."""
    CLIMBING = "climbing"
    """Taking off. The path cannot be changed before the vehicle reaches its flight altitude."""
    FLYING = "flying"
    """On the path, which can be changed."""
    CHANGING = "changing"
    """On the path while a new path is being sent. No other change is possible until the new path arrives."""
    SILENT = "silent"
    """Probably on the path, but without recent telemetry or with unknown progress. The vehicle cannot get a
    new path."""
    RETURNING = "returning"
    """Flying home or landing. The path can no longer be changed."""
    PILOTED = "piloted"
    """Taken out of its mission by a pilot, an operator or a failsafe. Policies do not change the path."""
    ENDED = "ended"
    """Landed as planned."""
    LOST = "lost"
    """Failed, or silent for longer than the planned flight can explain."""


class TravelCost(Protocol):
    """Travel costs of a vehicle from its current position, in the unit of its budget."""

    def rest(self, paths_m: Sequence[Points]) -> list[float]:
        """Return the cost of each path: from the vehicle's position through the path's points and home.

        A path is float64[n, 2] in metres of the farm frame; n = 0 is the direct return. If the budget does
        not count the return, the return costs nothing. A path that the vehicle cannot fly costs infinity.
        Decisions are validated with these costs.
        """

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return the approximate costs of straight legs, float64[n, m], from n points to m points.

        The costs include the wind and the mean cost of a turn. The method is fast, so that a policy can
        choose among many legs.
        """

    def change(self, points_m: Points) -> float:
        """Return the additional cost of switching from the current path to another path.

        The cost is 0 if the vehicle keeps its speed during the change, as with most autopilots. A policy
        needs to compare a new path with the current path only if the cost is above 0.
        """


@dataclass(frozen=True, slots=True)
class ContactArea:
    """Circle over ground with reliable radio contact, in which a vehicle can receive a new path.

    >>> ContactArea((0.0, 0.0), 4.0).away_m((3.0, 4.0))
    1.0
    """

    center_m: tuple[float, float]  # Metres of the farm frame.
    radius_m: float  # Negative if there is no reliable contact anywhere.

    @property
    def is_nowhere(self) -> bool:
        """Whether there is no reliable contact anywhere."""
        return self.radius_m < 0.0

    def away_m(self, point_m: tuple[float, float] | NDArray[np.float64]) -> float:
        """Return the distance from a point to the circle; 0 inside."""
        return max(0.0, math.dist(point_m, self.center_m) - self.radius_m)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleReport:
    """State of a vehicle according to its last telemetry.

    Parameters
    ----------
    system_id : int
        MAVLink system id, by which decisions name the vehicle.
    request : PlanningRequest
        Task of the vehicle: area, start, total budget, footprint, seed.
    status : Status
        State of the flight.
    position_m : tuple of float
        Position, x and y in metres of the farm frame.
    velocity_m_s : tuple of float
        Velocity over ground, along x and y.
    age_s : float
        Age of position and velocity.
    spent : float
        Spent part of the budget, in its unit. In a real flight this includes the predicted cost until the
        decision arrives.
    rest_m : float64[n, 2]
        Points of the path ahead, current target first; read-only.
    travel_cost : TravelCost
        Travel costs from the current position.
    battery : float or None
        Remaining fraction of the battery, or None if unknown.
    delay_s : float
        Measured delay from a decision until the vehicle turns to the new path (s).
    contact : ContactArea or None
        Area in which a path must end so that the vehicle can receive another path. None: no limit.
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
            msg = f"vehicle {self.system_id}: the path ahead (rest_m) has a point that is not finite"
            raise PlanningError(msg)
        rest.flags.writeable = False
        object.__setattr__(self, "rest_m", rest)

    @property
    def left(self) -> float:
        """Remaining budget in the budget's unit, at least 0."""
        return max(0.0, self.request.budget.limit - self.spent)

    @property
    def steerable(self) -> bool:
        """Whether a decision may change the vehicle's path."""
        return self.status in (Status.READY, Status.FLYING)

    @property
    def heading_rad(self) -> float:
        """Direction of motion over ground, from the x-axis towards y; 0 at rest."""
        return math.atan2(self.velocity_m_s[1], self.velocity_m_s[0])


@dataclass(frozen=True, slots=True, eq=False)
class PolicyObservation:
    """Input of a policy's decision.

    Parameters
    ----------
    event : Event
        Reason why the policy is asked.
    time_s : float
        Seconds since the mission began; 0 before.
    day : int
        Day of the environment.
    farm : Farm
        The farm.
    fields : FieldSet
        Sensed and scored fields.
    weights : ScoreWeights
        Weights of the score's errors.
    model : InformationModel
        Current estimate of the fields. The arrays are read-only, and valid until the decision.
    observations : Observations
        All observations of the run, in order of arrival.
    vehicles : tuple of VehicleReport
        Vehicles in the order of their system ids.
    compute_s : float
        Time limit of the decision (s). A later decision is not flown.
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
        """Vehicles with a path that a decision may change."""
        return tuple(vehicle for vehicle in self.vehicles if vehicle.steerable)

    def vehicle(self, system_id: int) -> VehicleReport:
        """Return the vehicle with this system id.

        Raises
        ------
        PlanningError
            If no vehicle has this system id.
        """
        for vehicle in self.vehicles:
            if vehicle.system_id == system_id:
                return vehicle
        known = ", ".join(str(vehicle.system_id) for vehicle in self.vehicles)
        raise PlanningError(f"no vehicle has the system id {system_id}; known system ids: {known}")


@dataclass(frozen=True, slots=True)
class GeometricTravelCost:
    """Travel costs for a budget in metres or steps.

    Parameters
    ----------
    budget : LengthBudget or StepBudget
        Cost function; the limit is ignored.
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
        """Return the cost of each path from the position, plus the return if the budget counts it.

        A repeated point costs nothing, because in flight the repetition only joins two pieces of a path.
        """
        here = np.asarray(self.position_m, dtype=np.float64)
        return [self.budget.cost(np.vstack((here, drop_coincident(path)))) for path in paths_m]

    def legs(self, from_m: Points, to_m: Points) -> NDArray[np.float64]:
        """Return the costs of straight legs, float64[n, m], from n points to m points."""
        steps = np.asarray(from_m)[:, None, :] - np.asarray(to_m)[None, :, :]
        length_m: NDArray[np.float64] = np.hypot(steps[..., 0], steps[..., 1])
        if isinstance(self.budget, LengthBudget):
            return length_m
        return np.maximum(np.ceil(length_m / self.budget.step_m - 1e-6), 1.0)

    def change(self, points_m: Points) -> float:  # noqa: ARG002 (the same for every path)
        """Return 0: a change costs neither metres nor steps."""
        return 0.0


def pays_for_return(vehicle: VehicleReport) -> bool:
    """Return whether the vehicle's budget counts the return; True if the costs are unknown (NaN)."""
    request = vehicle.request
    place = np.array(request.area.representative_point().coords)
    home = np.array([request.start_xy_m])
    there, and_home = vehicle.travel_cost.rest([place, np.vstack((place, home))])
    back = float(vehicle.travel_cost.legs(place, home)[0, 0])
    return not and_home - there > 0.5 * back
