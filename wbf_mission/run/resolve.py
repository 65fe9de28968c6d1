"""Resolves a scenario into a run: makes and checks its parts before planning and flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

from geo import Farm
from geo.errors import WbfMissionError, told_error
from geo.seeds import child_seed
from mission.files import read_mission
from mission.planners import make_planner
from mission.policies.policy import FixedPlan, KeepPath, Policy, make_policy
from sensors.camera.leaf_camera import LeafCameraOptions
from sensors.environment import Environment
from sensors.environment.cache import EnvironmentCache, EnvironmentMemory
from sensors.environment.world import World
from sensors.estimators import Estimator
from sensors.field_files import load_field_set
from sensors.fields import ALL_CROPS, FieldSet
from sensors.scoring.score import ScoreWeights
from sim_vehicle.host.injection import AnyFault, injection
from wbf_mission.events import EventStream
from wbf_mission.planning import PlanResult
from wbf_mission.planning.builder import MissionBuilder, positions_of
from wbf_mission.planning.fleet import Vehicle, vehicles_of
from wbf_mission.progress import Progress
from wbf_mission.run.estimation import estimator_of, readings_a_score, resolved
from wbf_mission.scenario import CameraOptions, FarmOptions, MissionOptions, Scenario, ScenarioError
from wbf_mission.scenario.values import Separation


class FlightError(WbfMissionError, RuntimeError):
    """Raised if a run cannot be flown."""


@dataclass(frozen=True, slots=True)
class Decider:
    """The planner, policy or mission file that decides the paths."""

    policy: Policy  # A `FixedPlan` for a planner, a `KeepPath` for a mission from a file.
    name: str  # Name in messages: ``planner spiral``, ``policy greedy``.
    label: str  # Name with parameters.
    mission: PlanResult | None = None  # Plan of a mission file, or None for a planner or policy.
    # Sorties of a mission, in the order of their flights; empty for a mission flown in one sortie
    sorties: tuple[PlanResult, ...] = ()
    named: bool = True  # Whether other processes can make the policy from its name (it may not be picklable)

    @property
    def steers(self) -> bool:
        """Whether the paths depend on the estimate; the paths of planners and mission files do not."""
        return not isinstance(self.policy, FixedPlan | KeepPath)

    def start(self) -> None:
        """Start the policy; ScenarioError names a policy that fails."""
        try:
            self.policy.start()
        except (Exception, SystemExit) as error:
            raise ScenarioError(f"{self.name} failed: {told_error(error)}") from error


@dataclass(frozen=True)
class Run:
    """A scenario's parts, made and checked: everything that decides the run's results."""

    asked: Scenario  # The scenario, with the default estimator named
    farm: Farm
    fields: FieldSet  # Fields that the camera senses.
    vehicles: tuple[Vehicle, ...]  # Ordered by system id.
    decider: Decider
    estimator_once: Callable[[], Estimator]  # Makes the estimator at the first call; not used to plan.
    cameras: tuple[LeafCameraOptions, ...]  # Cameras of the vehicles; empty for a run that is only planned.
    looks: CameraOptions  # Image spacing and footprint.
    weights: ScoreWeights  # Costs of estimation errors.
    seed: int
    first_day: int
    days: int
    flights_per_day: int
    points: int | None  # Scores per flight; None: chosen by the farm's size.
    keeps: Separation  # Separation of the vehicles.
    world: World | None = None  # True dynamics of the fields; used only for the environment.
    faults: tuple[AnyFault, ...] = ()  # Faults injected in each flight of simulated vehicles.

    def __getstate__(self) -> dict[str, object]:
        """Return the state without the estimator, which may be large and is not needed to fly elsewhere."""
        return {name: value for name, value in self.__dict__.items() if name != "estimator_once"}

    @property
    def estimator(self) -> Estimator:
        """The estimator; each access gives the same object."""
        return self.estimator_once()

    @property
    def camera(self) -> LeafCameraOptions:
        """The camera of the first vehicle; cameras of other vehicles differ only in their sensed fields."""
        return self.cameras[0]

    def camera_of(self, system_id: int) -> LeafCameraOptions:
        """Return the camera of a vehicle by its system id."""
        return self.cameras[[vehicle.task.system_id for vehicle in self.vehicles].index(system_id)]

    @cached_property
    def numbers(self) -> tuple[tuple[int, int], ...]:
        """Day and flight number of each flight of the run, in order."""
        return tuple(
            (day, flight)
            for day in range(self.first_day, self.first_day + self.days)
            for flight in range(1, self.flights_per_day + 1)
        )

    def readings_a_score(self, expected: float) -> int:
        """Return the number of observations between two scores, for a flight with `expected` observations."""
        ideal = all(vehicle.task.builder.vehicle.is_ideal for vehicle in self.vehicles)
        flights = len(self.numbers)
        return readings_a_score(self.points, self.farm, self.estimator, flights, expected, ideal=ideal)

    @property
    def last_day(self) -> int:
        """The last day of the run."""
        return self.first_day + self.days - 1

    def environment(
        self, progress: Progress | None, *, use_cache: bool, memory: EnvironmentMemory | None = None
    ) -> tuple[Environment, bool]:
        """Return the run's environment, and whether it came from the cache."""
        return environment_of(
            self.farm,
            self.fields,
            (self.first_day, self.last_day),
            self.seed,
            progress,
            world=self.world,
            use_cache=use_cache,
            memory=memory,
        )


