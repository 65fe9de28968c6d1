"""The interface of policies, policies by their names, and policies that do not search in flight."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol, get_args, get_type_hints, runtime_checkable

from geo.named import ParameterError, check_parameters, format_named
from mission.errors import PlanningError
from mission.planners.partition import STRIPS
from mission.planners.request import Planner, load_registered, make_planner, registered_names
from mission.policies.allocation import WHOLE, Share, check_partition, reallocate, shared
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, PolicyObservation, Status, VehicleReport


@dataclass(frozen=True, slots=True)
class Triggers:
    """The events after which a policy is asked for a decision in flight.

    Every policy is asked at the start and at the loss of a vehicle. A policy with any trigger is also asked
    shortly before a path ends.

    Parameters
    ----------
    period_s : float or None
        Period between decisions, in seconds of flight. None: no such trigger.
    observations : int or None
        Number of new observations after which the policy is asked. None: no such trigger.
    waypoints : bool
        Whether the policy is asked each time that a vehicle reaches a waypoint.
    least_s : float
        Least time between two triggered decisions, in seconds of flight.
    """

    period_s: float | None = None
    observations: int | None = None
    waypoints: bool = False
    least_s: float = 0.0

    @property
    def never(self) -> bool:
        """Whether no trigger is set."""
        return self.period_s is None and self.observations is None and not self.waypoints


LEAST_S = 4.0
"""Default of `Triggers.least_s` for map policies (s): a vehicle passes many cells in a second."""

NEVER_AGAIN = Triggers()
"""Triggers of a policy that decides only at the start and at the loss of a vehicle."""


@runtime_checkable
class Policy(Protocol):
    """Decides where vehicles go next.

    Each run calls `start` once, then `decide` for each observation. An observation gives no access to the
    true state of the farm.
    """

    @property
    def triggers(self) -> Triggers:
        """The triggers of this policy's decisions in flight."""

    def start(self) -> None:
        """Clear the policy's memory before a new run."""

    def decide(self, observation: PolicyObservation) -> Decision:
        """Return a decision within the computing time `observation.compute_s`.

        At `Event.START` every vehicle needs a path. A path without points keeps the vehicle on the ground for
        this flight; in the first flight of a run at least one vehicle must fly. At other events, `NO_CHANGE`
        keeps all paths. Every path must lie in `request.room` of its vehicle's report, and its cost
        (`VehicleReport.travel_cost`) must be within the remaining budget.

        Raises
        ------
        PlanningError
            If there is no path within the budget.
        """


@dataclass(slots=True, eq=False)
class FixedPlan:
    """A policy that flies the paths of a planner, which are planned at the start and then kept.

    Each vehicle of a fleet plans for a part of the land. When a vehicle is lost, the other vehicles take over
    the unflown land, as far as their budgets allow (`mission.policies.allocation`).

    Parameters
    ----------
    planner : Planner or str
        A planner or its name, as for `mission.planners.make_planner`.
    partition : {"strips", "voronoi", "none"}
        Partition of the land among several vehicles. With ``"none"`` each vehicle plans for the whole land,
        and a lost vehicle's land is not reallocated.

    Raises
    ------
    ParameterError
        If the partition is unknown.

    Examples
    --------
    >>> FixedPlan("spiral").triggers == NEVER_AGAIN
    True
    """

    triggers: ClassVar[Triggers] = NEVER_AGAIN
    planner: Planner | str
    partition: str = STRIPS
    _shares: dict[int, Share] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        check_partition(self.partition)

    def start(self) -> None:
        """Forget each vehicle's land of the previous run."""
        self._shares = {}

    def decide(self, observation: PolicyObservation) -> Decision:
        """Plan for every vehicle at the start, and reallocate the land of a vehicle that is lost later."""
        if observation.event is Event.START:
            return self._plan(observation.steerable)
        if observation.event is Event.LOST and self.partition != WHOLE:
            return self._reallocate(observation)
        return NO_CHANGE

    def _plan(self, vehicles: Sequence[VehicleReport]) -> Decision:
        planner = make_planner(self.planner)
        self._shares = {}
        if not vehicles:
            return NO_CHANGE
        parts = shared(vehicles, self.partition)
        paths, spacings = {}, {}
        for vehicle in vehicles:
            number, part = vehicle.system_id, parts[vehicle.system_id]
            path = planner(replace(vehicle.request, area=part))
            paths[number] = path.points_m
            if path.spacing_m is not None:
                spacings[number] = path.spacing_m
            self._shares[number] = Share(part, path.spacing_m)
        return Decision(paths, reason="plan", spacing_m=spacings)

    def _reallocate(self, observation: PolicyObservation) -> Decision:
        lost = [
            vehicle
            for vehicle in observation.vehicles
            if vehicle.status is Status.LOST and vehicle.system_id in self._shares
        ]
        taken = reallocate(lost, observation.steerable, self._shares, make_planner(self.planner))
        if not taken:
            return NO_CHANGE
        for vehicle in lost:
            del self._shares[vehicle.system_id]
        self._shares.update({system_id: share for system_id, (_, share) in taken.items()})
        who = ", ".join(str(vehicle.system_id) for vehicle in lost)
        return Decision(
            {system_id: points for system_id, (points, _) in taken.items()},
            reason=f"the unflown land of lost vehicle {who} is taken over",
        )


