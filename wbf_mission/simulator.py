"""The vehicle and its camera as components, for the simulator on sockets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from geo import get_farm
from geo.seeds import stream
from mission.model import GeoPoint
from sensors.camera import LeafCamera
from sim_vehicle.camera import LeafCameraComponent
from sim_vehicle.component import Component
from sim_vehicle.spec import get_vehicle
from sim_vehicle.vehicle import SimVehicle, get_persona
from sim_vehicle.warm_up import warm_up
from sim_vehicle.wind import Wind
from wbf_mission.flight import EPOCH_UNIX_S, camera_options, make_environment
from wbf_mission.scenario import Scenario, ScenarioError


@dataclass(frozen=True, slots=True)
class Simulated:
    """A vehicle that is ready to be served.

    Parameters
    ----------
    vehicle : SimVehicle
    camera : LeafCameraComponent or None
    home : GeoPoint
    autopilot : str
    """

    vehicle: SimVehicle
    camera: LeafCameraComponent | None
    home: GeoPoint
    autopilot: str

    @property
    def components(self) -> list[Component]:
        """What a host has to run."""
        return [self.vehicle] if self.camera is None else [self.vehicle, self.camera]

    @property
    def pictures(self) -> int:
        """How many pictures were taken."""
        return 0 if self.camera is None else self.camera.image_count


def parse_home(text: str) -> tuple[GeoPoint, float]:
    """Read ``LAT,LON[,ALT[,HEADING]]``.

    Returns
    -------
    tuple of GeoPoint and float
        The place and the compass heading in degrees.

    Raises
    ------
    ScenarioError
        If it is not two to four numbers, or no place on the globe.

    Examples
    --------
    >>> parse_home("28.05,-82.15,30,90")
    (GeoPoint(latitude_deg=28.05, longitude_deg=-82.15, altitude_m=30.0), 90.0)
    """
    try:
        numbers = [float(part) for part in text.split(",")]
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
    autopilot: str = "px4",
    home: tuple[GeoPoint, float] | None = None,
    wind: Wind | None = None,
    with_camera: bool = True,
    progress: Callable[[str, float, float], None] | None = None,
) -> Simulated:
    """Make the vehicle and its camera.

    Parameters
    ----------
    scenario : Scenario
        Farm, vehicle, seed, day and camera.
    autopilot : str
        The persona: px4 or ardupilot.
    home : tuple of GeoPoint and float, optional
        Where it starts and its heading; the farm's home without.
    wind : Wind, optional
    with_camera : bool
        Without the camera no environment is generated.

    Raises
    ------
    WbfMissionError
        If a name is unknown or an option out of range.
    """
    farm = get_farm(scenario.farm)
    spec = get_vehicle(scenario.vehicle)
    persona = get_persona(autopilot)
    if home is None:
        latitude, longitude = farm.frame.to_wgs84(*farm.home_m)
        home = GeoPoint(latitude, longitude, farm.frame.altitude_m), 0.0
    place, heading = home
    if progress is not None:
        progress("preparing the vehicle", 0.0, 1.0)
    warm_up(spec)
    vehicle = SimVehicle(spec, place, wind=wind, persona=persona, yaw_deg=heading, epoch_unix_s=EPOCH_UNIX_S)
    camera = None
    if with_camera:
        environment = make_environment(scenario, farm, progress)
        optics = LeafCamera(
            environment,
            farm.grid().shape,
            scenario.day,
            camera_options(scenario),
            stream(scenario.seed, "camera"),
        )
        camera = LeafCameraComponent(optics, farm)
    return Simulated(vehicle, camera, place, persona.name)