def resolve(
    scenario: Scenario,
    *,
    to_fly: bool = True,
    farm: Farm | None = None,
    fields: FieldSet | None = None,
    faults: Sequence[AnyFault | str] = (),
    fitted: Callable[[Scenario, EventStream], Scenario] | None = None,
    weights: ScoreWeights | None = None,
    events: EventStream | None = None,
) -> Run:
    """Make and check everything that a scenario names.

    Parameters
    ----------
    to_fly : bool
        Check also what a plan does not use: fields, cameras, world and estimator. A run that is only planned
        has no cameras and no world, and no vehicles if it has a mission file.
    farm, fields : Farm and FieldSet, optional
        Farm and fields of the scenario, if they are already loaded.
    faults : sequence of Fault or str
        Faults of each flight.
    fitted : callable, optional
        Waits for the vehicles behind a link, and returns the scenario fitted to them. It is called after all
        checks that do not depend on the vehicles.

    Raises
    ------
    WbfMissionError
        If a name is unknown, a value out of range, or the parts do not suit each other.
    """
    if to_fly and scenario.camera.model is not None:
        raise ScenarioError(
            f"camera {scenario.camera.model}: a run flies with the leaf camera, whose images are"
            f" {scenario.camera.footprint} cells wide; plan with camera {scenario.camera.model}, and fly the"
            " plan's file with --mission"
        )
    stream = EventStream() if events is None else events
    injected = injection(faults)
    injected.require_vehicles(range(1, len(scenario.vehicle.fleet) + 1))
    farm, fields = farm_of(scenario.farm, farm, fields)
    if to_fly:
        _require_hosts(farm, fields, stream)
        fields.require_simulated()
    scenario = resolved(scenario, farm, fields)
    choice, seed = scenario.estimate.estimator, scenario.seed
    estimator_once = cache(lambda: estimator_of(choice, seed, fields))
    if to_fly:
        estimator_once()
    if fitted is not None:
        # Camera options are checked before the wait for vehicles, whose number is still unknown.
        cameras_of(scenario, fields, len(scenario.camera.by_vehicle))
        scenario = fitted(scenario, stream)
    cameras = cameras_of(scenario, fields) if to_fly else ()
    progress = stream.progress
    progress("planning", 0, 1)
    decider = decider_of(scenario.mission, len(scenario.vehicle.fleet))
    file, day = scenario.mission.file, scenario.farm.day
    # Vehicles' tasks have budgets, which a mission file does not need.
    needs_tasks = to_fly or file is None
    vehicles = vehicles_of(scenario, farm, seed=seed, first_day=day, progress=progress) if needs_tasks else ()
    if file is not None:
        builder = vehicles[0].task.builder if vehicles else MissionBuilder.of(scenario, farm)
        flown = _read_plan(file, builder, scenario.camera.footprint, seed)
        decider = replace(decider, mission=flown)
    return Run(
        asked=scenario,
        farm=farm,
        fields=fields,
        vehicles=vehicles,
        decider=decider,
        estimator_once=estimator_once,
        cameras=cameras,
        looks=scenario.camera,
        weights=ScoreWeights.of(fields) if weights is None else weights,
        seed=seed,
        first_day=day,
        days=scenario.farm.days,
        flights_per_day=scenario.farm.flights_per_day,
        points=scenario.score.points,
        keeps=scenario.vehicle.keeps,
        world=world_of(scenario, fields) if to_fly else None,
        faults=injected.faults,
    )


def _read_plan(file: str, builder: MissionBuilder, footprint: int, seed: int) -> PlanResult:
    """Return the plan of a mission file; `ScenarioError` if no mission item has a position."""
    farm, mission = builder.farm, read_mission(file)
    path_m = positions_of(mission, farm)
    if not len(path_m):
        raise ScenarioError(f"{file}: no item of the mission has a position; give a mission with waypoints")
    return builder.plan_of(
        mission,
        path_m,
        planner=None,
        seed=seed,
        budget_text="none (mission file)",
        footprint=footprint,
    )


