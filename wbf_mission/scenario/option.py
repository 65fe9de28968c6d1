"""What an option of a run is: told once, beside the field that holds its value.

A part of a scenario is a frozen dataclass whose fields are made by `option`. The part checks its values
against what its fields say; files and the command line are derived from the same (`wbf_mission.cli.options`).
"""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import msgspec

from geo.errors import WbfMissionError
from geo.reading import misfit

_UNITS = {"_cm": "cm", "_m_s": "m/s", "_m": "m", "_s": "s", "_deg": "degrees"}
_METADATA = "option"


class ScenarioError(WbfMissionError, ValueError):
    """A scenario or scenario file with a value that cannot be used."""


@dataclass(frozen=True, slots=True)
class Option:
    """What is known of one option."""

    key: str  # Its name as a keyword of `Scenario` and in a scenario file; unique over all parts
    help: str  # What it is, without unit, range and default
    panel: str  # Under which heading ``--help`` shows it
    # The range of a number, both ends included
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()  # The words that it may be
    default: str = ""  # The default in words, where its value does not say it
    flag: str | None = None  # Its name on the command line; None if only another option sets it
    metavar: str | None = None  # What stands for its value in ``--help``
    example: str = ""  # A value that is easily given as a number, as the text that it has to be
    # Of what it is a name, for completion: farm, planner, policy, estimator, vehicle, autopilot or empty
    kind: str = ""
    needs: str = ""  # The key of the option without which it has no effect
    not_with: tuple[str, ...] = ()  # The keys of the options that leave it without effect
    # Reads its text of the command line; None where the command line's own types do
    read: Callable[[str], Any] | None = None
    needs_fleet: bool = False  # Whether it has an effect only where several vehicles fly
    # Whether several of the choices may be given, separated by commas: one for each vehicle
    each: bool = False
    # Of an option of the command line alone, such as ``--wind 5,270``: the keys of those that it sets, of
    # which `read` gives the values by key
    sets: tuple[str, ...] = ()
    wanted: Any = str  # The type of its field
    initial: Any = None  # The default of its field

    @property
    def unit(self) -> str:
        """The unit, as the key's ending tells it."""
        return next((unit for end, unit in _UNITS.items() if self.key.endswith(end)), "")

    @property
    def label(self) -> str:
        """The option in words."""
        ending = next((end for end in _UNITS if self.key.endswith(end)), "")
        return self.key.removesuffix(ending).replace("_", " ")

    @property
    def allowed(self) -> str:
        """What may be given, in words; empty if that is not limited."""
        if self.choices:
            return " or ".join(self.choices)
        if self.low is None or self.high is None:
            return ""
        low, high = (f"{end:g}" if abs(end) < 1e6 else f"{end:.0f}" for end in (self.low, self.high))
        return f"{low} to {'2^64 - 1' if self.high == 2**64 - 1 else high} {self.unit}".rstrip()

    def checked(self, value: Any) -> Any:
        """Return a value as the option's type; ScenarioError if it is of another, out of range or empty."""
        value = self._converted(value)
        if isinstance(value, str) and not value.strip():
            msg = f"{self.label} is empty: give {self.allowed or 'a value, or leave it out'}"
            raise ScenarioError(msg)
        if isinstance(value, str) and self.choices:
            good = all(one.strip() in self.choices for one in (value.split(",") if self.each else [value]))
        elif isinstance(value, (int, float)) and self.low is not None and self.high is not None:
            good = self.low <= value <= self.high and math.isfinite(value)
        else:
            good = True
        if not good:
            shown = repr(value) if isinstance(value, str) else value
            msg = f"{self.label} {shown} is out of range: give {self.allowed}"
            raise ScenarioError(msg)
        return value

    def _converted(self, value: Any) -> Any:
        if type(value).__module__ == "numpy" and hasattr(value, "item") and not getattr(value, "ndim", 0):
            value = value.item()
        if self.wanted is Any:
            return value
        try:
            return msgspec.convert(value, self.wanted)
        except msgspec.ValidationError as error:
            if isinstance(value, int | float) and str in (self.wanted, *typing.get_args(self.wanted)):
                such = f', such as "{self.example}"' if self.example else ""
                msg = f"{self.key}: {value!r} is a number; give a text{such}"
                raise ScenarioError(msg) from None
            raise ScenarioError(misfit(error, self.key)) from None


def option(default: Any, text: str, panel: str, /, **more: Any) -> Any:
    """Return a dataclass field with what `Option` holds: help, panel, more; the flag comes from the key."""
    metadata = {_METADATA: {"help": text, "panel": panel, **more}}
    if isinstance(default, type):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True)
class Part:
    """The base of the parts: a frozen dataclass of options that checks itself."""

    COMPOUND: ClassVar[tuple[Option, ...]] = ()

    def __post_init__(self) -> None:
        for name, one in options_of(type(self)).items():
            object.__setattr__(self, name, one.checked(getattr(self, name)))
        self.check()

    def check(self) -> None:
        """Raise ScenarioError if values do not fit each other."""

    def values(self) -> dict[str, Any]:
        """Return the options by their keys."""
        return {one.key: getattr(self, name) for name, one in options_of(type(self)).items()}


_OPTIONS: dict[type[Any], Mapping[str, Option]] = {}


def options_of(part: type[Any]) -> Mapping[str, Option]:
    """Return the options of a part by the names of its fields."""
    if part in _OPTIONS:
        return _OPTIONS[part]
    wanted = typing.get_type_hints(part)  # finding them takes longer than all else of a scenario
    found: dict[str, Option] = {}
    for one in dataclasses.fields(part):
        if _METADATA not in one.metadata:
            continue
        initial = one.default if one.default_factory is dataclasses.MISSING else one.default_factory()
        given = {"key": one.name, **one.metadata[_METADATA]}
        made = Option(wanted=wanted[one.name], initial=initial, **given)
        if "flag" not in given:
            made = dataclasses.replace(made, flag="--" + made.label.replace(" ", "-"))
        found[one.name] = made
    _OPTIONS[part] = found
    return found


def names_in(text: str) -> tuple[str, ...]:
    """Read names that are separated by commas.

    >>> names_in("tylcv, soil")
    ('tylcv', 'soil')
    """
    return tuple(word.strip() for word in text.split(",") if word.strip())
