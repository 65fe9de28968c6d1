"""Specification of a benchmark: scenarios, planners and policies, estimators and seeds."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from geo.errors import WbfMissionError
from geo.imports import load_entry
from geo.texts import parse_whole, unknown
from mission.planners import make_planner
from mission.policies.policy import Policy, make_policy
from wbf_mission.bench.digests import digest, meaning_of, own_digest
from wbf_mission.bench.provenance import in_words
from wbf_mission.events import EventStream, Noted
from wbf_mission.run.resolve import resolve
from wbf_mission.scenario import (
    Choice,
    Scenario,
    ScenarioError,
    load_scenario,
    read_table,
    scenario_with,
)
from wbf_mission.scenario.choice import choose, names_of, registered_elsewhere
from wbf_mission.version import behaviour

if TYPE_CHECKING:
    from wbf_mission.bench.rows import BenchRow

_FORMAT = 2
_SEEDS = 10
_DEFAULTS: Mapping[str, tuple[str, ...]] = {
    "scenarios": ("WBF/Miniberry-30-v1",),
    "planners": ("lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint"),
    "estimators": ("adaptive-disk", "gp"),
}
_KEYS = ("scenarios", "planners", "estimators", "seeds")


@dataclass(frozen=True, slots=True)
class BenchRun:
    """One run of a benchmark."""

    key: str
    """Unique key of the run: a digest of everything that decides its result."""
    scenario_id: str
    """Id or file of the scenario."""
    planner: str
    """Planner or policy, with parameters."""
    estimator: str
    """Estimator, with parameters."""
    scenario: Scenario
    """Complete scenario, with planner, estimator and seed."""
    codes: dict[str, str] = field(default_factory=dict)
    """Behaviour numbers of the built-in code (``code``, `wbf_mission.version.behaviour`), and digests of the
    scenario (``scenario``) and of a ``planner`` and an ``estimator`` of the user or another package."""
    objects: dict[str, str] = field(default_factory=dict)
    """Description, with parameters, of a ``planner`` (or policy) and an ``estimator`` given as objects."""

    @property
    def seed(self) -> int:
        """Seed of the run; each seed gives the same environment to all planners and estimators."""
        return self.scenario.seed


_MOST_RUNS = 10_000_000


@dataclass(frozen=True, slots=True)
class BenchSpec:
    """All combinations of scenarios, planners or policies, estimators and seeds.

    Parameters
    ----------
    scenarios : tuple of (str, Scenario)
        Scenarios with their ids or files.
    planners, estimators : tuple of Choice
        Planners or policies, and estimators. A name that no planner has is taken as the name of a policy.
    seeds : tuple of int
        Seeds of the environments.

    Raises
    ------
    ScenarioError
        If a value is missing, repeated, unknown or does not fit.
    WbfMissionError
        If a parameter of a planner, policy or estimator is wrong.
    """

    scenarios: tuple[tuple[str, Scenario], ...]
    planners: tuple[Choice, ...]
    estimators: tuple[Choice, ...]
    seeds: tuple[int, ...]

    def __post_init__(self) -> None:
        columns: dict[str, Sequence[Any]] = {
            "scenarios": [name for name, _ in self.scenarios],
            "planners": self.planners,
            "estimators": self.estimators,
            "seeds": self.seeds,
        }
        for key, values in columns.items():
            if not values:
                raise ScenarioError(f"{key}: the list is empty; give at least one entry")
            if key != "seeds" and (twice := _repeated(values)):
                raise ScenarioError(f"{key}: {twice} is given twice; give it once")
        if len(set(self.seeds)) != len(self.seeds):
            raise ScenarioError("seeds: a seed is given twice; give each seed once")
        if len(self) > _MOST_RUNS:
            msg = f"these are {len(self)} runs; a benchmark has at most {_MOST_RUNS}: make several benchmarks"
            raise ScenarioError(msg)
        for choice in self.planners:
            require_mover(choice)
        events, notes = EventStream(), list[str]()
        events.listen(lambda noted: notes.append(f"{name}: {noted.text}"), Noted)
        for (name, scenario), choice in product(self.scenarios, self.estimators):
            try:
                resolve(scenario_with(scenario, {"estimator": choice}), events=events)
            except WbfMissionError as error:
                raise ScenarioError(f"{name}: {error}") from error
        for note in dict.fromkeys(notes):
            warnings.warn(note, stacklevel=3)

    @classmethod
    def of(
        cls,
        scenarios: Sequence[str | Path] | None = None,
        planners: Sequence[Any] | None = None,
        estimators: Sequence[Any] | None = None,
        seeds: int | str | Sequence[int] | None = None,
        *,
        folder: Path | None = None,
    ) -> Self:
        """Return a specification from ids, names and counts; the paper's experiment is the default.

        Parameters
        ----------
        scenarios : sequence of str or Path
            Ids (`wbf_mission.scenario.scenario_ids`) or files.
        planners, estimators : sequence
            Names with parameters, tables, or objects.
        seeds : int, str or sequence of int
            Number of seeds from 0 on, a list of seeds, or a text such as ``"5,7,100..139"`` (`seeds_of`).
        folder : Path, optional
            Folder in which scenario files are searched first.

        Raises
        ------
        ScenarioError
            If a value is missing, unknown or wrong.

        Examples
        --------
        >>> len(BenchSpec.of(planners=["spiral", "greedy:least_weight=0.35"], seeds=20))
        80
        """
        names = _given("scenarios", scenarios)
        for name in names:
            if not isinstance(name, (str, Path)):
                raise ScenarioError(f"scenarios: {name!r} is neither an id nor a file")
        return cls(
            scenarios=tuple((str(name), _scenario(name, folder)) for name in names),
            planners=tuple(choose(planner, "planner") for planner in _given("planners", planners)),
            estimators=tuple(choose(given, "estimator") for given in _given("estimators", estimators)),
            seeds=_seeds(_SEEDS if seeds is None else seeds),
        )

    @classmethod
    def read(cls, path: str | Path, changes: Mapping[str, Any] | None = None) -> Self:
        """Read a specification from a TOML file.

        The keys of the file are the parameters of `of`: ``scenarios`` (ids, or files in the same folder),
        ``planners``, ``estimators`` and ``seeds``. Values of `changes` other than None override the values of
        the file.

        Raises
        ------
        ScenarioError
            If the file cannot be read, or a value in it is missing, unknown or wrong.
        """
        table = read_table(path)
        try:
            for key in table:
                if key not in _KEYS:
                    raise ScenarioError(unknown("key", key, _KEYS))
            given = {key: value for key, value in (changes or {}).items() if value is not None}
            return cls.of(**{**table, **given}, folder=Path(path).parent)
        except ScenarioError as error:
            raise ScenarioError(f"{path}: {error}") from error

    def __len__(self) -> int:
        return len(self.scenarios) * len(self.planners) * len(self.estimators) * len(self.seeds)

    def runs(self) -> Iterator[BenchRun]:
        """Yield all runs; runs on the same environment follow one another."""
        movers = [(mover, _kind_of(mover), _code_of(mover, _kind_of(mover))) for mover in self.planners]
        estimators = [(estimator, _code_of(estimator, "estimator")) for estimator in self.estimators]
        for name, base in self.scenarios:
            built_in = {"code": behaviour(), "scenario": meaning_of(base)}
            for seed in self.seeds:
                for (planner, mover, of_planner), (estimator, of_estimator) in product(movers, estimators):
                    scenario = scenario_with(base, {mover: planner, "estimator": estimator, "seed": seed})
                    own_codes = {"planner": of_planner, "estimator": of_estimator}
                    codes = built_in | {key: code for key, code in own_codes.items() if code}
                    yield BenchRun(
                        key=_key(codes, mover, str(planner), str(estimator), seed),
                        scenario_id=name,
                        planner=str(planner),
                        estimator=str(estimator),
                        scenario=scenario,
                        codes=codes,
                        objects=_objects(planner=planner, estimator=estimator),
                    )


def _key(codes: Mapping[str, str], mover: str, planner: str, estimator: str, seed: int) -> str:
    return digest([_FORMAT, codes, mover, planner, estimator, seed])


def run_keys(row: BenchRow) -> tuple[str, ...]:
    """Return both possible keys of a row's run, since the column `planner` may name a planner or a policy."""
    given = (row.planner, row.estimator, row.seed)
    return tuple(_key(row.codes, mover, *given) for mover in ("planner", "policy"))


