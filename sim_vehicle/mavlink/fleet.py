"""Fleet of simulated vehicles in one process: start positions, system ids and ports."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import zip_longest

from geo.frame import LocalFrame
from geo.seeds import child_seed
from mission.model import GeoPoint
from sim_vehicle.airframe.navigation_errors import SensorNoise
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import Autopilot, get_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.state import EPOCH_UNIX_S
from sim_vehicle.host.ports import ServerUrl
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.weather.wind import Wind

MOST_VEHICLES = 250
"""Maximum number of vehicles; system ids end at 255, and ground stations need a few."""
SPACING_M = 4.0


def start_positions(home: GeoPoint, count: int, spacing_m: float = SPACING_M) -> list[GeoPoint]:
    """Return start positions: home for the first vehicle, and a square spiral around home for the others.

    Raises VehicleError unless the spacing is 0.1 m to 1 km.

    Examples
    --------
    >>> positions = start_positions(GeoPoint(28.05, -82.15, 10.0), 3)
    >>> positions[0], len({(p.latitude_deg, p.longitude_deg) for p in positions})
    (GeoPoint(latitude_deg=28.05, longitude_deg=-82.15, altitude_m=10.0), 3)
    """
    if not 0.1 <= spacing_m <= 1000.0:
        raise VehicleError(f"fleet: a spacing of {spacing_m} m is out of range; give 0.1 to 1000 m")
    frame = LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m)
    positions = [home]
    column, row, dx, dy = 0, 0, 1, 0
    while len(positions) < count:
        column, row = column + dx, row + dy
        latitude, longitude = frame.to_wgs84(spacing_m * column, spacing_m * row)
        positions.append(GeoPoint(latitude, longitude, home.altitude_m))
        # The square spiral turns left at each of its corners.
        if column == row or (column < 0 and column == -row) or (column > 0 and column == 1 - row):
            dx, dy = -dy, dx
    return positions[:count]


def fleet_urls(
    autopilot: Autopilot, systems: range, named: Collection[str] = frozenset()
) -> tuple[ServerUrl, ...]:
    """Return the URLs of each vehicle's simulator; a URL serves only one vehicle.

    `named` contains the names of the links that have their own message rates.

    Examples
    --------
    >>> [(url.url, *url.systems) for url in fleet_urls(get_autopilot("ardupilot"), range(1, 3))]
    [('tcpin:127.0.0.1:5760', 1), ('tcpin:127.0.0.1:5770', 2)]
    """
    return tuple(
        ServerUrl(url, frozenset((system,)), name if name in named else "")
        for system in systems
        for url, name in zip_longest(autopilot.simulator_urls(system - 1), autopilot.link_names, fillvalue="")
    )


class Fleet:
    """Fleet of vehicles with consecutive system ids.

    Parameters
    ----------
    home : GeoPoint or sequence of (GeoPoint, heading in degrees)
        One position, around which the vehicles stand `spacing_m` apart, or one position per vehicle.
    count : int or None
        Number of vehicles; by default the number of positions.
    autopilot : Autopilot, optional
        Autopilot to simulate; by default the result of `get_autopilot`.
    wind : Wind, optional
        Wind field: all vehicles have the same steady wind, and each vehicle has its own gusts.
    noise : SensorNoise, optional
        Size of the sensor errors; each vehicle has its own errors.
    cold, sitl_rates : bool
        See `SimVehicle`.
    first_system : int
        System id of the first vehicle.

    Attributes
    ----------
    vehicles : tuple of SimVehicle

    Raises
    ------
    VehicleError
        If the number of vehicles differs from the number of positions, or a system id is above 250.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> fleet = Fleet(get_vehicle("quad"), GeoPoint(28.05, -82.15, 10.0), 3)
    >>> [vehicle.system_id for vehicle in fleet.vehicles]
    [1, 2, 3]
    >>> [link.url for link in fleet.urls if link.systems == {3}][:2]
    ['udpout:127.0.0.1:14550,18572', 'udpout:127.0.0.1:14542,14582']
    """

    def __init__(
        self,
        spec: VehicleSpec,
        home: GeoPoint | Sequence[tuple[GeoPoint, float]],
        count: int | None = None,
        *,
        autopilot: Autopilot | None = None,
        wind: Wind | None = None,
        noise: SensorNoise | None = None,
        spacing_m: float = SPACING_M,
        epoch_unix_s: float = EPOCH_UNIX_S,
        cold: bool = False,
        sitl_rates: bool = False,
        first_system: int = 1,
    ) -> None:
        given = 1 if isinstance(home, GeoPoint) else len(home)
        number = given if count is None else count
        if not 1 <= number <= MOST_VEHICLES:
            raise VehicleError(f"fleet: {number} vehicles are out of range; give 1 to {MOST_VEHICLES}")
        if not 1 <= first_system <= MOST_VEHICLES + 1 - number:
            last_system = first_system + number - 1
            msg = f"fleet: system ids {first_system} to {last_system} are out of range 1 to {MOST_VEHICLES}"
            raise VehicleError(msg)
        if isinstance(home, GeoPoint) or given == 1:
            first, heading = (home, 0.0) if isinstance(home, GeoPoint) else home[0]
            positions = [(position, heading) for position in start_positions(first, number, spacing_m)]
        else:
            positions = list(home)
        if len(positions) != number:
            msg = f"fleet: {len(positions)} homes for {number} vehicles; give one home, or a home for each"
            raise VehicleError(msg)
        self.autopilot = get_autopilot() if autopilot is None else autopilot
        self.vehicles = tuple(
            SimVehicle(
                spec,
                position,
                wind=_wind_of(wind, system),
                noise=None if noise is None else noise.of_vehicle(system),
                autopilot=self.autopilot,
                system_id=system,
                yaw_deg=heading,
                epoch_unix_s=epoch_unix_s,
                cold=cold,
                sitl_rates=sitl_rates,
            )
            for system, (position, heading) in enumerate(positions, first_system)
        )

    @property
    def urls(self) -> tuple[ServerUrl, ...]:
        """URLs that the autopilot's own simulators would have."""
        first = self.vehicles[0]
        systems = range(first.system_id, first.system_id + len(self.vehicles))
        return fleet_urls(self.autopilot, systems, first.link_names)


def _wind_of(wind: Wind | None, system: int) -> Wind | None:
    """Return the wind of a vehicle; vehicle 1 keeps the seed of the gusts, the others get their own seeds."""
    if wind is None or system == 1 or not wind.is_gusty:
        return wind
    return replace(wind, seed=child_seed(wind.seed, f"vehicle-{system}"))
