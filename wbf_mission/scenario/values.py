"""Parsers of options whose text holds several values: wind, shear, parameters, separation."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from geo.texts import parse_number
from wbf_mission.scenario.option import ScenarioError

LAYERS, DISTANCE, NOTHING = "layers", "distance", "none"
_LEAST_M, _MOST_M = 0.5, 100.0
_BATTERIES, _MOST_BATTERIES = re.compile(r"\s*(\d{1,3})\s*batter(?:y|ies)\s*", re.IGNORECASE), 100


@dataclass(frozen=True, slots=True)
class Separation:
    """Separation of the vehicles of a fleet."""

    # The kind is "layers" (each vehicle has its height), "distance" (at one height, apart in time) or "none".
    kind: str
    metres: float = 0.0  # Distance between layers, or between vehicles


def parse_separation(text: str) -> Separation:
    """Parse a separation such as ``layers:2m``, ``distance:5m`` or ``none``.

    Examples
    --------
    >>> parse_separation("layers:2m")
    Separation(kind='layers', metres=2.0)
    """
    kind, colon, rest = text.strip().lower().partition(":")
    if kind == NOTHING and not colon:
        return Separation(NOTHING)
    try:
        metres = parse_number(rest.strip().removesuffix("m").strip())
    except ValueError:
        metres = 0.0
    if kind not in (LAYERS, DISTANCE) or not _LEAST_M <= metres <= _MOST_M:
        raise ScenarioError(
            f"separation {text!r} cannot be read: give layers:METRES or distance:METRES with"
            f" {_LEAST_M:g} to {_MOST_M:g} m, such as layers:2m, or none"
        )
    return Separation(kind, metres)


def batteries_in(budget: str | None) -> int | None:
    """Return the number of batteries that a budget names, or None for a budget in another unit.

    Raises ScenarioError unless the number is 1 to 100.

    >>> batteries_in("3 batteries"), batteries_in("1battery"), batteries_in("30min")
    (3, 1, None)
    """
    match = None if budget is None else _BATTERIES.fullmatch(budget)
    if match is None:
        return None
    count = int(match.group(1))
    if not 1 <= count <= _MOST_BATTERIES:
        raise ScenarioError(f"budget {budget}: give 1 to {_MOST_BATTERIES} batteries")
    return count


def wind_values(text: str) -> dict[str, Any]:
    """Parse a wind ``SPEED,FROM[,GUST]`` into values of options.

    >>> wind_values("5,270")
    {'wind_speed_m_s': 5.0, 'wind_direction_deg': 270.0}
    """
    try:
        numbers = [parse_number(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        msg = f"--wind {text!r} is not SPEED,FROM or SPEED,FROM,GUST; give numbers such as 5,270 or 5,270,1.5"
        raise ScenarioError(msg)
    return dict(zip(("wind_speed_m_s", "wind_direction_deg", "wind_gust_m_s"), numbers, strict=False))


def shear_values(text: str) -> dict[str, Any]:
    """Parse a shear law ``log[,ROUGHNESS[,HEIGHT]]``, ``power[,EXPONENT[,HEIGHT]]`` or ``sitl``.

    >>> shear_values("power,0.2")
    {'wind_shear': 'power', 'wind_exponent': 0.2}
    """
    law, *rest = (part.strip() for part in text.split(","))
    try:
        numbers = [parse_number(part) for part in rest]
    except ValueError:
        numbers = [0.0] * 3
    most = {"log": 2, "power": 2, "sitl": 0}
    if law not in most or len(numbers) > most[law]:
        raise ScenarioError(
            f"--wind-shear {text!r} is not log[,ROUGHNESS[,HEIGHT]], power[,EXPONENT[,HEIGHT]] or sitl; "
            "give for example log,0.1,10"
        )
    names = ("wind_roughness_m" if law == "log" else "wind_exponent", "wind_height_m")
    return {"wind_shear": law, **dict(zip(names, numbers, strict=False))}


def turbulence_value(text: str) -> str | float:
    """Parse a level of turbulence, or the wind speed (m/s) that sets the level.

    >>> turbulence_value("light"), turbulence_value("6.5")
    ('light', 6.5)
    """
    try:
        return parse_number(text)
    except ValueError:
        return text


def parameter_values(texts: list[str]) -> dict[str, float]:
    """Parse texts ``NAME=VALUE`` into autopilot parameters.

    >>> parameter_values(["MPC_ACC_HOR=4", "NAV_ACC_RAD=1.5"])
    {'MPC_ACC_HOR': 4.0, 'NAV_ACC_RAD': 1.5}
    """
    values = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            values[name.strip().upper()] = parse_number(value)
        except ValueError:
            msg = f"--param {text!r} is not NAME=VALUE; give for example MPC_ACC_HOR=4"
            raise ScenarioError(msg) from None
    return values