def _objects(**choices: Choice) -> dict[str, str]:
    return {key: in_words(choice.made) for key, choice in choices.items() if choice.made is not None}


def _given(key: str, given: Any) -> Sequence[Any]:
    """Return the given list, or the default for None; ScenarioError if it is empty or not a list."""
    if given is None:
        return _DEFAULTS[key]
    if isinstance(given, (list, tuple)) and given:
        return given
    msg = f"{key} {given!r} is not a list with entries; give a list such as {list(_DEFAULTS[key])}"
    raise ScenarioError(msg)


def _seeds(given: Any) -> tuple[int, ...]:
    if isinstance(given, str):
        return seeds_of(given)
    if isinstance(given, int) and not isinstance(given, bool) and 1 <= given <= _MOST_RUNS:
        return tuple(range(given))
    if isinstance(given, (list, tuple, range)) and given and all(_is_seed(seed) for seed in given):
        return tuple(given)
    number = f"a number of seeds (1 to {_MOST_RUNS})"
    raise ScenarioError(f"seeds {given!r} are neither {number} nor a list of whole numbers from 0 on")


_MOST_ENDS = 2


def seeds_of(text: str) -> tuple[int, ...]:
    """Return the seeds that a text names: a number of seeds, counted from 0, or a list of seeds and ranges.

    ScenarioError if the text is neither.

    Examples
    --------
    >>> seeds_of("3"), seeds_of("5,7,100..103"), seeds_of("5..5")
    ((0, 1, 2), (5, 7, 100, 101, 102, 103), (5,))
    """
    found: list[int] = []
    parts = [part.split("..") for part in text.split(",")]
    for ends in parts:
        try:
            first, last = parse_whole(ends[0]), parse_whole(ends[-1])
        except ValueError:
            first, last = 0, -1
        if not (len(ends) <= _MOST_ENDS and _is_seed(first) and _is_seed(last) and first <= last):
            raise ScenarioError(
                f"seeds {text!r}: {'..'.join(ends)!r} is neither a seed nor a range of seeds;"
                f" give a number of seeds (10), a range (100..139) or a list (5,7,100..139)"
            )
        if last - first + len(found) >= _MOST_RUNS:
            raise ScenarioError(f"seeds {text!r}: too many seeds; give at most {_MOST_RUNS}")
        found += range(first, last + 1)
    return _seeds(found[0]) if len(parts) == len(parts[0]) == 1 else tuple(found)


