"""Scenario cards: a description of a scenario on half a page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
import numpy as np

from geo import Farm
from sensors.field_files import load_field_set
from wbf_mission.bench.digests import meaning_of
from wbf_mission.scenario import Scenario, about_scenario, scenario_ids

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
    """Return the card of a scenario; `name` is its id or its file.

    WbfMissionError if its farm, a field or a vehicle is unknown.
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
    when = "as often as the default of the farm says" if points is None else f"at {points} times of a flight"
    return f"{named}, by these weights, {when}"


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return _text(f"{key}={item}" for key, item in value.items())
    if isinstance(value, Iterable) and not isinstance(value, str):
        return ", ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
