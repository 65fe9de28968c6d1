"""Vehicles and their cameras as components, for the simulator on sockets."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from geo import get_farm
from geo.seeds import stream
from geo.texts import one_line, parse_number
from mission.model import GeoPoint
from sensors.camera.leaf_camera import LeafCamera
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.component import Component
from sim_vehicle.epoch import EPOCH_UNIX_S
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.mavlink.fleet import SPACING_M, Fleet
from sim_vehicle.prediction.compile_ahead import warm_up
from wbf_mission.planning import flown_vehicle
from wbf_mission.planning.weather import noise_of, wind_of_run
from wbf_mission.run.surroundings import camera_options, make_environment
from wbf_mission.scenario import Scenario, ScenarioError, read_table, scenario_from_table, take_faults
from wbf_mission.scenario.option import Part, option, options_of
from wbf_mission.scenario.parts import CAMERA, VEHICLE
from wbf_mission.scenario.scenario import unknown_key

if TYPE_CHECKING:
    from sim_vehicle.faults.fault import Fault

__all__ = ["SimOptions", "load_sim", "parse_speed"]


@dataclass(frozen=True, slots=True)
class Simulated:
    """Vehicles that are ready to be served.

    Parameters
    ----------
    fleet : Fleet
    cameras : tuple of LeafCameraComponent
        One for each vehicle, or none.
    """

    fleet: Fleet
    cameras: tuple[LeafCameraComponent, ...]

    @property
    def vehicles(self) -> tuple[SimVehicle, ...]:
        """The vehicles, in the order of their system ids."""
        return self.fleet.vehicles

    @property
    def vehicle(self) -> SimVehicle:
        """The first vehicle."""
        return self.vehicles[0]

    @property
    def autopilot(self) -> str:
        """Name of the autopilot that they show themselves as."""
        return self.fleet.autopilot.name

    @property
    def components(self) -> list[Component]:
        """What a host has to run."""
        return [*self.vehicles, *self.cameras]

    @property
    def images(self) -> int:
        """How many images were taken."""
        return sum(camera.image_count for camera in self.cameras)


def parse_home(text: str) -> tuple[GeoPoint, float]:
    """Read ``LAT,LON[,ALT[,HEADING]]``.

    Returns
    -------
    tuple of GeoPoint and float
        The position and the compass heading in degrees.

    Raises
    ------
    ScenarioError
        If it is not two to four numbers, or no position on the globe.

    Examples
    --------
    >>> parse_home("28.05,-82.15,30,90")
    (GeoPoint(latitude_deg=28.05, longitude_deg=-82.15, altitude_m=30.0), 90.0)
    """
    try:
        numbers = [parse_number(part) for part in text.split(",")]
        latitude, longitude, altitude, heading = [*numbers, *(0.0, 0.0)[len(numbers) - 2 :]]
        if not 0.0 <= heading <= 360.0:
            raise ValueError
        return GeoPoint(latitude, longitude, altitude), heading
    except ValueError as error:
        msg = (
            f"home {text!r} is not LAT,LON[,ALT[,HEADING]] in degrees and metres, such as 28.05,-82.15,30,90"
        )
        raise ScenarioError(msg) from error


def make_components(
    scenario: Scenario,
    *,
    count: int | None = None,
    homes: Sequence[tuple[GeoPoint, float]] = (),
    spacing_m: float = SPACING_M,
    first_system: int = 1,
    with_camera: bool = True,
    cold: bool = False,
    progress: Callable[[str, float, float], None] | None = None,
) -> Simulated:
    """Make vehicles, each with its camera.

    Parameters
    ----------
    scenario : Scenario
        Farm, vehicle, weather, sensors, seed, day and camera.
    count : int, optional
        How many; as many as there are homes, else one.
    homes : sequence of GeoPoint and float
        Where they start and their headings; none: around the farm's home.
    spacing_m : float
        Between vehicles that share a home.
    first_system : int
        The system id of the first one.
    with_camera : bool
        Without cameras no environment is generated.
    cold : bool
        The autopilots boot when they are first spoken to; otherwise they are up.

    Raises
    ------
    WbfMissionError
        If a name is unknown or an option out of range.
    """
    farm = get_farm(scenario.farm.name)
    spec = flown_vehicle(scenario.vehicle)
    if not homes:
        latitude, longitude = farm.frame.to_wgs84(*farm.home_m)
        homes = [(GeoPoint(latitude, longitude, farm.frame.altitude_m), 0.0)]
    fleet = Fleet(
        spec,
        homes,
        count,
        autopilot=get_autopilot(scenario.vehicle.autopilot),
        wind=wind_of_run(scenario),
        noise=noise_of(scenario.vehicle, scenario.seed),
        spacing_m=spacing_m,
        epoch_unix_s=EPOCH_UNIX_S,
        cold=cold,
        first_system=first_system,
    )
    if progress is not None:
        progress("preparing the vehicle", 0.0, 1.0)
    warm_up(spec)
    cameras: list[LeafCameraComponent] = []
    if with_camera:
        environment = make_environment(scenario, farm, progress)
        for vehicle in fleet.vehicles:
            names = ("camera",) if vehicle.system_id == 1 else ("camera", str(vehicle.system_id))
            optics = LeafCamera(
                environment,
                farm.grid().shape,
                scenario.farm.day,
                camera_options(scenario.camera, environment.fields),
                stream(scenario.seed, *names),
            )
            position_error = vehicle.position_error if vehicle.errors is not None else None
            cameras.append(
                LeafCameraComponent(
                    optics,
                    farm,
                    system_id=vehicle.system_id,
                    position_error=position_error,
                    looks=vehicle.camera_attitude,
                )
            )
    return Simulated(fleet, tuple(cameras))


LINKS = "Links and time"
_BOOTS = ("warm", "cold")
_SLOWEST, _FASTEST = 0.01, 10_000.0


@dataclass(frozen=True, slots=True)
class SimOptions(Part):
    """The simulator besides its scenario; the keys of the table ``[sim]`` of a file."""

    count: int | None = option(
        None,
        "How many vehicles, each a system of its own at its own ports",
        VEHICLE,
        low=1,
        high=250,
        default="one for each home",
    )
    system_id: int = option(
        1, "System id of the first vehicle; the others' follow it", VEHICLE, low=1, high=250
    )
    home: tuple[str, ...] = option(
        (),
        "Start at LAT,LON[,ALT[,HEADING]]: degrees, metres above sea level, degrees; once for all or once for"
        " each vehicle",
        VEHICLE,
        default="the farm's home",
        metavar="LAT,LON",
    )
    boot: str = option(
        "warm",
        "warm: the autopilot is up and can arm; cold: it boots when it is first spoken to, and can arm some"
        " 40 s later (ArduCopter)",
        VEHICLE,
        metavar="KIND",
    )
    spacing_m: float = option(4.0, "Between vehicles that share a home", VEHICLE, low=0.0, high=1000.0)
    listen: tuple[str, ...] = option(
        (),
        "Link for ground stations, with all vehicles behind it; may be repeated: udpin:, udpout: or"
        " tcpin:HOST:PORT, serial:DEVICE:BAUD",
        LINKS,
        default="the autopilot's own simulator ports",
        metavar="URL",
    )
    connect: tuple[str, ...] = option(
        (),
        "Link that we open: udpout:HOST:PORT or tcp:HOST:PORT; may be repeated",
        LINKS,
        default="none",
        metavar="URL",
    )
    speed: float | str = option(
        1.0, "Simulated seconds per second of wall time, or max", LINKS, metavar="FACTOR"
    )
    duration_s: float | None = option(
        None,
        "Simulated time after which it stops",
        LINKS,
        default="until Ctrl-C",
    )
    camera: bool = option(True, "Carry the leaf camera", CAMERA)

    def check(self) -> None:
        """Refuse speeds, durations and kinds of boot that cannot be."""
        if self.boot not in _BOOTS:
            msg = f"boot {one_line(str(self.boot), 40)!r} is unknown: give {' or '.join(_BOOTS)}"
            raise ScenarioError(msg)
        parse_speed(self.speed)
        if self.duration_s is not None and not 0.0 < self.duration_s < 1e9:
            msg = f"duration {self.duration_s} is out of range: give a positive number of simulated seconds"
            raise ScenarioError(msg)


def parse_speed(speed: float | str) -> float:
    """Return a speed as a number; "max" is infinity.

    Raises
    ------
    ScenarioError
        If it is neither "max" nor a number from 0.01 to 10000.

    Examples
    --------
    >>> parse_speed("max"), parse_speed("2.5")
    (inf, 2.5)
    """
    if isinstance(speed, str) and speed.strip().lower() == "max":
        return math.inf
    try:
        number = parse_number(speed) if isinstance(speed, str) else float(speed)
    except ValueError:
        number = math.nan
    if not _SLOWEST <= number <= _FASTEST:
        msg = f"speed {speed} is out of range: give {_SLOWEST:g} to {_FASTEST:g} (1 is real time), or max"
        raise ScenarioError(msg)
    return number


def load_sim(path: str | Path) -> tuple[Scenario, SimOptions, tuple[Fault, ...]]:
    """Read a scenario file for the simulator: a scenario's keys, a table ``[sim]``, tables ``[[fault]]``.

    Raises
    ------
    ScenarioError
        If the file cannot be read, or something in it is wrong.
    FaultError
        If a fault is wrong.
    """
    path = Path(path)
    table = read_table(path)
    faults = take_faults(table, path)
    given = table.pop("sim", {})
    scenario = scenario_from_table(table, path)
    if not isinstance(given, dict):
        msg = f"{path}: sim is written as a table [sim]"
        raise ScenarioError(msg)
    known = list(options_of(SimOptions))
    unknown = [key for key in given if key not in known]
    try:
        if unknown:
            raise ScenarioError(unknown_key(unknown[0], known) + " in [sim]")
        return scenario, SimOptions(**given), faults
    except ScenarioError as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error
