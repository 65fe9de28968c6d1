"""The conformance kit: does a MAVLink autopilot do what ground software expects of one."""

from wbf_mission.check.catalog import all_checks
from wbf_mission.check.registry import Check, CheckResult, Verdict
from wbf_mission.check.runner import CheckReport, check_vehicle

__all__ = ["Check", "CheckReport", "CheckResult", "Verdict", "all_checks", "check_vehicle"]
