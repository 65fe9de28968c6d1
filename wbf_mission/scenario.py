"""A scenario: everything that decides a run. Equal scenarios give equal results, bit for bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import msgspec

from geo.errors import WbfMissionError
from sim_vehicle.airframe.autopilot_names import DEFAULT_AUTOPILOT, autopilot_names

_SHEARS = ("log", "power")
_TURBULENCES = ("light", "moderate", "severe", "wind")


class ScenarioError(WbfMissionError, ValueError):
    """A scenario or scenario file with a value that cannot be used."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One run: where, with what, for how much.

    Parameters
    ----------
    farm : str
        Name of a farm, or path of a farm file.
    planner, estimator, vehicle : str
        Registered names.
    autopilot : str
        Who flies the vehicle: its law of motion, its modes and its habits. The ideal vehicle has none.
    parameters : dict of str to float
        Parameters of the autopilot that are not at their defaults, such as MPC_ACC_HOR or WPNAV_RADIUS.
    mission : str or None
        A mission file to fly instead of planning one.
    budget : str or None
        Such as ``8000m``, ``25min``, ``1500s``, ``360steps`` or ``50Wh``. None: the vehicle's battery less
        its reserve; for the ideal vehicle 0.4 times the owner's cells in timesteps, as in the paper.
    day : int
        Day of the environment that is flown.
    seed : int
        Everything random comes from it.
    altitude_m, cruise_speed_m_s : float or None
        Height above home and flight speed; None is the vehicle's own.
    acceptance_radius_m : float or None
        Of the planned waypoints; None: a quarter of the shortest leg, between 0.5 m and 2 m.
    wind_speed_m_s, wind_direction_deg, wind_gust_m_s : float
        Mean wind, the direction it comes from (degrees clockwise from north), standard deviation of gusts.
    wind_height_m : float
        Height above the ground at which the mean wind holds.
    wind_shear : {"log", "power"} or None
        How it grows with the height; None: not at all.
    wind_roughness_m, wind_exponent : float
        Roughness length of the logarithmic law, exponent of the power law.
    turbulence : str or float or None
        Dryden's gusts instead of ``wind_gust_m_s``: light, moderate, severe, wind (as strong as the mean wind
        makes them), or the wind at 6 m that decides them, m/s.
    gps_noise_m, baro_noise_m : float
        Standard deviation of the slow errors of satellite positions (each horizontal axis) and of the
        barometer's height.
    camera_spacing_m : float or None
        Distance between shots; None is one cell.
    camera_footprint : int
        Cells on a side of the camera's square footprint.
    camera_noise, false_positive_rate, false_negative_rate : float
        Sensor errors, see :class:`sensors.camera.leaf_camera.LeafCamera`.
    camera_fields : tuple of str
        The fields that the sensor suite measures.
    score_points : int or None
        How often the estimate is scored during the run; None: every observation on small farms of the ideal
        vehicle, otherwise 25 times, on farms like Waterberry 10 times.
    """

    farm: str = "miniberry-30"
    planner: str = "spiral"
    estimator: str = "adaptive-disk"
    vehicle: str = "quad"
    autopilot: str = DEFAULT_AUTOPILOT
    parameters: dict[str, float] = field(default_factory=dict)
    mission: str | None = None
    budget: str | None = None
    day: int = 6
    seed: int = 0
    altitude_m: float | None = None
    cruise_speed_m_s: float | None = None
    acceptance_radius_m: float | None = None
    wind_speed_m_s: float = 0.0
    wind_direction_deg: float = 0.0
    wind_gust_m_s: float = 0.0
    wind_height_m: float = 10.0
    wind_shear: str | None = None
    wind_roughness_m: float = 0.1
    wind_exponent: float = 1.0 / 7.0
    turbulence: str | float | None = None
    gps_noise_m: float = 0.0
    baro_noise_m: float = 0.0
    camera_spacing_m: float | None = None
    camera_footprint: int = 1
    camera_noise: float = 0.0
    false_positive_rate: float = 0.0
    false_negative_rate: float = 0.0
    camera_fields: tuple[str, ...] = ("tylcv", "ccr", "soil")
    score_points: int | None = None

    def __post_init__(self) -> None:
        _require(0 <= self.day <= 365, "day", self.day, "0 to 365")
        _require(0 <= self.seed < 2**64, "seed", self.seed, "0 to 2^64 - 1")
        _require(
            self.autopilot in autopilot_names(),
            "autopilot",
            repr(self.autopilot),
            " or ".join(autopilot_names()),
        )
        _in_range("altitude", self.altitude_m, 0.5, 120.0, "m")
        _in_range("cruise speed", self.cruise_speed_m_s, 0.1, 30.0, "m/s")
        _in_range("acceptance radius", self.acceptance_radius_m, 0.05, 50.0, "m")
        _in_range("wind speed", self.wind_speed_m_s, 0.0, 40.0, "m/s")
        _in_range("wind direction", self.wind_direction_deg, 0.0, 360.0, "degrees")
        _in_range("wind gust", self.wind_gust_m_s, 0.0, 15.0, "m/s")
        _in_range("wind height", self.wind_height_m, 1.0, 300.0, "m")
        _require(
            self.wind_shear in (None, *_SHEARS), "wind shear", repr(self.wind_shear), " or ".join(_SHEARS)
        )
        _in_range("wind roughness", self.wind_roughness_m, 1e-5, 0.7, "m")
        _in_range("wind exponent", self.wind_exponent, 0.0, 1.0, "")
        if isinstance(self.turbulence, str):
            levels = ", ".join(_TURBULENCES) + ", or the wind at 6 m in m/s"
            _require(self.turbulence in _TURBULENCES, "turbulence", repr(self.turbulence), levels)
        else:
            _in_range("turbulence", self.turbulence, 0.0, 40.0, "m/s")
        if self.turbulence is not None and self.wind_gust_m_s > 0.0:
            gust = f"a wind gust of {self.wind_gust_m_s:g} m/s"
            msg = f"turbulence {self.turbulence} and {gust}: give one of them"
            raise ScenarioError(msg)
        _in_range("gps noise", self.gps_noise_m, 0.0, 20.0, "m")
        _in_range("baro noise", self.baro_noise_m, 0.0, 5.0, "m")
        _in_range("camera spacing", self.camera_spacing_m, 0.05, 1000.0, "m")
        _require(1 <= self.camera_footprint <= 15, "camera footprint", self.camera_footprint, "1 to 15 cells")
        _in_range("camera noise", self.camera_noise, 0.0, 1.0, "")
        _in_range("false positive rate", self.false_positive_rate, 0.0, 1.0, "")
        _in_range("false negative rate", self.false_negative_rate, 0.0, 1.0, "")
        _require(
            self.score_points is None or 1 <= self.score_points <= 1_000_000,
            "score points",
            self.score_points,
            "1 to 1000000",
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the scenario as plain values, for a file or a summary."""
        return asdict(self)


