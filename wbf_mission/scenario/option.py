"""The definition of an option of a run, kept in the metadata of a dataclass field.

A part of a scenario is a frozen dataclass whose fields are made by `option`. The part checks values against
the fields' definitions. Scenario files and the command line (`wbf_mission.cli.options`) use these, too.
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
from geo.texts import unknown

_UNITS = {"_cm": "cm", "_m_s": "m/s", "_m": "m", "_s": "s", "_deg": "degrees"}
_METADATA = "option"


class ScenarioError(WbfMissionError, ValueError):
    """Error of a scenario or scenario file with an invalid value."""


@dataclass(frozen=True, slots=True)
class Option:
    """The definition of an option."""

    key: str  # Keyword of `Scenario` and key in scenario files, different for each option.
    help: str  # Description without unit, range and default.
    panel: str  # Heading in ``--help``.
    # `low` and `high` are the ends of the range of a number and belong to the range.
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()  # Valid words; empty if all values in the range are valid.
    default: str = ""  # Description of a default whose value does not explain itself.
    flag: str | None = None  # Name on the command line; None if only another option sets it.
    metavar: str | None = None  # Placeholder for the value in ``--help``.
    example: str = ""  # Valid text, for the error if a number is given in place of a text.
    # Kind of the names to complete: farm, planner, policy, estimator, vehicle, autopilot; or empty.
    kind: str = ""
    needs: str = ""  # Key of an option without which this option has no effect.
    not_with: tuple[str, ...] = ()  # Keys of options that make this option ineffective.
    # Function that parses the text on the command line; None if the type of the option suffices.
    read: Callable[[str], Any] | None = None
    needs_fleet: bool = False  # Whether the option has an effect only with several vehicles.
    # Whether a comma-separated list may be given, with a choice for each vehicle.
    each: bool = False
    # Keys that an option such as ``--wind 5,270`` sets; `read` returns the values by key.
    sets: tuple[str, ...] = ()
    wanted: Any = str  # Type of the field.
    initial: Any = None  # Default value of the field.

    @property
    def unit(self) -> str:
        """Unit of the value, which the ending of the key gives."""
        return next((unit for end, unit in _UNITS.items() if self.key.endswith(end)), "")

    @property
    def label(self) -> str:
        """Name of the option in words, without the unit."""
        ending = next((end for end in _UNITS if self.key.endswith(end)), "")
        return self.key.removesuffix(ending).replace("_", " ")

    @property
    def allowed(self) -> str:
        """Valid values in words; empty if all values are valid."""
        if self.choices:
            return " or ".join(self.choices)
        if self.low is None or self.high is None:
            return ""
        low, high = (f"{end:g}" if abs(end) < 1e6 else f"{end:.0f}" for end in (self.low, self.high))
        return f"{low} to {'2^64 - 1' if self.high == 2**64 - 1 else high} {self.unit}".rstrip()

    def checked(self, value: Any) -> Any:
        """Convert a value to the option's type; raise ScenarioError if it is invalid or empty."""
        value = self._converted(value)
        if isinstance(value, str) and not value.strip():
            msg = f"{self.label} is empty: give {self.allowed or 'a value, or leave the option out'}"
            raise ScenarioError(msg)
        if isinstance(value, str) and self.choices:
            words = [word.strip() for word in value.split(",")] if self.each else [value]
            for word in words:
                if word not in self.choices:
                    raise ScenarioError(unknown(self.label, word, self.choices))
        elif not isinstance(value, (int, float)) or self.low is None or self.high is None:
            return value
        elif not (self.low <= value <= self.high and math.isfinite(value)):
            raise ScenarioError(f"{self.label} {value} is out of range: give {self.allowed}")
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
                raise ScenarioError(f"{self.key}: {value!r} is a number; give a text{such}") from None
            raise ScenarioError(misfit(error, self.key)) from None


def option(default: Any, text: str, panel: str, /, **more: Any) -> Any:
    """Return a dataclass field with an `Option` as metadata; its flag is by default made from its key."""
    metadata = {_METADATA: {"help": text, "panel": panel, **more}}
    if isinstance(default, type):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True)
class Part:
    """Base class of a scenario's parts, frozen dataclasses of options that check their values."""

    COMPOUND: ClassVar[tuple[Option, ...]] = ()

    def __post_init__(self) -> None:
        for name, defined in options_of(type(self)).items():
            object.__setattr__(self, name, defined.checked(getattr(self, name)))
        self.check()

    def check(self) -> None:
        """Raise ScenarioError if values contradict each other."""

    def values(self) -> dict[str, Any]:
        """Return the values of the options by key."""
        return {defined.key: getattr(self, name) for name, defined in options_of(type(self)).items()}


_OPTIONS: dict[type[Any], Mapping[str, Option]] = {}


def options_of(part: type[Any]) -> Mapping[str, Option]:
    """Return the definitions of a part's options by field name."""
    if part in _OPTIONS:
        return _OPTIONS[part]
    wanted = typing.get_type_hints(
        part
    )  # cached below, as get_type_hints is the slowest step of making a scenario
    found: dict[str, Option] = {}
    for item in dataclasses.fields(part):
        if _METADATA not in item.metadata:
            continue
        initial = item.default if item.default_factory is dataclasses.MISSING else item.default_factory()
        given = {"key": item.name, **item.metadata[_METADATA]}
        made = Option(wanted=wanted[item.name], initial=initial, **given)
        if "flag" not in given:
            made = dataclasses.replace(made, flag="--" + made.label.replace(" ", "-"))
        found[item.name] = made
    _OPTIONS[part] = found
    return found


def names_in(text: str) -> tuple[str, ...]:
    """Split a comma-separated list of names.

    >>> names_in("tylcv, soil")
    ('tylcv', 'soil')
    """
    return tuple(word.strip() for word in text.split(",") if word.strip())
