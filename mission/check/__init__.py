"""The conformance kit: does a MAVLink autopilot do what ground software expects of one."""

from mission.check.catalog import all_checks
from mission.check.registry import Check, CheckResult, Verdict
from mission.check.runner import CheckReport, check_vehicle

__all__ = ["Check", "CheckReport", "CheckResult", "Verdict", "all_checks", "check_vehicle"]