def _require(condition: bool, name: str, value: object, allowed: str) -> None:
    if not condition:
        msg = f"{name} {value} is out of range: give {allowed}"
        raise ScenarioError(msg)


def _in_range(name: str, value: float | None, low: float, high: float, unit: str) -> None:
    if value is None:
        return
    allowed = f"{low:g} to {high:g} {unit}".rstrip()
    _require(math.isfinite(value) and low <= value <= high, name, value, allowed)


def scenario_with(base: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """Return ``base`` with those of ``changes`` that are not None; parameters are added to its own.

    Examples
    --------
    >>> scenario_with(Scenario(), {"planner": "lawnmower", "budget": None}).planner
    'lawnmower'
    """
    given = {key: value for key, value in changes.items() if value is not None}
    if "parameters" in given:
        given["parameters"] = {**base.parameters, **given["parameters"]}
    return replace(base, **given)


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario from a TOML file whose keys are the fields of :class:`Scenario`.

    A ``farm`` or ``mission`` that names an existing file beside the scenario is taken from there.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not TOML, or has an unknown key or a wrong type.
    """
    return scenario_from_table(read_table(path), Path(path))


def read_table(path: str | Path) -> dict[str, Any]:
    """Read a TOML file as it is; ScenarioError if it cannot be read or is not TOML."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        msg = f"{path}: cannot be read as a scenario ({_reason(error)}); give a TOML file"
        raise ScenarioError(msg) from error
    try:
        table: dict[str, Any] = msgspec.toml.decode(text)
    except msgspec.DecodeError as error:
        msg = f"{path}: not TOML ({error})"
        raise ScenarioError(msg) from error
    return table


def scenario_from_table(table: dict[str, Any], path: Path) -> Scenario:
    """Make a scenario from the keys of a file; ``path`` is that file. Errors as of `load_scenario`."""
    table = dict(table)
    known = {one.name for one in fields(Scenario)}
    unknown = sorted(set(table) - known)
    if unknown:
        msg = f"{path}: unknown key {unknown[0]!r}; known keys are {', '.join(sorted(known))}"
        raise ScenarioError(msg)
    for key in ("farm", "mission"):
        beside = path.parent / str(table.get(key, ""))
        if table.get(key) and beside.is_file():
            table[key] = str(beside)
    try:
        return msgspec.convert(table, Scenario)
    except msgspec.ValidationError as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error
    except ScenarioError as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error


def _reason(error: Exception) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else "not UTF-8 text"
