"""A run end to end: environment, plan, upload over MAVLink, flight, leaf camera, estimate, score."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from geo.errors import WbfMissionError
from mission.planners import Planner
from mission.policies.policy import FixedPlan, KeepPath, Policy
from mission.policies.registry import make_policy
from mission.transfer import refuse_errors
from sensors.estimators import Estimator
from sensors.field_files import load_field_set
from sensors.scoring.score import ScoreWeights
from sim_vehicle.faults.fault import Fault, parse_fault
from sim_vehicle.faults.session import check_vehicles
from sim_vehicle.host.simulation import Impairment
from wbf_mission.live.link import LiveLink
from wbf_mission.maps.field_maps import FieldMap, true_map
from wbf_mission.planning import plan, planner_of
from wbf_mission.preflight.run import Tell, check_plans, tell_nobody
from wbf_mission.progress import Progress, Stopwatch, silent
from wbf_mission.results.result import Result
from wbf_mission.run.campaign import Campaign
from wbf_mission.run.estimation import (
    attribute_errors_to,
    estimator_of,
    prepare_days,
    require_run_memory,
    resolved,
)
from wbf_mission.run.fleet import vehicles_of
from wbf_mission.run.flight_memory import FlightMemory
from wbf_mission.run.flights import Decider
from wbf_mission.run.hosting import VirtualHosting
from wbf_mission.run.surroundings import camera_options, find_environment
from wbf_mission.scenario import Scenario, scenario_with
from wbf_mission.scenario.scenario import require_scenario


class FlightError(WbfMissionError, RuntimeError):
    """A run that cannot be done."""


def check_flight(scenario: Scenario) -> None:
    """Check what a scenario says of fields, camera and estimator, which planning alone does not use.

    Raises
    ------
    WbfMissionError
        If `fly` would refuse it.
    """
    fields = load_field_set(scenario.farm.fields)
    camera_options(scenario.camera, fields)
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
    pace: float | None = None,
    tlog: Path | None = None,
    impairment: Impairment | None = None,
    faults: Sequence[Fault | str] = (),
    use_cache: bool = True,
    connect: LiveLink | None = None,
    memory: FlightMemory | None = None,
    force: bool = False,
    tell_errors: Tell = tell_nobody,
) -> Result:
    """Do a scenario's whole job, offline or with vehicles behind links.

    Parameters
    ----------
    scenario : Scenario
    planner, policy, estimator : object or str, optional
        In place of the scenario's.
    weights : ScoreWeights, optional
        What errors cost; the paper's by default.
    progress : callable, optional
        ``progress(what, done, total)``.
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
    tell = progress or silent
    watch = Stopwatch()
    fields = load_field_set(scenario.farm.fields)
    options = camera_options(scenario.camera, fields)
    given = {"planner": planner, "policy": policy, "estimator": estimator}
    scenario = resolved(scenario_with(scenario, given))
    learner = estimator_of(scenario.estimate.estimator, scenario.seed, fields)
    breaking = tuple(parse_fault(one) if isinstance(one, str) else one for one in faults)
    check_vehicles(breaking, range(1, len(scenario.vehicle.fleet) + 1))
    if connect is not None:
        scenario = connect.fitted(scenario)
    tell("planning", 0, 1)
    decider = decider_of(scenario)
    vehicles = vehicles_of(scenario, tell)
    if connect is not None:
        vehicles = connect.numbered(vehicles)
    campaign = Campaign(scenario, vehicles, decider, options=options, weights=weights, tell=tell, watch=watch)
    farm = campaign.farm
    if not decider.steers:
        # A planner needs no estimate: what it cannot plan is told before anything takes long.
        plans = campaign.plan(scenario.farm.day)
        tell("planning", 1, 1)
        watch.lap("plan")
        for one in plans:
            # The autopilot of a vehicle behind a link is known better when it is asked.
            if connect is None:
                refuse_errors(one.rendered)
        _check(campaign, connect, force=force, tell=tell_errors)
    require_run_memory(farm, learner, round(campaign.expected_readings))
    environment, cached = find_environment(
        scenario,
        farm,
        progress,
        use_cache=use_cache,
        memory=None if memory is None else memory.environments,
    )
    watch.lap("environment")
    # One BLAS thread: sums do not depend on the number of cores then, and small matrices are faster.
    with threadpool_limits(1, user_api="blas"):
        with attribute_errors_to(learner):
            learner.fit(farm.grid())
        prepare_days(learner, scenario.farm.day, scenario.farm.days, tell)
        watch.lap("learning")
        campaign.learn_with(learner, environment)
        assert campaign.evidence.estimate is not None
        try:
            if decider.steers:
                decider.policy.start()
                campaign.plan(scenario.farm.day)
                tell("planning", 1, 1)
                watch.lap("plan")
                _check(campaign, connect, force=force, tell=tell_errors)
            try:
                if connect is None:
                    hosting = VirtualHosting(pace, tlog, impairment, breaking)
                    campaign.fly(environment, hosting, memory=memory)
                else:
                    campaign.fly(environment, connect.hosting(tlog), connect.attendant)
            except KeyboardInterrupt:
                campaign.interrupt()
                if not campaign.flights:
                    raise
            result = _result(campaign)
        finally:
            campaign.evidence.estimate.close()
    result.environment_cached = cached
    return result


def _check(campaign: Campaign, connect: LiveLink | None, *, force: bool, tell: Tell) -> None:
    """Refuse plans with errors before anything takes off; vehicles behind links are asked, too."""
    if connect is None:
        plans = [(plan, vehicle.scenario) for vehicle, plan in campaign.planned]
        check_plans(plans, "nothing was flown", force=force, tell=tell)
    else:
        connect.check(campaign.planned)
    campaign.watch.lap("preflight")


def decider_of(scenario: Scenario) -> Decider:
    """Return who decides where the vehicles of a run fly: its mission file, policy or planner.

    Raises
    ------
    WbfMissionError
        If there is no such file, policy or planner, or several vehicles are to fly one file.
    """
    options = scenario.mission
    if options.file is not None:
        if len(scenario.vehicle.fleet) > 1:
            msg = f"mission {options.file} is one vehicle's, but {len(scenario.vehicle.fleet)} fly; give one"
            raise FlightError(msg)
        return Decider(KeepPath(), f"mission {options.file}", options.file, plan(scenario))
    if options.policy is not None:
        choice = options.policy
        made = make_policy(choice.name if choice.made is None else choice.made, **choice.params)
        return Decider(made, f"policy {choice}", str(choice))
    choice = options.planner
    return Decider(FixedPlan(planner_of(choice), options.partition), f"planner {choice}", str(choice))


def _result(campaign: Campaign) -> Result:
    """Score what was learned last and gather everything."""
    estimate, watch = campaign.evidence.estimate, campaign.watch
    assert estimate is not None
    campaign.end_day()
    maps, truth = campaign.maps, campaign.truth
    true_maps: tuple[FieldMap, ...] = ()
    if truth is not None:
        true_maps = tuple(true_map(campaign.farm, one.field, truth[k]) for k, one in enumerate(maps))
    watch.lap("report")
    return Result(
        scenario=campaign.scenario,
        flights=tuple(campaign.flights),
        observations=campaign.evidence.observations(),
        truth=truth,
        model=estimate.model,
        history=estimate.history,
        simulated_s=campaign.simulated_s,
        frames=campaign.frames,
        timings_s=watch.seconds,
        fields=campaign.fields,
        maps=maps,
        true_maps=true_maps,
        decisions=campaign.decisions,
        days=tuple(campaign.days),
    )
