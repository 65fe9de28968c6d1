"""What a scenario means, as a digest: all that decides its runs but planner, estimator and seed."""

from __future__ import annotations

import dataclasses
import hashlib
from typing import Any

import msgspec
import shapely

from geo import Farm
from geo.farms import get_farm
from sensors.field_files import field_to_table, load_field_set
from sim_vehicle.airframe.catalog import get_vehicle
from wbf_mission.scenario import Scenario

__all__ = ["digest", "meaning_of"]

_ROWS = ("planner", "policy", "estimator", "seed")
_FILES = ("farm", "fields", "vehicle")
# What was added after the first ids, with the values that leave everything as it was: these do not count.
_LATER_OPTIONS = {"estimate_errors": False}
_LATER_OF_VEHICLES = {"airframe": None, "return_margin_m": 0.0}


def meaning_of(scenario: Scenario) -> str:
    """Return the digest of a scenario's options, farm, fields and vehicles.

    A farm or vehicle file counts by what is in it, not by its name.

    Raises
    ------
    WbfMissionError
        If the farm, a field or a vehicle is unknown.
    """
    options = {key: one for key, one in scenario.to_dict().items() if key not in (*_ROWS, *_FILES)}
    options = _without(options, _LATER_OPTIONS)
    fields = load_field_set(scenario.farm.fields)
    return digest(
        {
            "options": options,
            "farm": _farm(get_farm(scenario.farm.name)),
            "fields": [field_to_table(one) for one in fields],
            "vehicles": [_vehicle(name) for name in scenario.vehicle.fleet],
        }
    )


def digest(values: Any) -> str:
    """Return the first 96 bits of a SHA-256 over plain values, as hexadecimal digits."""
    text = msgspec.json.encode(values, order="deterministic", enc_hook=str)
    return hashlib.sha256(text).hexdigest()[:24]


def _vehicle(name: str) -> dict[str, Any]:
    values = dataclasses.asdict(get_vehicle(name))
    del values["name"]
    return _without(values, _LATER_OF_VEHICLES)


def _without(values: dict[str, Any], left_out: dict[str, Any]) -> dict[str, Any]:
    return {key: one for key, one in values.items() if key not in left_out or one != left_out[key]}


def _farm(farm: Farm) -> dict[str, Any]:
    return {
        "cells": [farm.width_cells, farm.height_cells, farm.cell_size_m],
        "origin": [
            farm.frame.latitude_deg,
            farm.frame.longitude_deg,
            farm.frame.altitude_m,
            farm.frame.rotation_deg,
        ],
        "home": list(farm.home_m),
        "patches": [
            [shapely.to_wkt(one.polygon, rounding_precision=6), int(one.crop), one.owner == farm.owner]
            for one in farm.patches
        ],
        "obstacles": [shapely.to_wkt(one, rounding_precision=6) for one in farm.obstacles],
    }
