"""One vehicle's flight: the simulated vehicle, its leaf camera, and the ground station that flies it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from geo.seeds import stream
from mission.planners.path import Points
from mission.policies.situation import VehicleReport
from sensors.camera.leaf_camera import LeafCamera, LeafCameraOptions
from sensors.camera.wire import ObservationAssembler
from sensors.environment import Environment
from sensors.observations import Observations
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.component import Component
from sim_vehicle.epoch import EPOCH_UNIX_S
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.deciding.record import PathChange
from wbf_mission.flight_record import FlightRecord
from wbf_mission.ground.station import GROUND_SYSTEM_ID, GroundStation
from wbf_mission.outcome import Phase
from wbf_mission.planning import FlightTask, PlanResult, home_of
from wbf_mission.scenario import Scenario
from wbf_mission.weather import noise_of, wind_of_run


@dataclass(frozen=True, slots=True)
class SortieNumber:
    """Which flight of a run it is.

    Parameters
    ----------
    day : int
        Of the environment.
    flight : int
        On that day, from 1.
    system_id : int
        Of the vehicle.
    first_day : int
        The first day that is flown.
    """

    day: int
    flight: int
    system_id: int
    first_day: int

    def stream_names(self, part: str) -> tuple[str, ...]:
        """Return the names of a part's random stream; the first flight of a run has the part's own."""
        names = [part]
        if (self.day, self.flight) != (self.first_day, 1):
            names += [f"day-{self.day}", f"flight-{self.flight}"]
        if self.system_id != 1:
            names.append(f"vehicle-{self.system_id}")
        return tuple(names)


class Sortie:
    """One vehicle from the first heartbeat to the landing.

    Parameters
    ----------
    number : SortieNumber
    task : FlightTask
    plan : PlanResult
        What is uploaded before take-off.
    scenario : Scenario
        With the name of this one vehicle.
    environment : Environment
        What the camera looks at.
    options : LeafCameraOptions
    on_transfer : callable, optional
        ``on_transfer(phase, done, total)`` as mission items cross.
    """

    def __init__(
        self,
        number: SortieNumber,
        task: FlightTask,
        plan: PlanResult,
        scenario: Scenario,
        environment: Environment,
        options: LeafCameraOptions,
        on_transfer: Callable[[Phase, int, int], None] | None = None,
    ) -> None:
        farm, seed = plan.farm, scenario.seed
        self.number, self.task, self.plan = number, task, plan
        camera = LeafCamera(
            environment,
            farm.grid().shape,
            number.day,
            options,
            stream(seed, *number.stream_names("camera")),
        )
        self.assembler = ObservationAssembler(farm, day=number.day, fields=options.fields.names)
        self.ground = GroundStation(
            plan.mission,
            self.assembler,
            vehicle_system_id=number.system_id,
            system_id=GROUND_SYSTEM_ID + 1 - number.system_id,
            on_progress=on_transfer,
        )
        self.vehicle = SimVehicle(
            plan.vehicle,
            home_of(plan.mission, farm),
            wind=wind_of_run(scenario, number.stream_names("wind")),
            autopilot=get_autopilot(scenario.vehicle.autopilot),
            system_id=number.system_id,
            epoch_unix_s=EPOCH_UNIX_S,
            noise=noise_of(scenario.vehicle, seed, number.stream_names("navigation")),
        )
        self.camera = LeafCameraComponent(
            camera,
            farm,
            system_id=number.system_id,
            position_error=self.vehicle.position_error if self.vehicle.errors else None,
        )

    @property
    def components(self) -> list[Component]:
        """What a host has to run; the ground station comes last."""
        return [self.vehicle, self.camera, self.ground]

    @property
    def done(self) -> bool:
        """Whether the flight is over."""
        return self.ground.done

    def take(self) -> Observations:
        """Return the observations that arrived since the last call."""
        return self.assembler.take()

    @property
    def waypoints_reached(self) -> int:
        """How many waypoints the vehicle has passed."""
        return 0

    def report(self, now_s: float) -> VehicleReport:
        """Return what is known of the vehicle from its telemetry."""
        raise NotImplementedError

    def steer(self, points_m: Points, now_s: float) -> PathChange:
        """Send the vehicle a new rest of its path."""
        raise NotImplementedError

    def record(self) -> FlightRecord:
        """Return what the flight gave."""
        ground, battery = self.ground, self.plan.vehicle.battery
        used = None
        if battery is not None and ground.battery.consumed_wh is not None:
            used = ground.battery.consumed_wh / battery.capacity_wh
        frame = self.plan.farm.frame
        return FlightRecord(
            day=self.number.day,
            flight=self.number.flight,
            system_id=self.number.system_id,
            plan=self.plan,
            outcome=ground.outcome,
            reason=ground.reason,
            track=ground.track(frame),
            true_track=ground.true_track(frame),
            camera=self.assembler.statistics,
            transfers=ground.transfers,
            battery_used=used,
            flight_time_s=ground.flight_time_s,
            texts=ground.texts,
            warnings=[*self.plan.warnings, *filter(None, [self.assembler.mismatch()])],
        )
