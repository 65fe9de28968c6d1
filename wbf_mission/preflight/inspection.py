"""All checks of a plan, in the order in which their findings are told."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from wbf_mission.preflight.checks import (
    assumptions,
    camera,
    energy,
    heights,
    items,
    legs,
    performance,
    standing,
    start_and_end,
    surroundings,
)
from wbf_mission.preflight.finding import Finding, Report
from wbf_mission.preflight.subject import Subject

__all__ = ["CHECKS", "inspect"]

CHECKS: tuple[Callable[[Subject], Iterable[Finding]], ...] = (
    items.check_problems,
    items.check_predicted,
    items.check_dialect,
    items.check_unknown,
    items.check_flown,
    items.check_ends,
    items.check_frames,
    start_and_end.check_takeoff,
    start_and_end.check_end,
    surroundings.check_fence,
    surroundings.check_obstacles,
    heights.check_heights,
    legs.check_start_distance,
    legs.check_lengths,
    legs.check_radii,
    performance.check_speeds,
    performance.check_short_legs,
    performance.check_turns,
    performance.check_climbs,
    performance.check_wind,
    energy.check_battery,
    camera.check_camera,
    standing.check_firmware,
    standing.check_readiness,
    standing.check_gps,
    standing.check_estimator,
    standing.check_battery_now,
    standing.check_place,
    assumptions.check_motion_settings,
    assumptions.check_landing_rules,
    assumptions.check_fence_settings,
    assumptions.check_failsafes,
    assumptions.check_calibration,
    assumptions.check_unread,
)
"""Each takes what is checked and yields what it finds; the later ones only of a vehicle that was asked."""


def inspect(subject: Subject) -> Report:
    """Return the findings of all checks."""
    return Report(tuple(finding for check in CHECKS for finding in check(subject)))
