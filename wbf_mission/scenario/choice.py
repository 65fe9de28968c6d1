"""The choice of a planner, policy or estimator, by name with parameters or as an object."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from geo.errors import PACKAGES
from geo.imports import entry_points
from geo.named import ParameterError, format_named, parse_named, split_named
from wbf_mission.scenario.option import ScenarioError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


@dataclass(frozen=True, slots=True)
class Choice:
    """A chosen planner, policy or estimator."""

    name: str  # Registered name, or name of the object's function or class.
    params: dict[str, Any] = field(default_factory=dict)  # Parameters that differ from the defaults.
    made: Any = None  # The object, if it is given in place of a name.

    def __str__(self) -> str:
        return format_named(self.name, self.params)

    @property
    def chosen(self) -> Any:
        """The object if it is given, or else the name."""
        return self.name if self.made is None else self.made

    @property
    def value(self) -> str | dict[str, Any]:
        """The choice as a scenario file has it: the name, or a table with name and parameters."""
        return {"name": self.name, **self.params} if self.params else self.name


def choose(value: Any, what: str) -> Choice:
    """Return the choice that a text, a table of a file or an object stands for.

    Examples
    --------
    >>> choose("lawnmower:direction=0.3", "planner")
    Choice(name='lawnmower', params={'direction': 0.3}, made=None)
    >>> str(choose({"name": "gp", "learn_from": "model"}, "estimator"))
    'gp:learn_from=model'
    """
    if isinstance(value, Choice):
        return value
    if isinstance(value, str):
        try:
            name, params = parse_named(value)
        except ParameterError as error:
            own = "; only options of the command line take FILE.py:NAME" if ".py:" in value else ""
            raise ScenarioError(f"{what}: {error}{own}") from None
        return Choice(name, params)
    if isinstance(value, Mapping):
        given = {str(key): item for key, item in value.items()}
        named = given.pop("name", None)
        if not isinstance(named, str) or not named.strip():
            msg = f'{what}: the table has no name; give a name, such as name = "{_EXAMPLE[what]}"'
            raise ScenarioError(msg)
        return Choice(named.strip(), given)
    if value is None or isinstance(value, (int, float, bytes, list, tuple, set, type)):
        raise ScenarioError(f"{what} {value!r} is neither a name, a table nor {_OBJECT[what]}")
    return Choice(getattr(value, "__name__", type(value).__name__), {}, value)


_EXAMPLE = {"planner": "lawnmower", "policy": "greedy", "estimator": "gp"}
_GROUPS = {
    "planner": "wbf_mission.planners",
    "policy": "wbf_mission.policies",
    "estimator": "wbf_mission.estimators",
}
_OBJECT = {
    "planner": "a function that plans",
    "policy": "a policy (an object, not its class)",
    "estimator": "an estimator (an object, not its class)",
}


def drawing_seed(choice: Choice, kind: str, run_seed: int) -> int:
    """Return the seed for the random numbers of a planner, policy or estimator.

    Built-in planners, policies and estimators use the run's seed. Objects and code of other packages could
    use the run's seed to reproduce the truth. For these, the seed is their own parameter or attribute
    ``seed``, a whole number that is 0 by default.

    Examples
    --------
    >>> drawing_seed(Choice("greedy"), "policy", 7)
    7
    >>> drawing_seed(Choice("mine", {"seed": 3}, made=len), "policy", 7)
    3
    """
    if choice.made is None and registered_elsewhere(choice.name, kind) is None:
        return run_seed
    try:
        return max(0, operator.index(choice.params.get("seed", getattr(choice.made, "seed", 0))))
    except TypeError:
        return 0


def registered_elsewhere(name: str, kind: str) -> EntryPoint | None:
    """Return the entry point with which another package registered `name`; None if `name` is built in."""
    for entry in entry_points(group=_GROUPS[kind]):
        if entry.name.lower() == name.lower() and entry.module.partition(".")[0] not in PACKAGES:
            return entry
    return None


def split_choices(text: str, what: str) -> list[str]:
    """Split a list of choices at commas between choices, but not at commas between parameters.

    Examples
    --------
    >>> split_choices("lawnmower:direction=0.3,inset=1,spiral", "planner")
    ['lawnmower:direction=0.3,inset=1', 'spiral']
    """
    try:
        found = split_named(text)
    except ParameterError as error:
        raise ScenarioError(f"{what}s: {error}") from None
    if not found:
        raise ScenarioError(f"{what}s {text!r}: no name is given; give names separated by commas")
    return found


def names_of(kind: str) -> tuple[str, ...]:
    """Return all known names of a `kind`: farm, planner, policy, estimator, autopilot or vehicle."""
    if kind == "farm":
        from geo.farms import farm_names

        return farm_names()
    if kind in _GROUPS:
        return tuple(sorted({entry.name for entry in entry_points(group=_GROUPS[kind])}))
    if kind == "autopilot":
        from sim_vehicle.airframe.kind import autopilot_names

        return autopilot_names()
    from sim_vehicle.airframe.catalog import vehicle_names

    return vehicle_names()
