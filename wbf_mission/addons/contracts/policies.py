"""Checks of the policy contract, also for policies of other packages."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.farm import Farm
from geo.farms import get_farm
from geo.grid import Crop
from geo.seeds import sealed_seed
from mission.errors import AnswerError, PlanningError
from mission.planners.budget import LengthBudget, StepBudget
from mission.planners.path import Area, Points
from mission.planners.request import CropArea, PlanningRequest
from mission.policies.decision import Decision, answer_costs
from mission.policies.observation import Event, GeometricTravelCost, PolicyObservation, Status, VehicleReport
from mission.policies.policy import Policy, Triggers, make_policy
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import PAPER_WEIGHTS
from wbf_mission.contracts import PolicyCheck

_FARM = "miniberry-30"
_DAY = 6
_COMPUTE_S = 1.0  # As in a flight
_AREA_M = 1e-6
_LOST_AFTER = 0.4  # Fraction of the budget after which a vehicle is lost.
_MOST_STEPS = 20_000  # Many times the longest budget: a flight with more steps would never end.


@dataclass(frozen=True, slots=True)
class _Case:
    """A test case: an area, a start and a budget, the same for each vehicle."""

    name: str
    area: Area
    start_m: tuple[float, float]
    budget: StepBudget | LengthBudget
    vehicles: int = 1
    loses_one: bool = False


def check_policy(policy: str | Policy, **parameters: Any) -> PolicyCheck:
    """Check that a policy fulfils the contract (`mission.policies.policy.Policy`).

    One or three vehicles fly a cell per step, over an area with a pond and an area of two parts. Starts lie
    inside and outside the area. Budgets are in steps, or in metres including the return. The contract has
    these rules:

    - A decision names only vehicles that can be steered. The decision at the start names every vehicle.
    - A path of the first flight has a length above zero.
    - Each path lies in the area of its vehicle's request and costs at most the remaining budget.
    - Equal flights give equal decisions. Farms that differ only in unobserved cells give equal decisions,
      too: a difference would prove access to the truth.
    - The policy also decides if no cell was observed, if every cell was observed, and if a vehicle is lost.
    - The policy changes neither its observations nor numpy's global generator.

    Parameters
    ----------
    policy : str or Policy
        A name or a policy, as for `mission.policies.policy.make_policy`.
    **parameters
        Parameters of the policy.

    Returns
    -------
    PolicyCheck
        Number of decisions, and their computing time.

    Raises
    ------
    AssertionError
        If a rule is broken; the text names the rule and the case.
    PlanningError, ParameterError
        If the object is not a policy, or a parameter is unknown.

    Examples
    --------
    >>> from mission.policies.policy import FixedPlan
    >>> check_policy(FixedPlan("lawnmower")).time_share < 1.0
    True
    """
    chosen = make_policy(policy, **parameters)
    triggers = chosen.triggers
    _require(isinstance(triggers, Triggers), "triggers", f"it is a {type(triggers).__name__}, not a Triggers")
    truth = _some_truth()
    times: list[float] = []
    for case in _cases():
        before = str(np.random.get_state(legacy=False))  # noqa: NPY002
        first = _Flight(chosen, case, truth)
        first.fly(times)
        _time_share(times)  # Else a slow policy would be told only after all flights
        same = str(np.random.get_state(legacy=False)) == before  # noqa: NPY002
        _require(same, case.name, "the policy drew from numpy's global generator")
        second = _Flight(chosen, case, truth)
        second.fly(times)
        _require(first.answers == second.answers, case.name, "two equal flights have different answers")
        elsewhere = np.where(first.looked, truth, 1.0 - truth).astype(np.float32)
        third = _Flight(chosen, case, elsewhere)
        third.fly(times)
        _require(
            first.answers == third.answers, case.name, "its answers depend on cells that no vehicle observed"
        )
    _check_all_known(chosen, truth, times)
    return PolicyCheck(len(times), _time_share(times))


def _time_share(times: list[float]) -> float:
    """Return the median computing time as a fraction of the allowed time; AssertionError if it is above 1."""
    share = float(np.median(times)) / _COMPUTE_S
    _require(share <= 1.0, "computing time", f"an answer takes {share:.2g} of the allowed time")
    return share


def _cases() -> Iterator[_Case]:
    farm = get_farm(_FARM)
    cell, whole = farm.cell_size_m, farm.owner_area
    pond = shapely.Point(14.3 * cell, 17.1 * cell).buffer(4.2 * cell)
    parts = shapely.MultiPolygon(
        [shapely.box(0, 0, 12 * cell, 30 * cell), shapely.box(18 * cell, 0, 30 * cell, 30 * cell)]
    )
    home = farm.home_m
    yield _Case("whole farm, 150 steps", whole, home, StepBudget(150.0, cell))
    metres = LengthBudget(190.0 * cell, return_to=home)
    yield _Case("farm with a pond, budget in metres with the return", whole - pond, home, metres)
    yield _Case("two fields, 190 steps", parts, home, StepBudget(190.0, cell))
    outside = (-4.0 * cell, -3.0 * cell)
    away = LengthBudget(190.0 * cell, return_to=outside)
    yield _Case("start outside, budget in metres with the return", whole, outside, away)
    yield _Case("three vehicles, 130 steps each", whole, home, StepBudget(130.0, cell), 3)
    yield _Case("three vehicles, one is lost", whole, home, StepBudget(130.0, cell), 3, loses_one=True)


class _Vehicle:
    """A simulated vehicle that flies one cell per step along its path."""

    def __init__(self, system_id: int, request: PlanningRequest, cell_m: float) -> None:
        self.system_id = system_id
        self.request = request
        self.here = np.array(request.start_xy_m)
        self.velocity = np.zeros(2)
        self.spent = 0.0
        self.rest: Points = np.empty((0, 2))
        self.lost = False
        self._cell_m = cell_m

    def step(self) -> bool:
        """Fly one cell; return whether the vehicle reached a waypoint."""
        way = self.rest[0] - self.here
        distance = float(np.hypot(*way))
        reached = distance <= self._cell_m * (1.0 + 1e-9)
        self.velocity = way if reached else way * (self._cell_m / distance)
        self.here = self.rest[0].copy() if reached else self.here + self.velocity
        steps = isinstance(self.request.budget, StepBudget)
        self.spent += 1.0 if steps else min(distance, self._cell_m)
        if reached:
            self.rest = self.rest[1:]
        return reached

    def report(self, started: bool) -> VehicleReport:
        """Return the vehicle's current report."""
        budget, (x, y) = self.request.budget, self.here.tolist()
        assert isinstance(budget, StepBudget | LengthBudget)
        status = Status.READY if not started else Status.FLYING if len(self.rest) else Status.ENDED
        return VehicleReport(
            self.system_id, self.request, Status.LOST if self.lost else status, (x, y),
            (float(self.velocity[0]), float(self.velocity[1])), 0.0, self.spent, self.rest,
            GeometricTravelCost(budget, (x, y)),
        )  # fmt: skip


