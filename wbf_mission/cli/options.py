"""Options that several commands share, so that they read and behave the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

_RUN = "What to run"
_VEHICLE = "Vehicle and weather"
_CAMERA = "Leaf camera"
_OUTPUT = "Output"


def _complete(kind: str) -> Any:
    def names(incomplete: str) -> list[str]:
        from wbf_mission import names as known

        return [name for name in known.names_of(kind) if name.startswith(incomplete)]

    return names


Farm = Annotated[
    str | None,
    typer.Option(
        help="Farm: a name (see 'wbf-mission farm list') or a GeoJSON file.  [default: miniberry-30]",
        autocompletion=_complete("farm"),
        rich_help_panel=_RUN,
    ),
]
Planner = Annotated[
    str | None,
    typer.Option(
        help="lawnmower, adaptive-lawnmower, spiral, random-waypoint, or one of yours.  [default: spiral]",
        autocompletion=_complete("planner"),
        rich_help_panel=_RUN,
    ),
]
Estimator = Annotated[
    str | None,
    typer.Option(
        help="adaptive-disk, gp, epidemic, gp-sklearn, point, authors-ad or yours.  [default: adaptive-disk]",
        autocompletion=_complete("estimator"),
        rich_help_panel=_RUN,
    ),
]
Budget = Annotated[
    str | None,
    typer.Option(
        help="How much may be flown: 8000m, 2.5km, 25min, 1500s, 50Wh or 360steps."
        "  [default: the battery less its reserve; ideal: 0.4 x the owner's cells in steps]",
        rich_help_panel=_RUN,
    ),
]
ScenarioFile = Annotated[
    Path | None,
    typer.Option(
        "--scenario",
        help="A scenario file (TOML); other options change it.",
        rich_help_panel=_RUN,
        show_default=False,
    ),
]
Seed = Annotated[
    int | None, typer.Option(help="Everything random comes from it.  [default: 0]", rich_help_panel=_RUN)
]
Day = Annotated[
    int | None, typer.Option(help="Day of the environment that is flown.  [default: 6]", rich_help_panel=_RUN)
]
Vehicle = Annotated[
    str | None,
    typer.Option(
        help="One of `wbf-mission vehicle list`, such as quad or ideal (the paper's robot), or a .toml file."
        "  [default: quad]",
        autocompletion=_complete("vehicle"),
        rich_help_panel=_VEHICLE,
    ),
]
Autopilot = Annotated[
    str | None,
    typer.Option(
        help="px4 or ardupilot: whose way of flying, modes and habits.  [default: px4]",
        rich_help_panel=_VEHICLE,
    ),
]
Parameter = Annotated[
    list[str] | None,
    typer.Option(
        "--param",
        help="A parameter of the autopilot, NAME=VALUE, such as MPC_ACC_HOR=4; may be repeated.",
        rich_help_panel=_VEHICLE,
        show_default=False,
    ),
]
Altitude = Annotated[
    float | None,
    typer.Option(help="Flight height above home, m.  [default: the vehicle's]", rich_help_panel=_VEHICLE),
]
CruiseSpeed = Annotated[
    float | None, typer.Option(help="Flight speed, m/s.  [default: the vehicle's]", rich_help_panel=_VEHICLE)
]
AcceptanceRadius = Annotated[
    float | None,
    typer.Option(help="Of the planned waypoints, m.  [default: from the spacing]", rich_help_panel=_VEHICLE),
]
Wind = Annotated[
    str | None,
    typer.Option(
        help="Wind as SPEED,FROM[,GUST]: m/s, degrees, m/s; for example 5,270,1.5.  [default: calm]",
        rich_help_panel=_VEHICLE,
    ),
]
WindShear = Annotated[
    str | None,
    typer.Option(
        help="How the wind grows with the height: log[,ROUGHNESS[,HEIGHT]] or power[,EXPONENT[,HEIGHT]];"
        " HEIGHT, m, is that of --wind.  [default: not at all; log,0.1,10; power,0.143,10]",
        rich_help_panel=_VEHICLE,
    ),
]
Turbulence = Annotated[
    str | None,
    typer.Option(
        help="Dryden gusts (MIL-F-8785C): light, moderate, severe, wind (what the wind makes), or the wind at"
        " 6 m in m/s.  [default: none]",
        rich_help_panel=_VEHICLE,
    ),
]
GpsNoise = Annotated[
    float | None,
    typer.Option(
        help="Slow error of satellite positions, m, one sigma along an axis.  [default: 0]",
        rich_help_panel=_VEHICLE,
    ),
]
BaroNoise = Annotated[
    float | None,
    typer.Option(
        help="Slow error of the barometer's height, m, one sigma.  [default: 0]", rich_help_panel=_VEHICLE
    ),
]
CameraSpacing = Annotated[
    float | None,
    typer.Option(help="Distance between shots, m.  [default: one cell]", rich_help_panel=_CAMERA),
]
CameraFootprint = Annotated[
    int | None, typer.Option(help="Cells on a side of the footprint.  [default: 1]", rich_help_panel=_CAMERA)
]
CameraNoise = Annotated[
    float | None, typer.Option(help="Standard deviation of the noise.  [default: 0]", rich_help_panel=_CAMERA)
]
FalsePositives = Annotated[
    float | None,
    typer.Option(
        "--false-positive-rate",
        help="Healthy leaves seen as infected, 0 to 1.  [default: 0]",
        rich_help_panel=_CAMERA,
    ),
]
FalseNegatives = Annotated[
    float | None,
    typer.Option(
        "--false-negative-rate",
        help="Infected leaves seen as healthy, 0 to 1.  [default: 0]",
        rich_help_panel=_CAMERA,
    ),
]
CameraFields = Annotated[
    str | None,
    typer.Option(
        help="Fields that are measured, such as tylcv,soil.  [default: all three]", rich_help_panel=_CAMERA
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document.", rich_help_panel=_OUTPUT)]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no notes.", rich_help_panel=_OUTPUT)]


def wind_values(text: str | None) -> dict[str, float]:
    """Read ``SPEED,FROM[,GUST]`` into the scenario's wind fields.

    >>> wind_values("5,270")
    {'wind_speed_m_s': 5.0, 'wind_direction_deg': 270.0}
    """
    from wbf_mission.scenario import ScenarioError

    if text is None:
        return {}
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        msg = f"--wind {text!r} is not SPEED,FROM or SPEED,FROM,GUST; give numbers such as 5,270 or 5,270,1.5"
        raise ScenarioError(msg)
    return dict(zip(("wind_speed_m_s", "wind_direction_deg", "wind_gust_m_s"), numbers, strict=False))


def parameter_values(texts: list[str] | None) -> dict[str, float] | None:
    """Read ``NAME=VALUE`` texts.

    >>> parameter_values(["MPC_ACC_HOR=4", "NAV_ACC_RAD=1.5"])
    {'MPC_ACC_HOR': 4.0, 'NAV_ACC_RAD': 1.5}
    """
    from wbf_mission.scenario import ScenarioError

    if not texts:
        return None
    values = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            values[name.strip().upper()] = float(value)
        except ValueError:
            msg = f"--param {text!r} is not NAME=VALUE; give one such as MPC_ACC_HOR=4"
            raise ScenarioError(msg) from None
    return values


def shear_values(text: str | None) -> dict[str, Any]:
    """Read ``log[,ROUGHNESS[,HEIGHT]]`` or ``power[,EXPONENT[,HEIGHT]]`` into the scenario's wind fields.

    >>> shear_values("power,0.2")
    {'wind_shear': 'power', 'wind_exponent': 0.2}
    """
    from wbf_mission.scenario import ScenarioError

    if text is None:
        return {}
    law, *rest = (part.strip() for part in text.split(","))
    try:
        numbers = [float(part) for part in rest]
    except ValueError:
        numbers = [0.0] * 3
    if law not in ("log", "power") or len(numbers) > 2:
        msg = (
            f"--wind-shear {text!r} is not log[,ROUGHNESS[,HEIGHT]] or power[,EXPONENT[,HEIGHT]]; "
            "give such as log,0.1,10"
        )
        raise ScenarioError(msg)
    names = ("wind_roughness_m" if law == "log" else "wind_exponent", "wind_height_m")
    return {"wind_shear": law, **dict(zip(names, numbers, strict=False))}


def turbulence_value(text: str | None) -> str | float | None:
    """Read a level of turbulence, or the wind that decides it.

    >>> turbulence_value("light"), turbulence_value("6.5")
    ('light', 6.5)
    """
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        return text


def field_names(text: str | None) -> tuple[str, ...] | None:
    """Read ``tylcv,soil`` into a tuple of field names."""
    return None if text is None else tuple(part.strip() for part in text.split(",") if part.strip())
