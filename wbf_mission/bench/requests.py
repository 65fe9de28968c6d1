"""Requests stored in a benchmark folder (``asked.json``): specifications, commands and scenario cards."""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from geo import Farm
from geo.reading import MAX_TEXT_BYTES, UnreadableError, misfit, not_json, read_file
from sensors.field_files import load_field_set
from wbf_mission.bench.digests import meaning_of
from wbf_mission.bench.spec import BenchSpec, seeds_text
from wbf_mission.results.files import write_json
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice, Scenario, about_scenario, scenario_ids

_OPEN = ("planner", "policy", "estimator", "seed")


class Card(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Description of a scenario in words.

    Attributes
    ----------
    about : str
        One sentence; empty for a scenario file.
    meaning : str
        Digest of the scenario (`wbf_mission.bench.digests.meaning_of`).
    farm : str
        Size and crops of the farm.
    scored : str
        The scored fields with their weights, and the scored times.
    options : dict
        Options that are not at their defaults, except planner, policy, estimator and seed.
    """

    scenario: str
    about: str
    meaning: str
    farm: str
    scored: str
    options: dict[str, str]

    def entries(self) -> dict[str, str]:
        """Return the lines of the card by their labels."""
        first = {"about": self.about, "farm and crops": self.farm, "scored": self.scored}
        given = {label: text for label, text in first.items() if text}
        return {**given, **self.options, "digest of the meaning": self.meaning}


def card_of(name: str, scenario: Scenario) -> Card:
    """Return the card of a scenario; `name` is the scenario's id or file.

    WbfMissionError if the farm, a field or a vehicle is unknown.
    """
    defaults = Scenario().to_dict()
    changed = {key: value for key, value in scenario.to_dict().items() if value != defaults[key]}
    return Card(
        scenario=name,
        about=about_scenario(name) if name in scenario_ids() else "",
        meaning=meaning_of(scenario),
        farm=_farm(scenario.farm.load()),
        scored=_scored(scenario),
        options={key: _text(value) for key, value in changed.items() if key not in _OPEN},
    )


def _farm(farm: Farm) -> str:
    grid = farm.grid()
    counts = np.bincount(grid.crop[grid.owned], minlength=len(grid.crops))
    crops = ", ".join(f"{name} {count}" for name, count in zip(grid.crops, counts, strict=False) if count)
    size = f"{farm.width_cells} x {farm.height_cells} cells of {farm.cell_size_m:g} m"
    return f"{farm.name}: {size}; cells of the owner: {crops}"


def _scored(scenario: Scenario) -> str:
    fields = load_field_set(scenario.farm.fields)
    named = ", ".join(f"{field.name} ({field.weight:g})" for field in fields)
    points = scenario.score.points
    when = "at the farm's default number of times" if points is None else f"at {points} times of a flight"
    return f"{named}, by these weights, {when}"


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return _text(f"{key}={item}" for key, item in value.items())
    if isinstance(value, Iterable) and not isinstance(value, str):
        return ", ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


ASKED = "asked.json"


class Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A request to fly one specification.

    Attributes
    ----------
    when : str
        Time of the first such request, UTC (ISO 8601).
    command : str
        Command line; empty for a request from Python.
    specification : str
        TOML file for ``bench run``; objects given from Python are named in a comment.
    """

    when: str
    command: str
    specification: str


class AskedFor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All requests of a folder in order of time, and the cards of its scenarios."""

    asked: list[Asked] = []
    cards: list[Card] = []


def read_asked(folder: Path) -> AskedFor:
    """Return the requests of a folder; empty for an old folder without the file.

    ResultError if the file is damaged.
    """
    path = folder / ASKED
    if not path.exists():
        return AskedFor()
    try:
        data = read_file(path, MAX_TEXT_BYTES)
        return msgspec.json.decode(data, type=AskedFor)
    except UnreadableError as error:
        why = str(error)
    except msgspec.ValidationError as error:
        why = misfit(error)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        why = not_json(error, data)
    raise ResultError(f"{path}: is not a list of requests: {why}; remove the file") from None


def keep_asked(folder: Path, spec: BenchSpec, command: str) -> None:
    """Add a request to the file of a folder, unless the file already has it."""
    found = read_asked(folder)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    asked = Asked(now, command, specification_text(spec))
    new = all((old.command, old.specification) != (command, asked.specification) for old in found.asked)
    known = {(card.scenario, card.meaning) for card in found.cards}
    made = [card_of(name, scenario) for name, scenario in spec.scenarios]
    cards = [card for card in made if (card.scenario, card.meaning) not in known]
    if new or cards:
        write_json(
            folder / ASKED, AskedFor([*found.asked, *([asked] if new else [])], [*found.cards, *cards])
        )


def specification_text(spec: BenchSpec) -> str:
    """Return a specification as TOML for `BenchSpec.read`.

    Examples
    --------
    >>> print(specification_text(BenchSpec.of(planners=["spiral"], estimators=["gp"], seeds="100..139")))
    scenarios = ["WBF/Miniberry-30-v1"]
    planners = ["spiral"]
    estimators = ["gp"]
    seeds = "100..139"
    """
    seeds = seeds_text(spec.seeds)
    lines = [
        f"scenarios = {_texts([name for name, _ in spec.scenarios])}",
        *_choices("planners", spec.planners),
        *_choices("estimators", spec.estimators),
        f"seeds = {seeds}" if seeds.isdigit() else f"seeds = {json.dumps(seeds)}",
    ]
    return "\n".join(lines)


def _choices(key: str, choices: Sequence[Choice]) -> Iterator[str]:
    named = [str(choice) for choice in choices if choice.made is None]
    own = [str(choice) for choice in choices if choice.made is not None]
    if named:
        yield f"{key} = {_texts(named)}"
    if own:
        yield f"# a file cannot hold {key} of your own; give them all on the command line: {_texts(own)}"


def _texts(texts: Sequence[str]) -> str:
    return json.dumps(list(texts), ensure_ascii=False)
