"""Plans of a scenario: missions within the budget, with their predictions."""

from __future__ import annotations

from geo import Farm
from mission.errors import PlanningError
from sensors.estimation import Evidence
from wbf_mission.events import EventStream, Progressed
from wbf_mission.planning import PlanResult
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.loop import DecisionLoop, Knowledge
from wbf_mission.run.resolve import Run, resolve
from wbf_mission.scenario import Scenario, ScenarioError
from wbf_mission.scenario.scenario import require_scenario


def plan(scenario: Scenario, *, progress: Progress = silent) -> PlanResult:
    """Plan a scenario, or read the mission that it names.

    Parameters
    ----------
    progress : callable
        Progress of the planner's search: see `wbf_mission.progress.Progress`.

    Raises
    ------
    WbfMissionError
        If a name is unknown, a value is out of range, or no path fits the budget; if several vehicles fly
        (`plan_fleet` plans for them).
    """
    require_scenario(scenario)
    count = len(scenario.vehicle.fleet)
    if count > 1:
        msg = f"{count} vehicles: a mission is one vehicle's; plan for the fleet, or give one"
        raise ScenarioError(msg)
    return plan_fleet(scenario, progress=progress)[0]


def plan_fleet(
    scenario: Scenario, *, farm: Farm | None = None, progress: Progress = silent
) -> tuple[PlanResult, ...]:
    """Plan for all vehicles of a scenario, in the order of their system ids; errors as of `plan`.

    `farm` is the scenario's farm if it is loaded already. The plans of a policy are its first paths, decided
    without observations.
    """
    run = resolve(scenario, to_fly=False, farm=farm, events=progress_events(progress))
    if run.decider.mission is not None:
        return (run.decider.mission,)
    evidence = Evidence(run.farm, run.fields)
    knowledge = Knowledge(
        run.farm, run.first_day, run.fields, run.weights, evidence.model, evidence.observations
    )
    return plans_of(run, knowledge)


def progress_events(progress: Progress) -> EventStream:
    """Return a stream of events that hands its progress to `progress`."""
    events = EventStream()
    events.listen(lambda event: progress(event.what, event.done, event.total), Progressed)
    return events


def plans_of(run: Run, knowledge: Knowledge, flight: str = "a flight") -> tuple[PlanResult, ...]:
    """Return the plan of each vehicle of a run, decided before take-off; PlanningError if no path has points.

    A vehicle without a path has a plan without waypoints. `flight` names the flight in error messages.
    """
    decider, tasks = run.decider, [vehicle.task for vehicle in run.vehicles]
    decider.policy.start()
    loop = DecisionLoop(decider.policy, decider.name, knowledge, records=[])
    decision = loop.start([task.report(steered=decider.steers) for task in tasks]).decision
    if not any(len(decision.paths[task.system_id]) for task in tasks):
        msg = f"{decider.name} finds nothing worth {flight} within {tasks[0].budget_text}"
        raise PlanningError(msg)
    return tuple(task.plan_of(decision, decider.label, steered=decider.steers) for task in tasks)