def farm_of(
    options: FarmOptions, farm: Farm | None = None, fields: FieldSet | None = None
) -> tuple[Farm, FieldSet]:
    """Return the farm, limited to the crops of the fields, and the fields; load those that are None."""
    fields = load_field_set(options.fields) if fields is None else fields
    return (options.load() if farm is None else farm).scouting(fields.crops), fields


def _require_hosts(farm: Farm, fields: FieldSet, events: EventStream) -> None:
    """Refuse fields if the farm's owner grows none of their crops; note each field without a scored cell."""
    grown = f"farm {farm.name}: grows {', '.join(farm.grown) or 'nothing'}, but"
    wanted = fields.crops
    if wanted and set(farm.grown).isdisjoint(wanted):
        raise ScenarioError(
            f"{grown} the fields {', '.join(fields.names)} are of {', '.join(wanted)}: name fields for its"
            " crops (--fields)"
        )
    for field in fields:
        if ALL_CROPS not in field.crops and set(farm.grown).isdisjoint(field.crops):
            of = f"field {field.name} is of {', '.join(field.crops)}"
            events.note(f"{grown} the {of}, so its errors are not scored")


def decider_of(options: MissionOptions, vehicles: int) -> Decider:
    """Return the decider for a scenario's mission: a mission file for one vehicle, a policy, or a planner."""
    if options.file is not None:
        if vehicles > 1:
            msg = f"mission {options.file} is for one vehicle, but {vehicles} fly; give one vehicle"
            raise ScenarioError(msg)
        return Decider(KeepPath(), f"mission {options.file}", options.file)
    if options.policy is not None:
        choice = options.policy
        made = make_policy(choice.chosen, **choice.params)
        return Decider(made, f"policy {choice}", str(choice), named=choice.made is None)
    choice = options.planner
    policy = FixedPlan(make_planner(choice.chosen, **choice.params), options.partition)
    return Decider(policy, f"planner {choice}", str(choice), named=choice.made is None)


def make_environment(
    scenario: Scenario, farm: Farm, progress: Progress | None = None, *, use_cache: bool = True
) -> Environment:
    """Return the environment of a scenario's days and seed; the user's cache keeps large environments."""
    days = scenario.farm.day, scenario.farm.day + scenario.farm.days - 1
    fields, world = load_field_set(scenario.farm.fields), scenario.farm.load_world()
    return environment_of(farm, fields, days, scenario.seed, progress, world=world, use_cache=use_cache)[0]


def world_of(scenario: Scenario, fields: FieldSet) -> World | None:
    """Return the scenario's world, or None without one.

    Raises EnvironmentDataError if the world cannot be used, or does not suit the fields.
    """
    world = scenario.farm.load_world()
    if world is not None:
        world.fields(fields, scenario.seed)
    return world


def environment_of(
    farm: Farm,
    fields: FieldSet,
    days: tuple[int, int],
    seed: int,
    progress: Progress | None,
    *,
    world: World | None = None,
    use_cache: bool,
    memory: EnvironmentMemory | None = None,
) -> tuple[Environment, bool]:
    """Return the environment of a run's seed for `days` (first, last), and whether it came from the cache.

    Runs that share `memory` share equal environments. A world replaces the dynamics of the fields.
    """

    def told(done: int, total: int) -> None:
        if progress is not None:
            progress("environment", done, total)

    cache = EnvironmentCache.of_user() if use_cache else EnvironmentCache.off()
    memory = EnvironmentMemory() if memory is None else memory
    return memory.environment(
        cache,
        farm.grid(),
        day=days[0],
        last_day=days[1],
        seed=child_seed(seed, "environment"),
        fields=fields if world is None else world.fields(fields, seed),
        progress=told,
    )


def cameras_of(
    scenario: Scenario, fields: FieldSet, vehicles: int | None = None
) -> tuple[LeafCameraOptions, ...]:
    """Return the leaf camera's options for each vehicle; by default, for the scenario's fleet.

    Raises WbfMissionError if an option is out of range, or cameras are given for another number of vehicles.
    """
    camera, count = scenario.camera, len(scenario.vehicle.fleet) if vehicles is None else vehicles
    return tuple(
        LeafCameraOptions(
            footprint_cells=camera.footprint,
            noise_std=camera.noise,
            false_positive_rate=camera.false_positive_rate,
            false_negative_rate=camera.false_negative_rate,
            sensed=camera.sensed_by(vehicle, count),
            fields=fields,
        )
        for vehicle in range(count)
    )