class _Flight:
    """A simulated flight of a test case under a policy.

    `answers` has the policy's decisions as bytes, and `looked` marks the observed cells.
    """

    def __init__(self, policy: Policy, case: _Case, truth: NDArray[np.float32]) -> None:
        self._policy, self._case, self._truth = policy, case, truth
        self._farm = get_farm(_FARM)
        self._vehicles = [
            _Vehicle(k + 1, _request(self._farm, case), self._farm.cell_size_m) for k in range(case.vehicles)
        ]
        self._seen = Observations.empty()
        self._model = _model(truth, self._seen)
        self.looked = np.zeros(self._farm.grid().shape, np.bool_)
        self.answers: list[bytes] = []

    def fly(self, times: list[float]) -> None:
        """Fly to the end of all paths; append the processor time of each decision to `times`."""
        policy, case = self._policy, self._case
        policy.start()
        answer = self._ask(Event.START, 0, times)
        for vehicle in self._vehicles:
            named = vehicle.system_id in answer.paths
            _require(named, case.name, f"the first decision does not name vehicle {vehicle.system_id}")
        self._vehicles = [vehicle for vehicle in self._vehicles if len(vehicle.rest)]
        _require(bool(self._vehicles), case.name, "no vehicle has a path at the start of the first flight")
        farthest_m = max(float(np.abs(vehicle.rest - vehicle.here).max()) for vehicle in self._vehicles)
        _require(farthest_m > 0.0, case.name, "all paths of the first flight have length 0: no score")
        triggers, fresh, step = policy.triggers, 0, 0
        step_cost = 1.0 if isinstance(case.budget, StepBudget) else self._farm.cell_size_m
        lose_at = round(_LOST_AFTER * case.budget.limit / step_cost) if case.loses_one else -1
        while flying := [vehicle for vehicle in self._vehicles if len(vehicle.rest) and not vehicle.lost]:
            step += 1
            _require(step < _MOST_STEPS, case.name, "the flight does not end")
            reached = [vehicle.step() for vehicle in flying]
            fresh += self._observe([vehicle.here for vehicle in flying], step)
            if step == lose_at:
                self._vehicles[0].lost = True
                self._vehicles[0].rest = np.empty((0, 2))
                self._ask(Event.LOST, step, times)
            elif triggers.waypoints and any(reached):
                self._ask(Event.WAYPOINT, step, times)
            elif triggers.observations is not None and fresh >= triggers.observations:
                fresh = 0
                self._ask(Event.OBSERVATIONS, step, times)
            elif triggers.period_s is not None and step % max(1, round(triggers.period_s)) == 0:
                self._ask(Event.PERIOD, step, times)

    def _observe(self, places: Sequence[NDArray[np.float64]], step: int) -> int:
        here = np.array(places)
        at_x, at_y = self._farm.cell_of(here[:, 0], here[:, 1])
        x, y = at_x.astype(np.int32), at_y.astype(np.int32)
        shape = self.looked.shape
        on = (x >= 0) & (y >= 0) & (x < shape[0]) & (y < shape[1])
        x, y = x[on], y[on]
        self.looked[x, y] = True
        values = self._truth[:, x, y].T
        n = len(x)
        new = Observations(x, y, np.full(n, float(step)), np.full(n, _DAY), values)
        self._seen = Observations.concatenate([self._seen, new])
        return n

    def _ask(self, event: Event, step: int, times: list[float]) -> Decision:
        if event is not Event.START:
            self._model = _model(self._truth, self._seen)
        reports = tuple(vehicle.report(step > 0) for vehicle in self._vehicles)
        farm, model, seen = self._farm, self._model, self._seen
        observation = PolicyObservation(
            event, float(step), _DAY, farm, PAPER_FIELDS, PAPER_WEIGHTS, model, seen, reports, _COMPUTE_S
        )
        answer = _answer(self._policy, observation, self._case.name, times)
        for vehicle in self._vehicles:
            if vehicle.system_id in answer.paths:
                vehicle.rest = answer.paths[vehicle.system_id]
        paths = sorted(answer.paths.items())
        self.answers.append(b"".join(number.to_bytes(4, "big") + path.tobytes() for number, path in paths))
        return answer


