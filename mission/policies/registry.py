"""Policies with their parameters, by name or as objects.

Names are found through the entry point group ``wbf_mission.policies``; an entry is a class, or another
callable that makes a policy from keyword arguments.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from geo.installed import entry_points
from geo.named import ParameterError, check_parameters, parse_named
from mission.errors import PlanningError
from mission.policies.policy import Policy

ENTRY_POINT_GROUP = "wbf_mission.policies"


def policy_names() -> tuple[str, ...]:
    """Return the names of the installed policies, sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=ENTRY_POINT_GROUP)}))


def policy_parameters(name: str) -> dict[str, Any]:
    """Return the parameters of a policy, the arguments of its factory, with their defaults.

    Raises
    ------
    PlanningError
        If there is no policy of that name.
    """
    return _parameters(_factory(name)[1])


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
            msg = f"policy {what} {fault}: a policy has {_renamed(policy)}, start() and decide(observation)"
            raise PlanningError(msg)
        if parameters:
            msg = (
                f"parameter {sorted(parameters)[0]!r}: a policy that is an object has its parameters already"
            )
            raise ParameterError(msg)
        return policy
    name, given = parse_named(policy)
    name, factory = _factory(name)
    twice = sorted(given.keys() & parameters.keys())
    if twice:
        raise ParameterError(f"policy {name}: {twice[0]} is given twice; give it once")
    check_parameters(f"policy {name}", parameters.keys() | given.keys(), _parameters(factory))
    made = factory(**{**given, **parameters})
    if not isinstance(made, Policy):
        kind = type(made).__name__
        msg = f"policy {name} makes a {kind}, which has not {_renamed(made)}, start() and decide(observation)"
        raise PlanningError(msg)
    return made


def _renamed(policy: object) -> str:
    return "triggers (called asking before version 0.2)" if hasattr(policy, "asking") else "triggers"


def _parameters(factory: Callable[..., Any]) -> dict[str, Any]:
    return {name: argument.default for name, argument in inspect.signature(factory).parameters.items()}


def _factory(name: str) -> tuple[str, Callable[..., Any]]:
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name.lower() != name.lower():
            continue
        try:
            factory = entry.load()
        except (ImportError, AttributeError) as error:
            msg = f"policy {entry.name} ({entry.value}) cannot be loaded: {error}"
            raise PlanningError(msg) from error
        if not callable(factory):
            msg = f"policy {entry.name} ({entry.value}) is no class and no other callable that makes a policy"
            raise PlanningError(msg)
        return entry.name, factory
    msg = f"no policy is named {name!r}; there are {', '.join(policy_names()) or 'none'}"
    raise PlanningError(msg)
