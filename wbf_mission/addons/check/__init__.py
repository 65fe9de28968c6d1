"""The conformance kit: does a MAVLink autopilot do what ground software expects of one."""

from wbf_mission.addons.check.registry import Check, CheckResult, Verdict
from wbf_mission.addons.check.runner import CheckReport, all_checks, check_vehicle

__all__ = ["Check", "CheckReport", "CheckResult", "Verdict", "all_checks", "check_vehicle"]
