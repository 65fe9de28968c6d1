"""Conformance kit: checks that a MAVLink autopilot behaves as ground software expects."""

from typing import TYPE_CHECKING

from geo.imports import attach

if TYPE_CHECKING:
    from wbf_mission.addons.check.registry import Check as Check
    from wbf_mission.addons.check.registry import CheckResult as CheckResult
    from wbf_mission.addons.check.registry import Verdict as Verdict
    from wbf_mission.addons.check.runner import CheckReport as CheckReport
    from wbf_mission.addons.check.runner import all_checks as all_checks
    from wbf_mission.addons.check.runner import check_vehicle as check_vehicle
else:
    __getattr__, __dir__, __all__ = attach(__name__)
