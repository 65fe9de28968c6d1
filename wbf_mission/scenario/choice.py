"""What a scenario uses, as a name with parameters or as an object: planners and estimators."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from geo.named import ParameterError, parse_named
from wbf_mission.scenario.option import ScenarioError

# Commas within quotation marks or brackets part nothing.
_BETWEEN_COMMAS = re.compile(r'(?:"[^"]*"|\[(?:"[^"]*"|[^\]"])*\]|[^,"\[])+')


@dataclass(frozen=True, slots=True)
class Choice:
    """A planner or an estimator.

    Parameters
    ----------
    name : str
        Its registered name; of an object the name of its function or class.
    params : dict
        Parameters that are not at their defaults.
    made : object or None
        The object itself, where one was given in place of a name.
    """

    name: str
    params: dict[str, Any] = field(default_factory=dict)
    made: Any = None

    def __str__(self) -> str:
        texts = ",".join(f"{key}={_written(value)}" for key, value in self.params.items())
        return f"{self.name}:{texts}" if texts else self.name

    @property
    def value(self) -> str | dict[str, Any]:
        """As a file holds it: the name, or a table with the parameters."""
        return {"name": self.name, **self.params} if self.params else self.name


def choose(value: Any, what: str) -> Choice:
    """Return the choice that a text, a table of a file, or an object is.

    Parameters
    ----------
    value : str, dict, Choice or object
        ``name:key=value,...``, ``{"name": ..., key: value}``, or a planner or estimator.
    what : str
        Of what, for errors.

    Raises
    ------
    ScenarioError
        If it is empty or no such text or table.

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
            msg = f"{what}: {error}"
            raise ScenarioError(msg) from None
        return Choice(name, params)
    if isinstance(value, Mapping):
        given = {str(key): one for key, one in value.items()}
        named = given.pop("name", None)
        if not isinstance(named, str) or not named.strip():
            msg = f'{what}: the table has no name; give one such as name = "{_EXAMPLE[what]}"'
            raise ScenarioError(msg)
        return Choice(named.strip(), given)
    if value is None or isinstance(value, (int, float, bytes, list, tuple, set, type)):
        msg = f"{what} {value!r} is neither a name, a table nor {_OBJECT[what]}"
        raise ScenarioError(msg)
    return Choice(getattr(value, "__name__", type(value).__name__), {}, value)


def _written(value: Any) -> str:
    """Write a parameter's value as `geo.named.parse_named` reads it."""
    if isinstance(value, (list, tuple)):
        return "[" + ",".join(_written(one) for one in value) + "]"
    if value is None or isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str):
        return str(value)
    plain = value.replace("_", "").replace("-", "").isalpha() and value.lower() not in _CONSTANTS
    return value if plain else f'"{value}"'


_CONSTANTS = ("true", "false", "none")
_EXAMPLE = {"planner": "lawnmower", "estimator": "gp"}
_OBJECT = {"planner": "a function that plans", "estimator": "an estimator (an object, not its class)"}


def choices_in(text: str, what: str) -> list[Choice]:
    """Read several choices that are separated by commas, as their parameters are.

    Examples
    --------
    >>> [str(one) for one in choices_in("lawnmower:direction=0.3,inset=1,spiral", "planner")]
    ['lawnmower:direction=0.3,inset=1', 'spiral']
    """
    found: list[str] = []
    for part in (word.strip() for word in _BETWEEN_COMMAS.findall(text)):
        # A further parameter has a value and no name in front of it.
        if found and "=" in part and ":" not in part.partition("=")[0]:
            found[-1] += f",{part}"
        elif part:
            found.append(part)
    if not found:
        msg = f"{what}s {text!r} name nothing: give names separated by commas"
        raise ScenarioError(msg)
    return [choose(one, what) for one in found]