def _answer(policy: Policy, observation: PolicyObservation, what: str, times: list[float]) -> Decision:
    """Return the policy's decision after checking it against the contract."""
    begin = time.process_time()
    try:
        answer = policy.decide(observation)
    except PlanningError:
        raise
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        raise AssertionError(f"check_policy: {what}: the policy writes into its observation") from error
    times.append(time.process_time() - begin)
    policy_name = f"check_policy: {what}, after {observation.time_s:g} steps: the policy"
    try:
        answer_costs(policy_name, answer, observation)
    except AnswerError as error:
        raise AssertionError(str(error)) from error
    for system_id, points in answer.paths.items():
        inside = _lies_inside(observation.vehicle(system_id), points)
        _require(inside, what, f"the path of vehicle {system_id} leaves its area (request.room)")
    return answer


def _lies_inside(vehicle: VehicleReport, points: Points) -> bool:
    """Return whether a path stays in the area, except for legs from outside and between separate parts."""
    path = np.vstack((np.asarray(vehicle.position_m)[None], points))
    area = shapely.buffer(vehicle.request.room, _AREA_M)
    parts = shapely.buffer(shapely.get_parts(vehicle.request.room), _AREA_M)
    in_part = shapely.covers(parts[:, None], shapely.points(path))  # bool[parts, n + 1]
    first_part = in_part[:, :-1].argmax(axis=0)
    within_part = in_part[:, :-1].any(axis=0) & in_part[first_part, np.arange(1, len(path))]
    legs = shapely.linestrings(np.stack((path[:-1], path[1:]), axis=1))
    points_inside = shapely.covers(area, shapely.points(points))
    return bool(points_inside.all() and (shapely.covers(area, legs) | ~within_part).all())


