"""The keywords of a `Scenario` with their types, for editors and type checkers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict

from wbf_mission.scenario.parts import (
    CameraOptions,
    EstimateOptions,
    FarmOptions,
    MissionOptions,
    ScoreOptions,
    VehicleOptions,
    WeatherOptions,
)

__all__ = ["ScenarioKeywords"]


class ScenarioKeywords(TypedDict, total=False):
    """What `Scenario` takes: each option by its key, and whole parts by the names of the parts."""

    farm: str | FarmOptions
    day: int
    days: int
    flights_per_day: int
    fields: Sequence[str]
    planner: Any
    policy: Any
    budget: str | None
    mission: str | MissionOptions | None
    partition: str
    altitude_m: float | None
    cruise_speed_m_s: float | None
    acceptance_radius_m: float | None
    margin_m: float
    vehicle: str | VehicleOptions
    vehicles: int | None
    autopilot: str
    parameters: Mapping[str, float]
    gps_noise_m: float
    baro_noise_m: float
    estimate_errors: bool
    separation: str
    radio_range_m: float | None
    wind_speed_m_s: float
    wind_direction_deg: float
    wind_gust_m_s: float
    wind_height_m: float
    wind_shear: str | None
    wind_roughness_m: float
    wind_exponent: float
    turbulence: str | float | None
    camera_spacing_m: float | None
    camera_footprint: int
    camera_noise: float
    false_positive_rate: float
    false_negative_rate: float
    camera_fields: Sequence[str] | None
    estimator: Any
    score_points: int | None
    seed: int
    weather: WeatherOptions
    camera: CameraOptions
    estimate: EstimateOptions
    score: ScoreOptions
