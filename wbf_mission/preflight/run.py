"""The preflight check as the command line, an upload and a live flight ask for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mission.model import Mission
from wbf_mission.events import EventStream
from wbf_mission.planning.builder import PlanResult
from wbf_mission.preflight import flight_rules, plan_rules, vehicle_rules
from wbf_mission.preflight.finding import Concern, Finding, Report, Severity
from wbf_mission.preflight.flight_rules import TOO_GUSTY
from wbf_mission.preflight.subject import Circumstances, Subject, subject_of
from wbf_mission.scenario.parts import VehicleParts

if TYPE_CHECKING:
    from wbf_mission.preflight.inquiry import VehicleSnapshot

PLAN_CHECKS: tuple[Callable[[Subject], Iterable[Finding]], ...] = (
    plan_rules.check_problems,
    plan_rules.check_predicted,
    plan_rules.check_dialect,
    plan_rules.check_unknown,
    plan_rules.check_flown,
    plan_rules.check_ends,
    plan_rules.check_frames,
    plan_rules.check_takeoff,
    plan_rules.check_end,
    flight_rules.check_fence,
    flight_rules.check_obstacles,
    plan_rules.check_heights,
    plan_rules.check_start_distance,
    plan_rules.check_lengths,
    plan_rules.check_radii,
    flight_rules.check_speeds,
    flight_rules.check_short_legs,
    flight_rules.check_turns,
    flight_rules.check_climbs,
    flight_rules.check_wind,
    flight_rules.check_battery,
    plan_rules.check_camera,
    plan_rules.check_coverage,
)
"""Each takes a plan and yields what it finds in it, by the table of `wbf_mission.preflight.rules`."""
VEHICLE_CHECKS: tuple[Callable[[Subject, VehicleSnapshot], Iterable[Finding]], ...] = (
    vehicle_rules.check_firmware,
    vehicle_rules.check_readiness,
    vehicle_rules.check_gps,
    vehicle_rules.check_estimator,
    vehicle_rules.check_battery_now,
    vehicle_rules.check_place,
    vehicle_rules.check_motion_settings,
    vehicle_rules.check_return_height,
    vehicle_rules.check_landing_rules,
    vehicle_rules.check_fence_settings,
    vehicle_rules.check_failsafes,
    vehicle_rules.check_calibration,
    vehicle_rules.check_unread,
)
"""These also take what the vehicle answered."""


@dataclass(frozen=True, slots=True)
class Preflight:
    """A checked plan: with its predicted flight, and what was found."""

    subject: Subject
    report: Report


def check_mission(mission: Mission, circumstances: Circumstances | None = None) -> Preflight:
    """Check a plan before it goes up.

    VehicleError if the vehicle or a parameter of its autopilot is unknown, or a value out of range;
    PreflightError if several vehicles are named, or nothing tells where the mission begins.

    Examples
    --------
    >>> from mission.model import GeoPoint, MissionItem
    >>> takeoff = MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0)
    >>> there = MissionItem.waypoint(28.051, -82.15, 10.0, acceptance_radius_m=2.0)
    >>> checked = check_mission(Mission((takeoff, there), GeoPoint(28.05, -82.15)))
    >>> [str(one) for one in checked.report.findings if one.code == "no-landing"][0][:49]
    'mission item 2 (NAV_WAYPOINT): the mission ends i'
    """
    subject = subject_of(mission, circumstances or Circumstances())
    findings = [finding for check in PLAN_CHECKS for finding in check(subject)]
    if (snapshot := subject.given.snapshot) is not None:
        findings += [finding for check in VEHICLE_CHECKS for finding in check(subject, snapshot)]
    return Preflight(subject, Report(tuple(findings)))


def check_plan(plan: PlanResult, one: VehicleParts, coverage: float | None = None) -> Report:
    """Check a plan of one vehicle of a run; the paper's robot, which has no size, flies anything.

    The `coverage` is that of all plans of the run; by default it is the only one.
    """
    if plan.vehicle.is_ideal:
        return Report(())
    given = replace(
        Circumstances.of(one, plan.farm),
        imaging=plan.imaging,
        prediction=plan.prediction,
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

    Planners and policies keep away from what they know; gusts that the vehicle cannot hold are told, too. The
    PreflightError tells the first error, and as `consequence` what is not done: ``nothing was flown``. With
    `force` errors and gusts are only told.
    """
    found = [
        each
        for plan, one in plans
        for each in check_plan(plan, one).findings
        if each.severity is Severity.ERROR or each.code == TOO_GUSTY
    ]
    if found:
        Report(tuple(found)).require_no_errors(consequence, events, force=force)
