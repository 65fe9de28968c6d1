"""Wind at flight height, and position errors of a vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from numpy.random import SeedSequence

from geo.seeds import child_seed
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.navigation_errors import HEIGHT_M, SensorNoise
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import estimate_errs, with_autopilot
from sim_vehicle.weather.atmosphere import LEVELS_W20_M_S, REFERENCE_M, Turbulence, WindShear
from sim_vehicle.weather.wind import Wind
from wbf_mission.scenario import MissionOptions, Scenario, VehicleOptions, WeatherOptions

_SLOWEST_M_S = 1.0


@dataclass(frozen=True, slots=True)
class FlightLevel:
    """Height and speed of a planned flight."""

    altitude_m: float  # Above home.
    speed_m_s: float  # Over ground in calm air.


def flight_level(mission: MissionOptions, vehicle: VehicleOptions) -> FlightLevel:
    """Return the requested height and speed of a flight; the vehicle's design values by default."""
    built = get_vehicle(vehicle.name)
    return FlightLevel(
        mission.height_above_ground_m or mission.altitude_m or built.takeoff_altitude_m,
        mission.cruise_speed_m_s or built.cruise_speed_m_s,
    )


def wind_of_run(scenario: Scenario) -> Wind:
    """Return the wind of a run's first flight, with gusts."""
    level = flight_level(scenario.mission, scenario.vehicle)
    return wind_of(scenario.weather, level, child_seed(scenario.seed, "wind"))


def wind_of(
    weather: WeatherOptions, level: FlightLevel, seed: SeedSequence | int = 0, *, gusts: bool = True
) -> Wind:
    """Return the wind at a flight level; without ``gusts``, return only the mean wind.

    Dryden's turbulence depends on the flight's height and airspeed. Predictions omit `seed`, because they
    must not know the run's gusts.

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
    # This is the root mean square of the airspeed, over legs in all directions.
    airspeed_m_s = max(_SLOWEST_M_S, math.hypot(level.speed_m_s, *mean.mean_at(level.altitude_m)))
    # The wind at 20 ft sets the turbulence: a given value, the value of a named level, or the mean wind.
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
    """Return the position errors of a run's vehicle, drawn from the random stream with these `names`."""
    own = child_seed(seed, *names)
    return SensorNoise(vehicle.gps_noise_m, vehicle.baro_noise_m, own, vehicle.estimate_errors)


_DEVIATIONS = 3.0
_STEPS_PER_M = 10


def separation_margin_m(first_m: float, second_m: float) -> float:
    """Return the extra separation for the position errors of two vehicles (m).

    The margin is three standard deviations of the difference of their errors, rounded up to 0.1 m.

    Examples
    --------
    >>> separation_margin_m(0.0, 0.0), separation_margin_m(0.3, 0.4), separation_margin_m(0.0, 0.51)
    (0.0, 1.5, 1.6)
    """
    return math.ceil(_DEVIATIONS * math.hypot(first_m, second_m) * _STEPS_PER_M - 1e-9) / _STEPS_PER_M


def ground_separation_margin_m(options: VehicleOptions) -> float:
    """Return the horizontal `separation_margin_m` of two vehicles of a run.

    Errors of the estimate need no margin: they move vehicles no farther than gusts, which are covered.
    """
    return separation_margin_m(options.gps_noise_m, options.gps_noise_m)


def height_error_m(options: VehicleOptions, spec: VehicleSpec) -> float:
    """Return the standard deviation of a vehicle's height error, relative to take-off (m)."""
    errs = options.estimate_errors and estimate_errs(with_autopilot(spec, options.autopilot))
    # The barometer errs both at take-off and in flight, and the two errors add up.
    return math.hypot(HEIGHT_M if errs else 0.0, math.sqrt(2.0) * options.baro_noise_m)
