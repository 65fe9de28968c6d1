"""Policies: who decides in flight where to go next.

A policy is asked at the start and then whenever something is worth asking for. A planner is a policy that
never changes its mind (`FixedPlan`).
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol, runtime_checkable

from geo.named import ParameterError, check_parameters
from mission.errors import PlanningError
from mission.planners.partition import STRIPS
from mission.planners.registry import load_registered, make_planner, registered_names
from mission.planners.request import Planner
from mission.policies.allocation import WHOLE, Share, check_partition, reallocate, shared
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, PolicyObservation, Status, VehicleReport


@dataclass(frozen=True, slots=True)
class Triggers:
    """When a policy wants to be asked, besides at the start and when a vehicle is lost.

    One that wants any of these is also asked before a path ends.

    Parameters
    ----------
    period_s : float or None
        So often, in seconds of flight; None: not for time alone.
    observations : int or None
        After so many new observations; None: not for them alone.
    waypoints : bool
        Whenever a vehicle reaches a waypoint.
    least_s : float
        Never more often than this for these reasons, in seconds of flight.
    """

    period_s: float | None = None
    observations: int | None = None
    waypoints: bool = False
    least_s: float = 0.0

    @property
    def never(self) -> bool:
        """Whether it wants to be asked for none of these reasons."""
        return self.period_s is None and self.observations is None and not self.waypoints


LEAST_S = 4.0
"""How often our policies want to be asked at most: a vehicle passes many cells in a second."""

NEVER_AGAIN = Triggers()
"""Only at the start, and when a vehicle is lost."""


@runtime_checkable
class Policy(Protocol):
    """Decides where vehicles go next.

    It is an object of its own for each run: `start` makes it forget everything, then `decide` is called with
    one observation after the other. It gets no object that leads to the true state of the farm.
    """

    @property
    def triggers(self) -> Triggers:
        """When it wants to be asked."""

    def start(self) -> None:
        """Forget everything: a new run begins."""

    def decide(self, observation: PolicyObservation) -> Decision:
        """Answer, within the observation's computing time.

        At `Event.START` every vehicle must be named. One whose path has no points stays on the ground in this
        flight: nothing is worth it. In the first flight of a run at least one has to fly. Later `NO_CHANGE`
        leaves all as it is. Every path must lie in the area of its vehicle's request, and cost no more
        (`VehicleReport.travel_cost`) than is left of the budget.

        Raises
        ------
        PlanningError
            If there is no path within the budget.
        """


@dataclass(slots=True, eq=False)
class FixedPlan:
    """A planner as a policy: it plans at the start and does not change its mind.

    Several vehicles get a part of the land each. When one of them is lost, the others take over what it has
    not flown, as far as their budgets allow (`mission.policies.allocation`).

    Parameters
    ----------
    planner : Planner or str
        As for `mission.planners.make_planner`.
    partition : {"strips", "voronoi", "none"}
        How several vehicles share the land; with none of it each plans for the whole, and nothing is
        reallocated.

    Raises
    ------
    ParameterError
        If there is no such partition.

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
        """Forget whose land is which."""
        self._shares = {}

    def decide(self, observation: PolicyObservation) -> Decision:
        """Plan for every vehicle at the start; share what a lost one leaves; else go on."""
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
        for one in vehicles:
            path = planner(replace(one.request, area=parts[one.system_id]))
            paths[one.system_id] = path.points_m
            if path.spacing_m is not None:
                spacings[one.system_id] = path.spacing_m
            self._shares[one.system_id] = Share(parts[one.system_id], path.spacing_m)
        return Decision(paths, reason="plan", spacing_m=spacings)

    def _reallocate(self, observation: PolicyObservation) -> Decision:
        lost = [
            one for one in observation.vehicles if one.status is Status.LOST and one.system_id in self._shares
        ]
        taken = reallocate(lost, observation.steerable, self._shares, make_planner(self.planner))
        if not taken:
            return NO_CHANGE
        for one in lost:
            del self._shares[one.system_id]
        self._shares.update({system_id: share for system_id, (_, share) in taken.items()})
        who = ", ".join(str(one.system_id) for one in lost)
        return Decision(
            {system_id: points for system_id, (points, _) in taken.items()},
            reason=f"the rest of lost vehicle {who} is handed over",
        )


@dataclass(frozen=True, slots=True)
class KeepPath:
    """Leave every vehicle on the path that it was given otherwise: in a mission from a file."""

    triggers: ClassVar[Triggers] = NEVER_AGAIN

    def start(self) -> None:
        """Nothing is remembered."""

    def decide(self, observation: PolicyObservation) -> Decision:  # noqa: ARG002
        """Go on."""
        return NO_CHANGE


ENTRY_POINT_GROUP = "wbf_mission.policies"


def policy_names() -> tuple[str, ...]:
    """Return the names of the installed policies, sorted."""
    return registered_names(ENTRY_POINT_GROUP)


def policy_parameters(name: str) -> dict[str, Any]:
    """Return the parameters of a policy, the arguments of its factory, with their defaults.

    PlanningError if there is no policy of that name.
    """
    named = load_registered("policy", ENTRY_POINT_GROUP, name, {})
    return _parameters(named.found, named.what)


def make_policy(policy: str | Policy, /, **parameters: Any) -> Policy:
    """Make a policy.

    Parameters
    ----------
    policy : str or Policy
        A name, in which case does not matter, with parameters if wanted: ``greedy:acquisition=variance`` (see
        `geo.named.parse_named`). Or a policy of your own, which is given back and takes no parameters here.
    **parameters
        Further parameters, see `policy_parameters`.

    Raises
    ------
    PlanningError
        If there is no policy of that name, its package cannot be imported, or it is no policy.
    ParameterError
        If the text cannot be read, or a parameter is unknown or given twice.
    """
    if not isinstance(policy, str):
        if inspect.isclass(policy) or not isinstance(policy, Policy):
            what = policy.__name__ if inspect.isclass(policy) else type(policy).__name__
            fault = "is a class; give an object of it" if inspect.isclass(policy) else "is no policy"
            msg = f"policy {what} {fault}: a policy has triggers, start() and decide(observation)"
            raise PlanningError(msg)
        if parameters:
            msg = (
                f"parameter {sorted(parameters)[0]!r}: a policy that is an object has its parameters already"
            )
            raise ParameterError(msg)
        return policy
    name, what, factory, given = load_registered("policy", ENTRY_POINT_GROUP, policy, parameters)
    known = _parameters(factory, what)
    check_parameters(f"policy {name}", parameters.keys() | given.keys(), known)
    made = factory(**{**given, **parameters})
    if not isinstance(made, Policy):
        kind = type(made).__name__
        msg = f"policy {name} makes a {kind}, which has not triggers, start() and decide(observation)"
        raise PlanningError(msg)
    return made


def _parameters(factory: Any, what: str) -> dict[str, Any]:
    if not callable(factory):
        msg = f"{what} is no class and no other callable that makes a policy"
        raise PlanningError(msg)
    return {name: argument.default for name, argument in inspect.signature(factory).parameters.items()}
