"""Plans scenarios: missions within the budget or for a number of batteries, with their predictions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from geo import Farm
from mission.errors import PlanningError
from sensors.estimation import Evidence
from wbf_mission.events import EventStream, Progressed
from wbf_mission.planning import PlanResult
from wbf_mission.planning.sorties import SortiePlan, UncutError
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.loop import DecisionLoop, Knowledge
from wbf_mission.run.resolve import Run, resolve
from wbf_mission.scenario import Scenario, ScenarioError, scenario_with
from wbf_mission.scenario.parts import UNLIMITED
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
        msg = f"{count} vehicles: a mission is for one vehicle; plan for the fleet, or give one vehicle"
        raise ScenarioError(msg)
    return plan_fleet(scenario, progress=progress)[0]


def plan_fleet(
    scenario: Scenario, *, farm: Farm | None = None, progress: Progress = silent
) -> tuple[PlanResult, ...]:
    """Plan for all vehicles of a scenario, in the order of their system ids; raises the errors of `plan`.

    `farm` is the scenario's farm, if it is already loaded. For a policy, the plans are its first paths, which
    it decides without observations.
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
    """Return a stream of events that passes progress events to `progress`."""
    events = EventStream()
    events.listen(lambda event: progress(event.what, event.done, event.total), Progressed)
    return events


def plans_of(run: Run, knowledge: Knowledge, flight: str = "a flight") -> tuple[PlanResult, ...]:
    """Return the plan of each vehicle of a run, decided before take-off; PlanningError if no path has points.

    A vehicle without a path has a plan without waypoints. `flight` names the flight in error messages.
    """
    decider, tasks = run.decider, [vehicle.task for vehicle in run.vehicles]
    decider.start()
    loop = DecisionLoop(decider.policy, decider.name, knowledge, records=[])
    decision = loop.start([task.report(steered=decider.steers) for task in tasks]).decision
    if not any(len(decision.paths[task.system_id]) for task in tasks):
        raise PlanningError(f"{decider.name} finds nothing worth {flight} within {tasks[0].budget_text}")
    return tuple(task.plan_of(decision, decider.label, steered=decider.steers) for task in tasks)


_TRIES = 8
_SURVEY = "survey"
"""Planner that covers a whole area; the length of its missions does not depend on the budget."""
_CLOSE = 1.01
"""The search ends if the ratio of its bounds is below this."""
_PACKED, _ENOUGH = 0.985, 0.97
"""Fraction of all batteries' energy that the search aims at, and fraction at which the search ends. Sorties
can be cut only at certain places, so the batteries are never used up."""
_FARTHEST = 1.5
"""Upper bound of the distance per battery, in multiples of the length of a mission for one battery."""


def plan_for_batteries(
    scenario: Scenario,
    count: int,
    cut: Callable[[PlanResult], SortiePlan | None],
    *,
    progress: Progress = silent,
) -> tuple[PlanResult, SortiePlan | None]:
    """Plan the longest mission of one vehicle that `count` batteries can fly.

    The function searches for the budget in metres, with at most eight plans. Each plan is cut into sorties.
    The sorties' energy scales the next budget; if that is out of bounds, the middle of the bounds is tried.

    Parameters
    ----------
    scenario : Scenario
        The scenario; its budget is ignored.
    count : int
        Number of batteries.
    cut : callable
        Cuts a mission into sorties; returns None for a mission flown in one sortie.

    Returns
    -------
    tuple of PlanResult and SortiePlan or None
        The whole mission and its sorties, at most one per battery.

    Raises
    ------
    ScenarioError
        If the vehicle has no battery, or several vehicles fly.
    WbfMissionError
        See `plan_fleet`.
    """
    text = "1 battery" if count == 1 else f"{count} batteries"
    if len(scenario.vehicle.fleet) > 1:
        msg = f"budget {text}: for {len(scenario.vehicle.fleet)} vehicles, give metres, minutes or steps"
        raise ScenarioError(msg)

    def planned(budget: str | None) -> PlanResult:
        (one,) = plan_fleet(scenario_with(scenario, {"budget": budget}))
        return replace(one, budget_text=text)

    progress("planning", 0, _TRIES + 1)
    if scenario.mission.planner.chosen == _SURVEY:
        whole = planned(UNLIMITED)
        try:
            sorties = cut(whole) if whole.is_too_long else None
        except UncutError as error:
            raise ScenarioError(f"budget {text}: no number of batteries suffices: {error}") from error
        takes = 1 if sorties is None else len(sorties.sorties)
        if takes > count:
            raise ScenarioError(
                f"budget {text}: the survey needs {takes} batteries; give {takes}, or rows that are farther"
                " apart"
            )
        return whole, sorties
    best = planned(None)
    battery = best.vehicle.battery
    if battery is None:
        msg = f"budget {text}: vehicle {best.vehicle.name} has no battery; give metres, minutes or steps"
        raise ScenarioError(msg)
    found: tuple[PlanResult, SortiePlan | None] = best, None
    tried: list[tuple[PlanResult, SortiePlan | None]] = []
    all_wh = count * battery.capacity_wh * (1.0 - battery.reserve_fraction)
    low, high, guess = best.length_m, _FARTHEST * count * best.length_m, count * best.length_m
    for number in range(_TRIES if count > 1 else 0):
        progress("planning", number + 1, _TRIES + 1)
        whole = planned(f"{guess:.1f}m")
        # Nearly equal budgets often give the same mission, which need not be cut again.
        known = next((one for one in tried if one[0].mission == whole.mission), None)
        sorties = known[1] if known else cut_if_too_long(whole, cut)[0]
        tried.append((whole, sorties))
        # Number of batteries; None if the mission cannot be cut into sorties
        needed = None if whole.is_too_long else 1
        if sorties is not None:
            needed = len(sorties.sorties)
        takes_wh = 0.0 if sorties is None else sum(plan.prediction.most_wh for plan in sorties.plans)
        if needed is not None and needed <= count:
            found, low = (whole, sorties), guess
            if takes_wh >= _ENOUGH * all_wh:
                break
        else:
            high = guess
        if high <= _CLOSE * low:
            break
        aimed = guess * _PACKED * all_wh / takes_wh if takes_wh else 0.0
        guess = aimed if _CLOSE * low < aimed < high / _CLOSE else 0.5 * (low + high)
    progress("planning", _TRIES + 1, _TRIES + 1)
    return found


def cut_if_too_long(
    whole: PlanResult, cut: Callable[[PlanResult], SortiePlan | None]
) -> tuple[SortiePlan | None, str]:
    """Return a mission's sorties, if one battery is not enough, and the reason if it cannot be cut."""
    try:
        return (cut(whole) if whole.is_too_long else None), ""
    except UncutError as error:
        return None, str(error)