@dataclass(frozen=True, slots=True)
class KeepPath:
    """A policy that never changes a path, for missions from files."""

    triggers: ClassVar[Triggers] = NEVER_AGAIN

    def start(self) -> None:
        """Do nothing: this policy has no memory."""

    def decide(self, observation: PolicyObservation) -> Decision:  # noqa: ARG002
        """Return NO_CHANGE."""
        return NO_CHANGE


ENTRY_POINT_GROUP = "wbf_mission.policies"


def policy_names() -> tuple[str, ...]:
    """Return the names of the installed policies, sorted."""
    return registered_names(ENTRY_POINT_GROUP)


def policy_parameters(name: str) -> dict[str, Any]:
    """Return the parameters of a policy (the arguments of its factory) with their defaults.

    Raises PlanningError if no policy has this name.
    """
    named = load_registered("policy", ENTRY_POINT_GROUP, name, {})
    return _parameters(named.found, named.what)


def make_policy(policy: str | Policy, /, **parameters: Any) -> Policy:
    """Return a policy.

    Parameters
    ----------
    policy : str or Policy
        The name of an installed policy, optionally with parameters: ``greedy:acquisition=variance`` (see
        `geo.named.parse_named`). Names are case-insensitive. Your own policy object is returned unchanged
        and takes no parameters here.
    **parameters
        Further parameters, see `policy_parameters`.

    Raises
    ------
    PlanningError
        If no policy has the name, its package cannot be imported, or the object is not a policy.
    ParameterError
        If the text cannot be parsed, or a parameter is unknown, given twice or of the wrong type.
    """
    if not isinstance(policy, str):
        if inspect.isclass(policy) or not isinstance(policy, Policy):
            what = policy.__name__ if inspect.isclass(policy) else type(policy).__name__
            fault = "is a class; give an instance of it" if inspect.isclass(policy) else "is not a policy"
            msg = f"policy {what} {fault}: a policy has triggers, start() and decide(observation)"
            raise PlanningError(msg)
        if parameters:
            msg = f"parameter {sorted(parameters)[0]!r}: a policy object already has its parameters"
            raise ParameterError(msg)
        return policy
    name, what, factory, given = load_registered("policy", ENTRY_POINT_GROUP, policy, parameters)
    known = _parameters(factory, what)
    check_parameters(f"policy {name}", parameters.keys() | given.keys(), known)
    _check_types(name, {**given, **parameters}, factory)
    made = factory(**{**given, **parameters})
    if not isinstance(made, Policy):
        kind = type(made).__name__
        msg = f"policy {name} makes a {kind}, which lacks triggers, start() or decide(observation)"
        raise PlanningError(msg)
    return made


def _parameters(factory: Any, what: str) -> dict[str, Any]:
    if not callable(factory):
        raise PlanningError(f"{what} is neither a class nor another callable that makes a policy")
    return {name: argument.default for name, argument in inspect.signature(factory).parameters.items()}


_TYPES = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", type(None): "none"}


def _check_types(policy: str, given: Mapping[str, Any], factory: Any) -> None:
    """Raise ParameterError if a number, text, bool or None has another type than the factory declares."""
    try:
        declared = get_type_hints(factory.__init__ if inspect.isclass(factory) else factory)
    except NameError:  # Types that are imported for type checkers only
        return
    for key, value in given.items():
        kind = declared.get(key)
        allowed = [name for name in (get_args(kind) or (kind,)) if name in _TYPES]
        fits = type(value) in allowed or (type(value) is int and float in allowed)
        if allowed and type(value) in _TYPES and not fits:
            types = " or ".join(_TYPES[name] for name in allowed)
            raise ParameterError(f"policy {format_named(policy, {key: value})}: {key} must be {types}")
