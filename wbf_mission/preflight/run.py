"""The preflight check as the command line, an upload and a live flight ask for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

from geo import Farm
from mission.autopilots.profile import Profile
from mission.autopilots.registry import profile_for
from mission.model import Frame, Mission
from sim_vehicle.camera.component import MIN_INTERVAL_S
from wbf_mission.planning.builder import PlanResult, flown_vehicle
from wbf_mission.planning.conditions import flight_level, wind_of
from wbf_mission.preflight import flight_rules, plan_rules, vehicle_rules
from wbf_mission.preflight.finding import Concern, Finding, PreflightError, Report, Severity
from wbf_mission.preflight.flight_rules import TOO_GUSTY
from wbf_mission.preflight.plan_rules import PLACED
from wbf_mission.preflight.subject import Subject, subject_of
from wbf_mission.scenario import MissionOptions, VehicleOptions, WeatherOptions
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


def inspect(subject: Subject) -> Report:
    """Return the findings of all checks."""
    findings = [finding for check in PLAN_CHECKS for finding in check(subject)]
    if (snapshot := subject.snapshot) is not None:
        findings += [finding for check in VEHICLE_CHECKS for finding in check(subject, snapshot)]
    return Report(tuple(findings))


ShowFindings: TypeAlias = Callable[[Report, PreflightError | None, str], None]
"""Takes what is found, the error with which a plan is refused, if it is, and what each line begins with."""


def show_nobody(_report: Report, _refused: PreflightError | None, _who: str) -> None:
    """Show nobody what was found."""


@dataclass(frozen=True, slots=True)
class Circumstances:
    """Who flies a plan, where and in what air."""

    vehicle: VehicleOptions = field(default_factory=VehicleOptions)  # Of one vehicle
    weather: WeatherOptions = field(default_factory=WeatherOptions)
    farm: Farm | None = None  # Whose obstacles count
    # How far the flown path has to stay away from fence and obstacles
    margin_m: float = MissionOptions().margin_m
    image_interval_s: float = MIN_INTERVAL_S  # The camera's shortest interval
    assumed: bool = False  # Nobody said what vehicle it is
    snapshot: VehicleSnapshot | None = None  # What the vehicle told of itself


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
    given = circumstances or Circumstances()
    options = given.vehicle
    if len(options.fleet) > 1:
        msg = f"vehicle {options.name}: a plan is one vehicle's; name one"
        raise PreflightError(msg)
    if not _tells_where(mission) and given.farm is None and _stands_at(given.snapshot) is None:
        msg = "the mission has no home and no position: where does it begin? Give the plan a home"
        raise PreflightError(msg)
    level = flight_level(MissionOptions(), options)
    heights = [
        item.z
        for item in mission.items
        if item.command in PLACED and item.frame == Frame.GLOBAL_RELATIVE_ALT and item.z > 0.0
    ]
    level = replace(level, altitude_m=max(heights, default=level.altitude_m))
    subject = subject_of(
        mission,
        flown_vehicle(options),
        profile=_heard_profile(given.snapshot),
        wind=wind_of(given.weather, level),
        farm=given.farm,
        margin_m=given.margin_m,
        image_interval_s=given.image_interval_s,
        assumed=given.assumed,
        snapshot=given.snapshot,
        estimate_errors=options.estimate_errors,
    )
    return Preflight(subject, inspect(subject))


def check_plans(
    plans: Iterable[tuple[PlanResult, VehicleParts]],
    consequence: str,
    *,
    force: bool = False,
    show: ShowFindings = show_nobody,
) -> None:
    """Refuse plans in which the check finds errors; the paper's robot, which has no size, flies anything.

    Planners and policies keep away from what they know; gusts that the vehicle cannot hold are told, too. The
    PreflightError tells the first error, and as `consequence` what is not done: ``nothing was flown``. With
    `force` errors and gusts are only shown.
    """
    found = Report(
        tuple(
            finding
            for plan, one in plans
            if not plan.vehicle.is_ideal
            for finding in check_mission(plan.mission, _circumstances(plan, one))
            .report.about(Concern.PLAN)
            .findings
            if finding.severity is Severity.ERROR or finding.code == TOO_GUSTY
        )
    )
    refused = None if force else found.refusal(consequence)
    if found.findings:
        show(found, refused, "")
    if refused is not None:
        raise refused


def _circumstances(plan: PlanResult, one: VehicleParts) -> Circumstances:
    return Circumstances(one.vehicle, one.weather, plan.farm, one.mission.margin_m)


def _tells_where(mission: Mission) -> bool:
    places = (item for item in mission.items if item.has_position and (item.x, item.y) != (0.0, 0.0))
    return mission.home is not None or next(places, None) is not None


def _stands_at(snapshot: VehicleSnapshot | None) -> object:
    return None if snapshot is None else snapshot.position


def _heard_profile(snapshot: VehicleSnapshot | None) -> Profile | None:
    return None if snapshot is None else profile_for(snapshot.autopilot)
