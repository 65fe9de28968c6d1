"""Policies: who decides in flight where to go next.

A policy is asked at the start and then whenever something is worth asking for. A planner is a policy that
never changes its mind (`FixedPlan`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from mission.planners.registry import make_planner
from mission.planners.request import Planner
from mission.policies.decision import GO_ON, Decision
from mission.policies.situation import Event, Situation


@dataclass(frozen=True, slots=True)
class Asking:
    """When a policy wants to be asked, besides at the start and when a vehicle is lost.

    Parameters
    ----------
    period_s : float or None
        So often, in seconds of flight; None: not for time alone.
    observations : int or None
        After so many new observations; None: not for them alone.
    waypoints : bool
        Whenever a vehicle reaches a waypoint.
    """

    period_s: float | None = None
    observations: int | None = None
    waypoints: bool = False


NEVER_AGAIN = Asking()
"""Only at the start, and when a vehicle is lost."""


@runtime_checkable
class Policy(Protocol):
    """Decides where vehicles go next.

    It is an object of its own for each run: `start` makes it forget everything, then `decide` is called with
    one situation after the other. It gets no object that leads to the true state of the farm.
    """

    @property
    def asking(self) -> Asking:
        """When it wants to be asked."""

    def start(self) -> None:
        """Forget everything: a new run begins."""

    def decide(self, situation: Situation) -> Decision:
        """Answer, within the situation's computing time.

        At `Event.START` every vehicle needs a path. Later `GO_ON` leaves all as it is. Every path must lie in
        the area of its vehicle's request, and cost no more (`VehicleReport.fares`) than is left of the
        budget.

        Raises
        ------
        PlanningError
            If there is no path within the budget.
        """


@dataclass(frozen=True, slots=True)
class FixedPlan:
    """A planner as a policy: it plans at the start and never changes its mind.

    Parameters
    ----------
    planner : Planner or str
        As for `mission.planners.make_planner`.

    Examples
    --------
    >>> FixedPlan("spiral").asking == NEVER_AGAIN
    True
    """

    planner: Planner | str

    @property
    def asking(self) -> Asking:
        """Only at the start."""
        return NEVER_AGAIN

    def start(self) -> None:
        """Nothing is remembered."""

    def decide(self, situation: Situation) -> Decision:
        """Plan for every vehicle at the start, else go on."""
        if situation.event is not Event.START:
            return GO_ON
        planner = make_planner(self.planner)
        planned = {one.system_id: planner(one.request) for one in situation.steerable}
        return Decision(
            {system_id: path.points_m for system_id, path in planned.items()},
            reason="plan",
            spacing_m={
                system_id: path.spacing_m for system_id, path in planned.items() if path.spacing_m is not None
            },
        )
