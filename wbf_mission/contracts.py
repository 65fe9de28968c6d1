"""Checks that planners, policies and estimators keep their contracts; an add-on provides the checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from geo.errors import WbfMissionError
from geo.imports import load_named, loader_of

if TYPE_CHECKING:
    from collections.abc import Collection

    from mission.planners import Planner
    from mission.policies.policy import Policy
    from sensors.estimators import Estimator

GROUP = "wbf_mission.contracts"
_NAMES = ("check_estimator", "check_planner", "check_policy")


@dataclass(frozen=True, slots=True)
class PolicyCheck:
    """Measurements of `check_policy`.

    Parameters
    ----------
    decisions : int
        Number of decisions that the policy made.
    time_share : float
        Median processor time of a decision, as a fraction of the time limit.
    """

    decisions: int
    time_share: float


if TYPE_CHECKING:

    def check_planner(planner: str | Planner, lands: Collection[str] = ..., /, **parameters: Any) -> None:
        """Check a planner."""

    def check_policy(policy: str | Policy, **parameters: Any) -> PolicyCheck:
        """Check a policy."""

    def check_estimator(estimator: Estimator, *, n_observations: int = ...) -> None:
        """Check an estimator."""

else:
    __getattr__ = loader_of(
        __name__,
        _NAMES,
        lambda name: load_named(GROUP, name, "brings", "the contract check", WbfMissionError),
    )
