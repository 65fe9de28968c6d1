"""Preflight check of a mission file, of a vehicle's plan, and of all plans of a run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from geo.imports import load_named
from mission.errors import LinkError
from mission.model import Mission
from wbf_mission.events import EventStream
from wbf_mission.planning.builder import PlanResult
from wbf_mission.preflight import flight_rules, path_rules, plan_rules
from wbf_mission.preflight.finding import Concern, Report, Severity
from wbf_mission.preflight.flight_rules import TOO_GUSTY
from wbf_mission.preflight.subject import Circumstances, Subject, subject_of
from wbf_mission.scenario.parts import VehicleParts

PLAN_CHECKS = (*plan_rules.CHECKS.all, *path_rules.CHECKS.all, *flight_rules.CHECKS.all)
"""Checks of a plan; each yields findings."""


def connection(name: str) -> Any:
    """Return an object that an add-on for real vehicles provides; LinkError without such an add-on.

    The name ``LiveLink`` gives the class `wbf_mission.LiveLink`, and ``fly`` a function that makes such a
    link with the operator at the terminal. ``resume`` gives a function that takes the text of
    ``plan --resume`` and a mission's `Course`, and returns the place from which the mission is resumed.
    ``checks`` gives the checks of a plan against a vehicle's answers (`check_mission`).
    """
    group = "wbf_mission.connections"
    return load_named(group, name, "connects to real vehicles with", "the connection", LinkError)


@dataclass(frozen=True, slots=True)
class Preflight:
    """A checked plan with its predicted flight and its findings."""

    subject: Subject
    report: Report


def check_mission(mission: Mission, circumstances: Circumstances | None = None) -> Preflight:
    """Check a plan before its upload.

    VehicleError if the vehicle or a parameter of its autopilot is unknown, or a value out of range;
    PreflightError if several vehicles are named, or the mission's home is unknown.

    Examples
    --------
    >>> from mission.model import GeoPoint, MissionItem
    >>> takeoff = MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0)
    >>> there = MissionItem.waypoint(28.051, -82.15, 10.0, acceptance_radius_m=2.0)
    >>> checked = check_mission(Mission((takeoff, there), GeoPoint(28.05, -82.15)))
    >>> [str(finding) for finding in checked.report.findings if finding.code == "no-landing"][0][:49]
    'mission item 2 (NAV_WAYPOINT): the mission ends i'
    """
    subject = subject_of(mission, circumstances or Circumstances())
    findings = [finding for check in PLAN_CHECKS for finding in check(subject)]
    if (snapshot := subject.given.snapshot) is not None:
        findings += [finding for check in connection("checks") for finding in check(subject, snapshot)]
    return Preflight(subject, Report(tuple(findings)))


def check_plan(plan: PlanResult, vehicle: VehicleParts, coverage: float | None = None) -> Report:
    """Check the plan of one vehicle of a run; a plan of the paper's ideal robot always passes.

    `coverage` is the joint coverage of all plans of the run; by default, the coverage of this plan.
    """
    if plan.vehicle.is_ideal:
        return Report(())
    given = replace(
        Circumstances.of(vehicle, plan.farm),
        imaging=plan.imaging,
        prediction=plan.prediction,
        predicted_coverage=plan.coverage,
        planner=plan.planner,
        coverage=coverage,
    )
    return check_mission(plan.mission, given).report.about(Concern.PLAN)


def check_plans(
    plans: Iterable[tuple[PlanResult, VehicleParts]],
    consequence: str,
    events: EventStream,
    *,
    force: bool = False,
) -> None:
    """Refuse plans in which the check finds errors (`check_plan`).

    Gusts that push a vehicle off its path are reported, too. The PreflightError names the first error and the
    `consequence`, such as ``nothing was flown``. With `force`, errors are reported but not raised.
    """
    found = [
        finding
        for plan, vehicle in plans
        for finding in check_plan(plan, vehicle).findings
        if finding.severity is Severity.ERROR or finding.code == TOO_GUSTY
    ]
    if found:
        Report(tuple(found)).require_no_errors(consequence, events, force=force)
