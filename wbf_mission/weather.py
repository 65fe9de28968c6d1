"""The air of a scenario, and how wrong its vehicles are about their place."""

from __future__ import annotations

import math

from geo.seeds import child_seed
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.sensor_errors import SensorNoise
from sim_vehicle.weather.dryden import LEVELS_W20_M_S, REFERENCE_M
from sim_vehicle.weather.wind import Turbulence, Wind, WindShear
from wbf_mission.scenario import Scenario

__all__ = ["noise_of", "wind_of"]

_SLOWEST_M_S = 1.0


def wind_of(scenario: Scenario, *, gusts: bool = True) -> Wind:
    """Return the scenario's wind; without gusts for predictions, which must not know the run's weather.

    Raises
    ------
    VehicleError
        If the vehicle is unknown.

    Examples
    --------
    >>> wind = wind_of(Scenario(wind_speed_m_s=5.0, wind_shear="log", turbulence="wind"))
    >>> round(wind.turbulence.w20_m_s, 3), wind_of(Scenario(turbulence=6.0), gusts=False).turbulence
    (4.463, None)
    """
    shear = None
    if scenario.wind_shear is not None:
        shear = WindShear(scenario.wind_shear, scenario.wind_roughness_m, scenario.wind_exponent)
    mean = Wind.from_direction(
        scenario.wind_speed_m_s,
        scenario.wind_direction_deg,
        gust_m_s=scenario.wind_gust_m_s if gusts else 0.0,
        seed=child_seed(scenario.seed, "wind"),
        height_m=scenario.wind_height_m,
        shear=shear,
    )
    if not gusts or scenario.turbulence is None:
        return mean
    vehicle = get_vehicle(scenario.vehicle)
    height_m = scenario.altitude_m or vehicle.takeoff_altitude_m
    cruise_m_s = scenario.cruise_speed_m_s or vehicle.cruise_speed_m_s
    # With and against the wind the vehicle flies at this airspeed on average (root of the mean square).
    airspeed_m_s = max(_SLOWEST_M_S, math.hypot(cruise_m_s, *mean.mean_at(height_m)))
    turbulence = Turbulence(_w20_m_s(scenario.turbulence, mean), height_m, airspeed_m_s)
    return Wind(
        mean.east_m_s,
        mean.north_m_s,
        seed=mean.seed,
        height_m=mean.height_m,
        shear=shear,
        turbulence=turbulence,
    )


def _w20_m_s(given: str | float, mean: Wind) -> float:
    """Return the wind at 20 ft that decides the turbulence: of a level, of the mean wind, or as given."""
    if given == "wind":
        return math.hypot(*mean.mean_at(REFERENCE_M))
    return LEVELS_W20_M_S[given] if isinstance(given, str) else given


def noise_of(scenario: Scenario) -> SensorNoise:
    """Return how wrong the scenario's vehicles are about their place."""
    return SensorNoise(scenario.gps_noise_m, scenario.baro_noise_m, child_seed(scenario.seed, "navigation"))
