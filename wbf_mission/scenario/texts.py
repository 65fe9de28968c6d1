"""How options are written on the command line where one text holds several values."""

from __future__ import annotations

from typing import Any

from geo.texts import parse_number
from wbf_mission.scenario.option import ScenarioError


def wind_values(text: str) -> dict[str, Any]:
    """Read ``SPEED,FROM[,GUST]``.

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
    """Read ``log[,ROUGHNESS[,HEIGHT]]``, ``power[,EXPONENT[,HEIGHT]]`` or ``sitl``.

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
        msg = (
            f"--wind-shear {text!r} is not log[,ROUGHNESS[,HEIGHT]], power[,EXPONENT[,HEIGHT]] or sitl; "
            "give such as log,0.1,10"
        )
        raise ScenarioError(msg)
    names = ("wind_roughness_m" if law == "log" else "wind_exponent", "wind_height_m")
    return {"wind_shear": law, **dict(zip(names, numbers, strict=False))}


def turbulence_value(text: str) -> str | float:
    """Read a level of turbulence, or the wind that decides it.

    >>> turbulence_value("light"), turbulence_value("6.5")
    ('light', 6.5)
    """
    try:
        return parse_number(text)
    except ValueError:
        return text


def parameter_values(texts: list[str]) -> dict[str, float]:
    """Read ``NAME=VALUE`` texts.

    >>> parameter_values(["MPC_ACC_HOR=4", "NAV_ACC_RAD=1.5"])
    {'MPC_ACC_HOR': 4.0, 'NAV_ACC_RAD': 1.5}
    """
    values = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            values[name.strip().upper()] = parse_number(value)
        except ValueError:
            msg = f"--param {text!r} is not NAME=VALUE; give one such as MPC_ACC_HOR=4"
            raise ScenarioError(msg) from None
    return values
