"""Cards of scenarios: what each means, on half a page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np

from geo import Farm
from sensors.field_files import load_field_set
from wbf_mission.bench.digests import meaning_of
from wbf_mission.bench.page import Table
from wbf_mission.scenario import Scenario, about_scenario, load_scenario, scenario_ids

_OPEN = ("planner", "policy", "estimator", "seed")


class Card(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a scenario means, in words.

    Attributes
    ----------
    about : str
        A sentence; empty of a scenario file.
    meaning : str
        The digest of all that it means (`wbf_mission.bench.digests.meaning_of`).
    farm : str
        Its size and crops.
    scored : str
        Which fields are scored, and when.
    options : dict
        Those that are not at their defaults; planner, policy, estimator and seed are open.
    """

    scenario: str
    about: str
    meaning: str
    farm: str
    scored: str
    options: dict[str, str]

    def told(self) -> dict[str, str]:
        """Return what a reader is told, by what it is."""
        first = {"about": self.about, "farm and crops": self.farm, "scored": self.scored}
        told = {key: one for key, one in first.items() if one}
        return {**told, **self.options, "digest of the meaning": self.meaning}

    def table(self) -> Table:
        """Return the same as a table."""
        return Table(self.scenario, ("what", "value"), tuple(self.told().items()))


def card_of(name: str, scenario: Scenario) -> Card:
    """Return the card of a scenario that is called by its id, or by its file.

    WbfMissionError if its farm, a field or a vehicle is unknown.
    """
    defaults = Scenario().to_dict()
    changed = {key: one for key, one in scenario.to_dict().items() if one != defaults[key]}
    return Card(
        scenario=name,
        about=about_scenario(name) if name in scenario_ids() else "",
        meaning=meaning_of(scenario),
        farm=_farm(scenario.farm.load()),
        scored=_scored(scenario),
        options={key: _text(one) for key, one in changed.items() if key not in _OPEN},
    )


def known_cards(names: Iterable[str]) -> list[Card]:
    """Return the cards of those scenarios that have an id, sorted."""
    return [card_of(name, load_scenario(name)) for name in sorted(names) if name in scenario_ids()]


def _farm(farm: Farm) -> str:
    grid = farm.grid()
    counts = np.bincount(grid.crop[grid.owned], minlength=len(grid.crops))
    crops = ", ".join(f"{name} {count}" for name, count in zip(grid.crops, counts, strict=False) if count)
    size = f"{farm.width_cells} x {farm.height_cells} cells of {farm.cell_size_m:g} m"
    return f"{farm.name}: {size}; cells of the owner: {crops}"


def _scored(scenario: Scenario) -> str:
    fields = load_field_set(scenario.farm.fields)
    named = ", ".join(f"{one.name} ({one.weight:g})" for one in fields)
    points = scenario.score.points
    when = "as often as the default of the farm says" if points is None else f"at {points} times of a flight"
    return f"{named}, by these weights, {when}"


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return _text(f"{key}={one}" for key, one in value.items())
    if isinstance(value, Iterable) and not isinstance(value, str):
        return ", ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