def _check_all_known(policy: Policy, truth: NDArray[np.float32], times: list[float]) -> None:
    """Check the decisions when all cells have been observed, in flight and before a later flight."""
    case = next(iter(_cases()))
    farm = get_farm(_FARM)
    x, y = (part.ravel().astype(np.int32) for part in np.indices(farm.grid().shape))
    n = len(x)
    seen = Observations(x, y, np.arange(float(n)), np.full(n, _DAY), truth[:, x, y].T)
    vehicle = _Vehicle(1, _request(farm, case), farm.cell_size_m)
    vehicle.rest = np.array([[5.5, 0.5], [5.5, 20.5]]) * farm.cell_size_m
    vehicle.spent = 30.0
    policy.start()
    reports = (vehicle.report(started=True),)
    model = _model(truth, seen)
    observation = PolicyObservation(
        Event.OBSERVATIONS, 30.0, _DAY, farm, PAPER_FIELDS, PAPER_WEIGHTS, model, seen, reports, _COMPUTE_S
    )
    _answer(policy, observation, "all cells are observed", times)
    nothing_left = replace(reports[0], spent=case.budget.limit)
    _answer(policy, replace(observation, vehicles=(nothing_left,)), "nothing left of the budget", times)
    waiting = _Vehicle(1, _request(farm, case), farm.cell_size_m).report(started=False)
    later = replace(observation, event=Event.START, time_s=0.0, vehicles=(waiting,))
    observed = "all cells are observed before a later flight"
    answer = _answer(policy, later, observed, times)
    named = waiting.system_id in answer.paths
    _require(named, observed, "vehicle 1 gets no path, not even one without points")


def _request(farm: Farm, case: _Case) -> PlanningRequest:
    crops = tuple(
        CropArea(crop, land)
        for crop in (Crop.TOMATO, Crop.STRAWBERRY)
        if not (land := shapely.intersection(farm.crop_area(crop), case.area)).is_empty
    )
    # Policies may use the seed, so each case has a different seed.
    seed = sealed_seed(11, case.name)
    return PlanningRequest(case.area, case.start_m, case.budget, farm.cell_size_m, crops, seed=seed)


def _some_truth() -> NDArray[np.float32]:
    """Return the true fields of a farm with patches of sick plants, float32[3, W, H]."""
    truth = np.ones((len(PAPER_FIELDS), *get_farm(_FARM).grid().shape), np.float32)
    truth[2] = 0.4
    for x, y in ((6, 22), (21, 18), (25, 26), (8, 5), (20, 9)):
        truth[:2, x - 1 : x + 3, y - 1 : y + 2] = 0.5
        truth[:2, x, y] = 0.0
    return truth


def _model(truth: NDArray[np.float32], seen: Observations) -> InformationModel:
    """Return an estimate in read-only arrays: the truth in observed cells, else nearly healthy plants."""
    value = np.empty_like(truth)
    value[:] = np.array([0.9, 0.9, 0.4], np.float32)[:, None, None]
    uncertainty = np.full_like(value, 0.3)
    value[:, seen.x, seen.y] = truth[:, seen.x, seen.y]
    uncertainty[:, seen.x, seen.y] = 0.0
    for array in (value, uncertainty):
        array.flags.writeable = False
    return InformationModel(value, uncertainty)


def _require(good: bool, what: str, fault: str) -> None:
    if not good:
        raise AssertionError(f"check_policy: {what}: {fault}")
