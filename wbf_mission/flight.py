"""A complete run: environment, plan, upload over MAVLink, flight, leaf camera, estimate and score."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from threadpoolctl import threadpool_limits

from geo.imports import loader_of
from mission.transfer import refuse_errors
from sensors.field_files import load_field_set
from sensors.scoring.score import ScoreWeights
from sim_vehicle.host.injection import AnyFault
from sim_vehicle.host.simulation import Impairment
from wbf_mission.events import EventStream, RunBegun, RunEnded, VehicleInfo
from wbf_mission.maps.field_maps import FieldMap, true_map
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.planning.sorties import CHANGE_S, SortiePlan
from wbf_mission.preflight.run import check_plans, connection
from wbf_mission.progress import Stopwatch
from wbf_mission.results.result import Result
from wbf_mission.run.campaign import Campaign, RealSorties
from wbf_mission.run.estimation import estimator_of, require_run_memory
from wbf_mission.run.hosting import Hosting, VirtualHosting
from wbf_mission.run.joint_flight import OperatorConsole
from wbf_mission.run.orders import Orders
from wbf_mission.run.rehearsal import REHEARSED_ON, rehearsed
from wbf_mission.run.resolve import Run, cameras_of, resolve, world_of
from wbf_mission.run.reuse import FlightMemory
from wbf_mission.scenario import Scenario
from wbf_mission.scenario.scenario import require_scenario


def check_flight(scenario: Scenario) -> None:
    """Check the parts of a scenario that planning does not use: fields, camera, world and estimator.

    WbfMissionError if `fly` would refuse one of these parts.
    """
    fields = load_field_set(scenario.farm.fields)
    cameras_of(scenario, fields)
    world_of(scenario, fields)
    if scenario.estimate.estimator is not None:
        estimator_of(scenario.estimate.estimator, scenario.seed, fields)


class Way(Protocol):
    """A way to fly a run: with simulated vehicles (`Simulated`) or real vehicles (`wbf_mission.LiveLink`)."""

    @property
    def faults(self) -> Sequence[AnyFault | str]:
        """Faults injected into each flight of simulated vehicles."""

    @property
    def full(self) -> float:
        """Charge of a full battery, 0 to 1."""

    @property
    def change_s(self) -> float:
        """Time to change a battery (s)."""

    @property
    def force(self) -> bool:
        """Whether to fly plans with errors, and missions that need several batteries without cutting them."""

    @property
    def console(self) -> OperatorConsole | None:
        """Console of the operator of real vehicles, or None in simulation."""

    def fitted(self, scenario: Scenario, events: EventStream) -> Scenario:
        """Return the scenario, adapted to the vehicles."""

    def numbered(self, vehicles: Sequence[Vehicle]) -> tuple[Vehicle, ...]:
        """Return the run's vehicles with their real system ids and start positions."""

    def check(self, campaign: Campaign, events: EventStream) -> None:
        """Raise PreflightError before take-off if a plan has errors."""

    def sorties(self, cut: SortiePlan, vehicle: Vehicle, footprint: int) -> RealSorties | None:
        """Return the object that tracks a real vehicle's sorties, or None in simulation."""

    def hosting(self, faults: Sequence[AnyFault]) -> Hosting:
        """Return the host of the flights: a simulation, or the links to real vehicles."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """Simulated vehicles on a virtual clock.

    Parameters
    ----------
    faults : sequence of Fault or str
        Faults of each flight (needs the add-on `faults`).
    impairment : Impairment, optional
        Disturbances of the radio between the ground station and the vehicles.
    pace : float, optional
        Simulated seconds per wall second; by default, the simulation runs as fast as possible.
    tlog : Path, optional
        File for all MAVLink frames of the run; its folder is made when the flight begins.
    orders : Orders, optional
        Orders of an operator in flight; the seed alone cannot repeat a run in which orders were given.
    change_s : float
        Time to change a battery (s). If a single vehicle's mission needs several batteries, it is
        flown in sorties (`wbf_mission.planning.sorties`).
    force : bool
        Fly plans with preflight errors, and do not cut missions that need several batteries.
    """

    faults: Sequence[AnyFault | str] = ()
    impairment: Impairment | None = None
    pace: float | None = None
    tlog: Path | None = None
    orders: Orders | None = None
    change_s: float = CHANGE_S
    force: bool = False
    full: ClassVar[float] = 1.0
    console: ClassVar[None] = None

    def fitted(self, scenario: Scenario, events: EventStream) -> Scenario:  # noqa: ARG002
        """Return the scenario unchanged."""
        return scenario

    def numbered(self, vehicles: Sequence[Vehicle]) -> tuple[Vehicle, ...]:
        """Return the vehicles unchanged."""
        return tuple(vehicles)

    def check(self, campaign: Campaign, events: EventStream) -> None:
        """Raise an error if the simulated autopilot would refuse a mission, or a plan has errors."""
        if not campaign.run.decider.steers:
            for sortie in campaign.sorties:
                refuse_errors(sortie.rendered)
        plans = [(plan, vehicle) for vehicle, plan in campaign.planned]
        if campaign.cut is not None:
            plans = [(plan, plans[0][1]) for plan in campaign.sorties]
        check_plans(plans, "nothing was flown", events, force=self.force)

    def sorties(self, cut: SortiePlan, vehicle: Vehicle, footprint: int) -> None:
        """Return None: a simulation flies the sorties as they are cut."""

    def hosting(self, faults: Sequence[AnyFault]) -> Hosting:
        """Return a simulation."""
        return VirtualHosting(
            pace=self.pace,
            tlog=self.tlog,
            orders=self.orders,
            impairment=self.impairment,
            faults=tuple(faults),
        )


if TYPE_CHECKING:

    class _LiveLink(Protocol):
        """Signature of `wbf_mission.LiveLink`; the docstring of that class lists the parameters."""

        def __call__(
            self,
            urls: str | Sequence[str],
            console: OperatorConsole,
            *,
            agreed: bool = ...,
            wait_s: float = ...,
            system_ids: Sequence[int] = ...,
            force: bool = ...,
            via: object = ...,
            change_s: float = ...,
            tlog: Path | None = ...,
            orders: Orders | None = ...,
        ) -> Way: ...

    LiveLink: _LiveLink

else:
    __getattr__ = loader_of(__name__, ("LiveLink",), connection)


def fly(
    scenario: Scenario,
    *,
    by: Way = Simulated(),
    events: EventStream | None = None,
    weights: ScoreWeights | None = None,
    memory: FlightMemory | None = None,
    use_cache: bool = True,
) -> Result:
    """Plan, fly, estimate and score a scenario, in simulation or with real vehicles.

    Parameters
    ----------
    by : Simulated or LiveLink
        Simulated or real vehicles, with their options.
    events : EventStream, optional
        Stream for progress, notes, findings, questions and the flights. With a listener of ``VehicleMoved``,
        flights are flown one after the other in this process.
    weights : ScoreWeights, optional
        Costs of estimation errors; the paper's by default.
    memory : FlightMemory, optional
        Memory shared by several runs: equal flights of planners are flown once, and successive runs on the
        same small environment reuse that environment.
    use_cache : bool
        Read the environment of a large farm from the user's cache, or write the environment there
        (:class:`sensors.environment.cache.EnvironmentCache`).

    Returns
    -------
    Result
        Returned also for a failed flight or after Ctrl-C; its outcome states the reason.

    Raises
    ------
    WbfMissionError
        If the scenario cannot be planned or set up, or the preflight check finds an error in a plan.
    """
    require_scenario(scenario)
    stream = EventStream() if events is None else events
    progress = stream.progress
    watch = Stopwatch()
    run = resolve(scenario, faults=by.faults, fitted=by.fitted, weights=weights, events=stream)
    run = replace(run, vehicles=by.numbered(run.vehicles))
    if stream.wants(RunBegun):
        stream.tell(_begun(run, simulated=isinstance(by, Simulated)))
    changes_s = None if by.force else by.change_s
    with (
        rehearsed(run, rehearse) as ready,
        closing(Campaign(run, events=stream, watch=watch, change_s=changes_s, full=by.full)) as campaign,
    ):

        def plan() -> None:
            campaign.plan(run.first_day)
            progress("planning", 1, 1)
            watch.lap("plan")
            by.check(campaign, stream)
            watch.lap("preflight")

        if not run.decider.steers:
            # Planners need no estimate, so errors of the plan are raised before any slow step.
            plan()
        require_run_memory(run.farm, run.estimator, round(campaign.expected_readings))
        environments = None if memory is None else memory.environments
        environment, cached = run.environment(progress, use_cache=use_cache, memory=environments)
        watch.lap("environment")
        # With several BLAS threads, the last bits of sums in user code would depend on the number of cores.
        with threadpool_limits(1, user_api="blas"):
            campaign.learn_from(environment, ready)
            if run.decider.steers:
                run.decider.start()
                plan()
            try:
                campaign.fly(environment, by.hosting(run.faults), by.console, memory, by.sorties)
            except KeyboardInterrupt:
                if not campaign.flights:
                    raise
            result = _result(campaign)
        result.environment_cached = cached
        if stream.wants(RunEnded):
            outcome, reason = result.outcome.value, result.reason
            stream.tell(RunEnded(result.simulated_s, outcome, reason, result.summary()))
        return result


def _begun(run: Run, *, simulated: bool) -> RunBegun:
    """Return the first event of a run."""
    asked = run.asked
    tasks = [vehicle.task for vehicle in run.vehicles]
    vehicles = tuple(
        VehicleInfo(task.system_id, task.builder.vehicle.name, task.builder.vehicle.kind) for task in tasks
    )
    return RunBegun(
        f"{run.farm.name}, {run.decider.label}",
        run.farm,
        run.fields,
        vehicles,
        simulated=simulated,
        seed=run.seed,
        estimator=str(asked.estimate.estimator),
        planner=run.decider.label,
    )


def rehearse(estimator: str) -> None:
    """Fly a small run that compiles all functions that `estimator` uses on a large farm."""
    # Without a method, `gp` would choose its method for small farms here.
    chosen = "gp:method=local" if estimator == "gp" else estimator
    fly(Scenario(farm=REHEARSED_ON, planner="spiral", vehicle="ideal", estimator=chosen, budget="300steps"))


def _result(campaign: Campaign) -> Result:
    """Score the last estimate of a campaign and return the campaign's result."""
    estimate, watch = campaign.evidence.estimate, campaign.watch
    assert estimate is not None
    campaign.end_day()
    maps, truth = campaign.maps, campaign.truth
    true_maps: tuple[FieldMap, ...] = ()
    if truth is not None:
        true_maps = tuple(true_map(campaign.run.farm, shown.field, truth, k) for k, shown in enumerate(maps))
    watch.lap("report")
    return Result(
        scenario=campaign.run.asked,
        flights=tuple(campaign.flights),
        observations=campaign.evidence.observations(),
        truth=truth,
        model=estimate.model,
        history=estimate.history,
        simulated_s=campaign.simulated_s,
        frames=campaign.frames,
        timings_s=watch.seconds,
        fields=campaign.run.fields,
        maps=maps,
        true_maps=true_maps,
        decisions=campaign.decisions,
        days=tuple(campaign.days),
        stopped="" if campaign.real is None else campaign.real.stopped,
        rest=None if campaign.real is None else campaign.real.rest,
    )
