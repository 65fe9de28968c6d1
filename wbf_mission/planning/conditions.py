"""Wind at the height of a flight, and the position errors of its vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.random import SeedSequence

from geo.seeds import child_seed
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.estimate_errors import HEIGHT_M
from sim_vehicle.airframe.sensor_errors import SensorNoise
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot.autopilot import estimate_errs, with_autopilot
from sim_vehicle.weather.dryden import LEVELS_W20_M_S, REFERENCE_M
from sim_vehicle.weather.wind import Turbulence, Wind, WindShear
from wbf_mission.scenario import MissionOptions, Scenario, VehicleOptions, WeatherOptions

_SLOWEST_M_S = 1.0


@dataclass(frozen=True, slots=True)
class FlightLevel:
    """Height and speed of a planned flight."""

    altitude_m: float  # Above home
    speed_m_s: float  # Over ground in calm air


def flight_level(mission: MissionOptions, vehicle: VehicleOptions) -> FlightLevel:
    """Return the height and speed of a mission's flight: as asked for, else what the vehicle is built for."""
    built = get_vehicle(vehicle.name)
    return FlightLevel(
        mission.height_above_ground_m or mission.altitude_m or built.takeoff_altitude_m,
        mission.cruise_speed_m_s or built.cruise_speed_m_s,
    )


def wind_of_run(scenario: Scenario) -> Wind:
    """Return the wind that a run's first flight meets, gusts included."""
    level = flight_level(scenario.mission, scenario.vehicle)
    return wind_of(scenario.weather, level, child_seed(scenario.seed, "wind"))


def wind_of(
    weather: WeatherOptions, level: FlightLevel, seed: SeedSequence | int = 0, *, gusts: bool = True
) -> Wind:
    """Return the wind of a weather, or without ``gusts`` its mean; Dryden's turbulence depends on the level.

    Predictions must not know the seed of the run's gusts, and leave it out.

    Examples
    --------
    >>> weather = WeatherOptions(wind_speed_m_s=5.0, wind_shear="log", turbulence="wind")
    >>> wind = wind_of(weather, FlightLevel(10.0, 5.0))
    >>> round(wind.turbulence.w20_m_s, 3), wind_of(weather, FlightLevel(10.0, 5.0), gusts=False).turbulence
    (4.463, None)
    """
    shear = None
    if weather.wind_shear is not None:
        shear = WindShear(weather.wind_shear, weather.wind_roughness_m, weather.wind_exponent)
    mean = Wind.from_direction(
        weather.wind_speed_m_s,
        weather.wind_direction_deg,
        gust_m_s=weather.wind_gust_m_s if gusts else 0.0,
        seed=seed,
        height_m=weather.wind_height_m,
        shear=shear,
    )
    if not gusts or weather.turbulence is None:
        return mean
    # With and against the wind the vehicle flies at this airspeed on average (root of the mean square).
    airspeed_m_s = max(_SLOWEST_M_S, math.hypot(level.speed_m_s, *mean.mean_at(level.altitude_m)))
    # The wind at 20 ft decides the turbulence: that of a level, of the mean wind, or as given.
    w20_m_s = weather.turbulence
    if w20_m_s == "wind":
        w20_m_s = math.hypot(*mean.mean_at(REFERENCE_M))
    elif isinstance(w20_m_s, str):
        w20_m_s = LEVELS_W20_M_S[w20_m_s]
    turbulence = Turbulence(w20_m_s, level.altitude_m, airspeed_m_s)
    return Wind(
        mean.east_m_s,
        mean.north_m_s,
        seed=mean.seed,
        height_m=mean.height_m,
        shear=shear,
        turbulence=turbulence,
    )


def noise_of(
    vehicle: VehicleOptions, seed: SeedSequence | int, names: tuple[str, ...] = ("navigation",)
) -> SensorNoise:
    """Return the position errors of a run's vehicle; `names` are those of its random stream."""
    own = child_seed(seed, *names)
    return SensorNoise(vehicle.gps_noise_m, vehicle.baro_noise_m, own, vehicle.estimate_errors)


_DEVIATIONS = 3.0
_STEPS_PER_M = 10


def separation_margin_m(first_m: float, second_m: float) -> float:
    """Return the margin for the errors of two vehicles about their distance.

    Three standard deviations of the difference of their independent errors, rounded up to 0.1 m.

    Examples
    --------
    >>> separation_margin_m(0.0, 0.0), separation_margin_m(0.3, 0.4), separation_margin_m(0.0, 0.51)
    (0.0, 1.5, 1.6)
    """
    return math.ceil(_DEVIATIONS * math.hypot(first_m, second_m) * _STEPS_PER_M - 1e-9) / _STEPS_PER_M


def ground_separation_margin_m(options: VehicleOptions) -> float:
    """Return the horizontal `separation_margin_m` of two vehicles of a run.

    Swings by estimate errors are no larger than those by gusts, for which the separation has room.
    """
    return separation_margin_m(options.gps_noise_m, options.gps_noise_m)


def height_error_m(options: VehicleOptions, spec: VehicleSpec) -> float:
    """Return the standard deviation of a vehicle's error about its height above its take-off."""
    errs = options.estimate_errors and estimate_errs(with_autopilot(spec, options.autopilot))
    # The barometer erred at take-off, too.
    return math.hypot(HEIGHT_M if errs else 0.0, math.sqrt(2.0) * options.baro_noise_m)
