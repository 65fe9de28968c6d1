"""A run end to end: environment, plan, upload over MAVLink, flight, leaf camera, estimate, score."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from mission.planners import Planner
from mission.policies.policy import Policy
from mission.transfer import refuse_errors
from sensors.estimators import Estimator
from sensors.field_files import load_field_set
from sensors.scoring.score import ScoreWeights
from sim_vehicle.faults.fault import Fault
from sim_vehicle.host.simulation import Impairment
from wbf_mission.events import EventStream, RunBegun, RunEnded, VehicleInfo
from wbf_mission.live.battery_change import REAL_FULL
from wbf_mission.live.link import LiveLink
from wbf_mission.maps.field_maps import FieldMap, true_map
from wbf_mission.planning.builder import budget_left
from wbf_mission.planning.sorties import CHANGE_S
from wbf_mission.preflight.finding import ShowFindings, show_nobody
from wbf_mission.preflight.run import check_plans
from wbf_mission.progress import Progress, Stopwatch
from wbf_mission.results.result import Result
from wbf_mission.run.campaign import Campaign
from wbf_mission.run.estimation import estimator_of, require_run_memory
from wbf_mission.run.hosting import VirtualHosting
from wbf_mission.run.orders import Orders
from wbf_mission.run.rehearsal import REHEARSED_ON, rehearsed
from wbf_mission.run.resolve import Run, cameras_of, resolve, world_of
from wbf_mission.run.reuse import FlightMemory
from wbf_mission.scenario import Scenario, scenario_with
from wbf_mission.scenario.scenario import require_scenario


def check_flight(scenario: Scenario) -> None:
    """Check what a scenario says of fields, camera and estimator, which planning alone does not use.

    WbfMissionError if `fly` would refuse it.
    """
    fields = load_field_set(scenario.farm.fields)
    cameras_of(scenario, fields)
    world_of(scenario, fields)
    if scenario.estimate.estimator is not None:
        estimator_of(scenario.estimate.estimator, scenario.seed, fields)


def fly(
    scenario: Scenario,
    *,
    planner: Planner | str | None = None,
    policy: Policy | str | None = None,
    estimator: Estimator | str | None = None,
    weights: ScoreWeights | None = None,
    progress: Progress | None = None,
    events: EventStream | None = None,
    orders: Orders | None = None,
    pace: float | None = None,
    tlog: Path | None = None,
    impairment: Impairment | None = None,
    faults: Sequence[Fault | str] = (),
    use_cache: bool = True,
    connect: LiveLink | None = None,
    memory: FlightMemory | None = None,
    force: bool = False,
    tell_errors: ShowFindings = show_nobody,
    change_s: float = CHANGE_S,
) -> Result:
    """Do a scenario's whole job, offline or with vehicles behind links.

    Parameters
    ----------
    planner, policy, estimator : object or str, optional
        In place of the scenario's.
    weights : ScoreWeights, optional
        What errors cost; the paper's by default.
    progress : callable, optional
        ``progress(what, done, total)``.
    events : EventStream, optional
        Takes what happens, while it does; with listeners that follow the vehicles (``VehicleMoved``) flights
        are flown one after the other in this process.
    orders : Orders, optional
        What who watches orders of the vehicles in flight; a run in which something was ordered is not
        repeated by its seed.
    pace : float, optional
        Simulated seconds per wall second; as fast as possible without.
    tlog : Path, optional
        Write every MAVLink frame of the run there; its folder is made when the flight begins.
    impairment : Impairment, optional
        A bad radio between the ground station and the vehicle.
    faults : sequence of Fault or str
        What goes wrong in each flight (`sim_vehicle.faults`).
    use_cache : bool
        Take the environment of a large farm from the user's cache, or keep it there
        (:class:`sensors.environment.cache.EnvironmentCache`).
    connect : LiveLink, optional
        The links to the vehicles that fly, in place of simulated ones.
    memory : FlightMemory, optional
        Given to several runs: flights of planners that would be the same are flown once, and runs on the same
        small environment that follow one another share it.
    force : bool
        Fly plans in which the preflight check finds errors; of a vehicle behind a link its own says so.
    tell_errors : callable
        Takes these errors.
    change_s : float
        Seconds that changing a battery takes. A mission of one vehicle that is longer than a battery is flown
        in sorties (`wbf_mission.planning.sorties`), unless `force` says to fly it whole; for that of a real
        one see `LiveLink.change_s`.

    Returns
    -------
    Result
        Also when the flight went wrong or was interrupted by Ctrl-C: the outcome says how.

    Raises
    ------
    WbfMissionError
        If the scenario cannot be planned or set up, or the preflight check finds an error in what is planned.
    """
    require_scenario(scenario)
    stream = EventStream.of_progress(progress, events)
    progress = stream.progress
    watch = Stopwatch()
    scenario = scenario_with(scenario, {"planner": planner, "policy": policy, "estimator": estimator})
    fitted = None if connect is None else connect.fitted
    run = resolve(scenario, faults=faults, fitted=fitted, weights=weights, progress=progress)
    if connect is not None:
        run = replace(run, vehicles=connect.numbered(run.vehicles))
    if stream.wants(RunBegun):
        stream.tell(_begun(run, simulated=connect is None))
    full = 1.0 if connect is None else REAL_FULL
    changes_s = None if force or (connect is not None and connect.force) else change_s
    with (
        rehearsed(run, rehearse) as ready,
        closing(Campaign(run, events=stream, watch=watch, change_s=changes_s, full=full)) as campaign,
    ):

        def plan() -> None:
            campaign.plan(run.first_day)
            progress("planning", 1, 1)
            watch.lap("plan")
            # The autopilot of a vehicle behind a link is known better when it is asked.
            if connect is None and not run.decider.steers:
                for one in campaign.sorties:
                    refuse_errors(one.rendered)
            _check(campaign, connect, force=force, tell=tell_errors)

        if not run.decider.steers:
            # A planner needs no estimate: what it cannot plan is told before anything takes long.
            plan()
        require_run_memory(run.farm, run.estimator, round(campaign.expected_readings))
        environments = None if memory is None else memory.environments
        environment, cached = run.environment(progress, use_cache=use_cache, memory=environments)
        watch.lap("environment")
        # One BLAS thread: so sums of code of the user's own do not depend on the number of cores, either.
        with threadpool_limits(1, user_api="blas"):
            campaign.learn_from(environment, ready)
            if run.decider.steers:
                run.decider.policy.start()
                plan()
            try:
                if connect is None:
                    hosting = VirtualHosting(pace, tlog, impairment, run.faults, orders)
                    campaign.fly(environment, hosting, memory=memory)
                else:
                    campaign.fly(environment, connect.hosting(tlog, orders), connect.console, changer=connect)
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
    """Return what is flown."""
    asked = run.asked
    vehicles = tuple(
        VehicleInfo(one.task.system_id, one.task.builder.vehicle.name, one.task.builder.vehicle.kind)
        for one in run.vehicles
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
    """Fly what goes through everything that an estimator of this name compiles on a large farm."""
    # `gp` would take the readings of this farm as those of a small one.
    chosen = "gp:method=local" if estimator == "gp" else estimator
    fly(Scenario(farm=REHEARSED_ON, planner="spiral", vehicle="ideal", estimator=chosen, budget="300steps"))


def _check(campaign: Campaign, connect: LiveLink | None, *, force: bool, tell: ShowFindings) -> None:
    """Refuse plans with errors before anything takes off; vehicles behind links are asked, too."""
    if connect is None:
        plans = [(plan, vehicle) for vehicle, plan in campaign.planned]
        if campaign.cut is not None:
            plans = [(plan, plans[0][1]) for plan in campaign.sorties]
        check_plans(plans, "nothing was flown", force=force, show=tell)
    else:
        planned = campaign.planned
        if campaign.cut is not None:
            connect.note(campaign.cut.told())
            later = [(plan, planned[0][0]) for plan in campaign.sorties[1:]]
            check_plans(later, "nothing was sent", force=force, show=tell)
        if not campaign.run.decider.steers:
            missions = [[plan] for _, plan in planned] if campaign.cut is None else [campaign.sorties]
            for left in filter(None, dict.fromkeys(map(budget_left, missions))):
                connect.note(left)
        connect.check(planned)
    campaign.watch.lap("preflight")


def _result(campaign: Campaign) -> Result:
    """Score what was learned last and gather everything."""
    estimate, watch = campaign.evidence.estimate, campaign.watch
    assert estimate is not None
    campaign.end_day()
    maps, truth = campaign.maps, campaign.truth
    true_maps: tuple[FieldMap, ...] = ()
    if truth is not None:
        true_maps = tuple(true_map(campaign.run.farm, one.field, truth[k]) for k, one in enumerate(maps))
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