def seeds_text(seeds: Sequence[int]) -> str:
    """Return the shortest text that `seeds_of` converts back to the same seeds, in the same order.

    Examples
    --------
    >>> seeds_text(range(10)), seeds_text([5, 7, *range(100, 140)]), seeds_text([5])
    ('10', '5,7,100..139', '5..5')
    """
    if list(seeds) == list(range(len(seeds))):
        return str(len(seeds))
    return seed_ranges(seeds) if len(seeds) > 1 else f"{seeds[0]}..{seeds[0]}"


def seed_ranges(seeds: Sequence[int]) -> str:
    """Return seeds as a list of ranges, for display.

    >>> seed_ranges(range(10)), seed_ranges([5, 7])
    ('0..9', '5,7')
    """
    runs: list[list[int]] = []
    for seed in seeds:
        if runs and seed == runs[-1][-1] + 1:
            runs[-1][1:] = [seed]
        else:
            runs.append([seed])
    return ",".join("..".join(map(str, run)) for run in runs)


def _is_seed(given: Any) -> bool:
    return isinstance(given, int) and not isinstance(given, bool) and 0 <= given < 2**64


def _scenario(name: str | Path, folder: Path | None) -> Scenario:
    beside = None if folder is None else folder / name
    return load_scenario(beside if beside is not None and beside.is_file() else name)


def _kind_of(choice: Choice) -> str:
    named = choice.made is None and choice.name.lower() in names_of("planner")
    made = choice.made is not None and not isinstance(choice.made, Policy)
    return "planner" if named or made else "policy"


def _repeated(values: Sequence[str | Choice]) -> str:
    """Return a repeated value's name, or an empty text; equal objects have the same name, code and state."""
    made = [getattr(value, "made", None) for value in values]
    digests = ["" if found is None else own_digest(found) for found in made]
    counts = Counter(zip(map(str, values), digests, strict=True))
    return next((name for (name, _), count in counts.items() if count > 1), "")


def _code_of(choice: Choice, what: str) -> str:
    """Return the digest of a user's object or of another package's class; empty if built in."""
    if choice.made is not None:
        return own_digest(choice.made)
    entry = registered_elsewhere(choice.name, what)
    return "" if entry is None else own_digest(load_entry(entry, f"{what} {choice.name}", ScenarioError))


def require_mover(choice: Choice) -> None:
    """Raise an error if the planner or policy, or one of its parameters, is unknown."""
    known = (*names_of("planner"), *names_of("policy"))
    if choice.made is None and choice.name.lower() not in known:
        raise ScenarioError("planners: " + unknown("planner or policy", choice.name, known))
    make = make_planner if _kind_of(choice) == "planner" else make_policy
    make(choice.chosen, **choice.params)
