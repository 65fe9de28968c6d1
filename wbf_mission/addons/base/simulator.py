"""Makes simulated vehicles and their cameras for a server on sockets, and compiles their motion ahead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geo.farm import Farm
from geo.frame import LocalFrame
from geo.seeds import stream
from geo.texts import parse_number
from mission.model import GeoPoint, Mission, MissionItem
from sensors.camera.leaf_camera import LeafCamera
from sensors.environment import Environment
from sensors.field_files import load_field_set
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.kind import NO_AUTOPILOT, get_kind, kind_names
from sim_vehicle.airframe.navigation_errors import EstimateErrors
from sim_vehicle.autopilot import autopilot_names, flight_procedures, get_autopilot, with_autopilot
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.component import Component
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import EPOCH_UNIX_S
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.mavlink.fleet import SPACING_M, Fleet
from sim_vehicle.prediction.predict import predict_flights
from sim_vehicle.weather.wind import Wind
from wbf_mission.planning import flown_vehicle
from wbf_mission.planning.conditions import noise_of, wind_of_run
from wbf_mission.run.resolve import cameras_of, make_environment
from wbf_mission.scenario import Scenario, ScenarioError

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

_WIND = Wind(1.0, gust_m_s=0.5)


def warm_up(spec: VehicleSpec) -> None:
    """Compile the motion of a vehicle by simulating a two-second flight.

    Without this, the motion of a vehicle is compiled on its first flight, and a client that orders a take-off
    would time out. Compilation takes up to a minute once per machine; loading the compiled functions takes
    half a second in each process. `geo.compiled.compile_notices` names the functions that are being compiled.
    The ideal vehicle needs no compiled functions.

    >>> warm_up(get_vehicle("ideal"))
    """
    if spec.is_ideal:
        return
    executor = MissionExecutor(spec, LocalFrame(0.0, 0.0), wind=_WIND, estimate_errors=EstimateErrors())
    executor.arm()
    if spec.drives:
        executor.goto(1.0, 0.0, 0.0)
    else:
        executor.takeoff(min(2.0, spec.max_altitude_m))
    executor.advance(1.0)
    if spec.hovers:
        executor.steer((0.5, 0.0, 0.0))
    executor.advance(1.5)
    executor.flight.hold()
    executor.advance(2.0)


def compile_all(progress: Callable[[str, int, int], None] | None = None) -> None:
    """Compile the motion of all vehicles, for single flights and for batches, unless it is cached.

    `progress` is called before each vehicle with a title, the number of finished vehicles, and the total.
    """
    dynamics = _dynamics()
    for done, (name, spec) in enumerate(dynamics):
        if progress is not None:
            progress(name, done, len(dynamics))
        warm_up(spec)
        items = (
            MissionItem(22, 3, 0, 0, 0, None, 0.0, 0.0, 2.0),
            MissionItem.waypoint(0.0001, 0.0, 2.0),
            MissionItem(20, 2),
        )
        short = Mission(items, GeoPoint(0.0, 0.0))
        predict_flights([short, short], spec, wind=_WIND)


def _dynamics() -> list[tuple[str, VehicleSpec]]:
    """Return a vehicle, and a title to announce it, for each motion class of the installed autopilots."""
    found: dict[type, tuple[str, VehicleSpec]] = {}
    for bare in [get_vehicle(get_kind(kind).typical) for kind in kind_names()]:
        if bare.is_ideal:
            continue
        kind = bare.kind.replace("-", " ")
        flown = {kind: with_autopilot(bare, NO_AUTOPILOT)}
        for name in autopilot_names():
            autopilot = get_autopilot(name)
            if autopilot.firmware(bare.kind) is not None:
                flown[f"{kind} under {autopilot.title}"] = with_autopilot(bare, name)
        for title, spec in flown.items():
            motion = flight_procedures(spec).motion(spec, None, 0.0)
            found.setdefault(type(motion), (title, spec))
    return list(found.values())


@dataclass(frozen=True, slots=True)
class Simulated:
    """Simulated vehicles with their cameras."""

    fleet: Fleet
    cameras: tuple[LeafCameraComponent, ...]  # One camera for each vehicle, or empty.
    farm: Farm
    environment: Environment | None  # The fields that the cameras observe.

    @property
    def vehicles(self) -> tuple[SimVehicle, ...]:
        """The vehicles, in the order of their system ids."""
        return self.fleet.vehicles

    @property
    def vehicle(self) -> SimVehicle:
        """The first of the simulated vehicles."""
        return self.vehicles[0]

    @property
    def components(self) -> list[Component]:
        """All vehicles and cameras, which a server has to run."""
        return [*self.vehicles, *self.cameras]

    @property
    def images(self) -> int:
        """Number of images taken."""
        return sum(camera.image_count for camera in self.cameras)


def parse_home(text: str) -> tuple[GeoPoint, float]:
    """Read ``LAT,LON[,ALT[,HEADING]]``.

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
        raise ScenarioError(
            f"home {text!r} is not LAT,LON[,ALT[,HEADING]] in degrees and metres, such as 28.05,-82.15,30,90"
        ) from error


def make_components(
    scenario: Scenario,
    *,
    count: int | None = None,
    homes: Sequence[tuple[GeoPoint, float]] = (),
    spacing_m: float = SPACING_M,
    first_system: int = 1,
    with_camera: bool | None = True,
    cold: bool = False,
    sitl_rates: bool = False,
    progress: Callable[[str, float, float], None] | None = None,
) -> Simulated:
    """Make simulated vehicles with cameras from the scenario's farm, vehicle, weather, seed, day and camera.

    `homes` are pairs of position and heading in degrees (default: the farm's home). `count` is the number of
    vehicles (default: one for each home). Vehicles that share a home stand `spacing_m` apart. If
    `with_camera` is None, vehicles carry cameras if the autopilot supports them; without cameras no
    environment is made. With `cold`, an autopilot boots when a client first contacts it. With `sitl_rates`,
    vehicles stream the same messages at the same rates as the autopilot's SITL simulator.

    Raises WbfMissionError if a name is unknown or an option is out of range.
    """
    kinds = scenario.vehicle
    for option, names in (("vehicle", kinds.names), ("autopilot", kinds.autopilot.split(","))):
        if len(names) > 1:
            msg = f"{option} {', '.join(names)}: a simulator has one kind of vehicle; start one for each kind"
            raise ScenarioError(msg)
    farm = scenario.farm.load()
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
        sitl_rates=sitl_rates,
        first_system=first_system,
    )
    if progress is not None:
        progress("preparing the vehicle", 0.0, 1.0)
    warm_up(spec)
    cameras: list[LeafCameraComponent] = []
    environment = None
    if with_camera is None:
        with_camera = fleet.vehicles[0].firmware.mavlink.camera_by_default
    if with_camera:
        environment = make_environment(scenario, farm, progress)
        fields = load_field_set(scenario.farm.fields)
        options = cameras_of(scenario, fields, len(fleet.vehicles))
        for vehicle, camera in zip(fleet.vehicles, options, strict=True):
            names = ("camera",) if vehicle.system_id == 1 else ("camera", str(vehicle.system_id))
            optics = LeafCamera(
                environment,
                farm.grid().shape,
                scenario.farm.day,
                camera,
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
    return Simulated(fleet, tuple(cameras), farm, environment)
