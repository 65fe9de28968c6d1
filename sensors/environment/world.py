"""Worlds: true dynamics of an environment that differ from the published dynamics.

Planners, estimators and policies know a scenario's fields and the published dynamics of the fields. A world
changes the dynamics of the true environment: some parameters get a fixed value, or a value drawn for each
seed. A world is a TOML file with a table for each changed field::

    [tylcv]
    likelihood = { factor = [0.5, 2.0] }    # published value times a factor, log-uniform, drawn for each seed
    seeds = { one_of = [1, 6, 12] }         # one of these values, with equal probabilities
    kernel_shape = "exponential"            # this value

Each value is drawn from its own random stream ``"world", field, parameter`` of the run's seed. A further
drawn value thus changes neither the other values nor other draws of the environment.

>>> world_names()
('wrong-kernel', 'wrong-rates', 'wrong-seeds', 'wrong-soil')
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from geo.reading import UnreadableError, misfit, read_toml
from geo.seeds import stream
from geo.texts import unknown
from sensors.errors import EnvironmentDataError, FieldError
from sensors.field_files import field_from_table, field_to_table
from sensors.fields import PAPER_FIELDS, Dynamics, Field, FieldSet

if TYPE_CHECKING:
    from numpy.random import Generator, SeedSequence

_FOLDER = Path(__file__).parent / "worlds"
_MOST_CHOICES = 1000
_MOST_TIMES = 1000.0
Value = bool | int | float | str


class Drawn(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Distribution of a parameter: the published value times a factor, or an entry of a list."""

    factor: tuple[float, float] | None = None
    one_of: tuple[Value, ...] | None = None

    def __post_init__(self) -> None:
        if (self.factor is None) == (self.one_of is None):
            raise ValueError("give either factor = [least, most] or one_of = [...]")
        if self.factor is not None:
            low, high = self.factor
            if not 1.0 / _MOST_TIMES <= low <= high <= _MOST_TIMES:
                msg = f"factor {low:g}, {high:g}: give two numbers from {1 / _MOST_TIMES:g} to"
                raise ValueError(f"{msg} {_MOST_TIMES:g}, the lower first")
        if self.one_of is not None and not 1 <= len(self.one_of) <= _MOST_CHOICES:
            raise ValueError(f"one_of has {len(self.one_of)} values: give 1 to {_MOST_CHOICES}")

    def value(self, published: Any, rng: Generator) -> Value:
        """Draw a value; raise ValueError if a factor is given but the published value is not a number."""
        if self.one_of is not None:
            return self.one_of[int(rng.integers(len(self.one_of)))]
        assert self.factor is not None
        if isinstance(published, bool) or not isinstance(published, int | float):
            raise ValueError("a factor needs a numeric published value; give a value or one_of")
        low, high = map(math.log, self.factor)
        drawn = published * math.exp(rng.uniform(low, high))
        return max(1, round(drawn)) if isinstance(published, int) else drawn


def _law(given: Any, where: str) -> Value | Drawn:
    wanted: Any = Drawn if isinstance(given, Mapping) else Value
    try:
        law: Value | Drawn = msgspec.convert(given, wanted)
    except msgspec.ValidationError as error:
        raise EnvironmentDataError(f"{where}: {misfit(error)}") from None
    return law


@dataclass(frozen=True, slots=True)
class World:
    """True parameters of dynamics, by field and parameter name, that differ from published parameters.

    Examples
    --------
    >>> world = World.of_table({"ccr": {"likelihood": 0.3, "duration_days": {"factor": [0.5, 2.0]}}}, "here")
    >>> [world.fields(PAPER_FIELDS, seed)["ccr"].epidemic.duration_days for seed in range(5)]
    [6, 10, 15, 7, 18]
    >>> world.fields(PAPER_FIELDS, 0)["tylcv"] == PAPER_FIELDS["tylcv"]
    True
    """

    where: str  # Name of the world, with which error texts begin
    laws: Mapping[str, Mapping[str, Value | Drawn]]

    @classmethod
    def load(cls, name_or_path: str | Path) -> World:
        """Return a built-in world by name, or read a world from a ``.toml`` file.

        Raise EnvironmentDataError if there is no world of this name, or the file cannot be used.
        """
        given = str(name_or_path)
        if given in world_names():
            path = _FOLDER / f"{given}.toml"
        elif given.lower().endswith(".toml"):
            path = Path(given)
        else:
            msg = unknown("world", given, world_names(), ", or give a file (.toml)")
            raise EnvironmentDataError(msg)
        try:
            table = read_toml(path)
        except UnreadableError as error:
            raise EnvironmentDataError(f"{path}: cannot be read as a world: {error}") from None
        return cls.of_table(table, f"world {given}")

    @classmethod
    def of_table(cls, table: Mapping[str, Any], where: str) -> World:
        """Make a world of a table; raise EnvironmentDataError, which names `where`, for an invalid table."""
        laws: dict[str, dict[str, Value | Drawn]] = {}
        for name, given in table.items():
            if not isinstance(given, Mapping):
                msg = f"{where}: {name} is not a table; a world has a table for each field: [tylcv]"
                raise EnvironmentDataError(msg)
            laws[name] = {key: _law(law, f"{where}: {name}, {key}") for key, law in given.items()}
        if not any(laws.values()):
            msg = f"{where}: no parameter is changed; a world has a table for each field that it changes"
            raise EnvironmentDataError(msg)
        return cls(where, laws)

    def to_table(self) -> dict[str, Any]:
        """Return the world as a table of plain values, which `of_table` reads."""
        return msgspec.to_builtins(self.laws)

    def fields(self, fields: FieldSet, seed: SeedSequence | int) -> FieldSet:
        """Return the fields with the true dynamics of a run with this seed.

        Names, crops, weights and costs do not change. Tables of benchmark fields that the run does not have
        are ignored. Raise EnvironmentDataError if a table names an unknown field, no table names a field of
        the run, or a value is invalid for its field.
        """
        strange = [name for name in self.laws if name not in fields and name not in PAPER_FIELDS]
        if strange or not any(name in fields for name in self.laws):
            fault = f"no field {strange[0]!r:.60}" if strange else f"no table for {', '.join(fields.names)}"
            raise EnvironmentDataError(f"{self.where}: {fault}; the fields are {', '.join(fields.names)}")
        changed = {field.name: self._dynamics(field, seed) for field in fields if field.name in self.laws}
        return fields.with_dynamics(**changed)

    def _dynamics(self, field: Field, seed: SeedSequence | int) -> Dynamics:
        table, values = field_to_table(field), dict[str, Value | Drawn]()
        for key, law in self.laws[field.name].items():
            if isinstance(law, Drawn) and hasattr(field.dynamics, key):
                published = getattr(field.dynamics, key)
                try:
                    values[key] = law.value(published, stream(seed, "world", field.name, key))
                except ValueError as error:
                    raise EnvironmentDataError(f"{self.where}: {field.name}, {key}: {error}") from None
            else:
                values[key] = law
        try:
            return field_from_table(
                {**table, "dynamics": table["dynamics"] | values}, f"{self.where}: {field.name}"
            ).dynamics
        except FieldError as error:
            raise EnvironmentDataError(str(error)) from None


def world_names() -> tuple[str, ...]:
    """Return the sorted names of the built-in worlds."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))
